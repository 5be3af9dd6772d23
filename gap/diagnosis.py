"""The diagnosis of one machine, over all its joints: to look at, to save, to train on."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..common.errors import SealegsError
from .log.finding import Finding
from .log.progress import Progress
from .log.types import MeasuredSet
from .measure.named import NamedCause
from .output.document import document_of, joints_of, read_document
from .output.numbers import sureness, told_value
from .verdict.verdict import DataError, JointDiagnosis

if TYPE_CHECKING:
    from ..envs.extended import Extended


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis:
    """The diagnosis of one machine.

    Attributes:
        name: name of the data set.
        runs: names of the runs.
        joints: diagnosis of each joint, and of the ground under a leg.
        data: the measured runs; None for a diagnosis that was read from a folder.
        folder: where it was read from; None for one that was just made.
    """

    name: str
    runs: tuple[str, ...]
    joints: tuple[JointDiagnosis, ...]
    data: MeasuredSet | None = None
    folder: Path | None = None

    @property
    def verdict(self) -> str:
        """``explained``, ``partly explained``, ``nothing to explain``, ``not identifiable`` or ``unusable log``: the
        worst of the joints' verdicts.
        """
        return str(self._document["verdict"])

    @property
    def sentence(self) -> str:
        """What was found, how large it is and how sure, in one sentence."""
        return str(self._document["sentence"])

    @property
    def causes(self) -> tuple[NamedCause, ...]:
        """Named causes of all joints, the largest share first."""
        return tuple(sorted((c for joint in self.joints for c in joint.causes), key=lambda cause: -cause.share))

    @property
    def data_errors(self) -> tuple[DataError, ...]:
        """Faults of the log's columns. They are not causes, and have no share of the gap."""
        return tuple(error for joint in self.joints for error in joint.data_errors)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings of the checks of the log, those of all joints."""
        return tuple(dict.fromkeys(finding for joint in self.joints for finding in joint.findings))

    @cached_property
    def extended(self) -> Extended:
        """The extended model, for ``sealegs.make_env(..., extended=diagnosis.extended)``.

        Raises:
            SealegsError: no joint has an extended model: the log is unusable, or shows the torque alone.
        """
        from ..envs.extended import ExtensionError, no_model, read_extended

        if self.data is None:
            assert self.folder is not None
            return read_extended(self.folder)
        from .output.hand_over import hand_over

        found, _ = hand_over(self.joints, self.data)
        if found is None:  # None would be taken for the nominal machine, and train the model that was refuted
            raise ExtensionError(no_model(f"the diagnosis of {self.name}"))
        return found

    def joint(self, name: str) -> JointDiagnosis:
        """The diagnosis of one joint.

        Raises:
            SealegsError: there is no such joint.
        """
        for found in self.joints:
            if found.joint == name:
                return found
        known = ", ".join(found.joint for found in self.joints)
        raise SealegsError(f"the diagnosis has no joint '{name}'; it has {known}.")

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain data: the content of ``diagnosis.json``, without the names of the files beside it."""
        return dict(self._document)

    def save(self, folder: str | Path, progress: Progress = lambda text: None) -> dict[str, Path]:
        """Write ``diagnosis.json``, the extended model, the next experiment, pictures and ``report.html``.

        Args:
            folder: new or empty; nothing is overwritten.
            progress: called with each step as a sentence.

        Returns:
            Paths by kind of file.

        Raises:
            SealegsError: the folder has something in it, or this diagnosis was read from a folder.
        """
        from .output.files import fresh_folder, write_diagnosis
        from .output.partial import FOLDER

        if self.data is None:
            raise SealegsError(f"this diagnosis was read from {self.folder}, where everything is; copy that folder.")
        path = fresh_folder(Path(folder), besides=(FOLDER,))
        written = write_diagnosis(self.joints, self.data, path, progress)
        shutil.rmtree(path / FOLDER, ignore_errors=True)  # what was kept on the way is all in there
        return written

    @classmethod
    def load(cls, folder: str | Path) -> Diagnosis:
        """Read a diagnosis that was saved.

        Raises:
            SealegsError: there is none in the folder, or it is damaged.
        """
        path = Path(folder)
        document = read_document(path)
        found = cls(str(document["data"]), tuple(document["runs"]), joints_of(document, path), None, path)
        found.__dict__["_document"] = document
        return found

    @cached_property
    def _document(self) -> dict[str, Any]:
        return document_of(self.joints, self.name, self.runs)

    def __repr__(self) -> str:
        causes = ", ".join(cause.name for cause in self.causes) or "no cause named"
        return f"<Diagnosis of {self.name}: {self.verdict}; {causes}>"

    def _repr_html_(self) -> str:
        """Verdict, sentence and causes, for a notebook."""
        import pandas as pd

        rows = [row for cause in self.causes for row in _rows(cause)]
        table = pd.DataFrame(rows, columns=list(HEADS)).to_html(index=False) if rows else ""
        faults = "".join(f"<p>Error of the log: {escape(error.sentence)}</p>" for error in self.data_errors)
        return f"<div><p><b>{escape(self.verdict)}</b>: {escape(self.sentence)}</p>{faults}{table}</div>"


HEADS = ("cause", "joint", "confidence", "number", "value", "95 %", "model")
"""Of the table in a notebook; the last is what the model believed."""


def _rows(cause: NamedCause) -> list[tuple[str, ...]]:
    first = (cause.name, cause.joint, sureness(cause.confidence))
    told = {path: told_value(value) for path, value in cause.parameters.items()}
    numbers = [(path, t.size, t.interval, t.nominal) for path, t in told.items()] or [("", "", "", "")]
    return [(*(first if k == 0 else ("", "", "")), *number) for k, number in enumerate(numbers)]
