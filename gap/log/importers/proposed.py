"""What an import proposes: how each column is read, what is left out and why, and what is open."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..types import COMMANDS
from .mapping import Mapping, Question
from .units import Read


@dataclass
class Proposal:
    """A mapping with what is to be said of it.

    Attributes:
        columns: how each column of the log is read.
        unused: why a column of the file is left out.
        questions: that are open.
        joints: names.
        slides: joints whose position is a way.
        keep: by joint the conditions of the samples that are kept, each of them a factor of ``where``.
    """

    columns: dict[str, Read] = field(default_factory=dict)
    unused: dict[str, str] = field(default_factory=dict)
    questions: list[Question] = field(default_factory=list)
    slides: set[str] = field(default_factory=set)
    keep: dict[str, list[str]] = field(default_factory=dict)

    @property
    def joints(self) -> list[str]:
        """Joints that have a position."""
        return [name.rpartition(".")[0] for name in self.columns if name.endswith(".position")]

    @property
    def where(self) -> str | None:
        """Expression of the samples that are kept; None where all are."""
        factors = dict.fromkeys(factor for joint in self.joints for factor in self.keep.get(joint, []))
        return "*".join(factors) or None

    def mapping(self) -> Mapping:
        """The mapping without what it says of itself."""
        texts = {name: read.text for name, read in self.columns.items()}
        return Mapping(texts, questions=tuple(self.questions), where=self.where)

    def certain(self) -> Proposal:
        """Without what is in question; a joint whose position or command is goes as a whole."""
        open_ones = {name for question in self.questions for name in question.about}
        kept = {name: read for name, read in self.columns.items() if name not in open_ones}
        for joint in self.joints:
            if f"{joint}.position" not in kept or not any(f"{joint}.{signal}" in kept for signal in COMMANDS):
                kept = {name: read for name, read in kept.items() if name.rpartition(".")[0] != joint}
        return Proposal(kept, self.unused, [], self.slides, self.keep)
