"""How fast: physics with a chain over bare MuJoCo, and training over a plain Python environment. See ``__main__``."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from sealegs.actuators import Chain, Drivetrain
from sealegs.actuators.law import begin, torque
from sealegs.actuators.layout import P_STATE_SIZE
from sealegs.common.markdown import page, table
from sealegs.envs.arm.robot import ARM
from sealegs.envs.bench.robot import BENCH
from sealegs.envs.biped.robot import BIPED
from sealegs.envs.engine.robot import Robot
from sealegs.envs.hexapod.robot import HEXAPOD
from sealegs.envs.hopper.robot import HOPPER
from sealegs.envs.leg.robot import LEG

ROBOTS = {"bench": BENCH, "hopper": HOPPER, "biped": BIPED, "hexapod": HEXAPOD, "leg": LEG, "arm": ARM}
CHAINS = {"ideal": 0.90, "regression": 0.90, "net": 0.60}  # and the ratio that each must reach
CASES = [(name, chain, bar) for name in ("bench", "hopper") for chain, bar in CHAINS.items()]
CASES += [("biped", "mabel", 0.85), ("hexapod", "amru5_lugre", 0.85)]  # their printed chains
CASES += [("leg", "silo4", 0.85), ("arm", "srlfj", 0.85)]
SIMULATIONS = (1, 16, 64, 1024)
PER_CALL = 20  # physics steps between two goals: 50 Hz
FEWEST_TURNS, LONGEST_ROW = 9, 20.0  # [s] where one call takes long, there are fewer turns
TRAINING_BAR = 5.0
TRAINING_SIMULATIONS = 256  # of the batch engine; the other side has 8 processes, and both the same steps per update


def bare_model(driven: Drivetrain) -> mujoco.MjModel:
    """The same model with MuJoCo's own position servos, as stiff and damped as the chains are at rest.

    So both move alike, and have the same contacts to solve.
    """
    spec = driven.spec.copy()
    for coordinate in driven.coordinates:
        stiffness, damping, largest = _linear(driven.chains[coordinate.name])
        actuator = spec.actuator(coordinate.name)
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        actuator.gainprm[0] = stiffness
        actuator.biasprm[:3] = 0.0, -stiffness, -damping
        actuator.forcelimited, actuator.forcerange = True, (-largest, largest)
        actuator.userdata = []
    spec.nuserdata = 0
    return spec.compile()


def _linear(chain: Chain) -> tuple[float, float, float]:
    """Stiffness [N.m/rad], damping [N.m.s/rad] and largest torque [N.m] of a chain, once its current has followed."""
    if chain.find("dc_motor") is not None:
        chain = chain.with_value("dc_motor.inductance", 0.0)
    program = chain.program()

    def settled(goal: float, speed: float) -> float:
        state = np.zeros(int(program[P_STATE_SIZE]))
        begin(program, state, 0.0, goal, 0.0, speed)
        return torque(program, state, 0.0, goal, 0.0, speed, 0.0, True)

    small = 1e-2
    stiffness = (settled(small, 0.0) - settled(-small, 0.0)) / (2.0 * small)
    damping = -(settled(0.0, small) - settled(0.0, -small)) / (2.0 * small)
    return stiffness, max(damping, 0.0), max(abs(settled(1.5, 0.0)), abs(settled(-1.5, 0.0)))


class Stepper:
    """A batch whose goals swing, each simulation's in its own phase."""

    def __init__(self, robot: Robot, model: mujoco.MjModel, count: int) -> None:
        self.batch = Batch(model, count, 0)
        self.goals = self.batch.bind("ctrl")
        limits = np.array([robot.limits[item.name] for item in robot.coordinates])
        self.centre, self.half = limits.mean(axis=1), 0.5 * (limits[:, 1] - limits[:, 0])
        self.phase = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)[:, None]
        self.calls = 0

    def __call__(self) -> None:
        """One control step."""
        if self.calls % 200 == 0:
            self.batch.reset()
        self.goals[:] = self.centre + 0.3 * self.half * np.sin(0.1 * self.calls + self.phase)
        self.batch.step(nstep=PER_CALL)
        self.calls += 1


def interleaved(sides: dict[str, Callable[[], int]], seconds: float, repeats: int) -> dict[str, list[float]]:
    """Rates of several sides [1/s], measured in turns so that a busy machine slows all of them.

    Args:
        sides: each does some work and returns how much.
        seconds: for one side in one turn.
        repeats: turns.
    """
    rates: dict[str, list[float]] = {name: [] for name in sides}
    for _ in range(repeats):
        for name, work in sides.items():
            done, start = 0, time.perf_counter()
            while time.perf_counter() - start < seconds:
                done += work()
            rates[name].append(done / (time.perf_counter() - start))
    return rates


def physics(
    seconds: float, repeats: int, report: Callable[[dict[str, Any]], None], robots: Sequence[str] = tuple(ROBOTS)
) -> list[dict[str, Any]]:
    """Physics steps/s with each chain over bare MuJoCo on the same model."""
    rows = []
    for name, chain, bar in CASES:
        if name not in robots:
            continue
        robot = ROBOTS[name]
        driven = robot.drivetrain(chain)
        bare = bare_model(driven)
        for count in SIMULATIONS:
            sides, lasts = {}, seconds
            for side, model in (("chain", driven.model), ("bare", bare)):
                stepper = Stepper(robot, model, count)
                stepper()
                began = time.perf_counter()
                stepper()
                lasts = max(lasts, time.perf_counter() - began)

                def work(stepper: Stepper = stepper, count: int = count) -> int:
                    stepper()
                    return count * PER_CALL

                sides[side] = work
            turns = min(repeats, max(FEWEST_TURNS, int(LONGEST_ROW / (2.0 * lasts))))
            rates = interleaved(sides, seconds, turns)
            ratios = np.array(rates["chain"]) / np.array(rates["bare"])
            rows.append(
                {
                    "robot": name,
                    "chain": chain,
                    "simulations": count,
                    "steps_per_second": float(np.median(rates["chain"])),
                    "bare_steps_per_second": float(np.median(rates["bare"])),
                    "ratio": float(np.median(ratios)),
                    "ratio_low": float(np.quantile(ratios, 0.25)),
                    "ratio_high": float(np.quantile(ratios, 0.75)),
                    "bar": bar,
                }
            )
            report(rows[-1])
    return rows


def training(rollouts: int, repeats: int, report: Callable[[str], None]) -> dict[str, Any]:
    """PPO steps/s on the hopper: the batch engine against :class:`PythonHopper` under 8 ``SubprocVecEnv``."""
    import torch
    from sealegs.agents.algorithms import build, checked_agent, wrapped
    from sealegs.configs.compose import compose
    from sealegs.envs.engine.sb3 import BatchVecEnv
    from stable_baselines3.common.vec_env import SubprocVecEnv, VecMonitor

    from benchmarks.python_hopper import PythonHopper

    torch.set_num_threads(1)
    config = compose("train", {"env": "hopper", "agent": "ppo"})
    agent, count = checked_agent(config["agent"]), TRAINING_SIMULATIONS
    rollout = int(agent["n_steps"]) * int(config["n_envs"])
    batch = BatchVecEnv("SeaLegs/Hopper-v0", count, seed=0, actuator="sv1270tg")
    ours = build(agent | {"n_steps": rollout // count}, wrapped(batch, agent, True), 0)
    processes = SubprocVecEnv([PythonHopper] * 8, start_method="spawn")
    theirs = build(agent | {"n_steps": rollout // 8}, wrapped(VecMonitor(processes), agent, True), 0)
    learners = {"batch": ours, "subproc": theirs}
    rates: dict[str, list[float]] = {name: [] for name in learners}
    spent = dict.fromkeys(learners, 0.0)
    try:
        for name, learner in learners.items():
            learner.learn(rollout)
            report(f"{name}: warm")
        for _ in range(repeats):
            for name, learner in learners.items():
                workers = processes.env_method if name == "subproc" else None
                cpu, start = _cpu_seconds(workers), time.perf_counter()
                learner.learn(rollouts * rollout)
                rates[name].append(rollouts * rollout / (time.perf_counter() - start))
                spent[name] += _cpu_seconds(workers) - cpu
                report(f"{name}: {rates[name][-1]:.0f} steps/s")
    finally:
        processes.close()
    ratios = np.array(rates["batch"]) / np.array(rates["subproc"])
    steps = repeats * rollouts * rollout
    return {
        "batch_steps_per_second": float(np.median(rates["batch"])),
        "subproc_steps_per_second": float(np.median(rates["subproc"])),
        "ratio": float(np.median(ratios)),
        "ratio_low": float(ratios.min()),
        "ratio_high": float(ratios.max()),
        "bar": TRAINING_BAR,
        "cpu_microseconds_per_step": {name: 1e6 * value / steps for name, value in spent.items()},
        "simulations": {"batch": count, "subproc": 8},
        "steps_per_update": rollout,
        "load_average": os.getloadavg()[0],
    }


def _cpu_seconds(workers: Callable[[str], list[float]] | None) -> float:
    """CPU time of this process and of the workers [s]: it does not change with what else the machine is doing."""
    return time.process_time() + (sum(workers("cpu_seconds")) if workers else 0.0)


def told(physics_rows: list[dict[str, Any]], trained: dict[str, Any] | None, machine: dict[str, Any]) -> str:
    """The results as a page of Markdown."""
    heads = ("robot", "chain", "simulations", "steps/s", "bare steps/s", "ratio", "quartiles", "bar", "")
    cells = (
        (row["robot"], row["chain"], row["simulations"], f"{row['steps_per_second']:,.0f}",
         f"{row['bare_steps_per_second']:,.0f}", f"{row['ratio']:.2f}",
         f"{row['ratio_low']:.2f} to {row['ratio_high']:.2f}", f"{row['bar']:.2f}",
         "reached" if row["ratio"] >= row["bar"] else "**missed**")
        for row in physics_rows
    )  # fmt: skip
    parts = [
        f"Written by `python -m benchmarks` (`make bench`); {machine['cores']} cores, MuJoCo {machine['mujoco']}, "
        f"Python {machine['python']}. Ratios are medians of interleaved repeats in one run.",
        "## Physics steps per second, with a chain over bare MuJoCo on the same model",
        "Bare MuJoCo has its own position servos with the chain's stiffness and damping, so that both move alike.",
        table(heads, cells),
    ]
    if trained:
        verdict = "reached" if trained["ratio"] >= trained["bar"] else "**missed**"
        rates = (
            f"{trained['batch_steps_per_second']:,.0f}", f"{trained['subproc_steps_per_second']:,.0f}",
            f"{trained['ratio']:.1f}", f"{trained['ratio_low']:.1f} to {trained['ratio_high']:.1f}",
            f"{trained['bar']:.0f}", verdict,
        )  # fmt: skip
        parts += [
            "## PPO training steps per second on the hopper",
            "Same model, task, chain (`sv1270tg`), PPO settings (`configs/agent/ppo.yaml`) and "
            f"{trained['steps_per_update']} steps per update; "
            f"{trained['simulations']['batch']} simulations in the batch. "
            "The other side is `benchmarks/python_hopper.py`, a Gymnasium `MujocoEnv` with the law in Python. "
            f"Load average at the end: {trained['load_average']:.1f}; where it is far above the number of cores, other "
            "programs shared the machine, and 9 processes get more of it than one.",
            table(("batch engine", "8 SubprocVecEnv", "ratio", "lowest to highest", "bar", ""), [rates]),
            "CPU time per training step, all processes together: "
            f"{trained['cpu_microseconds_per_step']['batch']:.0f} us against "
            f"{trained['cpu_microseconds_per_step']['subproc']:.0f} us.",
        ]
    return page("Speed", *parts)
