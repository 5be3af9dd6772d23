"""Writes docs/dialects.md from the dialects themselves: ``python -m docs.generate.dialects``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from sealegs.common.markdown import table
from sealegs.gap.log.importers.dialects import FOLDER

PAGE = Path(__file__).resolve().parents[1] / "dialects.md"
HEAD = """# Dialects of the import

A dialect is a YAML file whose rows [claim columns](import-a-log.md) of one tool by their names. These are shipped, in
`configs/dialect`; [one of your own](import-a-log.md#a-dialect-of-your-own) comes before them. A name is a regular
expression of the whole name; `{joint}` stands for the joint's name and `{k}` for its number.

Written by `python -m docs.generate.dialects`; do not edit.
"""


def page() -> str:
    """The text of docs/dialects.md."""
    parts = [HEAD]
    for file in sorted(FOLDER.glob("*.yaml")):
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
        cells = ((f"`{row['name']}`", _signal(row), _unit(row)) for row in content["rows"])
        parts.append(f"\n## {content['title']}\n\n{content['about'][0].upper()}{content['about'][1:]}.\n")
        parts.append(f"\n{table(('name', 'column of the log', 'unit or line'), cells)}\n")
    return "".join(parts)


def _signal(row: dict[str, Any]) -> str:
    beside = "; left out beside one that goes before it" if "not_beside" in row else ""
    return f"left out: {row['aside']}" if "aside" in row else f"`{row['signal']}`{beside}"


def _unit(row: dict[str, Any]) -> str:
    sign = f"bit {row['sign_bit']} is the sign, " if "sign_bit" in row else ""
    text = f"`{row['formula']}`" if "formula" in row else row.get("unit", "")
    return sign + ("asked about" if text == "?" else text)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"Written: {PAGE}")
