"""Which of a robot's calibrations holds: the one made last, as the files say themselves.

Times of files on the disk say nothing: a copy, a checkout or a touch would bring back an old zero, on real servos.
"""

from __future__ import annotations

import glob
from datetime import date, datetime
from pathlib import Path
from typing import Any

from ...common.documents import DocumentError, read_yaml
from ...common.fresh_names import STAMP
from .joints import CalibrationError

FOLDER = Path("calibrations")
LENGTH = len("20260101-000000")
REMEDY = "repair it, move it elsewhere, or give calibration=<file>."


def newest(robot: str, folder: Path = FOLDER) -> Path | None:
    """The latest calibration of a robot; None where there is none.

    Args:
        robot: its name.
        folder: with files ``<robot>-*.yaml``. Whose they are and when they were made, they say themselves; where one
            has no date, the stamp in its name counts.

    Raises:
        CalibrationError: one that may be the latest cannot be read, or does not say when it was made.
    """
    dated: list[tuple[datetime, Path]] = []
    doubted: list[tuple[datetime | None, str]] = []
    undated: list[Path] = []
    for path in sorted(folder.glob(f"{glob.escape(robot)}-*.yaml")):
        try:
            whose, made = _whose_and_when(path)
        except CalibrationError as error:
            made, rest = _stamp(path), path.stem.removeprefix(f"{robot}-")
            if made is None or len(rest) == LENGTH:  # else its name is that of another robot's, <robot>-left
                doubted.append((made, str(error)))
            continue
        if whose != robot:
            continue
        if made is None:
            undated.append(path)
        else:
            dated.append((made, path))
    latest = max(dated, default=None)
    for made, sentence in doubted:
        if made is None or latest is None or made >= latest[0]:
            raise CalibrationError(sentence)
    if undated and len(undated) + len(dated) > 1:
        raise CalibrationError(
            f"{undated[0]} says no date, so which calibration of robot '{robot}' is the newest cannot be told; write "
            "date: <such as 2026-01-31T12:00:00> into it, move it elsewhere, or give calibration=<file>."
        )
    return undated[0] if undated else None if latest is None else latest[1]


def _whose_and_when(path: Path) -> tuple[str, datetime | None]:
    """Robot of a calibration, and when it was made; None: neither the file nor its name says.

    Raises:
        CalibrationError: it cannot be read.
    """
    try:
        document: Any = read_yaml(path)
        if not isinstance(document, dict) or not isinstance(document.get("robot"), str):
            raise ValueError("it does not say whose it is, as robot: <name>")
        said = document.get("date")
        return document["robot"], _stamp(path) if said is None else _time(said)
    except DocumentError as error:
        raise CalibrationError(f"the calibration {path} {error.problem}; {REMEDY}") from None
    except (ValueError, OverflowError) as error:
        raise CalibrationError(f"{path} is no calibration ({' '.join(str(error).split())}); {REMEDY}") from None


def _time(said: Any) -> datetime:
    """A date of a file, which YAML may have read as one; of the local clock where it names no zone.

    Raises:
        ValueError: it is none.
    """
    if isinstance(said, date) and not isinstance(said, datetime):
        said = said.isoformat()
    return (said if isinstance(said, datetime) else datetime.fromisoformat(str(said))).astimezone()


def _stamp(path: Path) -> datetime | None:
    """When a file was made by the end of its name; None: it does not say."""
    try:
        return datetime.strptime(path.stem[-LENGTH:], STAMP).astimezone()
    except ValueError:
        return None
