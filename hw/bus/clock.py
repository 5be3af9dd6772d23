"""A fixed rate without a busy wait, and how well it was kept."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...common.errors import SealegsError

LOWEST_RATE, HIGHEST_RATE = 0.5, 1000.0  # [Hz]


class Clock(Protocol):
    """What tells the time, and lets it pass."""

    @property
    def simulated(self) -> bool:
        """Whether it waits for whoever asks it: it then tells nothing of the host."""
        ...

    def now(self) -> float:
        """Monotonic [s]."""
        ...

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        ...


class HostClock:
    """The host's monotonic clock."""

    simulated = False

    def now(self) -> float:
        """[s]."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Leave the processor to others."""
        time.sleep(seconds)


@dataclass(frozen=True)
class Timing:
    """How well a loop kept its rate.

    Attributes:
        cycles: done.
        overruns: cycles whose work did not end before the next one was due.
        skipped: periods left out because of overruns.
        late_p99, late_worst: how late cycles began [s].
        busy_share: part of the period that the work of a cycle took, in the mean.
        read_mean, read_p99: from the request for the readings to the last reply [s].
        policy_mean: that the goals of a cycle took, of a policy or what else gives them [s].
        command_mean, command_p99: from the middle of the reading to the goals on the wire [s].
        cpu_share: processor time of the loop's process over wall time.
        stepped: whether time was the machine's, which waited for the loop: nothing then says how fast that was.
    """

    cycles: int
    overruns: int
    skipped: int
    late_p99: float
    late_worst: float
    busy_share: float
    read_mean: float
    read_p99: float
    command_mean: float
    command_p99: float
    cpu_share: float
    stepped: bool = False
    policy_mean: float = 0.0

    @property
    def overrun_share(self) -> float:
        """Overruns over cycles."""
        return self.overruns / max(self.cycles, 1)

    def sentence(self) -> str:
        """For people."""
        if self.stepped:
            return f"{self.cycles} cycles, {self.overruns} overruns; in stepped time, which waits for the loop."
        return (
            f"{self.cycles} cycles, {self.overruns} overruns ({100 * self.overrun_share:.2f} %), began late by "
            f"{1e3 * self.late_p99:.2f} ms (99 %) and {1e3 * self.late_worst:.2f} ms (worst), reading "
            f"{1e3 * self.read_mean:.2f} ms, goals made in {1e3 * self.policy_mean:.2f} ms, reading to command "
            f"{1e3 * self.command_mean:.2f} ms, "
            f"{100 * self.cpu_share:.0f} % of a core."
        )


class Metronome:
    """Wakes a loop at a fixed rate; the processor sleeps in between.

    Attributes:
        period: [s].
        cycles: done so far.
        overruns: of them.
    """

    def __init__(self, rate: float, expected: int = 1 << 16, clock: Clock | None = None) -> None:
        """Begin to count with the first :meth:`wait`.

        Args:
            rate: cycles per second [Hz].
            expected: cycles to make room for.
            clock: other than the host's, such as a simulated port's.

        Raises:
            SealegsError: the rate is no rate.
        """
        if not LOWEST_RATE <= rate <= HIGHEST_RATE:
            raise SealegsError(f"the rate is {rate:g} Hz; it must be between {LOWEST_RATE:g} and {HIGHEST_RATE:g} Hz.")
        self.period = 1.0 / rate
        self._clock: Clock = clock or HostClock()
        self._due: float | None = None
        self._times = np.zeros((5, max(expected, 16)))  # late, work, read, command, policy; grown when full
        self.cycles, self.overruns, self._skipped = 0, 0, 0
        self._began = self._woke = self._cpu = 0.0
        self._ended: tuple[float, float] | None = None

    def now(self) -> float:
        """Of the clock [s]."""
        return self._clock.now()

    def hold(self, time: float) -> None:
        """Wait within a cycle until ``time`` [s]; not at all where it has passed."""
        if (left := time - self.now()) > 0.0:
            self._clock.sleep(left)

    def wait(self) -> float:
        """Sleep until the next cycle is due; :meth:`now` at its beginning [s]."""
        now = self._clock.now()
        if self._due is None:
            self._due = self._began = now
            self._cpu = time.process_time()
        else:
            self._due += self.period
            behind = now - self._due
            if behind > 0.0:
                self.overruns += 1
                whole = int(behind / self.period)  # cycles that cannot be made up for are left out, not hurried through
                self._skipped += whole
                self._due += whole * self.period
            else:
                self._clock.sleep(-behind)
        self._woke = self._clock.now()
        return self._woke

    def restart(self) -> None:
        """Count and keep time anew from the next :meth:`wait` on."""
        self._due = self._ended = None
        self.cycles, self.overruns, self._skipped = 0, 0, 0

    def stop(self) -> None:
        """The last cycle has ended: what is done from now on is not the loop's."""
        self._ended = self.now(), time.process_time()

    def done(self, read: float, command: float, policy: float = math.nan) -> float:
        """Count a cycle, at the end of its work.

        Args:
            read: time that the reading took [s].
            command: from the middle of the reading to the goals on the wire [s].
            policy: time that the goals took [s].

        Returns:
            Time that all of it took [s].
        """
        assert self._due is not None
        if self.cycles == self._times.shape[1]:
            self._times = np.concatenate([self._times, np.zeros_like(self._times)], axis=1)
        work = self.now() - self._woke
        self._times[:, self.cycles] = self._woke - self._due, work, read, command, policy
        self.cycles += 1
        return work

    def timing(self) -> Timing:
        """How well the rate was kept so far."""
        late, work, *parts = self._times[:, : max(self.cycles, 1)]
        ended, cpu = self._ended or (self.now(), time.process_time())
        wall = max(ended - self._began, 1e-9)
        return Timing(
            cycles=self.cycles,
            overruns=self.overruns,
            skipped=self._skipped,
            late_p99=float(np.quantile(late, 0.99)),
            late_worst=float(late.max()),
            busy_share=float(work.mean() / self.period),
            read_mean=_mean(parts[0]),
            read_p99=_p99(parts[0]),
            command_mean=_mean(parts[1]),
            command_p99=_p99(parts[1]),
            cpu_share=(cpu - self._cpu) / wall if self._began else 0.0,
            stepped=self._clock.simulated,
            policy_mean=_mean(parts[2]),
        )


def _mean(times: np.ndarray) -> float:
    """Of those that are known; 0 where none is."""
    return float(np.nanmean(times)) if np.isfinite(times).any() else 0.0


def _p99(times: np.ndarray) -> float:
    return float(np.nanquantile(times, 0.99)) if np.isfinite(times).any() else 0.0
