"""How the package is built: no circles among its modules, and calls whose arguments a reader can tell apart."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
import sealegs

ROOT = Path(sealegs.__file__).parent
PARTS = (
    "actuators", "agents", "commands", "common", "configs", "envs", "evaluation", "gap", "hw", "papers",
)  # fmt: skip
MOST_POSITIONAL = 7


@cache
def sources() -> dict[str, tuple[Path, ast.Module]]:
    """File and tree of each module of the package, by its name."""
    found = {}
    for path in sorted(path for part in PARTS for path in (ROOT / part).rglob("*.py")):
        name = ".".join(("sealegs", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__")
        found[name] = (path, ast.parse(path.read_text()))
    return found


def imported(name: str) -> Iterator[str]:
    """Modules that a module names in an import, wherever in it and for whatever, types alone included."""
    path, tree = sources()[name]
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            start = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join((*start, *([node.module] if node.module else [])))
            for item in node.names:
                inside = f"{module}.{item.name}"
                yield inside if inside in sources() else module


def test_no_module_imports_itself_over_others_for_types_neither() -> None:
    graph = {name: [other for other in imported(name) if other in sources() and other != name] for name in sources()}
    assert sum(map(len, graph.values())) > 2000
    TopologicalSorter(graph).prepare()  # a circle raises CycleError, which names it


@pytest.mark.parametrize("part", PARTS)
def test_no_call_tells_more_than_seven_arguments_apart_by_their_order(part: str) -> None:
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno} {ast.unparse(node.func)}"
        for path, tree in sources().values()
        if path.is_relative_to(ROOT / part)
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and len(node.args) > MOST_POSITIONAL
    ]
    assert not found
