"""The load of a bench: a point mass at the end of a uniform rod."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from ...actuators.gravity import GRAVITY
from ...common.errors import SealegsError, nearest
from ...envs.bench.robot import BARE, NUMBERS
from ...envs.bench.robot import inertia as pendulum_inertia
from .load import Load, Range


@dataclass(frozen=True)
class PendulumLoad(Load):
    """What a bench carries, as a change of what its sidecar says.

    ``centre_shift`` is that of the mass along the arm, and ``typical_inertia`` that of the largest load that a run's
    sidecar describes. Nothing hangs behind what hangs on the shaft. Whoever hangs a mass there has weighed it, and the
    zero of the encoder is a pose of whatever hangs there.
    """

    mass_keys: ClassVar[tuple[str, ...]] = ("mass_factor",)
    tunable: ClassVar[tuple[str, ...]] = ()
    predictable: ClassVar[bool] = True
    pose_known: ClassVar[bool] = False

    @property
    def pull_back(self) -> float:
        """Unbounded: it always hangs."""
        return math.inf

    def known(self, params: Mapping[str, float]) -> bool:
        """Whether a run says what hangs there."""
        return bool(params)

    def numbers(self, params: Mapping[str, float]) -> dict[str, float]:
        """Numbers of the bench that carries this, where ``params`` are those of the one that its sidecar describes."""
        believed = completed(params)
        return {
            "mass": believed["mass"] * self.mass_factor,
            "arm_mass": believed["arm_mass"],
            "length": believed["length"],
            "centre_shift": believed["centre_shift"] + self.centre_shift,
            "extra_inertia": believed["extra_inertia"] + self.extra_inertia,
            "lower_stop": max(believed["lower_stop"], self.lower_stop),
            "upper_stop": min(believed["upper_stop"], self.stop_angle),
            "stop_stiffness": self.stop_stiffness or believed["stop_stiffness"],
        }

    def inertia(self, params: Mapping[str, float]) -> float:
        """Inertia about the shaft [kg.m2]: point mass on a uniform rod."""
        return pendulum_inertia(self.numbers(params))

    def gravity_torque(self, params: Mapping[str, float]) -> float:
        """Torque of gravity at a quarter turn [N.m]."""
        n = self.numbers(params)
        moment = n["mass"] * (n["length"] + n["centre_shift"]) + n["arm_mass"] * n["length"] / 2.0
        return GRAVITY * moment

    def planned_gravity(self, params: Mapping[str, float]) -> float:
        """All of it: an excitation may go to a quarter turn [N.m]."""
        return self.gravity_torque(params)

    def stops(self, params: Mapping[str, float]) -> tuple[float, float]:
        """Angles below and beyond which something blocks the link [rad]."""
        if not params:
            return super().stops(params)
        n = self.numbers(params)
        return n["lower_stop"], n["upper_stop"]

    def stop_ranges(self, middle: float, half: float, start: float) -> tuple[Range, Range]:
        """Either side of hanging, wherever it went [rad]."""
        del middle, half
        return Range(-0.5, 2.0, start, 0.03), Range(-2.0, 0.5, -start, 0.03)

    def inertia_ranges(self, armature: float) -> dict[str, Range]:
        """Beyond that of mass and arm [kg.m2]: at least what a hobby servo carries, more where the load is larger."""
        whole = self.typical_inertia + armature
        change = max(0.002, 0.1 * whole)
        return {"extra_inertia": Range(0.0, max(0.5, 20.0 * whole), change, change)}

    def unknown_ranges(self, armature: float) -> dict[str, Range]:
        """Of a mass that nobody weighed, from a gram to some kilograms, and more inertia than that of a point."""
        del armature
        return {"mass_factor": Range(0.005, 20.0, 1.0, 0.3), "extra_inertia": Range(0.0, 0.1, 0.002, 0.002)}


def completed(params: Mapping[str, float]) -> dict[str, float]:
    """Numbers of a bench, those that ``params`` leaves out being the robot's own (:data:`sealegs.envs.bench`).

    Without a mass there is no arm either, unless ``params`` has one: the shaft is empty.
    """
    empty = BARE if params.get("mass") == 0.0 else {}
    return {**{name: number.value for name, number in NUMBERS.items()}, **empty, **params}


def bench_parameters(params: Mapping[str, float], where: str) -> dict[str, float]:
    """Numbers of the bench of a run, checked and completed.

    Raises:
        SealegsError: mass or length is missing or negative, or there is a number that no bench has.
    """
    for key in params:
        if key not in NUMBERS:
            hint = nearest(key, NUMBERS) or f"; it has {', '.join(NUMBERS)}"
            raise SealegsError(f"{where}: robot_params has '{key}', which a bench has not{hint}.")
    if "mass" not in params:
        raise SealegsError(
            f"{where}: robot_params says nothing of the bench's load; add mass [kg] and length [m] to the sidecar, "
            "mass: 0 for an empty shaft, or name the robot that it is, robot: my_arm.xml."
        )
    for key in ("mass", "arm_mass"):
        if not params.get(key, 0.0) >= 0.0:
            raise SealegsError(f"{where}: robot_params has {key}: {params[key]:g}; a mass is zero or more [kg].")
    if not params.get("length", 0.0) > 0.0 and (params["mass"] > 0.0 or params.get("arm_mass", 0.0) > 0.0):
        raise SealegsError(
            f"{where}: robot_params needs 'length' above zero, the distance of the mass from the shaft [m]; add it to "
            "the sidecar."
        )
    return {"arm_mass": completed(params)["arm_mass"], **params}


def hung(params: Sequence[Mapping[str, float]]) -> PendulumLoad:
    """The load of a bench as the sidecars of its runs describe it, each by its numbers."""
    return PendulumLoad(typical_inertia=max((pendulum_inertia(completed(one)) for one in params), default=0.0))
