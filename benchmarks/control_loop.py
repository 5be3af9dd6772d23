"""The control loop for ten minutes: servos at 100 Hz on a virtual bus, with faults that must stop it.

    python -m benchmarks.control_loop                # ten minutes; writes benchmarks/results/control_loop.json and .md
    python -m benchmarks.control_loop --servos 12    # twelve in place of six; control_loop_12.json and .md
    python -m benchmarks.control_loop --seconds 20   # short; prints only

The servos move all the time under safety, a supervisor and a log, as in deploy.py. Each tenth of the run ends with a
fault, of another kind each time, that must stop the loop. A stop is missed if the loop ends without the fault; if it
comes after more than seven cycles that began with the fault in force; under another name or with another servo; if the
virtual machine still shows torque on a servo that can be reached, or showed it 100 ms after the fault was named; or if
the log lacks a cycle.

After each part a bare loop runs for half as long: a process that wakes at the same rate and spins for the processor
time that a cycle of the part took. What it misses is the machine's and not the loop's; so is time that a hypervisor
stole.
"""

from __future__ import annotations

import multiprocessing
import os
import platform
import signal
import sys
import tempfile
import threading
import time
from dataclasses import asdict
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from sealegs.common.errors import SealegsError
from sealegs.common.markdown import page, table
from sealegs.common.processes import end_with_parent
from sealegs.gap.log import read_measured
from sealegs.hw.bus.clock import Metronome
from sealegs.hw.bus.registers import load_model
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.guard.safety import Limits, Safety
from sealegs.hw.guard.stop import Stop
from sealegs.hw.guard.supervisor import Charge, Supervisor
from sealegs.hw.machine.robot import ServoRobot, nominal_joints
from sealegs.hw.run.commands import Trajectory
from sealegs.hw.run.loop import ControlLoop, Outcome
from sealegs.hw.run.measured_log import MeasuredLog, make_sidecar, read_events
from sealegs.hw.virtual.control import Control
from sealegs.hw.virtual.machine import Machine
from sealegs.hw.virtual.rig import Rig, mounts
from sealegs.hw.virtual.server import Server
from sealegs.hw.virtual.wire import Wire

from benchmarks.bus import servo_row
from benchmarks.kept import command, study, write

RATE, PARTS = 100.0, 10
BARE = 0.5  # time of the bare loop over that of a part
SILENCE = 2.0  # [s] of the loop until the supervisor kills it; longer than in deploy.py, so that a stall is counted
OVERRUN_BARS = {6: 0.005, 12: 0.01}  # share of the cycles, by number of servos
STOP_CYCLES, RELEASE_BAR = 7, 0.1
FAULTS: list[dict[str, Any]] = [
    {"kind": "overheat", "servos": [2]},
    {"kind": "drop", "servos": [4]},
    {"kind": "overload", "servos": [6]},
    {"kind": "corrupt", "servos": [1]},
    {"kind": "silence", "servos": [3]},
]
NAMES = {
    "overheat": {"OverheatFault"},
    "drop": {"NoReplyError"},
    "overload": {"OverloadFault"},
    "corrupt": {"CorruptReplyError", "NoReplyError"},  # a flipped bit in both headers leaves no packet at all
    "silence": {"NoReplyError"},
}
SETTLED = 2.0  # [s] after which a fault is over; until then the supervisor tries to reach the servos that it hides
LIMITS = Limits(
    0.15, 15.0, None, None, 0.3, 2.5, 0.25, 65.0, 6.0, 8.6, 0.03, 0.05, 0.1
)  # as in configs/robot/bench.yaml


def serve(servos: int, connection: Connection) -> None:
    """A virtual bus with six servos; sends its port and its control socket, and runs until its parent ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a Ctrl-C in the terminal is the parent's business
    model = load_model("sts3215")
    machine = Machine(servo_row(servos))
    with Server(Wire(Rig(machine, model, mounts(machine.names, None, model)))) as server:
        connection.send((server.port, server.control))
        end_with_parent(server.stop)
        server.run()


def sines(servos: int, seconds: float) -> Trajectory:
    """A sine for each servo, each at a frequency and phase of its own, from near 0."""
    time_ = np.arange(0.0, seconds + 5.0, 1.0 / RATE)
    k = np.arange(servos)
    goals = 0.5 * np.sin(2.0 * np.pi * (0.3 + 0.1 * (k % 6)) * time_[:, None])
    return Trajectory("sines", time_, goals)


def part(servos: int, number: int, seconds: float, port: str, control: Control, folder: Path) -> dict[str, Any]:
    """Run for a while, plant a fault, and see what becomes of it."""
    robot_model, servo = servo_row(servos), load_model("sts3215")
    robot = ServoRobot(robot_model, {}, servo, nominal_joints(robot_model, servo, {}), dict(robot_model.chains))
    bus = ServoBus(port)
    log = MeasuredLog(folder, f"part{number}", make_sidecar("servo row", {}, robot.belief, {}), robot.names, ())
    charge = Charge(
        port, 1_000_000, "sts3215", 0.02, robot.ids, "release", SILENCE, os.getpid(), str(log.events_path.resolve())
    )
    stop = Stop()
    loop = ControlLoop(
        bus,
        robot,
        Safety(robot, LIMITS, 1.0 / RATE),
        sines(servos, seconds),
        RATE,
        log=log,
        supervisor=Supervisor(charge),
        stop=stop,
    )
    ended: list[Outcome | SealegsError] = []

    def work() -> None:
        try:
            ended.append(loop.run(seconds + 4.0))
        except SealegsError as error:
            ended.append(error)

    fault = FAULTS[number % len(FAULTS)]
    planted, before = None, processor_times()
    thread = threading.Thread(target=work)
    thread.start()
    try:
        while thread.is_alive() and (log.rows == 0 or loop.elapsed < seconds):
            if sys.stderr.isatty():
                print(f"\rpart {number + 1} of {PARTS}: {loop.elapsed:3.0f} s ", end="", file=sys.stderr, flush=True)
            time.sleep(0.2)
        if thread.is_alive():
            planted = control.order("fault", **fault)["time"]
            thread.join(SETTLED)
        seen = control.order("status")["servos"]
        control.order("clear")
        thread.join()
    except KeyboardInterrupt:
        stop.ask("Ctrl-C")
        thread.join()
        raise
    finally:
        log.close()
    stolen = stolen_share(before, processor_times())
    (outcome,) = ended
    if isinstance(outcome, SealegsError):
        raise SealegsError(f"part {number + 1} did not start: {outcome}")
    row: dict[str, Any] = {
        "fault": fault["kind"],
        "named": outcome.fault.name if outcome.fault else None,
        "at_rest_after_seconds": outcome.rest_seconds,
        "bus": outcome.bus,
        "stolen": stolen,
        **asdict(outcome.timing),
    }
    if planted is not None:
        row |= stop_of(log.path, fault, outcome, seen, planted, bus.timeout)
    return {**row, "missed": missed_because(row)}


def stop_of(
    path: Path,
    fault: dict[str, Any],
    outcome: Outcome,
    servos: dict[str, dict[str, Any]],
    planted: float,
    timeout: float,
) -> dict[str, Any]:
    """How the loop stopped.

    Args:
        path: of the log.
        fault: that was planted.
        outcome: of the run.
        servos: state of the virtual machine's servos, by id.
        planted: when the fault came into force, on the machine's clock [s].
        timeout: of the bus, which a cycle without its reading has waited for [s].
    """
    begin = next(row["since_monotonic"] - row["since"] for row in servos.values())  # the two clocks differ by this
    events = read_events(path)
    origin = next(event["monotonic"] for event in events if event["event"] == "started")
    data = read_measured(path).runs[0]
    missed = [event["time"] + origin - timeout for event in without_row(events)]
    cycles = int((data.host["read_sent"] + origin > begin + planted).sum())
    cycles += sum(begun > begin + planted for begun in missed)
    reachable = [row for name, row in servos.items() if fault["kind"] != "silence" or int(name) not in fault["servos"]]
    named = [event["time"] + origin for event in events if event["event"] == "fault"]
    off = max(row["since_monotonic"] for row in reachable)
    return {
        "cycles_to_stop": cycles,
        "right_servo": outcome.fault is not None and set(fault["servos"]) <= set(outcome.fault.servos),
        "torque_left_on": sum(row["torque"] for row in reachable),
        "released_after_naming": off - named[0] if named else None,
        "released_after_fault": off - begin - planted,
        "rows": len(data.time),
        "rows_lacking": rows_lacking(events, outcome, len(data.time)),
    }


def without_row(events: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The cycles of a run in which a servo stayed silent: each left an event in place of a row.

    Nor does the way to the start leave rows, but it is no part of the cycles that are counted.
    """
    begun = next((k for k, event in enumerate(events) if event["event"] == "started"), len(events))
    return [event for event in events[begun:] if event["event"] == "missed"]


def rows_lacking(events: list[dict[str, Any]], outcome: Outcome, rows: int) -> int:
    """Cycles that left neither a row nor an event in its place; a fault ends one that the timing does not count."""
    begun = outcome.timing.cycles + (outcome.fault is not None)
    return begun - len(without_row(events)) - rows


def missed_because(row: dict[str, Any]) -> str | None:
    """Why the safety stop of a part counts as missed; None: it does not."""
    if "cycles_to_stop" not in row:
        return f"stopped before the fault, by {row['named']}"
    if row["named"] not in NAMES[row["fault"]] or not row["right_servo"]:
        return f"named {row['named']}" + ("" if row["right_servo"] else ", of another servo")
    if row["cycles_to_stop"] > STOP_CYCLES:
        return f"took {row['cycles_to_stop']} cycles"
    if row["rows_lacking"]:
        return f"the log lacks {row['rows_lacking']} cycles"
    if row["torque_left_on"]:
        return f"{row['torque_left_on']} servos have torque"
    if row["released_after_naming"] > RELEASE_BAR:
        return f"released {1e3 * row['released_after_naming']:.0f} ms after the fault was named"
    return None


# --- what the machine alone costs a loop -----------------------------------------------------------------------------
#
# A loop that shares its computer, or whose computer is a virtual machine, is late through no fault of its own. A bare
# one has no bus, no log and no other process to wait for: what it misses, no loop of that rate and work keeps here.

STAT = Path("/proc/stat")
STEAL, COUNTED = 7, 8  # place of the stolen time behind the name of a row, and columns that add up to all time; proc(5)
NOWHERE = float("nan")


def spin(rate: float, seconds: float, need: float, connection: Connection) -> None:
    """Wake at a fixed rate and keep the processor for a while in each cycle; sends the timing.

    Args:
        rate: [Hz].
        seconds: for how long.
        need: processor time that a cycle takes [s].
        connection: for the timing.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # its parent ends it
    metronome = Metronome(rate)
    end = metronome.wait() + seconds
    while metronome.wait() < end:
        until = time.thread_time() + need  # who is interrupted has still to do the rest
        while time.thread_time() < until:
            pass
        metronome.done(NOWHERE, NOWHERE)
    connection.send(asdict(metronome.timing()))


def bare_loop(rate: float, seconds: float, need: float) -> dict[str, Any]:
    """Timing of :func:`spin` in a process of its own, with the share of stolen time meanwhile."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=spin, args=(rate, seconds, need, there), daemon=True)
    process.start()
    there.close()
    before = processor_times()
    try:
        timing = here.recv()
    finally:
        process.terminate()
        process.join()
    return {**timing, "need": need, "stolen": stolen_share(before, processor_times())}


def processor_times() -> tuple[int, int] | None:
    """Time that the hypervisor gave to others, and all time, of all processors [ticks]; None: nobody counts it."""
    try:
        columns = [int(word) for word in STAT.read_text().splitlines()[0].split()[1 : 1 + COUNTED]]
    except (OSError, ValueError, IndexError):
        return None
    return (columns[STEAL], sum(columns)) if len(columns) == COUNTED else None


def stolen_share(before: tuple[int, int] | None, after: tuple[int, int] | None) -> float | None:
    """Stolen time over all time between two counts; None: not known."""
    if before is None or after is None or after[1] <= before[1]:
        return None
    return (after[0] - before[0]) / (after[1] - before[1])


# --- command ---------------------------------------------------------------------------------------------------------


@study
def main() -> None:
    """Run, print, and write what was measured."""
    parser = command(__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="of all parts; others than 600 write nothing")
    parser.add_argument("--servos", type=int, choices=tuple(OVERRUN_BARS), default=6)
    arguments = parser.parse_args()
    seconds, servos = arguments.seconds, arguments.servos
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=serve, args=(servos, there), daemon=True)
    process.start()
    rows: list[dict[str, Any]] = []
    try:
        port, path = here.recv()
        with tempfile.TemporaryDirectory() as folder:
            for number in range(PARTS):
                row = part(servos, number, seconds / PARTS, port, Control(path), Path(folder))
                need = row["cpu_share"] / RATE * (1.0 + row["skipped"] / max(row["cycles"], 1))
                rows.append({**row, "bare": bare_loop(RATE, BARE * seconds / PARTS, need)})
                print(f"\r{line(rows[-1])}", flush=True)
    finally:
        process.terminate()
        process.join()
    machine = {"cores": os.cpu_count(), "processor": platform.machine(), "load": os.getloadavg()[0]}
    print("\n" + told(servos, rows, machine))
    if seconds == 600.0:
        name = "control_loop" if servos == 6 else f"control_loop_{servos}"
        write(name, told(servos, rows, machine), {"machine": machine, "rows": rows})


def line(row: dict[str, Any]) -> str:
    """A part, for the terminal."""
    stop = f"{row['fault']} named {row['named']}"
    if "cycles_to_stop" in row:
        stop += f" after {row['cycles_to_stop']} cycles, released {1e3 * row['released_after_naming']:.1f} ms later"
    return f"{row['cycles']:6d} cycles, {row['overruns']:4d} overruns; {row['missed'] or stop}"


def told(servos: int, rows: list[dict[str, Any]], machine: dict[str, Any]) -> str:
    """The result as a page."""
    cycles, overruns = sum(row["cycles"] for row in rows), sum(row["overruns"] for row in rows)
    share, skipped = overruns / max(cycles, 1), sum(row["skipped"] for row in rows)
    missed = [f"part {number}: {row['missed']}" for number, row in enumerate(rows, 1) if row["missed"]]
    stopped = [row for row in rows if "cycles_to_stop" in row]
    named, fault = (
        max((row[key] for row in stopped), default=float("nan"))
        for key in ("released_after_naming", "released_after_fault")
    )
    bar = OVERRUN_BARS[servos]
    bare_cycles, bare_overruns = (sum(row["bare"][key] for row in rows) for key in ("cycles", "overruns"))
    stolen, bare_stolen = _share([row["stolen"] for row in rows]), _share([row["bare"]["stolen"] for row in rows])
    cells = (
        ("overruns", f"{100 * share:.2f} %", f"under {100 * bar:g} %", _verdict(share < bar)),
        ("overruns of a bare loop", f"{100 * bare_overruns / max(bare_cycles, 1):.2f} %", "", "the machine's own"),
        ("processor time stolen by the hypervisor", f"{stolen}; {bare_stolen} from the bare loop", "", ""),
        ("safety stops missed", f"{len(missed)} of {len(rows)}", "0", _verdict(not missed)),
        ("cycles from fault to stop, most", max((row["cycles_to_stop"] for row in stopped), default="-"), STOP_CYCLES,
         ""),
        ("fault named to torque off, slowest", f"{1e3 * named:.1f} ms", f"{1e3 * RELEASE_BAR:g} ms", ""),
        ("fault in force to torque off, slowest", f"{1e3 * fault:.1f} ms", "", ""),
        ("periods left out", f"{skipped} of {cycles + skipped}", "", ""),
        ("bare loop begins late by (99 %, worst part)",
         f"{1e3 * max(row['bare']['late_p99'] for row in rows):.2f} ms", "", ""),
        ("cycles begin late by (99 %, worst part)", f"{1e3 * max(row['late_p99'] for row in rows):.2f} ms", "", ""),
        ("cycles begin late by (worst)", f"{1e3 * max(row['late_worst'] for row in rows):.2f} ms", "", ""),
        ("reading, mean", f"{1e3 * np.mean([row['read_mean'] for row in rows]):.2f} ms", "", ""),
        ("reading to command, mean", f"{1e3 * np.mean([row['command_mean'] for row in rows]):.2f} ms", "", ""),
        ("processor", f"{100 * np.mean([row['cpu_share'] for row in rows]):.0f} % of a core", "", ""),
    )  # fmt: skip
    return page(
        "Control loop",
        f"{servos} virtual servos at {RATE:g} Hz for {(cycles + skipped) / RATE:.0f} s, {PARTS} faults in between; "
        f"{machine['cores']} cores, {machine['processor']}, load average {machine['load']:.1f}.\n"
        f"`python -m benchmarks.control_loop{'' if servos == 6 else f' --servos {servos}'}`",
        table(("", "measured", "to reach", ""), cells),
        "Torque as the virtual machine records it, on every servo that can be reached. Cycles that wait for a reply "
        "that a fault keeps back overrun, and count. The bare loop runs after each part, for half as long, at the same "
        f"rate. It sleeps, spins for the {1e3 * np.mean([row['bare']['need'] for row in rows]):.1f} ms of processor "
        "time that a cycle of the part took, and counts overruns alike. It waits for nobody: what it misses is the "
        "machine's.",
        *(f"Missed, {text}." for text in missed),
    )


def _share(shares: list[float | None]) -> str:
    known = [share for share in shares if share is not None]
    return f"{100 * np.mean(known):.1f} %" if known else "not counted here"


def _verdict(reached: bool) -> str:
    return "reached" if reached else "**missed**"


if __name__ == "__main__":
    sys.exit(main())
