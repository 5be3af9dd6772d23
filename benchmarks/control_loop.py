"""The control loop for ten minutes: six servos at 100 Hz on a virtual bus, with faults that must stop it.

    python -m benchmarks.control_loop                # ten minutes; writes benchmarks/results/control_loop.json and .md
    python -m benchmarks.control_loop --seconds 20   # short; prints only

The servos move all the time under safety, a supervisor and a log, as in deploy.py. Each tenth of the run ends with a
fault, of another kind each time, that must stop the loop; a stop that does not come within two cycles is a missed one.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import platform
import sys
import tempfile
import threading
import time
from dataclasses import asdict
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bus import servo_row
from benchmarks.speed import RESULTS
from gap.log import read_measured
from hw.bus import ServoBus
from hw.commands import Trajectory
from hw.deployment import SIGNALS
from hw.loop import ControlLoop, Outcome
from hw.measured_log import MeasuredLog, make_sidecar, read_events
from hw.registers import load_model
from hw.robot import ServoRobot, nominal_joints
from hw.safety import Limits, Safety
from hw.supervisor import Charge, Supervisor
from hw.virtual.control import Control
from hw.virtual.machine import Machine
from hw.virtual.rig import Rig, mounts
from hw.virtual.server import Server
from hw.virtual.wire import Wire

SERVOS, RATE, PARTS = 6, 100.0, 10
OVERRUN_BAR = 0.005
FAULTS: list[dict[str, Any]] = [
    {"kind": "overheat", "servos": [2]},
    {"kind": "drop", "servos": [4]},
    {"kind": "overload", "servos": [6]},
    {"kind": "corrupt", "servos": [1]},
    {"kind": "silence", "servos": [3]},
]
LIMITS = Limits(0.15, 15.0, 1.0, 2.5, 0.25, 65.0, 6.0, 8.6, 0.03, 1)  # as in configs/robot/bench.yaml


def serve(connection: Connection) -> None:
    """A virtual bus with six servos; sends its port and its control socket, and runs until its parent ends it."""
    model = load_model("sts3215")
    machine = Machine(servo_row(SERVOS))
    server = Server(Wire(Rig(machine, model, mounts(machine.names, None, model))))
    connection.send((server.port, server.control))
    server.run()


def sines(seconds: float) -> Trajectory:
    """Six sines, each at a frequency and phase of its own, from near 0."""
    time_ = np.arange(0.0, seconds + 5.0, 1.0 / RATE)
    k = np.arange(SERVOS)
    goals = 0.5 * np.sin(2.0 * np.pi * (0.3 + 0.1 * k) * time_[:, None])
    return Trajectory("sines", time_, goals)


def part(number: int, seconds: float, port: str, control: Control, folder: Path) -> dict[str, Any]:
    """Run for a while, plant a fault, and see what becomes of it."""
    robot_model, servo = servo_row(SERVOS), load_model("sts3215")
    robot = ServoRobot(robot_model, {}, servo, nominal_joints(robot_model, servo, {}), dict(robot_model.chains))
    bus = ServoBus(port)
    log = MeasuredLog(
        folder, f"part{number}", make_sidecar("servo row", {}, robot.belief, {}), robot.names, SIGNALS, ()
    )
    charge = Charge(
        port, 1_000_000, "sts3215", 0.02, robot.ids, "release", 0.5, os.getpid(), str(log.events_path.resolve())
    )
    loop = ControlLoop(
        bus, robot, Safety(robot, LIMITS, 1.0 / RATE), sines(seconds), RATE, log=log, supervisor=Supervisor(charge)
    )
    outcomes: list[Outcome] = []
    thread = threading.Thread(target=lambda: outcomes.append(loop.run(seconds + 4.0)))
    thread.start()
    while thread.is_alive() and (log.rows == 0 or loop.elapsed < seconds):
        time.sleep(0.02)
    early = not thread.is_alive()
    fault = FAULTS[number % len(FAULTS)]
    planted = time.monotonic()
    control.order("fault", **fault)
    thread.join()
    log.close()
    control.order("clear")
    events = read_events(log.path)
    origin = next(event["monotonic"] for event in events if event["event"] == "started")
    data = read_measured(log.path).runs[0]
    after = int((data.host["read_sent"] + origin > planted).sum())
    late = sum(event["event"] == "missed" and event["time"] + origin > planted for event in events)
    outcome = outcomes[0]
    return {
        "fault": fault["kind"],
        "named": outcome.fault.name if outcome.fault else None,
        "cycles_to_stop": after + late,
        "missed": early or outcome.fault is None or after + late > 3,  # the first of three may begin before the fault
        "rest_seconds": outcome.rest_seconds,
        "rows": len(data.time),
        **asdict(outcome.timing),
    }


def main() -> int:
    """Run, print, and write what was measured; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.control_loop", description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="of all parts; others than 600 write nothing")
    seconds = parser.parse_args().seconds
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=serve, args=(there,), daemon=True)
    process.start()
    port, path = here.recv()
    rows: list[dict[str, Any]] = []
    try:
        with tempfile.TemporaryDirectory() as folder:
            for number in range(PARTS):
                row = part(number, seconds / PARTS, port, Control(path), Path(folder))
                rows.append(row)
                print(
                    f"{row['cycles']:6d} cycles, {row['overruns']:4d} overruns; {row['fault']} named {row['named']} "
                    f"after {row['cycles_to_stop']} cycles, released in {1e3 * row['rest_seconds']:.1f} ms",
                    flush=True,
                )
    except KeyboardInterrupt:
        print("Stopped; nothing is written.", file=sys.stderr)
        return 130
    finally:
        process.terminate()
    page = table(rows)
    print("\n" + page)
    if seconds == 600.0:
        RESULTS.mkdir(parents=True, exist_ok=True)
        (RESULTS / "control_loop.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        (RESULTS / "control_loop.md").write_text(page, encoding="utf-8")
    return 0


def table(rows: list[dict[str, Any]]) -> str:
    """The result as a page."""
    cycles, overruns = sum(row["cycles"] for row in rows), sum(row["overruns"] for row in rows)
    share, missed = overruns / max(cycles, 1), sum(row["missed"] for row in rows)
    seconds = cycles / RATE
    verdict = "reached" if share < OVERRUN_BAR and missed == 0 else "missed"
    lines = [
        "# Control loop",
        "",
        f"{SERVOS} virtual servos at {RATE:g} Hz for {seconds:.0f} s; {os.cpu_count()} cores, {platform.machine()}.",
        "`python -m benchmarks.control_loop`",
        "",
        "| | measured | to reach |",
        "|---|---|---|",
        f"| overruns | {100 * share:.2f} % | under {100 * OVERRUN_BAR:g} % |",
        f"| safety stops missed | {missed} of {len(rows)} | 0 |",
        f"| all in all | {verdict} | |",
        f"| cycles begin late by (99 %, worst part) | {1e3 * max(row['late_p99'] for row in rows):.2f} ms | |",
        f"| reading, mean | {1e3 * np.mean([row['read_mean'] for row in rows]):.2f} ms | |",
        f"| reading to command, mean | {1e3 * np.mean([row['command_mean'] for row in rows]):.2f} ms | |",
        f"| processor | {100 * np.mean([row['cpu_share'] for row in rows]):.0f} % of a core | |",
        f"| release after a fault, slowest | {1e3 * max(row['rest_seconds'] for row in rows):.1f} ms | under 100 ms |",
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
