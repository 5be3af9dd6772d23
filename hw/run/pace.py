"""Whether bus, policy and computer keep the pace of the loop: measured before torque comes on, watched from then on."""

from __future__ import annotations

import contextlib
import os
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...common.errors import SealegsError
from ..bus.clock import Timing
from ..bus.imu import ImuSource
from ..bus.interface import Adapter, Bus
from ..bus.registers import ServoModel
from ..machine.robot import ServoRobot

READINGS = 12  # of which the median counts
BUSY = 0.7  # share of a period that reading and policy may take, before goals and log; 18 servos at 100 Hz take 0.6
WINDOW = 1.0  # [s] over which overruns are counted
DEVICES = Path("/sys/bus/usb-serial/devices")
"""Where Linux shows what a USB adapter is set to; only FTDI's have a ``latency_timer`` [ms]."""
SUSTAINED = 0.2  # share of the cycles from which overruns are no accident
SMALL = 0.05  # share of a time that is not worth naming
LIGHTER = "use a smaller network (agent.policy_kwargs.net_arch in training) or a faster computer"
IDLER = "let the computer do less beside"
FASTER = "use a higher baud rate or a faster adapter"


def reading_time(bus: Adapter, ids: Sequence[int]) -> float:
    """How long a reading of all servos takes [s]."""
    port, times = bus.clock, []
    for _ in range(READINGS):
        begun = port.now()
        bus.read_state(ids)
        times.append(port.now() - begun)
    return statistics.median(times)


def at_rate(rate: float) -> str:
    """What to do where no more than ``rate`` cycles a second are possible, and any rate will do [Hz]."""
    return f"give rate={max(int(rate), 1)}"


@dataclass(frozen=True)
class Pace:
    """What a cycle takes, before torque comes on.

    Attributes:
        reading: of all servos, by the slowest adapter [s].
        port: path of that.
        model: of its servos.
        policy: that the goals of a cycle take [s].
        slower: says what to do where no more than a rate [Hz] is possible.
    """

    reading: float
    port: str
    model: ServoModel
    policy: float = 0.0
    slower: Callable[[float], str] = at_rate

    @property
    def possible(self) -> float:
        """Highest rate of the loop [Hz]."""
        return BUSY / max(self.reading + self.policy, 1e-9)

    def sentence(self) -> str:
        """What was measured."""
        what, rate = f"A reading takes {1e3 * self.reading:.2f} ms", f"up to {self.possible:.4g} Hz are possible"
        return f"{what}, the goals of a cycle {1e3 * self.policy:.2f} ms: {rate}."

    def too_slow(self, period: float) -> str | None:
        """A sentence where reading and policy leave a cycle of ``period`` [s] too little time, with what mends it."""
        if self.reading + self.policy <= BUSY * period:
            return None
        told = f"takes {1e3 * self.reading:.1f} ms for a reading"
        if self.policy > self.reading:
            what = f"the policy takes {1e3 * self.policy:.1f} ms for its goals, and the adapter at {self.port} {told}"
            mend = LIGHTER
        else:
            small = self.policy <= SMALL * self.reading
            what = f"the adapter at {self.port} {told}"
            what += "" if small else f", and the policy {1e3 * self.policy:.1f} ms for its goals"
            mend = _faster(self.port, self.model)
        return (
            f"{what}, and a cycle has {1e3 * period:.1f} ms: at {1.0 / period:g} Hz that leaves too little for the "
            f"rest; {_mended(self.reading + self.policy, period, mend, self.slower)}."
        )


def slower_of(commands: object) -> Callable[[float], str]:
    """What a source of goals says to do where its rate is not possible."""
    return getattr(commands, "slower", at_rate)


def measured(bus: Bus, robot: ServoRobot, commands: object, period: float, imu: ImuSource | None = None) -> Pace:
    """What a cycle takes; the policy is tried on a reading of the robot as it is.

    Args:
        bus: open.
        robot: on it.
        commands: source of goals; what can ``rehearse``, as a policy can, does.
        period: of the loop [s].
        imu: of the robot; None: it has none.

    Raises:
        SealegsError: a servo does not answer, or the policy fails.
    """
    sample = None if imu is None else imu.latest()
    reading = robot.reading(
        bus.read_state(robot.all_ids), sample=sample
    )  # with all retries: who is missing here is missing
    rehearse: Callable[..., float] | None = getattr(commands, "rehearse", None)
    policy = 0.0 if rehearse is None else rehearse(reading, period, bus.clock.now)
    adapters = bus.adapters(robot.all_ids)
    times = [(reading_time(adapter, own), adapter) for adapter, own in adapters]
    seconds, slowest = max(times, key=lambda row: row[0])
    return Pace(seconds, slowest.port, slowest.model, policy, slower_of(commands))


def _faster(port: str, model: ServoModel) -> str:
    """What makes an adapter faster."""
    timer = DEVICES / Path(port).resolve().name / "latency_timer"
    if (held := _held(timer)) > 1:
        return f"its latency_timer holds bytes for {held} ms, which `echo 1 | sudo tee {timer}` mends"
    delay = model.role("return_delay")
    prompt = f"let the servos answer without return delay ({model.setting(1, {delay: 0}, port)}), " if delay else ""
    return f"use a higher baud rate or a faster adapter, {prompt}or let the computer do less"


def _held(timer: Path) -> int:
    """How long an adapter holds bytes back [ms]; 0: nothing says so."""
    try:
        return int(timer.read_text())
    except (OSError, ValueError):
        return 0


class Overruns:
    """Share of late cycles, told once where they go on, with what takes the time."""

    def __init__(self, period: float, slower: Callable[[float], str] = at_rate) -> None:
        """Watch a loop of the period ``period`` [s]; ``slower`` as of :func:`too_slow`."""
        self._period, self._slower, self._share, self._counted, self._told = period, slower, 0.0, 0, False
        self._spent = np.zeros(3)

    def seen(self, overruns: int, reading: float, policy: float, work: float) -> str | None:
        """One cycle.

        Args:
            overruns: of all cycles so far.
            reading: time that the reading of this one took [s].
            policy: time that its goals took [s].
            work: time that all of it took [s].

        Returns:
            A sentence, the first time that overruns go on.
        """
        late, self._counted = overruns > self._counted, overruns
        weight = min(self._period / WINDOW, 0.1)
        self._share += weight * (float(late) - self._share)
        spent = np.array([policy, reading, max(work - policy - reading, 0.0)])
        self._spent += (weight if self._spent.any() else 1.0) * (spent - self._spent)
        if self._told or self._share <= SUSTAINED:
            return None
        self._told = True
        total = float(self._spent.sum())
        named = zip(("the policy", "the reading", "all else"), self._spent, strict=True)
        parts = [f"{name} {1e3 * part:.1f} ms" for name, part in named if part > SMALL * total]
        mend = (LIGHTER, FASTER, IDLER)[int(np.argmax(self._spent))]
        return (
            f"more than {100 * SUSTAINED:.0f} % of the cycles come too late: one takes {1e3 * total:.1f} ms "
            f"({', '.join(parts)}) and has {1e3 * self._period:.1f} ms; "
            f"{_mended(total, self._period, mend, self._slower)}."
        )


def _mended(work: float, period: float, mend: str, slower: Callable[[float], str]) -> str:
    """What to do where cycles that take ``work`` come every ``period`` [s]: other programs may make them late."""
    possible = BUSY / max(work, 1e-9)
    if possible >= 1.0 / period:
        return IDLER
    return f"up to {possible:.4g} Hz are possible: {mend}, or {slower(possible)}"


def not_kept(timing: Timing, rate: float, commands: object) -> str | None:
    """A sentence where a run that is over did not keep its rate, with what mends it.

    Args:
        timing: of the run.
        rate: that it was to keep [Hz].
        commands: source of its goals.
    """
    if timing.overrun_share <= SUSTAINED:
        return None
    return (
        f"the rate of {rate:g} Hz was not kept: {100 * timing.overrun_share:.0f} % of {timing.cycles} cycles came too "
        f"late, and {timing.skipped} periods were left out; "
        f"{_mended(timing.busy_share / rate, 1.0 / rate, IDLER, slower_of(commands))}."
    )


# --- real-time priority of the loop, so that other programs do not delay it ------------------------------------------


@contextlib.contextmanager
def realtime(priority: int | None, threads: Sequence[int] = ()) -> Iterator[None]:
    """Run with a first-in-first-out priority of 1 to 99 for the length of a ``with``; None: as any program.

    Threads and processes that are started meanwhile, such as one that draws, are as those of any program.

    Args:
        priority: 1 to 99.
        threads: further threads of this process that a cycle waits for, or that end it, as the system numbers them.

    Raises:
        SealegsError: the system has none, or does not grant it.
    """
    if priority is None:
        yield
        return
    if not hasattr(os, "sched_setscheduler"):
        raise SealegsError("realtime= needs Linux; leave it out here.")
    if not 1 <= priority <= 99:
        raise SealegsError(f"realtime is {priority}; it must be between 1 and 99.")
    everyone = (0, *threads)  # 0: the thread that calls
    before = [(os.sched_getscheduler(thread), os.sched_getparam(thread)) for thread in everyone]

    def give_back() -> None:
        for thread, (policy, parameters) in zip(everyone, before, strict=True):
            with contextlib.suppress(OSError):  # a thread may have ended
                os.sched_setscheduler(thread, policy & ~os.SCHED_RESET_ON_FORK, parameters)

    try:
        for thread in everyone:
            os.sched_setscheduler(thread, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError:
        give_back()
        raise SealegsError(
            f"the system grants no real-time priority {priority}; allow it in this terminal: `sudo prlimit --pid $$ "
            f"--rtprio={priority}`, or leave realtime= out."
        ) from None
    try:
        yield
    finally:
        give_back()
