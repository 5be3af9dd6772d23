"""An IMU as a computer reads it: the newest sample, and a thread that waits for the next one."""

from __future__ import annotations

import math
import threading
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from time import monotonic
from typing import Protocol

import numpy as np

from ...common.errors import SealegsError
from ...envs.engine import turns
from ...envs.engine.base import quaternion

FIRST = 3.0  # [s] in which a part gives its first sample; a BNO055 starts in 0.65 s, a BNO085 in about 1 s


class ImuError(SealegsError):
    """An IMU that cannot be read."""


@dataclass(frozen=True)
class ImuSample:
    """What an IMU said, in its own axes.

    Attributes:
        time: clock of the host as it came [s].
        orientation: quaternion of the IMU in a world whose z axis points up (4,).
        turn_rate: about the IMU's axes (3,) [rad/s].
        switches: 1 where a contact switch on its board is closed, else 0 (s,).
    """

    time: float
    orientation: np.ndarray
    turn_rate: np.ndarray
    switches: np.ndarray = field(default_factory=lambda: np.empty(0))


class ImuSource(Protocol):
    """Where samples come from."""

    def latest(self) -> ImuSample | None:
        """The newest sample; None: there was none yet."""
        ...

    def problem(self) -> str:
        """Why there are no further ones, as far as it is known; "": nothing is wrong."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


class ThreadedImu(ABC):
    """A part that is read by a thread of its own, so that no loop waits for it."""

    def __init__(self, name: str) -> None:
        """Start to read; ``name`` is for messages.

        Raises:
            ImuError: it gives no sample, or cannot be read.
        """
        self.name = name
        self._sample: ImuSample | None = None
        self._problem = ""
        self._closing, self._come = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._read_on, daemon=True)
        self._thread.start()
        if not self._come.wait(FIRST) or self._sample is None:
            self.close()
            raise ImuError(f"the IMU {name} gave no sample in {FIRST:g} s{self._why()}.")

    @abstractmethod
    def read(self) -> tuple[np.ndarray, ...] | None:
        """Wait for a sample: orientation (4,), turn rate (3,) [rad/s], switches (s,) if any; None: none this time.

        Raises:
            OSError: the part is gone.
            ImuError: what it says cannot be read.
        """

    def latest(self) -> ImuSample | None:
        return self._sample

    def problem(self) -> str:
        return self._problem

    def close(self) -> None:
        self._closing.set()
        self._thread.join(1.0)

    def _why(self) -> str:
        return f": {self._problem}" if self._problem else ""

    def _read_on(self) -> None:
        while not self._closing.is_set():
            try:
                found = self.read()
            except (OSError, ImuError) as error:
                self._problem = str(error).rstrip(".") or type(error).__name__
                self._closing.wait(0.01)
                continue
            if found is not None:
                self._sample, self._problem = ImuSample(monotonic(), *found), ""
                self._come.set()


# --- how an IMU is turned, out of an accelerometer and a gyroscope alone: a complementary filter ---------------------
#
# The gyroscope tells each turn, and the accelerometer slowly where up is, in moments without much other acceleration.
# The heading is what the gyroscope adds up to, and drifts.

GRAVITY = 9.81  # [m/s2]
TRUST = (
    1.0  # [s] in which an error of the tilt goes: of Mahony's filter with a gain of 1/s (Mahony, Hamel, Pflimlin, 2008)
)
QUIET = 0.2  # share of gravity by which a pull may differ from it and still tell where up is; assumed


class Tilt:
    """The filter, sample by sample."""

    def __init__(self, period: float) -> None:
        """Of samples that come every ``period`` [s]."""
        self._period = period
        self._turn: np.ndarray | None = None

    def after(self, pull: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """The turn (4,) with one more sample.

        Args:
            pull: of the accelerometer (3,) [m/s2], which points up at rest.
            rate: of the gyroscope (3,) [rad/s].
        """
        size = float(np.linalg.norm(pull))
        up = pull / max(size, 1e-9)
        if self._turn is None:
            roll, pitch = math.atan2(up[1], up[2]), math.atan2(-up[0], math.hypot(up[1], up[2]))
            self._turn = quaternion(roll, pitch, 0.0)
            return self._turn
        correction = np.zeros(3)
        if abs(size - GRAVITY) < QUIET * GRAVITY:
            correction = np.cross(up, -turns.projected_gravity(self._turn)) / TRUST
        turn = turns.multiply(self._turn, turns.of_vector((rate + correction) * self._period))
        self._turn = turn / np.linalg.norm(turn)
        return self._turn
