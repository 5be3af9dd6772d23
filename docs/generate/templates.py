"""Pages whose text is written by hand and whose figures are not: templates, and the results that fill them.

A figure stands in the text as a field, ``{control_loop[overruns][measured]}``: a page of ``benchmarks/results``, the
first cell of a row of one of its tables, and the column's head without its unit. ``*`` for the row means all rows of
the table: their least and largest; ``min``, ``max`` and ``sum`` are one figure of them. A line of a list,
``- what: figure``, is ``{hidden_arm[what]}``. What a page works out itself comes before.
"""

from __future__ import annotations

import re
from collections import ChainMap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from benchmarks.kept import CHECKOUT, RESULTS

PAGES = CHECKOUT / "docs" / "results"
NUMBER = re.compile(r"-?\d[\d,]*(?:\.\d+)?")
UNIT = re.compile(r" \[[^\]]*\]$")
SPAN, LEAST, LARGEST, SUM = "*", "min", "max", "sum"


class FigureError(LookupError):
    """A field of a template for which the results have no figure."""


@dataclass(frozen=True)
class Table:
    """A table of Markdown: heads without units, and rows of cells."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def column(self, head: str) -> list[str]:
        """The cells of a column that have any text."""
        place = self.heads.index(head)
        return [row[place] for row in self.rows if row[place]]

    def cell(self, row: str, head: str) -> str | None:
        """A cell, or what all cells of a column come to; None: there is none."""
        if head not in self.heads:
            return None
        found = next((cells for cells in self.rows if cells[0] == row), None)
        if found is not None:
            return found[self.heads.index(head)]
        return summarised(self.column(head), row)

    def where(self, head: str, values: Sequence[str]) -> list[dict[str, str]]:
        """The rows that have one of the values in a column, by heads."""
        place = self.heads.index(head)
        return [dict(zip(self.heads, row, strict=True)) for row in self.rows if row[place] in values]


def summarised(cells: Sequence[str], how: str) -> str | None:
    """What the first numbers of cells come to: their least and largest, or one of them; None: there is no such way.

    A sum is of all numbers of a cell, ``49 of 50`` and ``50 of 50`` being ``99 of 100``.
    """
    if how == SUM:
        numbers = [[int(text.replace(",", "")) for text in NUMBER.findall(cell)] for cell in cells]
        return " of ".join(str(sum(column)) for column in zip(*numbers, strict=True))
    if how not in (SPAN, LEAST, LARGEST):
        return None
    texts = sorted((match.group() for cell in cells if (match := NUMBER.search(cell))), key=as_number)
    return {SPAN: f"{texts[0]} to {texts[-1]}", LEAST: texts[0], LARGEST: texts[-1]}[how]


def as_number(text: str) -> float:
    """The first number of a text."""
    found = NUMBER.search(text)
    if found is None:
        raise FigureError(f"'{text}' has no number")
    return float(found.group().replace(",", ""))


@dataclass(frozen=True)
class Page:
    """A page of ``benchmarks/results``: its tables and its lists."""

    path: Path

    @cached_property
    def lines(self) -> list[str]:
        """Of the page."""
        return self.path.read_text(encoding="utf-8").splitlines()

    @cached_property
    def tables(self) -> list[Table]:
        """All of them, in order."""
        found, block = [], []
        for line in [*self.lines, ""]:
            if line.startswith("|"):
                block.append(tuple(cell.strip() for cell in line.strip().strip("|").split("|")))
            elif block:
                found.append(Table(tuple(UNIT.sub("", head) for head in block[0]), tuple(block[2:])))
                block = []
        return found

    @cached_property
    def items(self) -> dict[str, str]:
        """Lines of lists, by what stands before the colon."""
        parts = (line.removeprefix("- ").partition(": ") for line in self.lines if line.startswith("- "))
        return {name: text for name, colon, text in parts if colon}

    def __getitem__(self, row: str | int) -> Any:
        if str(row) in self.items:
            return self.items[str(row)]
        return Row(self, str(row))


@dataclass(frozen=True)
class Row:
    """A row of whichever table of a page has it and the column that is asked for."""

    page: Page
    row: str

    def __getitem__(self, head: str | int) -> str:
        for table in self.page.tables:
            if (cell := table.cell(self.row, str(head))) is not None:
                return cell
        raise FigureError(f"{self.page.path.name} has no '{self.row}' with '{head}'")


class Measured(Mapping[str, Page]):
    """All pages of ``benchmarks/results`` by their names."""

    def __getitem__(self, name: str) -> Page:
        path = RESULTS / f"{name}.md"
        if not path.is_file():
            raise FigureError(f"there is no benchmarks/results/{name}.md")
        return Page(path)

    def __iter__(self) -> Iterator[str]:
        return (path.stem for path in sorted(RESULTS.glob("*.md")))

    def __len__(self) -> int:
        return len(list(RESULTS.glob("*.md")))


def fill(template: Path, own: Mapping[str, Any]) -> str:
    """The text of a page: its template, filled with its own figures and those of the pages of results.

    Raises:
        FigureError: there is no such figure; the sentence names it.
    """
    return template.read_text(encoding="utf-8").format_map(ChainMap(dict(own), Measured()))  # type: ignore[arg-type]


def write(name: str, text: str) -> None:
    """Write docs/results/<name>.md."""
    path = PAGES / f"{name}.md"
    path.write_text(text, encoding="utf-8")
    print(f"Written: {path}")
