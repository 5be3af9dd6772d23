"""Writes docs/thresholds.md from the settings of the search: ``python -m docs.generate.thresholds``."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from sealegs.gap.search.settings import SearchSettings

PAGE = Path(__file__).resolve().parents[1] / "thresholds.md"
HEAD = """# Thresholds

Written by `python -m docs.generate.thresholds` from `sealegs.gap.search.settings.SearchSettings`; do not edit. Losses
are per judged value, in parts of that of the noise: a right model has about one. How the rules work together:
[Choosing causes](choosing-causes.md). What happens when one is halved or doubled: `python -m benchmarks.sensitivity`.
"""


def page() -> str:
    """The text of docs/thresholds.md."""
    parts = [HEAD]
    for title, decides in (("What decides a name", True), ("What bounds the effort", False)):
        parts.append(f"\n## {title}\n\n| setting | value | meaning |\n|---|---|---|\n")
        parts += [
            f"| `{item.name}` | {item.default:g} | {item.metadata['meaning']} |\n"
            for item in fields(SearchSettings)
            if item.metadata["decides"] is decides
        ]
    return "".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"Written: {PAGE}")
