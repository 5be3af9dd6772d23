"""How well a quadruped follows commands: its reference gait and trained policies, on level and uneven ground.

    python -m benchmarks.walking                       the reference gait, without learning
    python -m benchmarks.walking runs/walk/best ...    and policies
    python -m benchmarks.walking --robots runs/dog/final ...   policies of any robots, each beside its own reference
    python -m benchmarks.walking --speed               steps per second over bare MuJoCo on the same model, in turns

The error of a speed is that of its mean after the first second, as a share of the mean command, of those that did not
fall. The commands are those of ``configs/env/walk.yaml``, none of them 0, from the same starts on each ground.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from sealegs.agents.make_env import checked_env, make_vec_env
from sealegs.agents.policy_files import load_policy, trained_env
from sealegs.common.documents import read_yaml
from sealegs.common.markdown import page, table
from sealegs.configs.compose import FOLDER
from sealegs.envs.any_robot.walk import WalkTask
from sealegs.envs.robots import get_robot

from benchmarks.kept import command, read, study, write
from benchmarks.speed import bare_model, interleaved

GAIT = "reference gait"
STARTS, SECONDS, SETTLING = 100, 20.0, 1.0
GROUNDS: Mapping[str, Any] = {
    "level": {},
    "slope of 0.1 rad": {"floor": {"slope": [0.1, 0.1]}},
    "rough, 20 mm": {"floor": {"rough": [0.02, 0.02]}},
    "rough, 30 mm": {"floor": {"rough": [0.03, 0.03]}},
    "steps of 10 mm": {"floor": {"steps": [0.01, 0.01]}},
    "steps of 20 mm": {"floor": {"steps": [0.02, 0.02]}},
    "pushes up to 0.3 m/s": {"push": {"speed": [0.0, 0.3]}},
}
COUNT = 64  # simulations of the speed
PUSHED: Mapping[str, Any] = {"push": {"speed": [0.0, 0.4], "interval": [2.0, 4.0]}}  # of any robot; of docs/walk.md


def walked(name: str, ground: Mapping[str, Any]) -> dict[str, float]:
    """How a walker does on a ground: falls, and errors of speed and turn as shares of what was asked."""
    if name == GAIT:
        return followed(checked_env(read_yaml(FOLDER / "env/walk.yaml", "the task")), ground, None)
    act, description = load_policy(Path(name))
    return followed(trained_env(description, Path(name), None), ground, act)


def followed(env: Mapping[str, Any], ground: Mapping[str, Any], act: Any) -> dict[str, float]:
    """The same of a policy ``act`` of observations in an environment, or of its reference (None)."""
    engine = make_vec_env({**env, "randomization": dict(ground), "stand_share": 0.0}, None, STARTS, 0).engine
    task = engine.task
    assert isinstance(task, WalkTask)
    engine.autoreset = False
    engine.seed(0)
    seen = engine.reset()
    fallen, speeds = np.zeros(STARTS, bool), []
    for step in range(round(SECONDS / engine.dt)):
        action = np.zeros((STARTS, len(engine.action_names))) if act is None else act(seen)
        result = engine.step(action)
        seen, fallen = result.observation, fallen | result.terminated
        if step * engine.dt >= SETTLING:
            velocity, turn, _ = task.velocity(engine.motion(action))
            speeds.append(np.column_stack([velocity[:, :2], turn]))
    asked, off = engine.motion(action).command, np.mean(speeds, axis=0) - engine.motion(action).command
    up = ~fallen
    return {
        "falls": int(fallen.sum()),
        "speed": _share(np.linalg.norm(off[up, :2], axis=1), np.linalg.norm(asked[up, :2], axis=1)),
        "turn": _share(np.abs(off[up, 2]), np.abs(asked[up, 2])),
    }


def _share(off: np.ndarray, asked: np.ndarray) -> float:
    """The mean of errors over that of what was asked; NaN where all fell, or nothing was asked."""
    return float(off.mean() / asked.mean()) if len(off) and asked.any() else math.nan


def learned(name: str) -> dict[str, Any]:
    """A policy of any robot beside its own reference, under pushes; and what its training took."""
    act, description = load_policy(Path(name))
    env = trained_env(description, Path(name), None)
    robot = get_robot(env["robot"])
    task = WalkTask.on(robot)
    model = robot.drivetrain().model
    return {
        "height": task.standing_of().height,
        "mass": float(mujoco.mj_getTotalmass(model)),
        "joints": len(robot.coordinates),
        "steps": int(description["step"]),
        "gait": followed(env, PUSHED, None),
        "policy": followed(env, PUSHED, act),
    }


def throughput() -> dict[str, list[float]]:
    """Control steps per second [1/s] of the task, and of bare MuJoCo with position servos on the same model."""
    engine = make_vec_env(checked_env(read_yaml(FOLDER / "env/walk.yaml", "the task")), None, COUNT, 0).engine
    engine.reset()
    bare = Batch(bare_model(engine.drivetrain), COUNT, 0)
    actions, stance = np.zeros((COUNT, len(engine.action_names))), np.array(engine.batch.bind("ctrl"))
    start = np.array(engine.batch.bind("qpos"))

    def task() -> int:
        engine.step(actions)
        return COUNT

    def alone() -> int:
        if not bare.bind("time").any() or bare.bind("time").max() > SECONDS:
            bare.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
            bare.bind("qpos")[:], bare.bind("ctrl")[:] = start, stance
        bare.step(nstep=engine.substeps)
        return COUNT

    return interleaved({"task": task, "bare": alone}, seconds=1.0, repeats=9)


def told(found: Mapping[str, Any]) -> str:
    """The results as a page of Markdown."""
    parts: list[str] = []
    for name, rows in found.get("walkers", {}).items():
        cells = ((ground, row["falls"], f"{100 * row['speed']:.0f}", f"{100 * row['turn']:.0f}")
                 for ground, row in rows.items())  # fmt: skip
        parts += [f"## {name.capitalize()}", table(("ground", "falls", "speed [%]", "turn [%]"), cells)]
    if robots := found.get("robots"):
        cells = (
            (name, row["joints"], f"{row['mass']:.1f}", f"{row['height']:.2f}", f"{row['steps']:,}", cell(row["gait"]),
             cell(row["policy"]))
            for name, row in robots.items()
        )  # fmt: skip
        parts += [
            "## Policies beside their gait",
            "Each beside its reference alone, both with strides of 1, under pushes of up to 0.4 m/s every 2 to 4 s: "
            "falls, errors of speed and turn. `python -m benchmarks.walking --robots runs/<run>/final ...`",
            table(("run", "joints", "mass [kg]", "height [m]", "steps", "reference", "policy"), cells),
        ]
    if rates := found.get("rates"):
        ratios = np.array(rates["task"]) / np.array(rates["bare"])
        parts.append(
            f"Throughput of `env=walk` with {COUNT} simulations over bare MuJoCo on the same model, contacts and "
            f"contact sensors, in turns: {np.median(ratios):.2f} (quartiles {np.quantile(ratios, 0.25):.2f} to "
            f"{np.quantile(ratios, 0.75):.2f}); {np.median(rates['task']):,.0f} control steps per second. "
            "`python -m benchmarks.walking --speed`"
        )
    return page(
        "A quadruped that walks as commanded",
        f"{STARTS} starts of {SECONDS:g} s on each ground; errors are shares of the mean command. "
        "`python -m benchmarks.walking`",
        *parts,
    )


def cell(row: Mapping[str, float]) -> str:
    """Falls, speed and turn of a walker."""
    return ", ".join([f"{row['falls']:.0f}", *(f"{100 * row[key]:.0f} %" for key in ("speed", "turn"))])


@study
def main() -> None:
    """Measure, print and write."""
    parser = command(__doc__)
    parser.add_argument("policies", nargs="*", help="folders of policies; the reference gait is always measured")
    parser.add_argument("--speed", action="store_true", help="measure the steps per second instead")
    parser.add_argument("--robots", action="store_true", help="measure policies of any robots beside their references")
    arguments = parser.parse_args()
    found: dict[str, Any] = read("walking", {})
    if arguments.speed:
        found["rates"] = throughput()
    for name in arguments.policies if arguments.robots else ():
        found.setdefault("robots", {})[Path(name).parent.name] = row = learned(name)
        print(f"{name}: {row}", flush=True)
    for name in () if arguments.speed or arguments.robots else (GAIT, *arguments.policies):
        rows = found.setdefault("walkers", {})[name] = {}
        for ground, drawn in GROUNDS.items():
            rows[ground] = walked(name, drawn)
            print(f"{name}, {ground}: {rows[ground]}", flush=True)
    write("walking", told(found), found)
    print(told(found))


if __name__ == "__main__":
    sys.exit(main())
