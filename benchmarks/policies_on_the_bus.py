"""What the committed policies earn on the virtual bus, beside what they earn in simulation.

    python -m benchmarks.policies_on_the_bus                 all of policies/, 60 s each, but those that have a row
    python -m benchmarks.policies_on_the_bus biped/seed0     some of them
    python -m benchmarks.policies_on_the_bus --again         all anew

Each policy is exported and runs from its file in the control loop: servos with their encoders' steps, the time of the
bytes on a line of 1 Mbit/s, sensors, limits of safety. Time is simulated. In simulation the same policy runs
in the environment that it was trained in, from several starts. Both are asked for the middle of what it was trained
for. The return on the bus is that of the machine's true motion; beside it stands what the servos' readings say.
"""

from __future__ import annotations

import dataclasses
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from sealegs.agents.export import export_policy
from sealegs.agents.make_env import make_vec_env
from sealegs.agents.policy_files import load_policy
from sealegs.common.markdown import page, table
from sealegs.configs.compose import compose, split
from sealegs.envs.contract import task_of
from sealegs.hw.guard.safety import Limits, Safety
from sealegs.hw.machine.robot import Reading, build_robot
from sealegs.hw.run.commands import PolicyCommands
from sealegs.hw.run.loop import ControlLoop
from sealegs.hw.run.observer import Observer
from sealegs.hw.run.policy import Policy
from sealegs.hw.virtual.in_process import bus_in_process
from sealegs.hw.virtual.machine import Machine

from benchmarks.kept import POLICIES, command, committed, read, study, write

SECONDS = 60.0
STARTS = 4
BAR = 0.9
TO_REACH = ("hopper", "biped", "hexapod")
"""Folders of policies whose return must reach the bar; hopping falls in simulation too."""


def in_simulation(folder: Path, seconds: float) -> dict[str, float]:
    """Mean return and time until the fall over several starts, in the environment of the training."""
    act, description = load_policy(folder)
    env = make_vec_env(at_middle(description["env"]), description["actuators"], STARTS, seed=0)
    env.engine.autoreset = False
    observation: Any = env.reset()
    alive, returns, lasted = np.ones(STARTS, bool), np.zeros(STARTS), np.zeros(STARTS)
    for _ in range(round(seconds * description["control_rate"])):
        step = env.engine.step(act(observation))
        returns += np.where(alive, step.reward, 0.0)
        lasted += alive / description["control_rate"]
        alive &= ~step.terminated
        observation = step.observation
        if not alive.any():
            break
    return {"return": float(returns.mean()), "seconds": float(lasted.mean()), "least": float(returns.min())}


def at_middle(env: dict[str, Any]) -> dict[str, Any]:
    """The environment with what a policy is asked for fixed, in the middle of what it was trained for."""
    task = task_of(env)[0]
    if "speed" not in {field.name for field in dataclasses.fields(task)}:
        return env
    middle = float(task.commands(np.full((1, task.draws), 0.5))[0, 0])
    return {**env, "speed": middle}


class Truth:
    """What the machine does while the loop runs: the task's reward from its true state."""

    def __init__(self, observer: Observer, machine: Machine) -> None:
        self.observer, self._machine = observer, machine
        self.rewards: list[float] = []
        self.failed_at: float | None = None

    def reading(self, time: float) -> Reading:
        """The true state as a reading."""
        m, names = self._machine, self.observer.base_names
        k = range(len(m.names))
        position = np.array([m.position(n) for n in k])
        values, rates = m.base()
        base, speed = (np.array([row[name] for name in names]) for row in (values, rates))
        nothing = np.zeros(len(position))
        link = np.array([m.link(n) for n in k])
        velocity = np.array([m.velocity(n) for n in k])
        return Reading(time, time, position, velocity, nothing, nothing, nothing, nothing, link, base, speed, None)

    def step(self, time: float, state: np.ndarray) -> None:
        """A control step of the policy, seen at ``time`` [s]; its state as the policy had it before."""
        self.observer.state = state
        torque = np.array([self._machine.torque(n) for n in range(len(self._machine.names))])
        seen = self.observer.see(self.reading(time), torque)
        self.rewards.append(sum(seen.rewards.values()))
        if seen.failed and self.failed_at is None:
            self.failed_at = time


def on_the_bus(name: str, policy: Policy, seconds: float) -> dict[str, Any]:
    """Return of the machine's true motion and of the readings, and how the run ended."""
    contract = policy.contract
    config = compose("deploy", split([f"robot={name}"], ()))["robot"]
    robot = build_robot(config)
    robot.check_contract(contract)
    commands = PolicyCommands(policy, robot)
    bus, rig = bus_in_process(robot, config["actuator"], pose=commands.pose)
    truth = Truth(Observer(contract, robot), rig.machine)
    clock = bus.line.port

    class Watched(PolicyCommands):
        def goals(self, time: float, reading: Reading) -> np.ndarray:
            before, state = len(self.history), self.observer.state
            goals = super().goals(time, reading)
            torque = np.array([rig.machine.torque(n) for n in range(len(rig.machine.names))])
            truth.observer.glance(truth.reading(time), torque)
            if len(self.history) > before:
                truth.step(time, self.observer.state if before == 0 else state)
            return goals

    watched = Watched(policy, robot)

    def begins() -> None:
        rig.held = None

    safety = Safety(robot, Limits.from_config(config["safety"]), 1.0 / contract.goal_rate)
    loop = ControlLoop(bus, robot, safety, watched, contract.goal_rate, begins=begins)
    begun = clock.now()
    outcome = loop.run(seconds)
    steps = truth.rewards[1:]
    fell = None if truth.failed_at is None else round(truth.failed_at * contract.control_rate)
    measured = [sum(seen.rewards.values()) for seen in watched.history[1:]]
    return {
        "return": float(np.sum(steps[:fell])),
        "measured": float(np.sum(measured[:fell])),
        "seconds": len(steps[:fell]) / contract.control_rate,
        "ending": outcome.ending if outcome.fault is None else outcome.fault.sentence,
        "cut": outcome.cut,
        "reading": outcome.timing.read_mean,
        "to goal": outcome.timing.command_mean,
        "simulated": clock.now() - begun,
    }


def measure(folder: Path, seconds: float) -> dict[str, Any]:
    """Row of one policy."""
    kind = folder.parent.name
    with tempfile.TemporaryDirectory() as out:
        policy = Policy(export_policy(folder, Path(out) / "policy.onnx"))
    bus = on_the_bus(policy.contract.robot, policy, seconds)
    simulation = in_simulation(folder, seconds)
    share = bus["return"] / simulation["return"]
    return {"policy": f"{kind}/{folder.name}", "share": share, "bus": bus, "simulation": simulation}


def told(rows: list[dict[str, Any]]) -> str:
    """The results as a page of Markdown."""
    cells = []
    for row in rows:
        bus, simulation = row["bus"], row["simulation"]
        judged = row["policy"].partition("/")[0] in TO_REACH
        verdict = ("reached" if row["share"] >= BAR else "**missed**") if judged else ""
        cells.append((
            row["policy"], f"{bus['return']:.1f}", f"{bus['measured']:.1f}", f"{bus['seconds']:.0f}",
            f"{simulation['return']:.1f}", f"{simulation['seconds']:.0f}", f"{row['share']:.2f}",
            BAR if judged else "", verdict,
        ))  # fmt: skip
    ended = [f"{row['policy']}: {row['bus']['ending']}" for row in rows if row["bus"]["ending"] != "finished"]
    heads = ("policy", "on the bus", "as the readings say", "s", "in simulation", "s", "share", "to reach", "")
    return page(
        "Policies on the virtual bus",
        f"Return over {SECONDS:g} s of each policy in `policies/` on the virtual machine of its robot with its sensors,"
        f" beside the mean of {STARTS} starts in the environment that it was trained in. Return counts until the robot "
        "falls. `python -m benchmarks.policies_on_the_bus`",
        table(heads, cells),
        "\n".join(ended or ["All runs went on to their end."]),
    )


@study
def main() -> None:
    """Measure, print and write."""
    parser = command(__doc__)
    parser.add_argument("policies", nargs="*", help="such as biped/seed0; default: all")
    parser.add_argument("--again", action="store_true", help="measure rows that are there anew")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="others than 60 write nothing")
    arguments = parser.parse_args()
    rows = {row["policy"]: row for row in read("policies_on_the_bus", [])}
    for name in arguments.policies or committed():
        if name in rows and not arguments.again:
            continue
        row = measure(POLICIES / name, arguments.seconds)
        rows[name] = row
        print(f"{name}: {row['bus']} beside {row['simulation']}: {row['share']:.2f}", flush=True)
        if arguments.seconds == SECONDS:
            ordered = [rows[key] for key in sorted(rows) if key in committed()]
            write("policies_on_the_bus", told(ordered), ordered)


if __name__ == "__main__":
    sys.exit(main())
