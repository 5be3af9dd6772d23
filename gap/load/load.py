"""What a joint works against, as far as the replay of the joint needs it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol


class Load(Protocol):
    """A load behind a joint, with what a fit found of it.

    One degree of freedom obeys ``inertia q'' + gravity_torque sin(q) = torque`` between its stops. The numbers of a
    run's load (``params``) are what its sidecar says; a run without any moves as measured.
    """

    @property
    def tree(self) -> bool:
        """Whether what it does changes along the log, as that of a joint of a robot does."""
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

    def stops(self, params: Mapping[str, float], /) -> tuple[float, float]:
        """Angles below and beyond which something blocks the link [rad]."""
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
