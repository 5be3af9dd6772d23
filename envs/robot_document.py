"""The YAML of a robot as a document, in which nothing stands twice: YAML itself keeps the last and drops the others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from .robot import RobotError


def read_document(path: Path) -> Any:
    """What stands in the YAML of a robot.

    Raises:
        RobotError: it is missing, cannot be read, or has a key twice.
    """
    try:
        node = yaml.compose(text := path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader)
        if (said := _twice(node)) is not None:
            raise RobotError(f"{path}: {said}")
        return yaml.safe_load(text)
    except FileNotFoundError:
        raise RobotError(f"there is no robot file {path}; sealegs new-robot <model> writes one.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise RobotError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}.") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark else ""
        raise RobotError(f"{path} is not valid YAML{where}: {getattr(error, 'problem', error)}.") from None


def _twice(node: yaml.Node | None) -> str | None:
    """The first key that stands twice in a mapping of the document, as a sentence."""
    if isinstance(node, yaml.MappingNode):
        lines: dict[str, int] = {}
        for key, value in node.value:
            line = key.start_mark.line + 1
            if isinstance(key, yaml.ScalarNode) and key.value != "<<":  # several may be merged in
                if key.value in lines:
                    where = f"in line {line}" if lines[key.value] == line else f"in lines {lines[key.value]} and {line}"
                    return f"'{key.value}' stands twice, {where}; keep one, or give the other another name."
                lines[key.value] = line
            if (said := _twice(value)) is not None:
                return said
    elif isinstance(node, yaml.SequenceNode):
        return next(filter(None, map(_twice, node.value)), None)
    return None
