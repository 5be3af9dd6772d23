"""On which side of the drive's own inertia and friction a torque column was taken.

A sensor behind the gear reads what the load needs. A drive that estimates its torque from current reads what the motor
gives, which turns its armature and overcomes its friction too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from .finding import Finding
from .types import Array, LogError, MeasuredRun

TorqueSide = Literal["shaft", "drive"]
Reason = Literal["said", "shown", "assumed"]
SIDES: tuple[TorqueSide, ...] = ("shaft", "drive")
FRICTION_SHARE = 0.1
"""Share of the believed friction from which a torque has friction in it: half of the least that a refit allows it."""
TAKEN_SHARE = 0.25
"""The same of what a drive's torque lost on its way to the shaft, which the model of its motor may have wrong as well:
half of a friction that is half of what is believed."""
NEAR_INERTIA = math.log(2.0)
"""Logarithm of the factor by which a load's inertia may be off on the side that it speaks for; assumed."""
CLEAR_MARGIN = math.log(1.2)
"""On the other side it must be off by twice as much and this beside: a load is known to a fifth or so, assumed."""
SLIGHT_SHARE = 0.01
"""Size of a part of a torque, over that of all of it, up to which the part does not show; assumed."""
SURE_DEVIATIONS = 2.0
"""Standard deviations by which a share must be on one side of its limit."""


def said_side(runs: Sequence[MeasuredRun], joint: str) -> TorqueSide | None:
    """What ``meta.torque`` of the sidecars says; None where none says anything.

    Only runs that have the torque of the joint are asked, and only words are an answer: ``meta`` is anybody's own.

    Raises:
        LogError: it is neither, or the runs contradict each other.
    """
    said: TorqueSide | None = None
    for run in runs:
        word = run.meta.get("torque")
        if not isinstance(word, str) or joint not in run.joints or run.joints[joint].torque is None:
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


def side_by_load(torque: Array, load: Array, armature: Array, friction: Array, block: np.ndarray) -> TorqueSide | None:
    """What a torque column itself says where the load is believed to be known.

    Inertia, gravity and offset are free, as is the column's sign, so that a wrong load or a reversed column hides
    nothing. Friction then shows whether the column has what is inside the drive in it. An armature looks like inertia
    of the load, so it says only which side asks for a load that is much less off.

    Args:
        torque: as logged (n,) [N.m].
        load: torque that inertia and gravity of the load are believed to take (n, 2) [N.m].
        armature: torque that the armature of the drive is believed to take (n,) [N.m].
        friction: torque that its friction is believed to take (n,) [N.m].
        block: number of the block of each row, within which errors are alike (n,).

    Returns:
        None where it does not tell, as where friction and armature contradict each other.
    """
    inside = armature + friction
    if _slight(inside, torque):
        return None
    if all(_slight(column, inside) for column in load.T):  # an empty shaft: a sensor behind the gear reads nothing
        share, spread = numbers_and_spread(np.column_stack([inside, np.ones_like(torque)]), torque, block)
        return _side(share[0], spread[0], FRICTION_SHARE)
    table = np.column_stack([load, friction, np.ones_like(torque)])
    numbers, spread = numbers_and_spread(table, torque, block)
    scale = abs(float(numbers[1]))
    if scale <= SURE_DEVIATIONS * spread[1]:  # how large the load is in the column does not show
        return None
    by_friction = None if _slight(friction, torque) else _side(numbers[2] / scale, spread[2] / scale, FRICTION_SHARE)
    alike = float(np.linalg.lstsq(table, armature, rcond=None)[0][0])  # inertia of the load that acts as the armature
    inertia = float(np.sign(numbers[1]) * numbers[0])
    by_armature = _by_inertia(
        {"shaft": inertia / scale, "drive": (inertia - alike) / scale}, SURE_DEVIATIONS * spread[0] / scale
    )
    if by_friction is not None and by_armature is not None and by_friction != by_armature:
        return None
    return by_friction or by_armature


def side_by_drive(torque: Array, given: Array, inside: Array, speed: Array, block: np.ndarray) -> TorqueSide | None:
    """What a torque column itself says where the motor's torque is known and the load is not.

    The drive's own damping is free, as a torque that is right but for its gains has another.

    Args:
        torque: as logged (n,) [N.m].
        given: what the motor is believed to give with each of some delays (d, n) [N.m].
        inside: what armature and friction of the drive are believed to take of it (d, n) [N.m].
        speed: of the joint (n,) [rad/s].
        block: as of :func:`side_by_load`.

    Returns:
        None where it does not tell.
    """
    if _slight(inside[0], torque):
        return None
    tables = [np.column_stack([g, -i, speed, np.ones_like(torque)]) for g, i in zip(given, inside, strict=True)]
    found = [numbers_and_spread(table, torque, block) for table in tables]
    left = [float(((torque - table @ numbers) ** 2).sum()) for table, (numbers, _) in zip(tables, found, strict=True)]
    numbers, spread = found[int(np.argmin(left))]
    scale = float(numbers[0])
    if abs(scale) <= SURE_DEVIATIONS * spread[0]:
        return None
    side = _side(numbers[1] / scale, spread[1] / abs(scale), TAKEN_SHARE)
    return None if side is None else SIDES[1 - SIDES.index(side)]  # what is taken is not in it


def numbers_and_spread(table: Array, torque: Array, block: np.ndarray) -> tuple[Array, Array]:
    """The numbers (k,) by which columns (n, k) explain a torque best, and their standard deviations over blocks."""
    numbers = np.asarray(np.linalg.lstsq(table, torque, rcond=None)[0], dtype=np.float64)
    inverse = np.linalg.pinv(table.T @ table)
    score = table * (torque - table @ numbers)[:, None]
    per_block = np.stack([np.bincount(block, score[:, k]) for k in range(table.shape[1])], axis=1)
    return numbers, np.sqrt(np.diag(inverse @ per_block.T @ per_block @ inverse))


def _slight(part: Array, torque: Array) -> bool:
    """Whether a part of a torque is too little to show in it."""
    return float(np.std(part)) <= SLIGHT_SHARE * float(np.std(torque))


def _by_inertia(ratios: Mapping[TorqueSide, float], reach: float) -> TorqueSide | None:
    """The side whose inertia of the load, as a ratio to what gravity says of it, is the only one that is near one.

    Args:
        ratios: on each side.
        reach: half their 95 % interval.
    """
    for side, other in (SIDES, SIDES[::-1]):
        worst = max(_off(ratios[side] + end) for end in (-reach, reach))
        best = 0.0 if abs(ratios[other] - 1.0) < reach else min(_off(ratios[other] + end) for end in (-reach, reach))
        if worst < NEAR_INERTIA and best > 2.0 * worst + CLEAR_MARGIN:
            return side
    return None


def _off(ratio: float) -> float:
    """How far a ratio is from one, as a logarithm; none below zero."""
    return abs(math.log(ratio)) if ratio > 0.0 else math.inf


def _side(share: float, spread: float, limit: float) -> TorqueSide | None:
    """The side of a column that has a share of what is inside the drive in it, with either sign."""
    if abs(share) - SURE_DEVIATIONS * spread > limit:
        return "drive"
    return "shaft" if abs(share) + SURE_DEVIATIONS * spread < limit else None


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
        "shown": f"as its own shape shows; if that is wrong, {correct}",
        "assumed": f"which the log cannot tell; if it is not, {correct}",
    }
    return Finding(
        "torque.side",
        "note",
        joint,
        f"{joint}.torque",
        f"{joint}.torque is taken as the torque of {of}, {reasons[why]}.",
    )
