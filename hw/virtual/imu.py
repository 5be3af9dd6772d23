"""The IMU of a virtual machine: samples of how its base turns, at their own times, with noise, bias and delay."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ...common.errors import SealegsError, nearest
from ...configs.check import NotNegative, Positive, checked
from ...envs.described.robot_imu import check_units
from ...envs.engine import turns
from ...envs.engine.base import quaternion
from ...envs.engine.imu import Imu
from ...envs.engine.keyed import key_of
from ..bus.imu import ImuSample

KEPT = 1000  # samples that nobody has fetched
HIDES = {"delay": NotNegative, "rate": Positive, "rotation": tuple[float, float, float]}
"""What a file of hidden effects may say under ``imu``, beside ``noise`` and ``bias``."""


def hidden_imu(imu: Imu, hidden: Mapping[str, Any], where: str) -> Imu:
    """An IMU as it really is.

    Args:
        imu: as believed.
        hidden: by key after ``imu.``: ``delay`` [s], ``rate`` [Hz], ``rotation`` (how it is turned on its seat: roll,
            pitch, yaw [rad]), ``noise.orientation``, ``bias.turn_rate`` and so on.
        where: file, for the message.

    Raises:
        SealegsError: there is no such key, or it takes no such value.
    """
    spreads = {f"{kind}.{name}": (kind, name) for kind in ("noise", "bias") for name in ("orientation", "turn_rate")}
    for key, value in hidden.items():
        if key in spreads:
            kind, name = spreads[key]
            found = checked(f"{where}: imu.{key}", value, NotNegative)
            imu = replace(imu, **{kind: replace(getattr(imu, kind), **{name: found})})
        elif key == "rotation":
            angles = checked(f"{where}: imu.rotation", value, HIDES[key])
            check_units(f"{where}: imu", angles)
            imu = replace(imu, mount=tuple(turns.multiply(np.array(imu.mount), quaternion(*angles)).tolist()))
        elif key in HIDES:
            imu = replace(imu, **{key: checked(f"{where}: imu.{key}", value, HIDES[key])})
        else:
            known = [*HIDES, *spreads]
            raise SealegsError(f"{where}: imu.{key} is unknown{nearest(key, known)}; there are {', '.join(known)}.")
    check_units(f"{where}: imu", delay=imu.delay)
    return imu


class VirtualImu:
    """Takes samples of a machine that others simulate.

    Attributes:
        imu: as it really is.
        silent: whether it says nothing, as with its cable out.
    """

    def __init__(
        self,
        imu: Imu,
        turn: Callable[[], tuple[np.ndarray, np.ndarray]],
        seed: int,
        closed: Callable[[], np.ndarray] = lambda: np.empty(0),
    ) -> None:
        """Prepare.

        Args:
            imu: as it really is.
            turn: of the base: orientation (4,) and turn rate about its axes (3,) [rad/s].
            seed: of its noise, its bias and its clock.
            closed: 1 where a contact switch on its board is closed, else 0 (s,).
        """
        self.imu, self.silent, self._turn, self._closed = imu, False, turn, closed
        self._key = key_of(np.random.default_rng([seed, 0x1A0]).random(()))
        number, taken = imu.sample_at(np.asarray(imu.delay), self._key)  # the latest before time 0
        self._number, self._phase = int(number), float(taken) - int(number) / imu.rate
        self._coming: deque[ImuSample] = deque(maxlen=KEPT)
        self._number -= 2 + int(imu.delay * imu.rate)  # it was on before
        while self.next_at <= 0.0:
            self.take()

    @property
    def next_at(self) -> float:
        """When the next sample is taken [s]."""
        return (self._number + 1) / self.imu.rate + self._phase

    def take(self) -> None:
        """Take the next sample, of the machine as it is."""
        at = self.next_at + self.imu.delay
        self._number += 1
        orientation, turn_rate = self.imu.measured(*self._turn(), self._key, np.asarray(self._number))
        if not self.silent:
            self._coming.append(ImuSample(at, *self.imu.raw(orientation, turn_rate), self._closed()))

    def due(self, now: float) -> list[ImuSample]:
        """Samples that have come by ``now`` [s] and were not fetched before."""
        found = []
        while self._coming and self._coming[0].time <= now + 1e-9:
            found.append(self._coming.popleft())
        return found

    @property
    def next_due(self) -> float | None:
        """When the next sample comes [s]; None: none is on its way."""
        return self._coming[0].time if self._coming else None


class FetchedImu:
    """A virtual IMU as a loop in the same process reads it."""

    def __init__(self, imu: VirtualImu, now: Callable[[], float]) -> None:
        """Of samples that have come by the time of a clock [s]."""
        self._imu, self._now = imu, now
        self._latest: ImuSample | None = None

    def latest(self) -> ImuSample | None:
        for sample in self._imu.due(self._now()):
            self._latest = sample
        return self._latest

    def problem(self) -> str:
        return "its fault was planted" if self._imu.silent else ""

    def close(self) -> None:
        """Nothing is open."""


def line_of(sample: ImuSample) -> bytes:
    """A sample as it goes over a serial line, in the format of :func:`sealegs.hw.bus.imu_chips.plain`."""
    numbers = [f"{value:.6f}" for value in (*sample.orientation, *sample.turn_rate)]
    return (", ".join([*numbers, *(f"{value:.0f}" for value in sample.switches)]) + "\n").encode()
