"""Cycles per second of the servo bus, over those of bare SDK calls for the same transactions on the same port.

    python -m benchmarks.bus            # a minute; writes benchmarks/results/bus.json and bus.md
    python -m benchmarks.bus --quick    # a few seconds; prints only

A cycle is one SYNC_WRITE of goals and one SYNC_READ of registers 56 to 70. The servos are virtual, with the timing of
a wire at 1 Mbit/s; both sides drive the same ones, in one process, in turns of a fraction of a second. The bus
uses the replies that came and asks the others once more, as in the control loop; a bare cycle that fails is none.

What other programs do meanwhile changes that ratio: the SDK waits in a busy loop, the bus in the kernel. So the
processor time of a cycle is measured too, with replies that are there at once, and from it the ratio on a machine that
waits for nothing but the wire.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import platform
import signal
import sys
import time
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from typing import Any

import mujoco
import numpy as np
import scservo_sdk as sdk
from sealegs.actuators import DrivenCoordinate
from sealegs.common.markdown import page, table
from sealegs.common.processes import end_with_parent
from sealegs.envs.engine.robot import Robot
from sealegs.hw.bus.packets import ReplyError
from sealegs.hw.bus.registers import load_model
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.virtual.machine import Machine
from sealegs.hw.virtual.protocol import SYNC_READ, status_packet
from sealegs.hw.virtual.rig import Rig, mounts
from sealegs.hw.virtual.server import Server
from sealegs.hw.virtual.wire import Wire

from benchmarks.kept import command, study, write

COUNTS = (1, 3, 6, 12, 18)
BAR = 0.95
CYCLE = 0.05  # [s] in which a servo that stayed silent is asked again
QUIET, LONGEST = 0.004, 0.05  # [s] without a byte, after a failure; as in sealegs.hw.bus.port
FAIR = 0.3  # share of what the bytes allow that bare SDK calls must reach for a ratio to mean something
BAUDRATE = 1_000_000
GOAL, GOAL_BYTES, BLOCK, BLOCK_BYTES = 42, 2, 56, 15


def servo_row(count: int) -> Robot:
    """So many servos side by side, each with a small pendulum."""

    def build(_: Mapping[str, float]) -> mujoco.MjSpec:
        spec = mujoco.MjSpec()
        spec.option.timestep = 0.001
        for k in range(count):
            arm = spec.worldbody.add_body(name=f"arm{k}", mass=0.1, ipos=(0, 0, -0.05), explicitinertial=True)
            arm.inertia = (1e-4, 1e-4, 1e-5)
            arm.add_joint(name=f"joint{k}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0.0, -1.0, 0.0))
        return spec

    names = [f"joint{k}" for k in range(count)]
    return Robot(
        name="servo row",
        numbers={},
        coordinates=tuple(DrivenCoordinate.of_joint(name) for name in names),
        goal_limits=lambda _: dict.fromkeys(names, (-math.pi, math.pi)),
        chains=dict.fromkeys(names, "sts3215"),
        build=build,
    )


def serve(count: int, connection: Connection) -> None:
    """A virtual bus with so many servos; sends its port, and runs until its parent ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a Ctrl-C in the terminal is the parent's business
    model = load_model("sts3215")
    machine = Machine(servo_row(count))
    with Server(Wire(Rig(machine, model, mounts(machine.names, None, model)))) as server:
        connection.send(server.port)
        end_with_parent(server.stop)
        server.run()


def bare_cycle(port: str, ids: list[int]) -> tuple[Callable[[list[int]], bool], Callable[[], None]]:
    """A cycle of SDK calls and nothing else, and what closes its port."""
    handler = sdk.PortHandler(port)
    handler.openPort()
    handler.setBaudRate(BAUDRATE)
    serial = handler.ser
    assert serial is not None
    packets = sdk.PacketHandler(0)
    calls = bare_calls(handler, packets, ids)

    def cycle(goals: list[int]) -> bool:
        if calls(goals) == sdk.COMM_SUCCESS:
            return True
        # servos may be late: what they still send is no answer to the next request; waited for as the bus does
        quiet_since = begin = time.perf_counter()
        while (now := time.perf_counter()) < min(quiet_since + QUIET, begin + LONGEST):
            if serial.read(256):
                quiet_since = now
        return False

    return cycle, handler.closePort


def bare_calls(handler: sdk.PortHandler, packets: Any, ids: list[int]) -> Callable[[list[int]], int]:
    """The SDK's calls of a cycle; they return its result."""
    writer = sdk.GroupSyncWrite(handler, packets, GOAL, GOAL_BYTES)
    reader = sdk.GroupSyncRead(handler, packets, BLOCK, BLOCK_BYTES)
    for servo in ids:
        writer.addParam(servo, [0, 8])
        reader.addParam(servo)

    def calls(goals: list[int]) -> int:
        for servo, goal in zip(ids, goals, strict=True):
            writer.changeParam(servo, [sdk.SCS_LOBYTE(goal), sdk.SCS_HIBYTE(goal)])
        writer.txPacket()
        return reader.txRxPacket()

    return calls


def rate(cycle: Callable[[list[int]], bool], count: int, seconds: float) -> tuple[float, int]:
    """Successful cycles per second, and how many failed."""
    begin, cycles, failed = time.perf_counter(), 0, 0
    while (passed := time.perf_counter() - begin) < seconds:
        if cycle([2048 + round(200 * math.sin(6.0 * passed))] * count):
            cycles += 1
        else:
            failed += 1
    return cycles / passed, failed


def measure(count: int, rounds: int, seconds: float) -> dict[str, Any]:
    """Both sides with so many servos, in turns."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=serve, args=(count, there), daemon=True)
    process.start()
    ids = list(range(1, count + 1))
    try:
        port = here.recv()
        bare, close = bare_cycle(port, ids)
        with ServoBus(port, BAUDRATE) as bus:

            def ours(goals: list[int]) -> bool:
                bus.write_goal_steps(ids, goals)
                try:
                    return not bus.read_cycle(ids, until=bus.clock.now() + CYCLE).missing
                except ReplyError:
                    return False

            for side in (bare, ours):
                rate(side, count, 0.2)
            found = [(rate(ours, count, seconds), rate(bare, count, seconds)) for _ in range(rounds)]
            failures = dict(bus.counts)
        close()
    finally:
        process.terminate()
        process.join()
    speeds = np.array([(a, b) for (a, _), (b, _) in found])
    ours_rate, bare_rate = speeds.mean(axis=0)
    ratios = [a / b if b > 0.0 else math.inf for a, b in speeds]  # a turn in which the SDK had no reply at all
    low, high = np.percentile(ratios, (25, 75), method="nearest")
    wire = 1.0 / wire_rate(count)
    cpu, bare_cpu = processor_time(count)
    return {
        "servos": count,
        "cycles_per_second": float(ours_rate),
        "bare_cycles_per_second": float(bare_rate),
        "wire_cycles_per_second": wire_rate(count),
        "ratio": float(ours_rate / bare_rate) if bare_rate > 0.0 else None,
        "ratio_low": float(low) if math.isfinite(low) else None,
        "ratio_high": float(high) if math.isfinite(high) else None,
        "cpu_microseconds": 1e6 * cpu,
        "bare_cpu_microseconds": 1e6 * bare_cpu,
        "ratio_alone": (wire + bare_cpu) / (wire + cpu),
        "bar": BAR,
        "failed_cycles": sum(ours[1] for ours, _ in found),
        "bare_failed_cycles": sum(bare[1] for _, bare in found),
        "failures": failures,
    }


class ReadyReplies:
    """Stands for a serial port at which the replies to a SYNC_READ are there at once."""

    def __init__(self, ids: list[int]) -> None:
        self._replies = b"".join(status_packet(servo, 0, bytes(BLOCK_BYTES)) for servo in ids)
        self._input = b""
        self.in_waiting = 0

    def write(self, data: bytes) -> int:
        """Take a request."""
        self._input = self._replies if bytes(data)[4] == SYNC_READ else b""
        return len(data)

    def read(self, size: int) -> bytes:
        """Up to ``size`` bytes."""
        taken, self._input = self._input[:size], self._input[size:]
        return taken

    def flush(self) -> None:
        """Nothing is left to send."""

    def close(self) -> None:
        """Nothing is open."""


def processor_time(count: int) -> tuple[float, float]:
    """Processor time of a cycle [s], of the bus and of bare SDK calls: the least of several repeats."""
    ids = list(range(1, count + 1))
    master, slave = os.openpty()
    try:
        bus = ServoBus(os.ttyname(slave), BAUDRATE)
        handler, packets = sdk.PortHandler(""), sdk.PacketHandler(0)
        bus.line.port.ser = handler.ser = ReadyReplies(ids)  # pyright: ignore[reportAttributeAccessIssue]
        handler.tx_time_per_byte = 1e4 / BAUDRATE
        bare = bare_calls(handler, packets, ids)
        goals = [2048] * count

        def ours() -> None:
            bus.write_goal_steps(ids, goals)
            bus.read_cycle(ids, until=bus.clock.now() + CYCLE)

        return _least(ours), _least(lambda: bare(goals))
    finally:
        os.close(master)
        os.close(slave)


def _least(cycle: Callable[[], object], repeats: int = 15, cycles: int = 200) -> float:
    spent = []
    for _ in range(repeats):
        begin = time.process_time()
        for _ in range(cycles):
            cycle()
        spent.append((time.process_time() - begin) / cycles)
    return min(spent)


def wire_rate(count: int) -> float:
    """Cycles per second that the bytes alone would allow."""
    sent = (8 + count * (1 + GOAL_BYTES)) + (8 + count)
    return BAUDRATE / 10.0 / (sent + count * (6 + BLOCK_BYTES))


def told(rows: list[dict[str, Any]], machine: dict[str, Any]) -> str:
    """The results as a page of Markdown."""
    rates = (
        (row["servos"], f"{row['cycles_per_second']:,.0f}", f"{row['bare_cycles_per_second']:,.0f}",
         f"{row['wire_cycles_per_second']:,.0f}", _shown(row["ratio"]),
         f"{_shown(row['ratio_low'])} to {_shown(row['ratio_high'])}", f"{row['bar']:.2f}", _verdict(row),
         f"{row['failed_cycles']}, {row['bare_failed_cycles']}")
        for row in rows
    )  # fmt: skip
    times = ((row["servos"], f"{row['cpu_microseconds']:.0f}", f"{row['bare_cpu_microseconds']:.0f}",
              f"{row['ratio_alone']:.2f}") for row in rows)  # fmt: skip
    heads = ("servos", "cycles/s", "bare SDK", "bytes alone", "ratio", "quartiles", "bar", "", "failed")
    return page(
        "Servo bus",
        f"Written by `python -m benchmarks.bus`; {machine['cores']} cores, Python {machine['python']}, load average "
        f"{machine['load']:.1f}. A cycle is one SYNC_WRITE of goals and one SYNC_READ of registers 56 to 70 on the "
        "virtual bus, which keeps the time of the bytes at 1 Mbit/s. Turns of both sides alternate. Failed: cycles "
        "without all replies, of the bus and of the SDK; they take their time and do not count.",
        table(heads, rates),
        "Where the machine was too busy, other programs kept it so that bare SDK calls reached less than "
        f"{FAIR:.0%} of what the bytes allow: the ratio then says nothing. Repeat it without other load."
        * any(map(_too_busy, rows)),
        "Processor time of a cycle, with replies that are there at once, and the ratio that follows where nothing but "
        "the bytes' time is added; what it takes to be woken is not in it.",
        table(("servos", "bus, us", "bare SDK, us", "ratio"), times),
    )


def _too_busy(row: dict[str, Any]) -> bool:
    return row["bare_cycles_per_second"] < FAIR * row["wire_cycles_per_second"]


def _verdict(row: dict[str, Any]) -> str:
    if _too_busy(row):
        return "machine too busy"
    return "reached" if row["ratio"] >= row["bar"] else "**missed**"


def _shown(ratio: float | None) -> str:
    """A ratio; None where the SDK had no reply in a whole turn."""
    return f"{ratio:.2f}" if ratio is not None else "-"


@study
def main() -> int:
    """Measure all counts; return the exit status."""
    parser = command(__doc__)
    parser.add_argument("--quick", action="store_true", help="short turns; prints, writes nothing")
    quick = parser.parse_args().quick
    rows = []
    for count in COUNTS:
        print(f"{count:3d} servos: ", end="", flush=True)
        rows.append(measure(count, 3 if quick else 20, 0.5))
        print(f"ratio {_shown(rows[-1]['ratio'])}", flush=True)
    machine = {"cores": os.cpu_count(), "python": platform.python_version(), "load": os.getloadavg()[0]}
    print("\n" + told(rows, machine))
    if any(_too_busy(row) for row in rows):
        print("Nothing is written: the machine was too busy to compare.", file=sys.stderr)
        return 1
    if not quick:
        write("bus", told(rows, machine), {"machine": machine, "rows": rows})
    return 0


if __name__ == "__main__":
    sys.exit(main())
