"""The YAML of a robot as a document, in which nothing stands twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from ..actuators.yaml_text import TwiceError, load_yaml
from .robot import RobotError


def read_document(path: Path) -> Any:
    """What stands in the YAML of a robot.

    Raises:
        RobotError: it is missing, cannot be read, or has a key twice.
    """
    try:
        return load_yaml(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise RobotError(f"there is no robot file {path}; sealegs new-robot <model> writes one.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise RobotError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}.") from None
    except TwiceError as error:
        raise RobotError(f"{path}: {error.problem}.") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark else ""
        raise RobotError(f"{path} is not valid YAML{where}: {getattr(error, 'problem', error)}.") from None
