"""Names that a command gives by itself: what it is of, and the second in which it began."""

from __future__ import annotations

import glob
import itertools
from datetime import datetime
from pathlib import Path

STAMP = "%Y%m%d-%H%M%S"
"""Of the end of such a name."""


def fresh(folder: Path, label: str, ending: str = "") -> Path:
    """``folder/<label>-<stamp><ending>``, with a number behind the stamp where something there has that name.

    Args:
        folder: that it is to be in; it may be missing.
        label: what it is of, a part of a file name.
        ending: of the file, such as ``.mp4``. A name is taken with whatever ending: a log is several files.
    """
    stem = f"{label}-{datetime.now():{STAMP}}"
    names = itertools.chain([stem], (f"{stem}-{count}" for count in itertools.count(2)))
    free = next(name for name in names if not any(folder.glob(f"{glob.escape(name)}*")))
    return folder / f"{free}{ending}"
