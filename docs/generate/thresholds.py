"""Writes docs/thresholds.md from the settings themselves: ``python -m docs.generate.thresholds``."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from sealegs.common.markdown import table
from sealegs.gap.measure.confidence import Thresholds
from sealegs.gap.measure.signatures import SignatureLimits
from sealegs.gap.search.settings import COLUMNS, EFFORT, ROBOT, TOLD, SearchSettings
from sealegs.gap.search.structure import StructureLimits

PAGE = Path(__file__).resolve().parents[1] / "thresholds.md"
HEAD = """# Thresholds

All values that decide what a diagnosis names and says. [Choosing causes](choosing-causes.md) and
[The verdict](verdict.md) explain how the rules work together. [Thresholds halved and doubled](results/sensitivity.md)
shows what each value of the search does. Losses are per judged value and relative to that of the noise: a right model
has about one.

Written by `python -m docs.generate.thresholds`; do not edit.
"""
TABLES: tuple[tuple[str, type, bool], ...] = (
    ("What decides a name", SearchSettings, True),
    *((about, SearchSettings, False) for about in (EFFORT, COLUMNS, ROBOT, TOLD)),
    ("What counts as structure", StructureLimits, False),
    ("What decides a verdict", Thresholds, False),
    ("What a feature must show", SignatureLimits, False),
)
"""Heading, class of the settings, and of the search whether they decide what is named; those that do not are listed by
what they are about.
"""


def page() -> str:
    """The text of docs/thresholds.md."""
    parts = [HEAD]
    for title, settings, decides in TABLES:
        rows = [item for item in fields(settings) if item.metadata["decides"] is decides]
        if settings is SearchSettings and not decides:
            rows = [item for item in rows if item.metadata["about"] == title]
        cells = ((f"`{item.name}`", f"{item.default:g}", item.metadata["meaning"]) for item in rows)
        parts.append(f"\n## {title}\n\n`{settings.__module__}.{settings.__name__}`\n")
        parts.append(f"\n{table(('setting', 'value', 'meaning'), cells)}\n")
    return "".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"Written: {PAGE}")
