"""A chain as it is with the angle of the log, and with that of the robot's model: direction and zero may differ."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

from ...actuators import Chain
from ...actuators.stages.base import Stage
from .robot import Frame

ODD: Mapping[str, tuple[str, ...]] = {
    "offset": ("value",),
    "friction": ("asymmetry", "viscous_asymmetry"),
    "regression": ("constant",),
}
"""Numbers of a chain that change sign with the direction of the angle."""
POSITIVE, NEGATIVE = "_positive", "_negative"


def in_frame(chain: Chain, frame: Frame) -> Chain:
    """A chain that was found with the angle as the log has it, for the angle of the model."""
    if frame == Frame():
        return chain
    return dataclasses.replace(chain, stages=tuple(_turned(stage, chain, frame) for stage in chain.stages))


def in_log(chain: Chain, frame: Frame) -> Chain:
    """A chain of the robot's model, for the angle as the log has it: :func:`in_frame` undone."""
    return in_frame(chain, Frame(-frame.sign * frame.zero, frame.sign))


def _turned(stage: Stage, chain: Chain, frame: Frame) -> Stage:
    values = stage.parameters()
    if stage.name == "encoder":
        offset = values["offset"] + (values["scale"] - 1.0) * frame.zero
        return dataclasses.replace(stage, offset=frame.sign * offset)
    changed = {key: frame.sign * values[key] for key in ODD.get(stage.name, ())}
    if stage.name == "friction":  # a cosine
        phase = values["ripple_phase"] + values["ripple_count"] * frame.zero
        changed["ripple_phase"] = _wrapped(frame.sign * phase)
    elif stage.name == "meshing":
        changed |= _meshing(values, chain.gear_ratio(), frame)
    return dataclasses.replace(stage, **changed) if changed else stage


def _meshing(values: Mapping[str, float], ratio: float, frame: Frame) -> dict[str, float]:
    """Sines over the motor's angle, and a set of numbers for each direction."""
    changed = {}
    for k in (1, 2, 3):
        phase = values[f"phase_{k}"] + values[f"frequency_{k}"] * ratio * frame.zero
        changed[f"phase_{k}"] = _wrapped(phase if frame.sign > 0.0 else math.pi - phase)
    if frame.sign < 0.0:
        for key in [key for key in values if key.endswith(POSITIVE)]:
            other = key.removesuffix(POSITIVE) + NEGATIVE
            changed |= {key: values[other], other: values[key]}
    return changed


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)
