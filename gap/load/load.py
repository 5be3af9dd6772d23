"""What a joint works against, as far as the replay of the joint needs it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Self

from ...actuators.gravity import GRAVITY
from ...common.errors import SealegsError, nearest
from ...envs.bench.robot import BARE, NUMBERS
from ...envs.bench.robot import inertia as pendulum_inertia


class Range(NamedTuple):
    """Where a number of a load is sought: bounds, where a fit starts, and its typical change."""

    low: float
    high: float
    start: float
    scale: float


@dataclass(frozen=True)
class Load(ABC):
    """A load behind a joint, as a change of what is believed of it.

    One degree of freedom obeys ``inertia q'' + gravity_torque sin(q) = torque`` between its stops. The numbers of a
    run's load (``params``) are what its sidecar says; a run without any moves as measured.

    Attributes:
        mass_keys: numbers that a wrong mass may be, the usual one first.
        tunable: factors of it that nobody knows exactly, though somebody claims them.
        predictable: whether its numbers alone say what it does on a motion that nobody has made yet.
        pose_known: whether it is known at which angle it hangs, even where the load itself is not.
        mass_factor: true over believed mass of all that hangs behind the joint.
        extra_inertia: beyond the believed one [kg.m2].
        centre_shift: of the centre of mass, away from the joint [m].
        stop_angle, lower_stop: beyond and below which something blocks the link [rad].
        stop_stiffness: of what blocks it [N.m/rad]; 0: as usual of such a joint.
        typical_inertia: by which a search is scaled [kg.m2].
        least_payload: the least that leaves a body at its end [kg], below zero; 0 where nobody says where that is.
        own_lever: from the joint to the centre of mass of its own body, where others hang behind it [m]; 0 where
            nothing does: then one factor is all that its mass may be wrong by.
        tip_mass: what at the end weighs as much as the last of the bodies behind the joint's own [kg]; 0 where there is
            none.
    """

    mass_keys: ClassVar[tuple[str, ...]]
    tunable: ClassVar[tuple[str, ...]]
    predictable: ClassVar[bool]
    pose_known: ClassVar[bool]

    mass_factor: float = 1.0
    extra_inertia: float = 0.0
    centre_shift: float = 0.0
    stop_angle: float = math.inf
    lower_stop: float = -math.inf
    stop_stiffness: float = 0.0
    typical_inertia: float = 0.0
    least_payload: float = 0.0
    own_lever: float = 0.0
    tip_mass: float = 0.0

    @property
    @abstractmethod
    def pull_back(self) -> float:
        """Largest change of gravity's torque with the angle [N.m/rad]: what holds a constant torque in place."""

    @abstractmethod
    def known(self, params: Mapping[str, float]) -> bool:
        """Whether a run with these parameters says what the load is; else it moves as measured."""

    @abstractmethod
    def inertia(self, params: Mapping[str, float]) -> float:
        """Inertia about the joint [kg.m2]."""

    @abstractmethod
    def gravity_torque(self, params: Mapping[str, float]) -> float:
        """Torque of gravity at a quarter turn from where it hangs [N.m]."""

    @abstractmethod
    def planned_gravity(self, params: Mapping[str, float]) -> float:
        """Largest torque of gravity that a planned motion must leave room for [N.m]."""

    def stops(self, params: Mapping[str, float]) -> tuple[float, float]:
        """Angles below and beyond which something blocks the link [rad]."""
        del params
        return self.lower_stop, self.stop_angle

    @abstractmethod
    def stop_ranges(self, middle: float, half: float, start: float) -> tuple[Range, Range]:
        """Where an upper and a lower stop are sought of a joint that went ``half`` either side of ``middle``.

        ``start`` is in parts of what the joint went through, counted from where it is at rest.
        """

    @abstractmethod
    def inertia_ranges(self, armature: float) -> dict[str, Range]:
        """Where its inertia beyond the believed one is sought [kg.m2], by key: of the load itself first.
        The motor's own ``armature`` is given [kg.m2].
        """

    @abstractmethod
    def unknown_ranges(self, armature: float) -> dict[str, Range]:
        """Where its numbers are sought, by key, when nobody measured it."""

    def along_log(self, slide: bool) -> dict[str, float]:
        """What the simulator needs of a load whose inertia and gravity are given along the log, by name of
        :class:`sealegs.gap.replay.constants.Constants`; nothing where they follow from the angle alone.
        """
        del slide
        return {}

    def numbers(self, params: Mapping[str, float]) -> dict[str, float]:
        """Numbers of the bench that carries this load, for the engine; those of a robot stand in its model file."""
        return dict(params)

    def value(self, key: str) -> float:
        """A number that a fit may turn."""
        return getattr(self, key)

    def with_values(self, values: Mapping[str, float]) -> Self:
        """The load with some of these numbers set."""
        return replace(self, **values)


# --- the load of a bench: a point mass at the end of a uniform rod ---------------------------------------------------


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
