"""Pages of Markdown: their tables, and what stands around them."""

from __future__ import annotations

from collections.abc import Iterable


def table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """A table of Markdown."""
    heads = tuple(heads)
    head, *cells = (f"| {' | '.join(map(str, row))} |" for row in (heads, *rows))
    return "\n".join([head, "|---" * len(heads) + "|", *cells])


def page(title: str, *parts: str) -> str:
    """A page of Markdown: its title, then paragraphs, tables and lists; what is empty is left out."""
    return "\n\n".join([f"# {title}", *(part for part in parts if part)]) + "\n"
