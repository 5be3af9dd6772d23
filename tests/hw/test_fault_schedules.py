"""Faults at random, several at a time: no run ends with torque on and nothing said, every log reads back."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
import pytest
from sealegs.envs.contract import start_pose
from sealegs.gap.log import read_measured
from sealegs.hw.bus.packets import BusError
from sealegs.hw.guard.supervisor import Rest
from sealegs.hw.machine.robot import ServoRobot, build_robot
from sealegs.hw.run.commands import PolicyCommands, Reference, park_motion
from sealegs.hw.run.deployment import Run, at_rest_sentence
from sealegs.hw.run.measured_log import read_events
from sealegs.hw.run.policy import Policy
from sealegs.hw.virtual.wire import KINDS, Fault

from tests.servo_runs import committed, config, gentle_policy
from tests.simulated_runs import QUIET, XL330, Simulation, TimedPolicy, sine

SPAN = 2.5  # [s] of the machine's clock, the way to the start included


def schedule(random: np.random.Generator, servos: list[int]) -> list[dict[str, Any]]:
    """One to three faults, some for good, some of all servos, some that spoil only a part of the replies."""
    faults = []
    for _ in range(random.integers(1, 4)):
        fault: dict[str, Any] = {"kind": str(random.choice(list(KINDS))), "at": float(random.uniform(0.0, SPAN))}
        if random.random() < 0.6:
            fault["seconds"] = float(random.uniform(0.005, 1.0))
        if random.random() < 0.7:
            fault["servos"] = [int(random.choice(servos))]
        if random.random() < 0.5:
            fault["probability"] = float(random.uniform(0.005, 1.0))
        if fault["kind"] == "late":
            fault["delay"] = float(random.uniform(0.001, 0.1))
        if fault["kind"] == "brown_out":
            fault["value"] = float(random.uniform(1.0, 7.0))
        if fault["kind"] == "restart":
            fault["value"] = float(random.uniform(0.0, 1.0))
        if fault["kind"] == "unplug" and "seconds" in fault and random.random() < 0.5:
            fault["name"] = f"/dev/again{len(faults)}"
        faults.append(fault)
    return faults


def pace(random: np.random.Generator, period: float) -> dict[str, Any]:
    """Time that each call of a policy takes [s]: mostly none, else more than a period, or long and once."""
    drawn = random.random()
    if drawn < 0.25:
        return {"seconds": float(random.uniform(1.0, 2.0)) * period}
    if drawn < 0.45:
        return {"blocks": (int(random.integers(1, 150)), float(random.uniform(0.05, 1.5)))}
    return {}


ANSWERS = 5  # in a row, by which a servo counts as reachable
PATIENCE = SPAN + 1.5  # [s] that the supervisor tries: past the end of every fault that ends
NAMED_LAST = re.compile(r"TORQUE MAY BE ON at servo\(s\) (.*?), which cannot be reached")


@cache
def gentle() -> Policy:
    return Policy(gentle_policy(Path(mkdtemp()) / "policy.onnx"))


def end_of(random: np.random.Generator, simulation: Simulation) -> None:
    """How a run is to end, the moment at which the emergency stop is pressed, and that at which the supervisor dies."""
    if random.random() < 0.3:  # sits down about the middle of its range
        middle = 0.5 * (simulation.robot.low + simulation.robot.high)
        pose = dict(zip(simulation.robot.names, middle.tolist(), strict=True))
        simulation.loop.park = park_motion(pose, simulation.robot)
    if random.random() < 0.2:
        simulation.guard.pressed = float(random.uniform(0.0, 1.5 * SPAN))
    if random.random() < 0.2:
        simulation.guard.dies = float(random.uniform(0.0, 1.5 * SPAN))


def rest_of(random: np.random.Generator) -> Rest:
    return "hold" if random.random() < 0.4 else "release"


FEETECH = {"bench": (), "hopper": (), "row": ()}
DYNAMIXEL = {
    "bench": XL330,
    "hopper": ("robot.servo=xl330_m288",),  # a motor of the XL330 does not hold this leg: its own chain
}
"""Robots of each maker, with the arguments that make them his."""


def run_of(seed: int, folder: Path, makers: Mapping[str, tuple[str, ...]] = FEETECH) -> Simulation:
    random = np.random.default_rng(seed)
    robot = list(makers)[seed % len(makers)]
    servos = {"bench": [1], "hopper": [1, 2, 3, 4, 5, 6], "row": [1, 2, 3, 4]}[robot]
    if robot == "hopper" and makers is FEETECH:
        return run_of_committed("hopper", seed, folder)
    timed = TimedPolicy(gentle(), **pace(np.random.default_rng([seed, 3]), 0.02)) if robot == "bench" else None
    commands = {
        "bench": lambda robot: commands_of(timed, robot),
        "hopper": Reference,
        "row": sine(0.4, 0.7),
    }[robot]
    simulation = Simulation(
        robot,
        *makers[robot],
        commands=commands,
        rate=50.0 if robot == "bench" else 100.0,
        faults=schedule(random, servos),
        limits={"range_margin": 3.0} if robot == "hopper" else {},
        **drawn(seed, folder),
    )
    return readied(simulation, seed, timed)


def drawn(seed: int, folder: Path) -> dict[str, Any]:
    """What a seed decides in every run."""
    serials = bool(np.random.default_rng([seed, 4]).random() < 0.5)
    return {"seed": seed, "folder": folder, "rest": rest_of(np.random.default_rng([seed, 1])), "serials": serials}


def readied(simulation: Simulation, seed: int, timed: TimedPolicy | None = None) -> Simulation:
    simulation.guard.patience = PATIENCE
    if timed is not None:
        timed.sleep = simulation.port.sleep
        simulation.delays = 10.0 * timed.seconds + timed.blocks[1]
    end_of(np.random.default_rng([seed, 2]), simulation)
    return simulation


def commands_of(policy: Any, robot: ServoRobot) -> PolicyCommands:
    return PolicyCommands(policy, robot)


TWO = {
    "feetech": ("robot.actuator=sts3215", "robot.buses={knee: {servo: sts3215, joints: [knee]}}"),
    "dynamixel": ("robot.actuator=sts3215", "robot.buses={knee: {servo: xl330_m288, joints: [knee]}}"),
}
"""Makers of the second adapter of a hopper."""


def run_of_two(seed: int, folder: Path) -> Simulation:
    """A hopper whose hip and knee are on an adapter each."""
    random = np.random.default_rng([seed, 2])
    faults = [fault | {"bus": str(random.choice(["", "knee"]))} for fault in schedule(random, [1])]
    arguments = list(TWO.values())[seed % len(TWO)]
    made = Simulation("hopper", *arguments, commands=sine(0.1), faults=faults, limits=QUIET, **drawn(seed, folder))
    return readied(made, seed)


def run_of_committed(kind: str, seed: int, folder: Path, faults: list[dict[str, Any]] | None = None) -> Simulation:
    """A policy of ``policies/`` on its robot, with all its servos and sensors; faults of the seed, or those given."""
    policy = committed(kind)
    servos = len(build_robot(config(f"robot={kind}", patient=False)["robot"]).all_ids)
    random, period = np.random.default_rng([seed, servos]), 1.0 / policy.contract.goal_rate
    timed = TimedPolicy(policy, **(pace(np.random.default_rng([seed, 3]), period) if faults is None else {}))
    keys = drawn(seed, folder)
    if faults is not None:
        keys["rest"] = "release"
    simulation = Simulation(
        kind,
        commands=lambda robot: commands_of(timed, robot),
        rate=policy.contract.goal_rate,
        faults=schedule(random, list(range(1, servos + 1))) if faults is None else faults,
        pose=start_pose(policy.contract),
        **keys,
    )
    if faults is None:
        return readied(simulation, seed, timed)
    simulation.guard.patience = 0.3
    return simulation


SURE = {"silence": "NoReplyError", "unplug": "UnpluggedError", "limp": "torque"}
"""Faults that show whatever else is wrong, where they are for good, and what they are called."""
NAMED = 0.3  # [s] within which they end a run: 0.1 s, and cycles whose replies other faults spoil


def certain(simulation: Simulation, since: float) -> list[Fault]:
    """Faults from ``since`` on [s] that certainly show."""

    def shows(fault: Fault, bus: str) -> bool:
        joints = {joint.id for joint in simulation.robot.joints if joint.line.name == bus}
        lasts = fault.seconds is None or fault.kind == "limp"
        of_a_joint = not fault.servos or bool(joints & set(fault.servos))
        return fault.kind in SURE and lasts and fault.probability == 1.0 and of_a_joint and fault.at > since

    return [fault for bus, wire in simulation.wires.items() for fault in wire.faults if shows(fault, bus)]


def reachable(simulation: Simulation) -> set[str]:
    """Servos of joints that answer whenever they are asked, as the host addresses them."""
    found = set[str]()
    for line in simulation.lines():
        with contextlib.suppress(BusError), line.opening() as bus:
            bus.line.retries = 0
            for servo in line.ids:
                with contextlib.suppress(BusError):
                    for _ in range(ANSWERS):
                        bus.ping(servo)
                    found |= set(line.named([servo]))
    return found


def judge(simulation: Simulation) -> None:
    """Run to the end, and look at what it leaves."""
    faults = {name: [vars(fault) for fault in wire.faults] for name, wire in simulation.wires.items()}
    guard, pressed = simulation.guard, simulation.guard.pressed
    outcome = simulation.run(SPAN)
    simulation.port.sleep(0.01)
    assert simulation.log is not None
    last = at_rest_sentence(Run(outcome, simulation.log.path), guard.rest)
    context = (faults, guard.dies, pressed, outcome, guard.heard, simulation.said, last)
    assert outcome.ending in ("finished", "fault") or simulation.stop.emergency, context
    torque = {str(joint.address): on for joint, on in zip(simulation.robot.joints, simulation.torque, strict=True)}
    left_on = {servo for servo, on in torque.items() if on}
    said = " ".join(line for _, line in simulation.said)
    assert not outcome.not_at_rest or "TORQUE MAY BE ON" in said, context
    trying = not outcome.not_at_rest or guard.heard[-1] in ("call", "released", "brought to hold")
    if outcome.rest == "hold":
        assert guard.lives and not simulation.stop.emergency and "release only" not in guard.heard, context
        assert trying and (outcome.not_at_rest or guard.heard[-1] == "held"), context
    else:
        listed = NAMED_LAST.search(last)
        named = set(listed[1].split(", ")) if listed is not None else set[str]()
        assert left_on <= named, ("torque is on, and nothing is said", context)
        assert trying or "nobody goes on trying" in said, context
        false = {servo for servo in named & reachable(simulation) if not torque[servo]}
        assert not false, ("a false alarm at the last word", false, context)
    assert read_events(simulation.log.path)[-1]["event"] == "end", context
    if simulation.log.rows > 1:
        assert len(read_measured(simulation.log.path).runs[0].time) == simulation.log.rows, context
    switched = [time for time, _, on in simulation.rig.history if on]
    for fault in certain(simulation, max(switched) if switched else 0.0):
        within = NAMED + simulation.delays
        assert guard.called_at is not None and guard.called_at < fault.at + within, ("not named", fault, context)
        alone = sum(map(len, faults.values())) == 1 and guard.dies is None and pressed is None
        if alone and guard.called_at > fault.at and not simulation.delays:
            assert outcome.fault is not None and outcome.fault.name == SURE[fault.kind], context
            ill = {f"{fault.bus}:{servo}" if fault.bus else str(servo) for servo in fault.servos}
            assert not ill or ill & set(map(str, outcome.fault.servos)) or fault.kind == "unplug", context


RUNS: dict[str, Callable[[int, Path], Simulation]] = {
    "feetech": run_of,
    "dynamixel": lambda seed, folder: run_of(seed, folder, DYNAMIXEL),
    "two": run_of_two,
    "hopper": lambda seed, folder: run_of_committed("hopper", seed, folder),
    "biped": lambda seed, folder: run_of_committed("biped", seed, folder),
    "hexapod": lambda seed, folder: run_of_committed("hexapod", seed, folder),
}
"""Robots with what moves them: those of one adapter by maker, two adapters, and the committed policy of each walker."""
QUICK = {"two": 2}
DAILY = {"feetech": 30, "dynamixel": 30, "two": 30, "hopper": 6, "biped": 3, "hexapod": 2}
WEEKLY = {"feetech": 200, "dynamixel": 200, "two": 60, "hopper": 12, "biped": 6, "hexapod": 4}
MIXED = [*7 * ["feetech", "dynamixel", "two", "two"], "feetech", "biped", "hexapod"]
"""Of seeds that are asked for, one after the other."""


def chosen() -> list[Any]:
    """Kinds and seeds: those of the tests, or so many from a seed on as SEALEGS_SCHEDULES="<seed> <number>" says."""
    if asked := os.environ.get("SEALEGS_SCHEDULES"):
        first, number = map(int, asked.split())
        return [(MIXED[seed % len(MIXED)], seed) for seed in range(first, first + number)]
    rows: list[Any] = [(kind, seed) for kind, count in QUICK.items() for seed in range(count)]
    for kind, count in DAILY.items():
        rows += [pytest.param(kind, seed, marks=pytest.mark.long) for seed in range(QUICK.get(kind, 0), count)]
    weekly = [pytest.mark.long, pytest.mark.weekly]
    for kind, count in WEEKLY.items():
        rows += [pytest.param(kind, seed, marks=weekly) for seed in range(DAILY[kind], count)]
    return rows


@pytest.mark.parametrize(("kind", "seed"), chosen())
def test_no_run_ends_with_torque_on_unsaid_or_a_false_alarm(kind: str, seed: int, tmp_path: Path) -> None:
    judge(RUNS[kind](seed, tmp_path))


def bench(folder: Path, *faults: dict[str, Any], **keys: Any) -> Simulation:
    made = Simulation(commands=sine(0.2), faults=faults, folder=folder, **keys)
    made.guard.patience = 1.5
    return made


@pytest.mark.parametrize("serials", [True, False])
def test_an_adapter_that_returns_under_another_name_is_released_there(serials: bool, tmp_path: Path) -> None:
    away = {"kind": "unplug", "at": 2.0, "seconds": 0.5, "name": "/dev/again"}
    simulation = bench(tmp_path, away, serials=serials)
    judge(simulation)
    assert simulation.guard.heard[-1] == "released" and simulation.torque == [False]
    assert simulation.rig.history[-1][0] > 2.5 and [one.device for one in simulation.adapters.listed()] == [
        "/dev/again"
    ]


@pytest.mark.parametrize("tries", [True, False])
def test_a_servo_that_is_off_and_answers_is_a_finding_where_it_is_named_last(
    tries: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = bench(tmp_path, {"kind": "restart", "at": 2.0, "value": 0.3})

    def gives_up(*_: object) -> bool:
        simulation.guard.heard.append("call")
        simulation.port.sleep(0.5)
        return False

    if not tries:
        monkeypatch.setattr(simulation.guard, "call", gives_up)
    with contextlib.nullcontext() if tries else pytest.raises(AssertionError, match="a false alarm at the last word"):
        judge(simulation)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["hopper", "biped"])
def test_a_policy_survives_one_lost_reply_in_a_hundred_within_the_limits_of_its_file(kind: str, tmp_path: Path) -> None:
    simulation = run_of_committed(kind, 0, tmp_path, [{"kind": "drop", "probability": 0.01}])
    outcome = simulation.run(6.0)
    assert outcome.ending == "finished" and outcome.bus["NoReplyError"] > 10, outcome.fault
