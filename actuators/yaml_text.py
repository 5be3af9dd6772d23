"""YAML in which nothing stands twice: YAML itself keeps the last of two equal keys and drops the other."""

from __future__ import annotations

from typing import Any

import yaml


class TwiceError(yaml.MarkedYAMLError):
    """A key stands twice in a mapping; ``problem`` says which, and where."""

    def __str__(self) -> str:
        return str(self.problem)


def load_yaml(text: str) -> Any:
    """What a YAML text holds.

    Raises:
        TwiceError: a key stands twice in a mapping.
        yaml.YAMLError: it is none.
    """
    loader = yaml.SafeLoader(text)
    try:
        node = loader.get_single_node()
        _check(node)
        return None if node is None else loader.construct_document(node)
    finally:
        loader.dispose()


def _check(node: yaml.Node | None) -> None:
    """Refuse the first key that stands twice in a mapping of the document."""
    if isinstance(node, yaml.MappingNode):
        lines: dict[str, int] = {}
        for key, value in node.value:
            line = key.start_mark.line + 1
            if isinstance(key, yaml.ScalarNode) and key.value != "<<":  # several may be merged in
                if key.value in lines:
                    where = f"in line {line}" if lines[key.value] == line else f"in lines {lines[key.value]} and {line}"
                    said = f"'{key.value}' stands twice, {where}; keep one, or give the other another name"
                    raise TwiceError(problem=said, problem_mark=key.start_mark)
                lines[key.value] = line
            _check(value)
    elif isinstance(node, yaml.SequenceNode):
        for item in node.value:
            _check(item)
