"""What MuJoCo says of a model that it refuses, as a sentence that names the link and tells what to do."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco

from ...common.documents import XML_SIZE, read_bytes, without_comments
from ...common.errors import SealegsError

ELEMENT = re.compile(r" Element name '([^']*)'(?:, id \d+)?(?:, line \d+)?.*$")
LINE = re.compile(r",? line \d+$")
LEAST = float(mujoco.mjMINVAL)  # [kg], [kg.m2] of a body that moves
MACRO = re.compile(r"<xacro:[^>]*>|\$\((?:arg|dirname|env|eval|find|optenv)\b[^)]*\)|\$\{[^}]*\}")
"""What xacro would have replaced: its elements, and what it reckons within attributes."""


def line_of(error: Exception) -> str:
    """What an error says, in one line."""
    return " ".join(str(error).split()).rstrip(".")


def unreadable(path: Path, error: Exception) -> str:
    """A sentence for a model that cannot be read; a URDF's line is that of the file, not of the mended text."""
    refused = isinstance(error, SealegsError)  # by a sentence of its own
    sentence = line_of(error)
    if path.suffix.lower() == ".urdf" and not refused:
        sentence = LINE.sub("", sentence)
        try:
            mujoco.MjSpec.from_file(str(path))
        except ValueError as other:
            if LINE.sub("", line_of(other)) == sentence:
                sentence = line_of(other)
    if "'mujocoinclude'" in sentence:
        return f"{path} is a part that other files include; give the file with <mujoco> that includes it."
    if path.suffix.lower() == ".urdf" and not refused and (macro := xacro_left(path)):
        return (
            f"{path} cannot be read as a model: {sentence}. It holds {macro}, which is for xacro to replace; expand "
            f"it: xacro {path.name} > robot.urdf."
        )
    if refused:
        return f"{sentence}."
    return f"{path} cannot be read as a model: {sentence}."


def xacro_left(path: Path) -> str:
    """The first thing in a URDF that xacro should have replaced, in one line; empty where there is none."""
    found = MACRO.search(without_comments(read_bytes(path, XML_SIZE)).decode("utf-8", "replace"))
    return "" if found is None else " ".join(found.group(0).split())


def uncompiled(path: Path, error: Exception) -> str:
    """A sentence for a model that does not compile."""
    sentence = line_of(error)
    urdf = path.suffix.lower() == ".urdf"
    found = ELEMENT.search(sentence)
    what = f"{'link' if urdf else 'body'} '{found.group(1) if found else ''}'"
    if "A + B >= C" in sentence:
        return (
            f"{path}: {what} has an inertia that no body has: of its principal moments, one is more than the sum of "
            'the others. Correct it, or write <compiler balanceinertia="true"/>, and MuJoCo evens them out.'
        )
    if "positive eigenvalues" in sentence:
        return (
            f"{path}: {what} has an inertia that no body has: a principal moment is not above {LEAST:g} kg.m2, the "
            "least that MuJoCo takes. Correct the numbers of its inertia: their signs, or their unit."
        )
    if "mjMINVAL" in sentence:
        return (
            f"{path}: {what} moves, but has no mass or no inertia, or at most {LEAST:g} kg or kg.m2, which MuJoCo "
            "takes for none; give it an inertial with numbers above that."
        )
    if "free joint can only be used on top level" in sentence:
        return (
            f"{path}: {what} has a {'floating' if urdf else 'free'} joint below another {what.split()[0]}; a free base "
            f"hangs on the {'root link' if urdf else 'worldbody'} itself."
        )
    if urdf:
        sentence = re.sub(r", line \d+", "", sentence)  # of the mended text, not of the file
    return f"{path} does not compile: {sentence}."
