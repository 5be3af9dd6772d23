"""Pages of Markdown: their tables, and what stands around them."""

from __future__ import annotations

from collections.abc import Iterable


def table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """A table of Markdown; a bar in a cell is one of its text."""
    heads = tuple(heads)
    texts = ((str(cell).replace("|", r"\|") for cell in row) for row in (heads, *rows))
    head, *lines = (f"| {' | '.join(row)} |" for row in texts)
    return "\n".join([head, "|---" * len(heads) + "|", *lines])


def page(title: str, *parts: str) -> str:
    """A page of Markdown: its title, then paragraphs, tables and lists; what is empty is left out."""
    return "\n\n".join([f"# {title}", *(part for part in parts if part)]) + "\n"
