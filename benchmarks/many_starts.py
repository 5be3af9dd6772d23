"""Committed policies from many starts on the virtual bus: how their runs end, and whether their models show a gap.

    python -m benchmarks.many_starts ends                 50 ends of each policy that have no row yet
    python -m benchmarks.many_starts gaps hopper/seed0    20 comparisons of one with a machine that hides nothing
    python -m benchmarks.many_starts hidden               a comparison of each with a machine that hides friction
    python -m benchmarks.many_starts ends --again         all anew

Time is simulated: the figures do not depend on the computer. A run is ended at a moment that is drawn, in whatever
state the policy has left the robot, and what it is asked for is drawn too. It ends well without a fault, with torque
off or, where the robot is held, with servos that bear that. For a comparison the adapter holds every reply for a time
that is drawn for each start, which the models know nothing of: a reading is late, and goals are too.
"""

from __future__ import annotations

import dataclasses
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from sealegs.agents.export import export_policy
from sealegs.common.markdown import page, table
from sealegs.configs.compose import compose, split
from sealegs.envs.contract import task_of
from sealegs.evaluation.comparison import compare, verdict
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.guard.safety import Limits, Safety
from sealegs.hw.machine.robot import build_robot
from sealegs.hw.run.commands import PolicyCommands, park_motion
from sealegs.hw.run.loop import ControlLoop
from sealegs.hw.run.policy import Policy
from sealegs.hw.virtual.in_process import SimulatedPort, bus_in_process

from benchmarks.kept import POLICIES, command, committed, read, study, write

STARTS = {"ends": 50, "gaps": 20, "hidden": 1}
SECONDS = (0.3, 8.0)  # of a run that is ended
COMPARED = 4.0  # [s]
HELD = 3.0  # [s] for which a robot that is held is watched
LATENCY = 0.0005  # [s] of the adapter at most: a leg at 500 Hz has 2 ms a cycle
HIDDEN = {
    **dict.fromkeys(("hopper", "biped", "biped_hopping", "arm", "leg"), "delay.seconds: 0.03\n"),
    "hexapod": "dc_motor.resistance: 2.5\n",
}
"""What a machine hides, by kind of policy."""


def end(policy: Policy, start: int) -> dict[str, Any]:
    """One run of a policy, ended at a moment that ``start`` draws."""
    contract, rng = policy.contract, np.random.default_rng(start)
    config = compose("deploy", split([f"robot={contract.robot}"], ()))["robot"]
    robot, task = build_robot(config), task_of(contract.env)[0]
    commands = PolicyCommands(policy, robot, task.commands(rng.random((1, task.draws))))
    bus, rig = bus_in_process(robot, config["actuator"], pose=commands.pose)
    safety = Safety(robot, Limits.from_config(config["safety"]), 1.0 / contract.goal_rate)
    rest, seconds = config["rest"], float(rng.uniform(*SECONDS))

    def begins() -> None:
        rig.held = None

    loop = ControlLoop(
        bus, robot, safety, commands, contract.goal_rate, begins=begins, rest="hold" if rest == "hold" else "release",
        park=park_motion(config["park"], robot) if rest == "sit" else None,
    )  # fmt: skip
    outcome = loop.run(seconds)
    said = outcome.fault.sentence if outcome.fault is not None else outcome.note
    on = sum(rig.torque(k) for k in range(len(robot.joints)))
    if rest == "hold" and not said:
        said = held(bus, robot.ids, safety)
        on = len(robot.joints) - on
    return {"start": start, "seconds": round(seconds, 3), "said": said, "torque": on + len(outcome.not_at_rest)}


def held(bus: ServoBus, ids: list[int], safety: Safety) -> str:
    """What is wrong with servos that are held, in a sentence; "": nothing."""
    assert isinstance(bus.line.port, SimulatedPort)
    port, limits = bus.line.port.reopened(), safety.limits
    with ServoBus("simulated", model=bus.model.name, opened=port) as again:
        end = port.now() + HELD
        while port.now() < end:
            port.sleep(0.5)
            state = again.read_state(ids)
            if faults := state.faults():
                return str(faults[0])
            if (np.abs(state.current) > limits.current).any() or (state.temperature > limits.temperature).any():
                return "a servo that is held is beyond its limit of current or temperature."
    return ""


def gap(policy: Policy, start: int, hidden: Path | None = None, seconds: float = COMPARED) -> dict[str, Any]:
    """One comparison of a policy on its robot over ``seconds``; it hides nothing but what ``hidden`` says."""
    latency = float(np.random.default_rng(start).uniform(0.0, LATENCY))
    words = [f"policy={policy.path}", f"robot={policy.contract.robot}", f"seconds={seconds}", f"seed={start}"]
    words += ["hw.virtual.time=stepped", f"hw.virtual.latency={latency:.6f}", "live=false"]
    words += [f"hw.virtual.hidden={hidden}"] if hidden is not None else []
    with tempfile.TemporaryDirectory() as folder:
        found = compare(
            compose("evaluate", split(words, ("policy", "hw.virtual.hidden"))), Path(folder), lambda _: None
        )
    figures = found.figures["nominal"]
    kept = ("gap", "gap_at", "same_goals", "accounted", "same_goals_of_slides", "accounted_of_slides")
    values = {key: value for key, value in dataclasses.asdict(figures).items() if key in kept}
    values = {key: None if isinstance(value, float) and np.isnan(value) else value for key, value in values.items()}
    return {"start": start, "ending": found.ending, "verdict": verdict(figures), **values}


def hidden_gap(policy: Policy, start: int, kind: str, seconds: float = COMPARED) -> dict[str, Any]:
    """A comparison with a machine that hides what :data:`HIDDEN` says."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "hidden.yaml"
        file.write_text(HIDDEN[kind], encoding="utf-8")
        return gap(policy, start, file, seconds)


def well(kind: str, row: dict[str, Any]) -> bool:
    """Whether one start came to what it should."""
    if kind == "ends":
        return not row["said"] and row["torque"] == 0
    return (row["gap"] is not None) == (kind == "hidden")


def told(results: dict[str, dict[str, list[dict[str, Any]]]]) -> str:
    """The results as a page of Markdown."""
    lines = []
    for name in sorted({name for rows in results.values() for name in rows}):
        cells = [name]
        for kind in ("ends", "gaps"):
            rows = results.get(kind, {}).get(name, [])
            cells.append(f"{sum(well(kind, row) for row in rows)} of {len(rows)}" if rows else "")
        ratios = [
            row[f"same_goals{unit}"] / row[f"accounted{unit}"]
            for row in results.get("gaps", {}).get(name, [])
            for unit in ("", "_of_slides")
            if row[f"accounted{unit}"]
        ]
        cells.append(f"{max(ratios):.2f}" if ratios else "")
        rows = results.get("hidden", {}).get(name, [])
        cells.append(f"`{HIDDEN[name.partition('/')[0]].strip()}`" if rows else "")
        cells.append(", ".join("no" if row["gap"] is None else f"{row['gap']:.1f} times" for row in rows))
        lines.append(cells)
    bad = [
        f"{name}, start {row['start']}: {row.get('said') or row.get('verdict')}"
        for kind, policies in results.items() for name, rows in policies.items() for row in rows if not well(kind, row)
    ]  # fmt: skip
    return page(
        "Committed policies from many starts",
        "How many runs ended well at a moment drawn between 0.3 and 8 s; how many comparisons with a machine that "
        "hides nothing told no gap, and their largest ratio of the error found to that accounted for; and whether a "
        "machine that hides something was told from it. `python -m benchmarks.many_starts`",
        table(("policy", "ended well", "no gap", "largest ratio", "hidden", "told"), lines),
        "\n".join(bad or ["All as they should."]),
    )


@study
def main() -> None:
    """Measure, print and write."""
    parser = command(__doc__)
    parser.add_argument("kind", choices=list(STARTS))
    parser.add_argument("policies", nargs="*", help="such as biped/seed0; default: all")
    parser.add_argument("--again", action="store_true", help="measure rows that are there anew")
    parser.add_argument("--starts", type=int, default=None)
    arguments = parser.parse_args()
    kind, starts = arguments.kind, arguments.starts or STARTS[arguments.kind]
    results: dict[str, Any] = read("many_starts", {})
    one: Callable[..., dict[str, Any]] = {"ends": end, "gaps": gap, "hidden": hidden_gap}[kind]
    for name in arguments.policies or committed():
        rows = [] if arguments.again else results.setdefault(kind, {}).get(name, [])
        with tempfile.TemporaryDirectory() as folder:
            policy = Policy(export_policy(POLICIES / name, Path(folder) / "policy.onnx"))
            more = (name.partition("/")[0],) if kind == "hidden" else ()
            for start in range(len(rows), starts):
                rows.append(one(policy, start, *more))
                results.setdefault(kind, {})[name] = rows
                write("many_starts", None, results)
        print(f"{name}: {sum(well(kind, row) for row in rows)} of {len(rows)} {kind} as they should", flush=True)
        write("many_starts", told(results))


if __name__ == "__main__":
    sys.exit(main())
