"""What a joint works against, as far as the replay of the joint needs it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Self


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
