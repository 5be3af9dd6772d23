"""The testbed shares no code with what it tests: otherwise it would prove nothing."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
FILES = sorted((REPOSITORY / "testbed").glob("*.py"))


def imported(path: Path) -> set[str]:
    """Modules that a file imports, those of its own package left out."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add(node.module or "")
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_the_testbed_knows_nothing_of_sealegs_but_the_type_of_a_log(path: Path) -> None:
    known = {"sealegs.gap.log.types"} if path.name == "logs.py" else set()
    assert {name for name in imported(path) if name.split(".")[0] in ("sealegs", "tests", "benchmarks")} == known
