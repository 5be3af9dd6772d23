"""Writes the pages of the papers from what their command found: ``python -m docs.generate.papers [folder ...]``.

    sealegs evaluate paper=hopper out=runs/hopper
    python -m docs.generate.papers runs/hopper

The ``<robot>.json`` of each folder is kept as ``benchmarks/results/paper_<robot>.json``. Then every page whose text
lies in ``papers/<robot>/page.md`` is written from those results. A figure of the run stands there as a field, such as
``{hopping[period]:.3f}``, and a table as ``{rows}``; a paper's own tables are in its results under ``page_tables``.
Fields of other results are as :mod:`docs.generate.templates` has them.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from sealegs.common.markdown import table
from sealegs.papers.published import MARKS

from benchmarks.kept import CHECKOUT, RESULTS, read

from .templates import fill, write

TEXTS = CHECKOUT / "papers"
WRITTEN = """
*Written by `python -m docs.generate.papers` from the results of `sealegs evaluate paper={robot}`; do not edit.*
"""


def robots() -> list[str]:
    """Robots whose page is written here."""
    return sorted(path.parent.name for path in TEXTS.glob("*/page.md"))


def page(robot: str) -> str:
    """The text of docs/results/<robot>.md."""
    result = read(f"paper_{robot}")
    own = {name: table(found["head"], found["rows"]) for name, found in result.get("page_tables", {}).items()}
    figures = {**result, **tables(result), **own}
    return fill(TEXTS / robot / "page.md", figures) + WRITTEN.format(robot=robot)


def tables(result: Mapping[str, Any]) -> dict[str, str]:
    """What every page has: its rows, notes, sensitivities, decided predictions, choices, and what is not built."""
    rows = result["rows"]
    with_rival = [row for row in rows if row["decides"]]
    return {
        "rows": table(
            ("paper", "where", "printed", "here", "off", "judged by", "mark", "agrees"),
            (
                (
                    _name(row),
                    row["where"],
                    _text(row["printed"]),
                    _text(row["ours"]),
                    "" if row["off"] is None else f"{row['off']:+.1%}",
                    _judged(row),
                    row["mark"],
                    {None: "not judged", True: "yes", False: "**no**"}[row["holds"]],
                )
                for row in rows
            ),
        ),
        "marks": table(
            ("mark", "what it means", "rows", "judged", "of them agree"),
            (
                (mark, meaning, *map(str, (len(of), len(judged), sum(judged))))
                for mark, meaning in MARKS.items()
                for of in [[row for row in rows if row["mark"] == mark]]
                for judged in [[row["holds"] for row in of if row["holds"] is not None]]
            ),
        ),
        "notes": "\n".join(f"- {row['name']}: {row['note']}." for row in rows if row["note"]),
        "sensitivity": table(
            ("row", "as chosen", "otherwise", "then"),
            (
                (_name(row), _text(row["ours"]), change, _text(ours))
                for row in rows
                for change, ours in row["sensitivity"].items()
            ),
        ),
        "decided": table(
            ("prediction", "printed", "here", "other model", "its figure"),
            (
                (_name(row), _text(row["printed"]), _text(row["ours"]), model, _text(ours))
                for row in with_rival
                for model, ours in row["rival"].items()
            ),
        )
        if with_rival
        else "None.",
        "chosen_numbers": table(
            ("number", "value", "chosen by", "to reach", "rows that rest on it"),
            (
                (
                    f"`{key}`",
                    item["value"],
                    item["why"],
                    "; ".join(item["reach"]) or "no row",
                    str(sum(key in (row["rests"] or ()) for row in rows)),
                )
                for key, item in result["chosen"].items()
            ),
        ),
        "number_table": table(
            ("number", "value", "source"),
            (
                (f"`{name}`", f"{item['value']:g} {item['unit']}".removesuffix(" -"), item["source"])
                for name, item in result.get("numbers", {}).items()
            ),
        ),
        "left_out": table(
            ("where", "the paper", "why it is not built"),
            ((item["where"], item["statement"], item["why"]) for item in result["not_built"]),
        ),
    }


def _name(row: Mapping[str, Any]) -> str:
    return f"{row['name']} [{row['unit']}]" if row["unit"] else row["name"]


def _judged(row: Mapping[str, Any]) -> str:
    bound = "" if row["within"] is None else f"{100.0 * row['within']:.2g} %: "
    return bound + row["judged"]


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.5g}"


def main(folders: Iterable[str]) -> None:
    """Keep the results that lie in the folders, and write all pages."""
    for folder in map(Path, folders):
        found = [path for path in sorted(folder.glob("*.json")) if path.stem in robots()]
        if not found:
            raise SystemExit(f"{folder} holds no results of a paper; run sealegs evaluate paper=<robot> out={folder}.")
        for path in found:
            shutil.copyfile(path, RESULTS / f"paper_{path.name}")
    for robot in robots():
        write(robot, page(robot))


if __name__ == "__main__":
    main(sys.argv[1:])
