"""What a person sees of a run, in the terminal; drawn by a thread of its own, a few times a second."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Iterator

from rich.console import Console
from rich.live import Live
from rich.table import Table

from .loop import ControlLoop

PERIOD = 0.25  # [s] between two pictures
STALE = 0.5  # [s] after which a reading is no longer how the robot is
SWITCH = 5e-4  # [s] that the drawing thread may keep the interpreter from the loop; Python's default is 5 ms


def picture(loop: ControlLoop) -> Table:
    """The state of the loop as a table."""
    cut, cycles, overruns = loop.safety.cut, *loop.counts
    failures = ", ".join(f"{name} {count}" for name, count in loop.bus.counts.items()) or "none"
    title = f"{loop.elapsed:6.1f} s   {cycles} cycles, {overruns} overruns   goals cut: {sum(cut.values())}"
    title += f"   bus: {failures}"
    stale = loop.state not in ("start", "running", "sitting down") or loop.reading_age > STALE
    caption = "Ctrl-C stops"
    if loop.state == "NOT AT REST":
        caption = "TORQUE MAY BE ON: CUT THE POWER. Ctrl-C ends the wait"
    if stale:
        title = f"STALE ({loop.state}), last reading {loop.reading_age:.1f} s ago   " + title
    table = Table(
        title=title, title_justify="left", caption=caption, caption_justify="left", style="dim" if stale else ""
    )
    units = list(dict.fromkeys(loop.robot.units))
    place, speed = " or ".join(units), " or ".join(f"{unit}/s" for unit in units)
    for name in (
        "joint",
        f"goal [{place}]",
        f"position [{place}]",
        f"speed [{speed}]",
        "duty",
        "current [A]",
        "[V]",
        "[°C]",
    ):
        table.add_column(name, justify="left" if name == "joint" else "right")
    reading = loop.reading
    if reading is None:
        return table
    for k, joint in enumerate(loop.robot.joints):
        values = (reading.velocity[k], reading.duty[k], reading.current[k])
        table.add_row(
            f"{joint.name} ({joint.address})",
            f"{loop.sent[k]:+.3f}",
            f"{reading.position[k]:+.3f}",
            *(f"{value:+.2f}" for value in values),
            f"{reading.voltage[k]:.1f}",
            f"{reading.temperature[k]:.0f}",
        )
    return table


@contextlib.contextmanager
def live_view(loop: ControlLoop, wanted: bool) -> Iterator[None]:
    """Draw the loop while the block runs, if ``wanted`` and the output is a terminal."""
    console = Console()
    if not (wanted and console.is_terminal):
        yield
        return
    done = threading.Event()
    interval = sys.getswitchinterval()

    def draw() -> None:
        with Live(picture(loop), console=console, auto_refresh=False, transient=True) as live:
            while not done.wait(PERIOD):
                live.update(picture(loop), refresh=True)

    thread = threading.Thread(target=draw, daemon=True)
    sys.setswitchinterval(SWITCH)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join(2.0)
        sys.setswitchinterval(interval)
