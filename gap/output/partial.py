"""What a diagnosis that was stopped leaves: its fits, and what was found so far for people to read.

<out>/partial/partial.json    data, settings, what was said and when, joints that are done
<out>/partial/fits.jsonl      every fit (:mod:`sealegs.gap.search.journal`), by which the same command goes on
<out>/partial/.lock           while a process writes there: a second one on the same folder is refused
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ... import actuators, envs
from ...common.atomic import locked, write_text
from ...common.documents import DocumentError, read_json
from ...common.errors import SealegsError
from ..log.progress import Milestone, Progress
from ..log.reader import files_named_by
from ..log.sidecar import FOLDER_DEFAULTS, Sidecar, files_named
from ..log.types import LogError, MeasuredSet
from ..search.journal import keeping
from ..verdict.verdict import JointDiagnosis
from .document import plain

FOLDER, TOLD, FITS, LOCK = "partial", "partial.json", "fits.jsonl", ".lock"


class Partial:
    """The folder of a diagnosis that is under way.

    Attributes:
        folder: ``<out>/partial``.
        reused: fits of an earlier session that were at hand when this one began.
    """

    def __init__(self, out: Path, source: Mapping[str, Any]) -> None:
        """Begin, or go on with what an earlier session left in ``out``.

        Raises:
            LogError: what is there is of other data or other settings.
        """
        self.folder, self._begun = out / FOLDER, time.monotonic()
        code = code_digest()
        self._document: dict[str, Any] = {
            "source": plain(dict(source)), "code": code, "seconds": 0.0, "said": [], "joints": {}
        }  # fmt: skip
        if (before := _read(self.folder)) is not None:
            if before.get("code") != code:
                raise LogError(
                    f"{out} holds an unfinished diagnosis that another version of sealegs began, which this one does "
                    "not go on with and does not overwrite; give another out=<folder>."
                )
            if before["source"] != self._document["source"]:
                raise LogError(
                    f"{out} holds an unfinished diagnosis of other logs or settings, or of another robot, which is not "
                    "overwritten; give another out=<folder>."
                )
            self._document["earlier"] = before.get("said", [])
        self.folder.mkdir(parents=True, exist_ok=True)
        self.fits = self.folder / FITS
        journals = [self.fits, *self.folder.glob(f"{self.fits.stem}-*{self.fits.suffix}")]  # one more for each joint
        self.reused = sum(path.read_bytes().count(b"\n") for path in journals if path.exists())
        self._write()

    def say(self, text: str) -> None:
        """Keep what goes on."""
        self._document["said"].append({"after": round(time.monotonic() - self._begun, 1), "text": text})
        self._write()

    def done(self, joint: JointDiagnosis) -> None:
        """Keep what was found about a joint."""
        self._document["joints"][joint.joint] = {
            "verdict": joint.verdict,
            "sentence": joint.sentence,
            "causes": [
                {"name": c.name, "values": {path: value.value for path, value in c.parameters.items()}}
                for c in joint.causes
            ],
        }
        self._write()

    def remove(self) -> None:
        """Remove the folder: the diagnosis is written."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _write(self) -> None:
        self._document["seconds"] = round(time.monotonic() - self._begun, 1)
        write_text(self.folder / TOLD, json.dumps(plain(self._document), indent=1) + "\n", replace=True)


@contextmanager
def alone(out: Path, inner: str = FOLDER) -> Iterator[None]:
    """Keep other processes from diagnosing into ``out`` while the block runs; folders that stay empty are removed.

    Args:
        out: a folder, which need not be there; what is no folder is left to who writes there.
        inner: name of the folder in it that holds the lock file; empty: ``out`` itself does.

    Raises:
        LogError: another process does so.
    """
    made = [path for path in (out / inner, out) if not path.exists()]
    if out.exists() and not out.is_dir():
        yield
        return
    (out / inner).mkdir(parents=True, exist_ok=True)
    try:
        with contextlib.ExitStack() as stack:
            try:
                stack.enter_context(locked(out / inner / LOCK))
            except BlockingIOError:
                raise LogError(
                    f"Another process is diagnosing into {out}: wait until it is done, or give another out=<folder>."
                ) from None
            yield
    finally:
        for path in made:
            with contextlib.suppress(OSError):  # not empty, or gone
                path.rmdir()


@contextmanager
def going_on(
    out: Path | None, source: Callable[[], Mapping[str, Any]], progress: Progress
) -> Iterator[tuple[Progress, Callable[[JointDiagnosis], None]]]:
    """Keep what is found under ``out``, and go on with what is there; None: keep nothing.

    Yields:
        What to call with words about what goes on, and with each joint that is done.
    """
    if out is None:
        yield progress, lambda joint: None
        return
    with alone(out):
        partial = Partial(out, source())
        if partial.reused:
            progress(Milestone(f"going on with {partial.reused} fits of the session before"))

        def say(text: str) -> None:
            partial.say(text)
            progress(text)

        try:
            with keeping(partial.fits):
                yield say, partial.done
        except SealegsError:  # what is refused leaves nothing behind, so that the mended log finds its folder free
            if not partial.reused:
                partial.remove()
            raise


def source_of(log: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """What the diagnosis of a log on disk depends on, as plain data: settings, checksums of log and robot."""
    if log.is_dir():
        files = [path for path in log.iterdir() if path.is_file()]
    else:
        beside = [log.with_suffix(".yaml"), log.with_suffix(".yml"), log.parent / FOLDER_DEFAULTS]
        files = [path for path in (log, *beside) if path.is_file()]
    sums = {path.name: _checksum(path) for path in sorted(files)}
    return _source(settings, sums, files_named_by(log))


def source_in_memory(data: MeasuredSet, settings: Mapping[str, Any]) -> dict[str, Any]:
    """The same of runs in memory."""
    sums = {}
    for run in data.runs:
        digest = hashlib.sha256(repr((run.robot, dict(run.robot_params), dict(run.actuators), run.meta)).encode())
        for name, values in run.columns().items():
            digest.update(name.encode() + values.tobytes())
        sums[run.name] = digest.hexdigest()
    machines = (Sidecar(run.robot, {}, dict(run.actuators)) for run in data.runs)
    return _source(settings, sums, [path for machine in machines for path in files_named(machine)])


def _source(settings: Mapping[str, Any], sums: Mapping[str, str], named: Iterable[Path]) -> dict[str, Any]:
    source = {"settings": json.loads(json.dumps(dict(settings))), "files": dict(sums)}
    if machine := sorted(f"{path.name} {_checksum(path)}" for path in set(named)):  # wherever they lie
        source["machine"] = hashlib.sha256("\n".join(machine).encode()).hexdigest()
    return source


@functools.cache
def code_digest() -> str:
    """A digest of the modules that a fit depends on: fits of other code are not gone on with."""
    digest, top = hashlib.sha256(), Path(__file__).resolve().parents[1]
    for package in (top, Path(actuators.__file__).resolve().parent, Path(envs.__file__).resolve().parent):
        for path in sorted(package.rglob("*.py")):
            digest.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def unfinished(folders: Iterator[Path], source: Mapping[str, Any]) -> Path | None:
    """The newest of some output folders that holds an unfinished diagnosis of the same data, settings and code."""
    for out in sorted(folders, reverse=True):
        before = _read(out / FOLDER)
        if before is not None and (before["source"], before.get("code")) == (plain(dict(source)), code_digest()):
            return out
    return None


def _read(folder: Path) -> dict[str, Any] | None:
    """What an earlier session said; None where there was none, or it died before it said anything."""
    try:
        document = read_json(folder / TOLD)
    except DocumentError:
        return None
    return document if isinstance(document, dict) and "source" in document else None


def _checksum(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
