"""What a comparison leaves: numbers, a page, and the table in the terminal."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..common.atomic import write_text
from .comparison import MACHINE, Comparison, table, verdict
from .page import write_page


def write_comparison(comparison: Comparison, folder: Path, say: Callable[[str], None] = print) -> dict[str, Path]:
    """Write ``comparison.json`` and ``comparison.html`` into ``folder``, and print the table.

    Raises:
        FileExistsError: they are there already.
    """
    document = {
        "policy": comparison.policy,
        "robot": comparison.robot,
        "ending": comparison.ending,
        "log": str(comparison.log),
        "figures": {name: asdict(value) for name, value in comparison.figures.items()},
    }
    paths = {"json": folder / "comparison.json", "page": folder / "comparison.html"}
    write_text(paths["json"], json.dumps(_finite(document), indent=1))
    write_page(comparison, paths["page"])
    header, rows = table(comparison)
    for line in columns([header, *rows]):
        say(f"  {line}")
    for name, figures in comparison.figures.items():
        if name != MACHINE:
            say(f"  The {name} model: {verdict(figures)}")
    if comparison.note:
        say(f"  {comparison.note}")
    if comparison.ending != "finished":
        say(f"  The machine's run ended early: {comparison.ending}")
    say(f"  Page  {paths['page']}")
    return paths


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table: the first column to the left, the others to the right, two spaces between them at least."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    widths = [max(widths[0], 40), *(max(width, 16) for width in widths[1:])]
    return [
        "  ".join(f"{cell:{'>' if k else '<'}{width}}" for k, (cell, width) in enumerate(zip(row, widths, strict=True)))
        for row in rows
    ]


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value
