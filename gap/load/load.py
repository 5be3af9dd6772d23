"""What a joint works against, as far as the replay of the joint needs it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol


class Range(NamedTuple):
    """Where a number of a load is sought: bounds, where a fit starts, and its typical change."""

    low: float
    high: float
    start: float
    scale: float


class Load(Protocol):
    """A load behind a joint, with what a fit found of it.

    One degree of freedom obeys ``inertia q'' + gravity_torque sin(q) = torque`` between its stops. The numbers of a
    run's load (``params``) are what its sidecar says; a run without any moves as measured.
    """

    @property
    def mass_keys(self) -> tuple[str, ...]:
        """Numbers that a wrong mass may be, the usual one first."""
        ...

    @property
    def least_payload(self) -> float:
        """The least payload that leaves a body at its end [kg], below zero; 0 where nobody says where that is."""
        ...

    @property
    def own_lever(self) -> float:
        """How far the centre of mass of a joint's own body is from it where others hang behind [m]; 0 elsewhere."""
        ...

    @property
    def tip_mass(self) -> float:
        """What at the end weighs as much as the last of the bodies behind a joint's own [kg]; 0 where there is none."""
        ...

    @property
    def tunable(self) -> tuple[str, ...]:
        """Factors of it that nobody knows exactly, though somebody claims them."""
        ...

    @property
    def pull_back(self) -> float:
        """Largest change of gravity's torque with the angle [N.m/rad]: what holds a constant torque in place."""
        ...

    @property
    def predictable(self) -> bool:
        """Whether its numbers alone say what it does on a motion that nobody has made yet."""
        ...

    @property
    def pose_known(self) -> bool:
        """Whether it is known at which angle it hangs, even where the load itself is not."""
        ...

    def known(self, params: Mapping[str, float], /) -> bool:
        """Whether a run with these parameters says what the load is; else it moves as measured."""
        ...

    def inertia(self, params: Mapping[str, float], /) -> float:
        """Inertia about the joint [kg.m2]."""
        ...

    def gravity_torque(self, params: Mapping[str, float], /) -> float:
        """Torque of gravity at a quarter turn from where it hangs [N.m]."""
        ...

    def planned_gravity(self, params: Mapping[str, float], /) -> float:
        """Largest torque of gravity that a planned motion must leave room for [N.m]."""
        ...

    def stops(self, params: Mapping[str, float], /) -> tuple[float, float]:
        """Angles below and beyond which something blocks the link [rad]."""
        ...

    def stop_ranges(self, middle: float, half: float, start: float, /) -> tuple[Range, Range]:
        """Where an upper and a lower stop are sought of a joint that went ``half`` either side of ``middle``.

        ``start`` is in parts of what the joint went through, counted from where it is at rest.
        """
        ...

    def inertia_ranges(self, armature: float, /) -> dict[str, Range]:
        """Where its inertia beyond the believed one is sought [kg.m2], by key: of the load itself first.
        The motor's own ``armature`` is given [kg.m2].
        """
        ...

    def unknown_ranges(self, armature: float, /) -> dict[str, Range]:
        """Where its numbers are sought, by key, when nobody measured it."""
        ...

    def along_log(self, slide: bool, /) -> dict[str, float]:
        """What the simulator needs of a load whose inertia and gravity are given along the log, by name of
        :class:`sealegs.gap.replay.constants.Constants`; nothing where they follow from the angle alone.
        """
        ...

    def numbers(self, params: Mapping[str, float], /) -> dict[str, float]:
        """Numbers of the robot that carries this load, for the engine."""
        ...

    def value(self, key: str, /) -> float:
        """A number that a fit may turn."""
        ...

    def with_values(self, values: Mapping[str, float], /) -> Load:
        """The load with some of these numbers set."""
        ...
