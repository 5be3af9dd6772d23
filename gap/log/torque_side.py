"""On which side of the drive's own inertia and friction a torque column was taken.

A sensor behind the gear reads what the load needs. A drive that estimates its torque from current reads what the motor
gives, which turns its armature and overcomes its friction too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from .finding import Finding
from .types import Array, LogError, MeasuredRun

TorqueSide = Literal["shaft", "drive"]
Reason = Literal["said", "shown", "assumed"]
SIDES: tuple[TorqueSide, ...] = ("shaft", "drive")
BETWEEN = 0.25
"""Share of armature and friction in the column below which they are not in it: friction is often half or twice."""
LEAST = 0.01
"""Size of what is inside the drive, over that of the torque, up to which nothing tells; assumed."""


def said_side(runs: Sequence[MeasuredRun]) -> TorqueSide | None:
    """What ``meta.torque`` of the sidecars says; None where none says anything.

    Raises:
        LogError: it is neither, or the runs contradict each other.
    """
    said: TorqueSide | None = None
    for run in runs:
        word = run.meta.get("torque")
        if word is None:
            continue
        side: TorqueSide | None = next((one for one in SIDES if one == word), None)
        if side is None:
            raise LogError(
                f"{run.name}: meta.torque is 'shaft' (a sensor behind the gear) or 'drive' (the drive's estimate, with "
                f"its armature and friction in it), not {word!r}."
            )
        if said not in (None, side):
            raise LogError(f"{run.name}: meta.torque is '{side}', that of another run '{said}'; diagnose them apart.")
        said = side
    return said


def shown_side(torque: Array, shaft: Array, inside: Array) -> TorqueSide | None:
    """What a torque column itself says.

    Args:
        torque: as logged (n,) [N.m].
        shaft: what is believed of the torque at the shaft (n,) [N.m].
        inside: what armature and friction of the drive take beside it (n,) [N.m].

    Returns:
        None where too little is inside the drive to tell.
    """
    table = np.column_stack([shaft, inside, np.ones_like(shaft)])
    if float(np.std(inside)) <= LEAST * float(np.std(torque)):
        return None
    numbers = np.linalg.lstsq(table, torque, rcond=None)[0]
    inside_it = bool(numbers[1] > BETWEEN * abs(numbers[0]))
    return "drive" if inside_it else "shaft"


def side_note(joint: str, side: TorqueSide, why: Reason) -> Finding:
    """What the column was taken as, and why."""
    of = (
        "the load alone, as behind the gear: the drive's armature and friction are not in it"
        if side == "shaft"
        else "the drive: its armature and friction are in it"
    )
    other = "drive" if side == "shaft" else "shaft"
    correct = f"say so in the sidecar: meta: {{torque: {other}}}"
    reasons = {
        "said": "as the sidecar says",
        "shown": f"which fits better; else {correct}",
        "assumed": f"which the log cannot tell; if it is not, {correct}",
    }
    return Finding(
        "torque.side",
        "note",
        joint,
        f"{joint}.torque",
        f"{joint}.torque is taken as the torque of {of}, {reasons[why]}.",
    )
