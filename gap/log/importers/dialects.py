"""Dialects: rows of YAML that claim the columns of one tool, drive or robot by their names.

Shipped ones lie in ``configs/dialect``; a file of one's own is given as ``dialect=mine.yaml``, and a package names its
file under the entry point group ``sealegs.dialects``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from ....common.documents import DocumentError, read_yaml
from ....common.errors import nearest
from ..sidecar import check_keys
from ..types import SIGNAL_UNITS, LogError
from .expression import evaluate, quoted, shows_sign, unit_of
from .names import Claim, said
from .recording import Recording

FOLDER = Path(__file__).resolve().parents[3] / "configs" / "dialect"
GROUP = "sealegs.dialects"
KEYS = ("title", "about", "kind", "needs", "rows")
ROW = ("name", "signal", "joint", "unit", "formula", "sign_bit", "aside", "ask", "not_beside")
SIGNALS = ("time", *SIGNAL_UNITS, "load")
PLACES = {"{joint}?": r"(?:(?P<joint>.+?)[._/ ])?", "{joint}": r"(?P<joint>.+?)", "{k}": r"(?:[\[_. ]?(?P<k>\d+)\]?)"}
"""What stands in names for the joint, for the joint before a sign or none, and for a number in brackets or behind a
sign."""


@dataclass(frozen=True)
class Row:
    """One row: columns of this name are claimed for a signal, or set aside.

    Attributes:
        name: regular expression of the whole name, small and capital letters alike.
        signal: of the log.
        joint: name of the joint, with ``{k}`` for the number; empty: the part of the name that stands for it.
        unit: as ``deg``; ``?`` where the tool does not say it.
        formula: of the line, with ``{}`` for the column, where a unit does not say it.
        sign_bit: bit that has the sign; the row holds where the counts show it.
        aside: why the column is none of a log.
        ask: question about it.
        not_beside: name of columns beside which the row's are set aside.
    """

    name: re.Pattern[str]
    signal: str = ""
    joint: str = ""
    unit: str = ""
    formula: str = ""
    sign_bit: int | None = None
    aside: str = ""
    ask: str = ""
    not_beside: re.Pattern[str] | None = None


@dataclass(frozen=True)
class Dialect:
    """Rows of one tool.

    Attributes:
        title: of the tool, for people.
        kind: of the files, where a format alone tells it.
        needs: names of which each must be among the columns.
        rows: the first that has a column's name claims it.
    """

    title: str
    kind: str
    needs: tuple[re.Pattern[str], ...]
    rows: tuple[Row, ...]


def dialects(own: str | Path | None = None) -> tuple[Dialect, ...]:
    """All dialects: one's own, those of installed packages, and those that are shipped.

    Raises:
        LogError: a file is none.
    """
    files = [Path(own)] if own is not None else []
    files += [Path(str(point.load())) for point in entry_points(group=GROUP)]
    return tuple(map(read_dialect, [*files, *sorted(FOLDER.glob("*.yaml"))]))


def read_dialect(path: Path) -> Dialect:
    """Read a dialect.

    Raises:
        LogError: it cannot be read, or a row of it cannot be understood.
    """
    try:
        content = read_yaml(path)
    except DocumentError as error:
        raise LogError(f"{path}: {error.problem}; correct it.") from None
    rows = content.get("rows") if isinstance(content, dict) else None
    if not isinstance(content, dict) or not isinstance(rows, list) or not rows:
        raise LogError(
            f"{path}: must be a mapping with the key rows, a list of rows that claim columns by their names."
        )
    check_keys(content, KEYS, f"{path}")
    needs = tuple(_pattern(text, f"{path}: needs") for text in content.get("needs") or [])
    title = str(content.get("title") or path.stem)
    own = tuple(_row(row, f"{path}: row {k}") for k, row in enumerate(rows, 1))
    return Dialect(title, str(content.get("kind") or ""), needs, own)


def _pattern(text: Any, where: str) -> re.Pattern[str]:
    pattern = str(text)
    for place, regex in PLACES.items():
        pattern = pattern.replace(place, regex)
    try:
        return re.compile(pattern, re.IGNORECASE)
    except re.error as error:
        raise LogError(f"{where}: {text!r} is no regular expression: {error}; correct it.") from None


def _row(content: Any, where: str) -> Row:
    if not isinstance(content, dict) or "name" not in content:
        raise LogError(f"{where} must be a mapping with the key name.")
    check_keys(content, ROW, where)
    said = {key: str(content.get(key) or "") for key in ROW}
    unit, bit, formula = said["unit"], content.get("sign_bit"), said["formula"]
    if bool(said["signal"]) == bool(said["aside"]):
        raise LogError(f"{where} needs either signal, what the column is, or aside, why it is left out.")
    if said["signal"] and said["signal"] not in SIGNALS:
        meant = nearest(said["signal"], SIGNALS)
        raise LogError(f"{where}: unknown signal '{said['signal']}'{meant}; there are {', '.join(SIGNALS)}.")
    if unit and unit != "?" and not unit_of(unit):
        raise LogError(f"{where}: the unit '{unit}' is none that is known; give a formula, such as '{{}}*0.01'.")
    if bit is not None and type(bit) is not int:
        raise LogError(f"{where}: sign_bit must be the number of a bit, counted from 0, not {bit!r}.")
    try:
        evaluate(formula.replace("{}", "x") or "x", {"x": 1.0}, where)
    except LogError:
        raise LogError(f"{where}: the formula '{formula}' is no expression of {{}}, the column; correct it.") from None
    beside = _pattern(said["not_beside"], where) if said["not_beside"] else None
    own = {key: said[key] for key in ("signal", "joint", "formula", "aside", "ask")}
    unit = unit if unit == "?" else unit_of(unit)
    return Row(_pattern(said["name"], where), unit=unit, sign_bit=bit, not_beside=beside, **own)


def claimed(recording: Recording, known: Sequence[Dialect]) -> dict[str, Claim]:
    """What dialects say of the columns of a recording; the first that claims a column has it."""
    names = list(recording.columns)
    speaking = [dialect for dialect in known if dialect.kind in ("", recording.kind)
                and all(any(one.fullmatch(name) for name in names) for one in dialect.needs)]  # fmt: skip
    out: dict[str, Claim] = {}
    for column in names:
        for dialect in speaking:
            found = next((claim for row in dialect.rows if (claim := _claim(row, column, recording, names))), None)
            if found:
                out[column] = replace(found, by=dialect.title)
                break
    return out


def _claim(row: Row, column: str, recording: Recording, names: Sequence[str]) -> Claim | None:
    match = row.name.fullmatch(column)
    if match is None:
        return None
    text = quoted(column)
    if row.sign_bit is not None:
        text = f"sign_bit({text}, {row.sign_bit})"
        if not shows_sign(recording.columns[column], row.sign_bit):
            return None
    formula = row.formula.replace("{}", text) if row.formula else ""
    place = match.groupdict()
    joint = row.joint.replace("{k}", place.get("k") or "") or re.sub(r"\W+", "_", place.get("joint") or "").strip("_")
    own = row.not_beside
    beside = own is not None and any(own.fullmatch(other) for other in names if other != column)
    aside = row.aside or (f"{row.signal.replace('_', ' ')} beside one that goes before it" if beside else "")
    return Claim(column, "" if aside else row.signal, row.unit, joint, aside, how=row.signal, formula=formula,
                 ask=row.ask, words=said(column).words, sure=bool(joint))  # fmt: skip
