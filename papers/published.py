"""What a paper prints beside ours, row by row, with a mark that says what each row is worth as evidence.

A mark is no opinion: :meth:`Paper.check` holds it against the paper's one list of chosen numbers, and
:meth:`Paper.check_rests` what a row says that it rests on against the rows that move with each of these numbers.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

from ..common.errors import SealegsError
from ..envs.engine.numbers import Number

Mark = Literal["fitted", "planted and recovered", "follows from the inputs", "predicted"]
MARKS: Mapping[Mark, str] = {
    "fitted": "a number was chosen so that this comes out",
    "planted and recovered": "the simulation was built with the printed number, and a procedure found it again",
    "follows from the inputs": "arithmetic on printed numbers: nothing could make it come out otherwise",
    "predicted": "nothing that it rests on was chosen to reach it; how far it hangs on what is assumed stands below "
    "for some",
}
"""What a row is, and what that means."""

LARGEST = 0.1
"""Relative difference above which a row agrees only if it is fitted or says that its tolerance is assumed."""

MOVES = 1e-3
"""Relative change of a row's figure that counts where a chosen number is changed; less is the noise of encoders."""


@dataclass(frozen=True)
class Choice:
    """A number that the paper does not print.

    Attributes:
        value: with its unit.
        why: how it was chosen.
        reach: names of the rows that it was chosen to reach; none: it is only plausible.
    """

    value: str
    why: str
    reach: tuple[str, ...] = ()


def choice_of(number: Number, reach: tuple[str, ...] = ()) -> Choice:
    """An assumed number of a robot as a choice."""
    why = number.source.removeprefix("assumed").removeprefix(":").strip()
    return Choice(f"{number.value:g} {number.unit}".removesuffix(" -"), why or "plausible", reach)


def assumed(numbers: Mapping[str, Number], **reach: tuple[str, ...]) -> dict[str, Choice]:
    """All assumed numbers of a robot as choices, by their names; ``reach`` says what some were chosen for."""
    found = {name: choice_of(number, reach.pop(name, ())) for name, number in numbers.items() if number.assumed}
    if reach:
        raise SealegsError(f"no assumed number is called {', '.join(reach)}.")
    return found


@dataclass(frozen=True)
class NotBuilt:
    """A statement of the paper that simulation could check, and that is no row.

    Attributes:
        where: section, table or figure.
        statement: what the paper says.
        why: it is not checked.
    """

    where: str
    statement: str
    why: str


@dataclass(frozen=True)
class Otherwise:
    """What a row would be otherwise: with another value of something assumed, or in another model.

    Attributes:
        change: which number, and its other value; or which model.
        ours: the row's figure then.
        holds: whether that agrees with the paper; None: as ``within`` says, or not judged.
    """

    change: str
    ours: float | str
    holds: bool | None = None


def half_digit(printed: float, digits: int) -> float:
    """Half a unit of the last printed digit, relative to the number: what a printed number leaves open.

    Args:
        printed: the number.
        digits: printed behind the point.
    """
    return 0.5 * 10.0**-digits / abs(printed)


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
        judged: where the tolerance or the limit comes from: the paper's digits, its scatter, or ``assumed``.
        rests: names of the chosen numbers that it rests on; None: not said.
        rival: the figure in another model, which the paper's would show to be wrong.
        timed: whether the figure measures this computer, so that another run gives another one.
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
    judged: str = ""
    rests: tuple[str, ...] | None = None
    rival: Otherwise | None = None
    timed: bool = False

    def __post_init__(self) -> None:
        if self.mark not in get_args(Mark):
            raise SealegsError(f"row '{self.name}': there is no mark '{self.mark}'; there are {', '.join(MARKS)}.")

    @property
    def off(self) -> float | None:
        """Relative difference of both numbers; None where one is a text or nothing was printed to divide by."""
        return self._off(self.ours)

    def _off(self, ours: float | str) -> float | None:
        if isinstance(self.printed, str) or isinstance(ours, str) or self.printed == 0.0:
            return None
        return float(ours) / float(self.printed) - 1.0

    @property
    def holds(self) -> bool | None:
        """Whether both agree; None where that is not judged."""
        return self._holds(self.ours, self.agrees)

    def _holds(self, ours: float | str, agrees: bool | None) -> bool | None:
        if self.within is not None and (off := self._off(ours)) is not None:
            return bool(abs(off) <= self.within)
        return None if agrees is None else bool(agrees)

    @property
    def decides(self) -> bool:
        """Whether the row is a prediction that agrees with the paper, and would not in the other model."""
        if self.rival is None or self.mark != "predicted" or not self.holds:
            return False
        return self._holds(self.rival.ours, self.rival.holds) is False

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
            "within": self.within,
            "judged": self.judged,
            "holds": self.holds,
            "rests": None if self.rests is None else list(self.rests),
            "sensitivity": {item.change: item.ours for item in self.sensitivity},
            "rival": None if self.rival is None else {self.rival.change: self.rival.ours},
            "decides": self.decides,
            "timed": self.timed,
            "note": self.note,
        }


@dataclass(frozen=True)
class Paper:
    """A paper with all that was chosen to repeat it, and what was not repeated.

    Attributes:
        name: as headings have it, such as ``paper 002``.
        choices: the one list of chosen numbers, by name.
        not_built: statements that are no row.
    """

    name: str
    choices: Mapping[str, Choice]
    not_built: tuple[NotBuilt, ...]

    def check(self, rows: Sequence[Row]) -> None:
        """Hold the marks of the rows against the list of chosen numbers.

        Raises:
            SealegsError: a mark that the list contradicts, or a row that does not say what it rests on or how it is
                judged; the sentence names all of them.
        """
        names = {row.name for row in rows}
        wrong = [
            f"'{key}' is chosen to reach '{name}', which is no row"
            for key, choice in self.choices.items()
            for name in choice.reach
            if name not in names
        ]
        wrong += [f"'{name}' is the name of {count} rows" for name, count in Counter(row.name for row in rows).items()
                  if count > 1]  # fmt: skip
        for row in rows:
            wrong += [f"row '{row.name}' {reason}" for reason in self._contradictions(row)]
        if wrong:
            raise SealegsError(f"{self.name}: {'; '.join(wrong)}.")

    def check_rests(self, rows: Sequence[Row], otherwise: Iterable[tuple[str, Sequence[Row]]]) -> None:
        """Hold what rows say that they rest on against what moves them.

        A row may name more than moves it: its figure may be a text, or rounded. It must not name less.

        Args:
            rows: of the paper, computed with the chosen numbers.
            otherwise: name of a chosen number, and the rows computed with another value of it alone.

        Raises:
            SealegsError: a row moves with a number that it does not name, or none moves of those that name it.
        """
        wrong = []
        for key, changed in otherwise:
            figures = {row.name: row for row in changed}
            still = [row for row in rows if not row.timed]
            moved = [row for row in still if row.name not in figures or _moved(row, figures[row.name])]
            naming = [row for row in still if key in (row.rests or ())]
            wrong += [f"row '{row.name}' moves with '{key}', which it does not name" for row in moved
                      if row not in naming]  # fmt: skip
            if naming and not moved:
                wrong.append(f"'{key}' moves none of the {len(naming)} rows that name it")
        if wrong:
            raise SealegsError(f"{self.name}: {'; '.join(wrong)}.")

    def _contradictions(self, row: Row) -> list[str]:
        if row.rests is None:
            return ["does not say which chosen numbers it rests on"]
        wrong = [f"rests on '{key}', which is not in the list of chosen numbers" for key in row.rests
                 if key not in self.choices]  # fmt: skip
        chosen_for = [key for key, choice in self.choices.items() if row.name in choice.reach]
        wrong += [f"does not name '{key}', which was chosen to reach it" for key in chosen_for if key not in row.rests]
        if chosen_for and row.mark != "fitted":
            wrong.append(f"is {row.mark}, though '{chosen_for[0]}' was chosen to reach it")
        if row.mark == "fitted" and not chosen_for:
            wrong.append("is fitted, though nothing was chosen to reach it")
        if row.mark == "fitted" and row.holds is None:
            wrong.append("is fitted, and does not say whether it fits")
        if row.mark == "follows from the inputs" and row.rests:
            wrong.append(f"follows from the inputs, though it rests on '{row.rests[0]}'")
        if row.holds is not None and not row.judged:
            wrong.append("does not say where its tolerance comes from")
        if (row.within or 0.0) > LARGEST and row.mark != "fitted" and "assumed" not in row.judged:
            wrong.append(f"may be off by {row.within:.0%}, which is neither fitted nor assumed")
        return wrong

    def document(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Rows, chosen numbers and what is not built, as JSON has them; checked before."""
        self.check(rows)
        return {
            "paper": self.name,
            "rows": documents(rows),
            "chosen": {key: asdict(choice) for key, choice in self.choices.items()},
            "not_built": [asdict(item) for item in self.not_built],
        }

    def lines(self, rows: Sequence[Row]) -> list[str]:
        """The rows as text, predictions that another model misses, the chosen numbers, and what is not built."""
        lines = row_lines(self.name, rows)
        lines += ["Predictions that another model of this project would have missed:"]
        for row in rows:
            if row.decides and row.rival is not None:
                lines.append(f"  {_name(row)}: printed {_text(row.printed)}, ours {_text(row.ours)}")
                lines.append(f"    {row.rival.change}: {_text(row.rival.ours)}")
        if not any(row.decides for row in rows):
            lines.append("  none")
        lines += ["", "Chosen numbers, what they were chosen to reach, and how many rows rest on them:"]
        for key, choice in self.choices.items():
            used = sum(key in (row.rests or ()) for row in rows)
            reached = "; ".join(choice.reach) or "no row"
            lines.append(f"  {key} = {choice.value}: {reached} ({used} rows)")
        lines += ["", "Not built:"]
        lines += [f"  {item.where}, {item.statement}: {item.why}" for item in self.not_built]
        return [*lines, ""]


def _moved(row: Row, other: Row) -> bool:
    if row.holds != other.holds or isinstance(row.ours, str) or isinstance(other.ours, str):
        return (row.holds, row.ours) != (other.holds, other.ours)
    return abs(other.ours - row.ours) > MOVES * abs(row.ours)


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
