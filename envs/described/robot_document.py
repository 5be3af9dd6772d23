"""The YAML of a robot as a document, in which nothing stands twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...common.documents import DocumentError, read_yaml
from ..engine.numbers import RobotError


def read_document(path: Path) -> Any:
    """What stands in the YAML of a robot.

    Raises:
        RobotError: it is missing, cannot be read, or has a key twice.
    """
    try:
        return read_yaml(path)
    except DocumentError as error:
        if error.missing:
            raise RobotError(f"there is no robot file {path}; sealegs new-robot <model> writes one.") from None
        raise RobotError(f"{error}.") from None
