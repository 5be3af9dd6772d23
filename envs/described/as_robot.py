"""A robot of files as training, simulation and deployment take it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import mujoco

from ...actuators import DrivenCoordinate
from ..engine.numbers import Number
from ..engine.robot import Robot
from .robot_described import FLOOR_FRICTION, RobotFile
from .robot_numbers import harden_stops, model_effects, model_numbers


def as_robot(file: RobotFile) -> Robot:
    """The robot that a file describes."""
    singles = {item.name: item.joint for item in file.joints if item.terms == ((item.joint, 1.0),)}
    limits = {item.name: item.range for item in file.joints}
    driven = {name for item in file.joints for name, _ in item.terms}
    known = model_numbers(file.model, list(singles.values()), file.timestep)
    if file.floor is not None:
        known[FLOOR_FRICTION] = Number(file.floor.friction, "-", f"{file.path.name}: floor", 0.0, 10.0)
    return Robot(
        name=file.name,
        numbers=known,
        coordinates=tuple(DrivenCoordinate(item.name, item.terms) for item in file.joints),
        goal_limits=_Limits(limits),
        chains={item.name: item.chain for item in file.joints},
        build=file.build,
        effects=model_effects(file.model, singles),
        finish=partial(harden_stops, file.model),
        start={item.name: item.start for item in file.joints},
        pose={label: place for label, place in file.model.pose.items() if label[0] not in driven} | file.at_height(),
        units={item.name: item.unit for item in file.joints if item.unit != "rad"},
        file=file,
    )


def bare_model(file: RobotFile, params: Mapping[str, float] | None = None) -> mujoco.MjModel:
    """The robot without actuators, compiled: the load that its chains work against.

    Raises:
        RobotError: as :meth:`Robot.parameters`.
    """
    return as_robot(file).build_spec(params).compile()


@dataclass(frozen=True)
class _Limits:
    """Limits of goals that hang on no number."""

    limits: Mapping[str, tuple[float, float]]

    def __call__(self, values: Mapping[str, float]) -> Mapping[str, tuple[float, float]]:
        del values
        return self.limits
