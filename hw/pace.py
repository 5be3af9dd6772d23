"""Whether bus and computer keep the pace of the loop: measured before torque comes on, watched while it is on."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from pathlib import Path

from .interface import Adapter
from .registers import ServoModel

READINGS = 12  # of which the median counts
BUSY = 0.7  # share of a period that a reading may take, before policy, goals and log; 18 servos at 100 Hz take 0.6
WINDOW = 1.0  # [s] over which overruns are counted
DEVICES = Path("/sys/bus/usb-serial/devices")
"""Where Linux shows what a USB adapter is set to; only FTDI's have a ``latency_timer`` [ms]."""
SUSTAINED = 0.2  # share of the cycles from which overruns are no accident


def reading_time(bus: Adapter, ids: Sequence[int]) -> float:
    """How long a reading of all servos takes [s]."""
    port, times = bus.clock, []
    for _ in range(READINGS):
        begun = port.now()
        bus.read_state(ids)
        times.append(port.now() - begun)
    return statistics.median(times)


def too_slow(seconds: float, period: float, port: str, model: ServoModel) -> str | None:
    """A sentence where readings leave a cycle no time, with what mends it.

    Args:
        seconds: that a reading takes.
        period: of the loop [s].
        port: path of the adapter.
        model: of the servos.
    """
    if seconds <= BUSY * period:
        return None
    rate = max(int(BUSY / seconds), 1)
    timer = DEVICES / Path(port).resolve().name / "latency_timer"
    delay = model.role("return_delay")
    prompt = f"let the servos answer without return delay ({model.setting(1, {delay: 0}, port)}), " if delay else ""
    mend = f"use a higher baud rate or a faster adapter, {prompt}or let the computer do less"
    if (held := _held(timer)) > 1:
        mend = f"its latency_timer holds bytes for {held} ms, which `echo 1 | sudo tee {timer}` mends"
    return (
        f"the adapter at {port} takes {1e3 * seconds:.1f} ms for a reading, and a cycle has {1e3 * period:.1f} ms: at "
        f"{1.0 / period:g} Hz that leaves too little for the rest; {mend}, or give rate={rate}."
    )


def _held(timer: Path) -> int:
    """How long an adapter holds bytes back [ms]; 0: nothing says so."""
    try:
        return int(timer.read_text())
    except (OSError, ValueError):
        return 0


class Overruns:
    """Share of late cycles, told once where they go on."""

    def __init__(self, period: float) -> None:
        """Watch a loop of the period ``period`` [s]."""
        self._period, self._share, self._counted, self._told = period, 0.0, 0, False

    def seen(self, overruns: int, reading: float) -> str | None:
        """One cycle.

        Args:
            overruns: of all cycles so far.
            reading: time that the reading of this one took [s].

        Returns:
            A sentence, the first time that overruns go on.
        """
        late, self._counted = overruns > self._counted, overruns
        weight = min(self._period / WINDOW, 0.1)
        self._share += weight * (float(late) - self._share)
        if self._told or self._share <= SUSTAINED:
            return None
        self._told = True
        return (
            f"more than {100 * SUSTAINED:.0f} % of the cycles come too late: one takes longer than its "
            f"{1e3 * self._period:.1f} ms, of which the reading took {1e3 * reading:.1f} ms; lower the rate, or let "
            "the computer do less beside."
        )
