"""The parts of the study, each a file that is there when it is done: a diagnosis, or a policy judged on its machine."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...actuators import load_chain
from ...common.atomic import write_text
from ...common.documents import read_json
from .machines import Hidden, publish, recorded, running

if TYPE_CHECKING:
    from ...agents.config import TrainConfig
from collections.abc import Sequence
from typing import Protocol

from ...envs.any_robot.task import AnyRobotTask
from ...envs.engine.arguments import check_values
from ...envs.engine.task import Motion, Step

NOMINAL, HAND, EVERY = "nominal", "hand-made randomisation", "every number by 20 %"
EXTENDED, DRAWN, SHORT, FINE = "extended", "extended, drawn", "extended, a fifth", "fine-tuned"
LIMIT = "limit"
REFERENCE, EXTENDED_REFERENCE = "reference", "extended reference"
TREATMENTS = (NOMINAL, HAND, EVERY, EXTENDED, DRAWN, SHORT, FINE, LIMIT)
"""What a policy is trained on; ``limit`` is the machine itself. Two have a fifth of the steps on the extended model:
``fine-tuned`` begins with the nominal policy, the other, beside it, with none."""
FIFTH = 5
"""By how much shorter a fine-tuning is than a training."""
REFERENCES = (REFERENCE, EXTENDED_REFERENCE)
"""What needs no learning: the trajectory with the lead of the model as believed, and as diagnosed."""
SCREENING = 1000
"""Seed of the policies by which machines are chosen; it is none of those that are counted."""
STARTS = 7919
"""Seed of the episodes on the machine, the same for all policies."""
HAND_MADE: dict[str, Any] = {
    "position_p.gain": (0.8, 1.2), "dc_motor.motor_constant": (0.9, 1.1), "friction.coulomb": (0.5, 2.0),
    "friction.viscous": (0.5, 2.0), "delay.seconds": (1.0, 4.0),
}  # fmt: skip
"""Ranges, as multiples, that a person would give these servos without measuring them: assumed, from what is usual for
legged robots (motor strength 10 %, gains 20 %, friction twofold, latency up to 20 ms, masses -10 to +30 %)."""
HAND_MASS, HAND_BIAS = (0.9, 1.3), 0.02  # of bodies; of encoders [rad]
WIDE = 0.2


@dataclass(frozen=True)
class Cell:
    """One policy, or one reference, on one machine.

    Attributes:
        hidden: the machine.
        treatment: of :data:`TREATMENTS` or :data:`REFERENCES`.
        seed: of the training.
    """

    hidden: Hidden
    treatment: str
    seed: int = 0

    @property
    def file(self) -> str:
        """Where it is kept, in the folder of the study."""
        word = self.treatment.replace(" %", "").replace(",", "").replace(" ", "-")
        return f"{self.hidden.name}/{word}-{self.seed}.json"


@dataclass(frozen=True)
class Recipe:
    """How policies are trained and judged.

    Attributes:
        steps: of a training; None: those of the task's own config.
        n_envs: simulations side by side; None: likewise.
        episodes: on the machine.
        arguments: further ones of ``sealegs train``.
    """

    steps: int | None
    n_envs: int | None
    episodes: int
    arguments: tuple[str, ...] = ()


# --- diagnosis ---------------------------------------------------------------------------------------------------


def diagnosed(hidden: Hidden, out: Path) -> None:
    """Record a machine and diagnose it, where that is not done."""
    folder = out / hidden.name
    if (folder / "diagnosis.json").is_file():
        return
    from ...gap.diagnose import diagnose
    from ...gap.output.document import FILE

    robot = publish(hidden, folder)
    data = recorded(hidden, robot.parent)
    began = time.perf_counter()
    if not (folder / "diagnosis" / FILE).is_file():
        found = diagnose(data, workers=1, keep=folder / "diagnosis")
        found.save(folder / "diagnosis")
    document = read_json(folder / "diagnosis" / FILE)
    rows = document.get("joints") or [document]
    kept = {
        "seconds": time.perf_counter() - began,
        "joints": {
            row["joint"]: {
                "verdict": row["verdict"],
                "causes": {cause["name"]: cause["confidence"] for cause in row["causes"]},
                "gap": {name: error["rmse"] for name, error in row["gap"].items() if isinstance(error, dict)},
            }
            for row in rows
        },
        "whole_robot": document.get("whole_robot"),
        "model": (folder / "diagnosis" / "extended-robot.yaml").is_file(),
    }
    write_text(folder / "diagnosis.json", json.dumps(kept, indent=1) + "\n", replace=True)


# --- policies ----------------------------------------------------------------------------------------------------


def judged(cell: Cell, recipe: Recipe, out: Path) -> None:
    """Train a policy and judge it on its machine, where that is not done."""
    file = out / cell.file
    if file.is_file():
        return
    began = time.perf_counter()
    rewards, errors, saturated = _judged(cell, recipe, out)
    row = {
        "machine": cell.hidden.name,
        "treatment": cell.treatment,
        "seed": cell.seed,
        "reward": [round(float(x), 4) for x in rewards],
        "rms": [round(float(x), 6) for x in errors],
        "saturated": round(float(saturated), 4),
        "seconds": round(time.perf_counter() - began, 1),
    }
    write_text(file, json.dumps(row) + "\n", replace=True)


def model_of(treatment: str, folder: Path) -> list[str]:
    """Arguments of ``sealegs train`` by which a treatment's model is given."""
    diagnosis = folder / "diagnosis"
    found = (diagnosis / "extended-robot.yaml").is_file()
    if treatment == HAND:
        return [f"randomization={json.dumps(_randomised(HAND_MADE, HAND_MASS, HAND_BIAS))}"]
    if treatment == EVERY:
        wide = (1.0 - WIDE, 1.0 + WIDE)
        return [f"randomization={json.dumps(_randomised(_every(folder, wide), wide, 0.0))}"]
    if found and treatment in (EXTENDED, EXTENDED_REFERENCE, SHORT, FINE):
        return [f"extended={diagnosis}"]
    if found and treatment == DRAWN:
        return [f"randomization={diagnosis}"]
    return []  # as believed; so is what a diagnosis hands over that has no model


def _randomised(chain: dict[str, Any], mass: tuple[float, float], bias: float) -> dict[str, Any]:
    told: dict[str, Any] = {"all": {path: {"times": list(ends)} for path, ends in chain.items()}}
    told["mass"] = {"all": list(mass)}
    return told | ({"bias": {"reading": [0.0, bias]}} if bias else {})


def _every(folder: Path, ends: tuple[float, float]) -> dict[str, Any]:
    """All numbers of the chain that are not 0 but the encoder's ticks, within their own bounds."""
    from ...envs.robots import get_robot

    chain = load_chain(next(iter(get_robot(folder / "robot.yaml").chains_for(None).values())))
    found = {}
    for stage in chain.stages:
        most = {item.name: item.metadata.get("high", np.inf) for item in fields(stage)}
        for key, value in stage.parameters().items():
            if value and stage.name != "encoder":
                found[f"{stage.name}.{key}"] = (ends[0], min(ends[1], most[key] / value))
    return found


def _judged(cell: Cell, recipe: Recipe, out: Path) -> tuple[np.ndarray, np.ndarray, float]:
    """Reward and rms error of each episode on the machine, and the share of saturated duty."""
    import torch
    from gymnasium import spec

    from ...agents.algorithms import build, wrapped
    from ...agents.config import read_config
    from ...agents.initial import keep
    from ...agents.make_env import stream_seed
    from ...agents.policy_files import policy_of
    from ...agents.training import description_of, new_learner, with_fitted
    from ...envs.any_robot.track import TRIALS, TrackTask, measured_lead
    from ...envs.contract import task_of
    from ...envs.engine.sb3 import EngineVecEnv

    folder = out / cell.hidden.name
    robot = publish(cell.hidden, folder)
    words = ["env=track", f"robot={robot}", f"seed={cell.seed}", "video.seconds=0", "evaluate.every=0"]
    words += [f"total_timesteps={recipe.steps}"] if recipe.steps else []
    words += [f"n_envs={recipe.n_envs}"] if recipe.n_envs else []
    words += recipe.arguments
    nominal = folder / f"nominal-{cell.seed}"
    if cell.treatment == FINE:
        if not nominal.is_dir():
            _judged(replace(cell, treatment=NOMINAL), recipe, out)
        words = [f"from={nominal}", f"seed={cell.seed}"]
    config = read_config([*words, *model_of(cell.treatment, folder)]).config
    assert config is not None
    config = a_fifth(config) if cell.treatment in (SHORT, FINE) else config
    steps, rate = spec(config.env["id"]).max_episode_steps or 500, config.env.get("control_rate")
    learns = cell.treatment in TREATMENTS
    torch.set_num_threads(1)

    def on_machine(task: Any, count: int, seed: int) -> PlantEngine:
        dt = 1.0 / float(task.control_rate if rate is None else rate)
        engine = PlantEngine(task, running(cell.hidden, count, dt, seed), count, dt, steps)
        engine.seed(seed)
        return engine

    if cell.treatment == LIMIT:
        task, _ = task_of(_plain(config.env))
        assert isinstance(task, TrackTask)
        straight = replace(task, lead=0.0)
        lead = measured_lead(on_machine(straight, TRIALS, 0), straight.target, task.half)  # type: ignore[arg-type]
        task = replace(task, lead=lead)
        seed = stream_seed(cell.seed, 0)
        machine = EngineVecEnv(on_machine(task, config.n_envs, seed % 2**31))
        model = build(config.agent, wrapped(machine, config.agent, training=True), seed)
    else:
        model, env = new_learner(config, config.actuator)
        config = with_fitted(config, env)
        task, _ = task_of(_plain(config.env))
    if learns:
        model.learn(config.total_timesteps)
    if cell.treatment == NOMINAL:
        keep(nominal, config.as_dict(), model, description_of(config, env))
    act = policy_of(model) if learns else lambda seen: np.zeros((len(seen), len(task.action_names())))
    return on_plant(act, on_machine(task, recipe.episodes, STARTS))


def a_fifth(config: TrainConfig) -> TrainConfig:
    """The config of a training with a fifth of the steps, and as many updates from a fifth of the data each."""
    shorter = {key: max(config.agent[key] // FIFTH, 1) for key in ("n_steps", "batch_size") if key in config.agent}
    return replace(config, total_timesteps=config.total_timesteps // FIFTH, agent={**config.agent, **shorter})


def _plain(env: dict[str, Any]) -> dict[str, Any]:
    """An environment without what only simulations have."""
    return {key: value for key, value in env.items() if key not in ("randomization", "params")}


def on_plant(act: Any, engine: Any) -> tuple[np.ndarray, np.ndarray, float]:
    """Reward and rms error [rad] of an episode of each copy (m,), and the share of time in which a drive saturates."""
    seen, total = engine.reset(), np.zeros(engine.num_envs)
    squares, saturated = np.zeros(engine.num_envs), 0.0
    for step in range(engine.episode):
        if step == engine.episode - 1:  # the last step begins a new episode: its motion is not looked at
            total += engine.step(act(seen)).reward
            break
        result = engine.step(act(seen))
        seen, total = result.observation, total + result.reward
        motion = engine.motion(np.zeros((engine.num_envs, len(engine.action_names))))
        error = motion.link - engine.task.target(motion.time, motion.command)
        squares += (error**2).mean(axis=1)
        saturated += float((np.abs(motion.duty) > 0.95).mean())
    return total, np.sqrt(squares / (engine.episode - 1)), saturated / (engine.episode - 1)


# --- A task on a machine that is no simulation of sealegs: what its encoders say is all that a policy sees -----------
#
# Copies of the machine stand in the place of a batch of simulations, so that a policy can be judged on it, and one
# can learn on it, which is the limit of what any model of it can give.


class Plant(Protocol):
    """Copies of a machine (m of them, n joints each)."""

    @property
    def links(self) -> np.ndarray: ...
    @property
    def torques(self) -> np.ndarray: ...
    @property
    def speeds(self) -> np.ndarray: ...
    @property
    def duties(self) -> np.ndarray: ...
    def place(self, which: np.ndarray, angles: np.ndarray) -> None: ...
    def step(self, goals: np.ndarray) -> None: ...
    def read(self) -> np.ndarray: ...


class PlantEngine:
    """A task on copies of a machine, as :class:`~sealegs.envs.engine.batch.BatchEngine` is one on simulations.

    Attributes:
        task: what is asked of the machine; it has a reference.
        num_envs: copies.
        observation_size: numbers that a policy sees.
        dt: control step [s].
        steps: control steps since each copy started (m,).
    """

    def __init__(self, task: AnyRobotTask, plant: Plant, count: int, dt: float, episode: int) -> None:
        """Take the machine.

        Args:
            task: see above.
            plant: the copies.
            count: of them.
            dt: control step [s].
            episode: control steps of an episode.
        """
        self.task, self.num_envs, self.dt, self.episode = task, count, dt, episode
        self._plant, self._numbers = plant, task.robot.parameters()
        joints = len(task.names)
        self.action_names, self.observation_size = task.action_names(), len(task.observation_names())
        limits = np.array([task.robot.limits[name] for name in task.names])
        self._low, self._high = limits[:, 0], limits[:, 1]
        self._command = np.zeros((count, task.commands(np.zeros((1, task.draws))).shape[1]))
        self._action = np.zeros((count, joints))
        self._reading, self._before = np.zeros((count, joints)), np.zeros((count, joints))
        self._link_before = np.zeros((count, joints))
        self.steps = np.zeros(count, dtype=np.int64)
        self._random = np.random.default_rng(0)

    def seed(self, seed: int | Sequence[int | None] | None) -> None:
        """Of commands and starts; of several numbers, one for each copy, the first counts."""
        self._random = np.random.default_rng(seed[0] if isinstance(seed, Sequence) else seed)

    def set_number(self, name: str, value: Any) -> None:
        """Give a number of the task another value from the next step on.

        Raises:
            SealegsError: the value is none for it.
        """
        check_values(type(self.task), {name: value})
        self.task = replace(self.task, **{name: value})

    def reset(self) -> np.ndarray:
        """Start all copies; their observations (m, size)."""
        self._start(np.arange(self.num_envs))
        return self._observation(self.motion(self._action))

    def _start(self, chosen: np.ndarray) -> None:
        task = self.task
        random = self._random.random((len(chosen), task.draws))
        self._command[chosen] = task.commands(random)
        self.steps[chosen] = 0
        start, per_action = self._reference()
        noise = getattr(task, "start_noise", 0.0) * task.half * (2.0 * task.per_coordinate(random)[:, :, -1] - 1.0)
        begin = np.clip(start[chosen] + noise, self._low, self._high)
        self._plant.place(chosen, begin)
        self._action[chosen] = np.clip((begin - start[chosen]) / per_action, -1.0, 1.0)
        self._reading[chosen] = self._before[chosen] = self._plant.read()[chosen]
        self._link_before[chosen] = self._plant.links[chosen]

    def _reference(self) -> tuple[np.ndarray, np.ndarray]:
        found = self.task.reference(self.steps * self.dt, self._command, self._numbers)
        assert found is not None, "the task corrects a reference"
        return found

    def step(self, action: np.ndarray) -> Step:
        """One control step of all copies; those whose episode ends start anew."""
        previous, self._action = self._action, np.clip(np.asarray(action, np.float64), -1.0, 1.0)
        zero, per_action = self._reference()
        self._plant.step(np.clip(zero + per_action * self._action, self._low, self._high))
        self.steps = self.steps + 1
        self._before, self._reading = self._reading, self._plant.read()
        motion = self.motion(previous)
        terms = self.task.rewards(motion)
        observation = self._observation(motion)
        truncated = self.steps >= self.episode
        done = np.flatnonzero(truncated)
        final = observation[done]
        self._link_before = motion.link
        if len(done):
            self._start(done)
            observation[done] = self._observation(self.motion(self._action))[done]
        never = np.zeros(self.num_envs, bool)
        reward = np.sum(list(terms.values()), axis=0)
        return Step(
            observation, reward=reward, terminated=never, truncated=truncated, terms=terms, flags={"unstable": never},
            servo={}, errors=self.task.errors(motion), done=done, final_observation=final,
        )  # fmt: skip

    def motion(self, previous: np.ndarray) -> Motion:
        """What the task sees of the machine now."""
        link, none = self._plant.links, np.zeros((self.num_envs, 0))
        return Motion(
            qpos=none, qvel=none, link=link, link_speed=(link - self._link_before) / self.dt, reading=self._reading,
            reading_speed=(self._reading - self._before) / self.dt, torque=self._plant.torques,
            motor_speed=self._plant.speeds, action=self._action, previous_action=previous, command=self._command,
            time=self.steps * self.dt, numbers=self._numbers, duty=self._plant.duties,
        )  # fmt: skip

    def _observation(self, motion: Motion) -> np.ndarray:
        return np.concatenate(self.task.observe(motion), axis=1).astype(np.float32)
