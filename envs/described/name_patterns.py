"""Names of joints by pattern, as the files of robots give limits and gears."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable


def fits(name: str, pattern: str) -> bool:
    """Whether a pattern means a name; a name means itself, even where it has signs of patterns, such as ``j[0]``."""
    return name == pattern or fnmatch.fnmatchcase(name, pattern)


def fitting(names: Iterable[str], pattern: str) -> list[bool]:
    """Whether a pattern means each of the names."""
    return [fits(name, pattern) for name in names]
