"""Faults at random, several at a time: no run ends with torque on and nothing said, every log reads back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.envs.contract import start_pose
from sealegs.gap.log import read_measured
from sealegs.hw.guard.supervisor import Rest
from sealegs.hw.machine.robot import build_robot
from sealegs.hw.run.commands import PolicyCommands, Reference, park_motion
from sealegs.hw.run.measured_log import read_events
from sealegs.hw.run.policy import Policy
from sealegs.hw.virtual.faults import Fault

from tests.committed_policies import committed
from tests.random_faults import SPAN, schedule
from tests.servo_runs import config, gentle_policy
from tests.simulated_runs import Simulation, sine

QUICK, QUICK_DYNAMIXEL, DAILY, ALL = 5, 2, 60, 200


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Policy:
    return Policy(gentle_policy(tmp_path_factory.mktemp("policy") / "policy.onnx"))


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
    "bench": ("robot.servo=xl330_m288", "robot.actuator=xl330", "robot.params.mass=0.05", "robot.params.length=0.05"),
    "hopper": ("robot.servo=xl330_m288",),  # a motor of the XL330 does not hold this leg: its own chain
}
"""Robots of each maker, with the arguments that make them his."""


def run_of(seed: int, folder: Path, policy: Policy, makers: Mapping[str, tuple[str, ...]] = FEETECH) -> Simulation:
    random = np.random.default_rng(seed)
    robot = list(makers)[seed % len(makers)]
    servos = {"bench": [1], "hopper": [1, 2, 3, 4, 5, 6], "row": [1, 2, 3, 4]}[robot]
    if robot == "hopper" and makers is FEETECH:
        return run_of_committed("hopper", seed, folder)
    commands = {
        "bench": lambda robot: PolicyCommands(policy, robot),
        "hopper": Reference,
        "row": sine(0.4, 0.7),
    }[robot]
    rest = rest_of(np.random.default_rng([seed, 1]))
    simulation = Simulation(
        robot,
        *makers[robot],
        commands=commands,
        rate=50.0 if robot == "bench" else 100.0,
        faults=schedule(random, servos),
        seed=seed,
        folder=folder,
        limits={"range_margin": 3.0} if robot == "hopper" else {},
        rest=rest,
    )
    simulation.guard.patience = 0.3
    end_of(np.random.default_rng([seed, 2]), simulation)
    return simulation


def run_of_committed(kind: str, seed: int, folder: Path, faults: list[dict[str, Any]] | None = None) -> Simulation:
    """A policy of ``policies/`` on its robot, with all its servos and sensors; faults of the seed, or those given."""
    policy = committed(kind)
    servos = len(build_robot(config(f"robot={kind}", patient=False)["robot"]).all_ids)
    drawn = schedule(np.random.default_rng([seed, servos]), list(range(1, servos + 1)))
    simulation = Simulation(
        kind,
        commands=lambda robot: PolicyCommands(policy, robot),
        rate=policy.contract.goal_rate,
        faults=drawn if faults is None else faults,
        seed=seed,
        folder=folder,
        pose=start_pose(policy.contract),
        rest="release" if faults is not None else rest_of(np.random.default_rng([seed, 1])),
    )
    simulation.guard.patience = 0.3
    if faults is None:
        end_of(np.random.default_rng([seed, 2]), simulation)
    return simulation


SURE = {"silence": "NoReplyError", "unplug": "UnpluggedError", "limp": "torque"}
"""Faults that show whatever else is wrong, where they are for good, and what they are called."""
NAMED = 0.3  # [s] within which they end a run: 0.1 s, and cycles whose replies other faults spoil


def certain(simulation: Simulation, since: float) -> list[Fault]:
    """Faults from ``since`` on [s] that certainly show."""
    joints = {joint.id for joint in simulation.robot.joints}

    def shows(fault: Fault) -> bool:
        lasts = fault.seconds is None or fault.kind == "limp"
        of_a_joint = not fault.servos or bool(joints & set(fault.servos))
        return fault.kind in SURE and lasts and fault.probability == 1.0 and of_a_joint and fault.at > since

    return [fault for fault in simulation.wire.faults if shows(fault)]


def judge(simulation: Simulation) -> None:
    """Run to the end, and look at what it leaves."""
    faults = [vars(fault) for fault in simulation.wire.faults]
    guard, pressed = simulation.guard, simulation.guard.pressed
    outcome = simulation.run(SPAN)
    simulation.port.sleep(0.01)
    context = (faults, guard.dies, pressed, outcome, guard.heard, simulation.said)
    assert outcome.ending in ("finished", "fault") or simulation.stop.emergency, context
    left_on = {joint.id for joint, on in zip(simulation.robot.joints, simulation.torque, strict=True) if on}
    said = " ".join(line for _, line in simulation.said)
    assert not outcome.not_at_rest or "TORQUE MAY BE ON" in said, context
    trying = not outcome.not_at_rest or guard.heard[-1] in ("call", "released", "brought to hold")
    if outcome.rest == "hold":
        assert guard.lives and not simulation.stop.emergency and "release only" not in guard.heard, context
        assert trying and (outcome.not_at_rest or guard.heard[-1] == "held"), context
    else:
        assert left_on <= set(outcome.not_at_rest), context
        assert trying or "nobody goes on trying" in said, context
    assert simulation.log is not None and read_events(simulation.log.path)[-1]["event"] == "end", context
    if simulation.log.rows > 1:
        assert len(read_measured(simulation.log.path).runs[0].time) == simulation.log.rows, context
    torque = [time for time, _, on in simulation.rig.history if on]
    for fault in certain(simulation, max(torque) if torque else 0.0):
        assert guard.called_at is not None and guard.called_at < fault.at + NAMED, ("not named", fault, context)
        alone = len(faults) == 1 and guard.dies is None and pressed is None
        if alone and guard.called_at > fault.at:
            assert outcome.fault is not None and outcome.fault.name == SURE[fault.kind], context
            assert not fault.servos or set(fault.servos) & set(outcome.fault.servos) or fault.kind == "unplug", context


def seeds(quick: int) -> list[Any]:
    daily = (pytest.param(seed, marks=pytest.mark.long) for seed in range(quick, DAILY))
    weekly = (pytest.param(seed, marks=[pytest.mark.long, pytest.mark.weekly]) for seed in range(DAILY, ALL))
    return [*range(quick), *daily, *weekly]


@pytest.mark.long
@pytest.mark.parametrize("seed", seeds(QUICK))
def test_no_run_ends_with_torque_on_and_nothing_said_and_every_log_reads_back(
    seed: int, tmp_path: Path, policy: Policy
) -> None:
    judge(run_of(seed, tmp_path, policy))


@pytest.mark.long
@pytest.mark.parametrize("seed", seeds(QUICK_DYNAMIXEL))
def test_nor_does_a_run_on_dynamixels(seed: int, tmp_path: Path, policy: Policy) -> None:
    judge(run_of(seed, tmp_path, policy, DYNAMIXEL))


COMMITTED = {"hopper": 12, "biped": 6, "hexapod": 4}
"""Schedules over the committed policy of each robot."""


@pytest.mark.long
@pytest.mark.parametrize(("kind", "seed"), [(kind, seed) for kind, count in COMMITTED.items() for seed in range(count)])
def test_nor_does_a_run_of_a_committed_policy(kind: str, seed: int, tmp_path: Path) -> None:
    judge(run_of_committed(kind, seed, tmp_path))


@pytest.mark.long
@pytest.mark.parametrize("kind", ["hopper", "biped"])
def test_a_policy_survives_one_lost_reply_in_a_hundred_within_the_limits_of_its_file(kind: str, tmp_path: Path) -> None:
    simulation = run_of_committed(kind, 0, tmp_path, [{"kind": "drop", "probability": 0.01}])
    outcome = simulation.run(6.0)
    assert outcome.ending == "finished" and outcome.bus["NoReplyError"] > 10, outcome.fault
