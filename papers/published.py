"""What a paper prints beside ours, row by row, with a mark that says what each row is worth as evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

from ..common.errors import SealegsError

Mark = Literal["fitted", "planted and recovered", "follows from the inputs", "predicted"]
MARKS: Mapping[Mark, str] = {
    "fitted": "an assumed number was chosen so that this comes out, or it rests on one that was",
    "planted and recovered": "the simulation was built with the printed number, and a procedure found it again",
    "follows from the inputs": "arithmetic on printed numbers: nothing could make it come out otherwise",
    "predicted": "nothing was chosen to reach it; how far it hangs on what is assumed stands below",
}
"""What a row is, and what that means."""


@dataclass(frozen=True)
class Otherwise:
    """What a row would be with another value of something assumed.

    Attributes:
        change: which number, and its other value.
        ours: the row's figure then.
    """

    change: str
    ours: float | str


@dataclass(frozen=True)
class Row:
    """One printed number or statement beside ours.

    Attributes:
        name: of the quantity.
        where: section, table or figure of the paper.
        printed: as the paper has it.
        ours: the same quantity here.
        mark: what the row is, one of :data:`MARKS`.
        unit: of both numbers.
        within: largest relative difference that counts as agreement; None: see ``agrees``.
        agrees: whether both agree, where ``within`` does not decide it; None: not judged.
        sensitivity: the figure with other assumptions.
        note: what the reader has to know about the row.
    """

    name: str
    where: str
    printed: float | str
    ours: float | str
    mark: Mark
    unit: str = ""
    within: float | None = None
    agrees: bool | None = None
    sensitivity: tuple[Otherwise, ...] = ()
    note: str = ""

    def __post_init__(self) -> None:
        if self.mark not in get_args(Mark):
            raise SealegsError(f"row '{self.name}': there is no mark '{self.mark}'; there are {', '.join(MARKS)}.")

    @property
    def off(self) -> float | None:
        """Relative difference of both numbers; None where one is a text or nothing was printed to divide by."""
        if isinstance(self.printed, str) or isinstance(self.ours, str) or self.printed == 0.0:
            return None
        return float(self.ours) / float(self.printed) - 1.0

    @property
    def holds(self) -> bool | None:
        """Whether both agree; None where that is not judged."""
        if self.within is not None and (off := self.off) is not None:
            return bool(abs(off) <= self.within)
        return None if self.agrees is None else bool(self.agrees)

    def document(self) -> dict[str, Any]:
        """The row as JSON has it."""
        return {
            "name": self.name,
            "where": self.where,
            "printed": self.printed,
            "ours": self.ours,
            "unit": self.unit,
            "off": self.off,
            "mark": self.mark,
            "holds": self.holds,
            "sensitivity": {item.change: item.ours for item in self.sensitivity},
            "note": self.note,
        }


def documents(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Rows as JSON has them."""
    return [row.document() for row in rows]


def row_lines(paper: str, rows: Sequence[Row]) -> list[str]:
    """The rows as lines of text: printed, ours, how far off, and the mark; sensitivities, notes and marks below.

    Args:
        paper: as the heading names it, such as ``paper 002``.
        rows: in the order of the paper.
    """
    label = max([len(_name(row)) for row in rows] + [len(paper)])
    place = max([len(row.where) for row in rows] + [5])
    printed = max([len(_text(row.printed)) for row in rows] + [7])
    ours = max([len(_text(row.ours)) for row in rows] + [4])
    lines = ["", f"  {paper:<{label}} {'where':<{place}} {'printed':>{printed}} {'ours':>{ours}} {'off':>8}  mark"]
    for row in rows:
        off = "" if row.off is None else f"{row.off:+8.2%}"
        missed = "!" if row.holds is False else " "
        cells = f"{_text(row.printed):>{printed}} {_text(row.ours):>{ours}} {off:>8}"
        lines.append(f"{missed} {_name(row):<{label}} {row.where:<{place}} {cells}  {row.mark}".rstrip())
    lines += _sensitivities(rows)
    if noted := [row for row in rows if row.note]:
        lines += ["", *(f"  {row.name}: {row.note}" for row in noted)]
    return [*lines, "", *_legend(rows), ""]


def _sensitivities(rows: Sequence[Row]) -> list[str]:
    lines: list[str] = []
    for row in rows:
        if row.sensitivity:
            unit = f" {row.unit}" if row.unit else ""
            lines.append(f"  {row.name}: {_text(row.ours)}{unit}, and with")
            lines += [f"    {item.change}: {_text(item.ours)}{unit}" for item in row.sensitivity]
    return ["", "How far a row hangs on what is assumed:", *lines] if lines else []


def _legend(rows: Sequence[Row]) -> list[str]:
    """What each mark means that occurs, with how many rows have it and how many of those agree."""
    lines = []
    for mark, meaning in MARKS.items():
        marked = [row for row in rows if row.mark == mark]
        if marked:
            judged = [row for row in marked if row.holds is not None]
            agree = f", {sum(bool(row.holds) for row in judged)} of {len(judged)} judged agree" if judged else ""
            lines.append(f"  {mark}: {meaning} ({len(marked)} of {len(rows)} rows{agree})")
    if any(row.holds is False for row in rows):
        lines.append("  ! missed")
    return lines


def _name(row: Row) -> str:
    return f"{row.name} [{row.unit}]" if row.unit else row.name


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.5g}"
