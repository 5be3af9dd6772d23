"""What MuJoCo says of a model that it refuses, as a sentence that names the link and tells what to do."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco

ELEMENT = re.compile(r" Element name '([^']*)'(?:, id \d+)?(?:, line \d+)?.*$")
LINE = re.compile(r",? line \d+$")


def line_of(error: Exception) -> str:
    """What an error says, in one line."""
    return " ".join(str(error).split()).rstrip(".")


def unreadable(path: Path, error: Exception) -> str:
    """A sentence for a model that cannot be read; a URDF's line is that of the file, not of the mended text."""
    sentence = line_of(error)
    if path.suffix.lower() == ".urdf" and isinstance(error, ValueError):
        sentence = LINE.sub("", sentence)
        try:
            mujoco.MjSpec.from_file(str(path))
        except ValueError as other:
            if LINE.sub("", line_of(other)) == sentence:
                sentence = line_of(other)
    return f"{path} cannot be read as a model: {sentence}."


def uncompiled(path: Path, error: Exception) -> str:
    """A sentence for a model that does not compile."""
    sentence = line_of(error)
    urdf = path.suffix.lower() == ".urdf"
    found = ELEMENT.search(sentence)
    what = f"{'link' if urdf else 'body'} '{found.group(1) if found else ''}'"
    if "A + B >= C" in sentence:
        line = '<compiler balanceinertia="true"/>'
        line = f"<mujoco>{line}</mujoco>" if urdf else line
        where = "<robot>" if urdf else "<mujoco>"
        return (
            f"{path}: {what} has an inertia that no body has: of its principal moments, one is more than the sum of "
            f"the others. Correct it, or add {line} inside {where}, and MuJoCo evens them out."
        )
    if "positive eigenvalues" in sentence:
        return (
            f"{path}: {what} has an inertia that no body has: a principal moment is not above 0. Correct the numbers "
            "of its inertia, among them their signs."
        )
    if "mjMINVAL" in sentence:
        return f"{path}: {what} moves, but has no mass or no inertia; give it an inertial with numbers above 0."
    if "free joint can only be used on top level" in sentence:
        return (
            f"{path}: {what} has a {'floating' if urdf else 'free'} joint below another {what.split()[0]}; a free base "
            f"hangs on the {'root link' if urdf else 'worldbody'} itself."
        )
    if urdf:
        sentence = re.sub(r", line \d+", "", sentence)  # of the mended text, not of the file
    return f"{path} does not compile: {sentence}."
