"""The committed policies on every actuator model of their robot, beside their reference and the best constant action.

    python -m benchmarks.policy_matrix             what has no row yet, about 20 minutes of one core
    python -m benchmarks.policy_matrix hopper      one task
    python -m benchmarks.policy_matrix --again     all anew

Nothing is trained. Each policy acts on the chain of its training and on the others of its robot, from starts that no
training has seen; what counts is the measure of its task. The reference is the action 0 where actions correct one, and
the controller of paper 004 for the hopper. The best constant action of those tried is chosen anew on each model, from
other starts: of the action 0, the mean action of each policy, and actions drawn uniformly. So it knows the model; a
policy does not. A row holds the digest of the policies that it was measured with, and one of other policies is no row.
"""

from __future__ import annotations

import hashlib
import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sealegs.actuators import load_chain
from sealegs.agents.policy_files import load_policy
from sealegs.common.atomic import write_text
from sealegs.common.errors import SealegsError
from sealegs.common.markdown import page, table
from sealegs.envs.hexapod.env import MOST
from sealegs.envs.hopper.controller import BangBang, spring_stiffness

from benchmarks.kept import POLICIES, RESULTS, Kept, command, study, write
from benchmarks.learned import OTHERS, Biped
from benchmarks.rollouts import Act, Seeds, at_own_step, foot_errors, hopper_rewards, hops, moments, tool_errors, walked
from benchmarks.verdicts import BETTER, LEAST_POLICIES, RULE, UNJUDGED, WORSE, Estimate, beside, estimate, over, short

FILE = RESULTS / "policy_matrix.jsonl"
SEED, SEARCH_SEED = 40_000, 60_000  # of the starts that are judged, and of those on which a constant is chosen
JUDGED = Biped.judged
SECONDS = 15.0  # of walking and of hopping
WINDOW = 12.0  # [s] of the hexapod's way, two cycles of its gait, after as many
REFERENCE, CONSTANT = "reference", "constant"
Scores = tuple[np.ndarray, np.ndarray]
"""The measure of each start (n,), and whether it ended in a fall (n,)."""


# --- measures of the tasks --------------------------------------------------------------------------------------------


def hopper(env: dict[str, Any], actuator: Any, act: Act, starts: int, seed: Seeds) -> Scores:
    """Reward of an episode; it is over with a fall, and what follows earns nothing."""
    rewards, upright = hopper_rewards(env, actuator, act, starts, seed)
    return rewards, ~upright


def leg(env: dict[str, Any], actuator: Any, act: Act, starts: int, seed: Seeds) -> Scores:
    """Rms distance of the foot from its path."""
    errors, _ = foot_errors(env, actuator, act, starts, seed)
    return np.sqrt(np.mean(np.square(errors), axis=0)), np.zeros(starts, bool)


def arm(env: dict[str, Any], actuator: Any, act: Act, starts: int, seed: Seeds) -> Scores:
    """Largest distance of the tool from its place."""
    errors, _ = tool_errors(env, actuator, act, starts, seed)
    return errors.max(axis=0), np.zeros(starts, bool)


def hexapod(env: dict[str, Any], actuator: Any, act: Act, starts: int, seed: Seeds) -> Scores:
    """Specific resistance; the most that the task's reward counts where it fell, or went nowhere."""
    found = walked(env, actuator, act, starts=starts, window=WINDOW, seed=seed)
    forward = (found.way[:, 0] > 0.0) & ~found.fallen
    return np.where(forward, np.minimum(found.resistance, MOST), MOST), found.fallen


def biped(env: dict[str, Any], actuator: Any, act: Act, starts: int, seed: Seeds) -> Scores:
    """How far the way is from the commanded one, in parts of that; with a fall all of it is lost."""
    way, upright = np.zeros(starts), np.ones(starts, bool)
    for moment in moments(env | {"speed": JUDGED}, actuator, act, starts, SECONDS, seed):
        upright = moment.upright
        way = np.where(upright, moment.forward, way)
    return np.where(upright, np.abs(way / (JUDGED * SECONDS) - 1.0), 1.0), ~upright


def biped_hopping(env: dict[str, Any], actuator: Any, act: Act, starts: int, seed: Seeds) -> Scores:
    """Hops until the fall."""
    found = hops(env, actuator, act, starts, SECONDS, seed)
    return found.count, ~found.upright


@dataclass(frozen=True)
class Judged:
    """A task, and how its policies are judged.

    Attributes:
        measure: of each start.
        said: what it is, with its unit.
        models: words of the actuator models of its robot; first the one that policies were trained with.
        starts: on each model; 1 where all come to the same.
        drawn: constant actions that are tried beside 0 and the policies' means.
        tried: starts of each constant action.
        more: whether more is better.
    """

    measure: Callable[[dict[str, Any], Any, Act, int, Seeds], Scores]
    said: str
    models: tuple[str, ...]
    starts: int
    drawn: int = 20
    tried: int = 8
    more: bool = False


AMRU5 = ("amru5_lugre", "amru5_dry", "amru5_load", "amru5_frictionless")
FALLING = ("hopper", "hexapod", "biped", "biped_hopping")
TASKS: Mapping[str, Judged] = {
    "hopper": Judged(hopper, "reward of an episode", ("sv1270tg", *OTHERS), 32, more=True),
    "leg": Judged(leg, "rms error of the foot [mm]", ("silo4_pd", "silo4", *OTHERS), 16),
    "arm": Judged(arm, "largest error of the tool [mm]", ("srlfj_joint1 to 3", *OTHERS), 1, tried=1),
    "hexapod": Judged(hexapod, "specific resistance", (*AMRU5, *OTHERS), 2, drawn=6, tried=1),
    "biped": Judged(biped, f"share by which the way is off, at {JUDGED:g} m/s", ("mabel", *OTHERS), 8),
    "biped_hopping": Judged(biped_hopping, f"hops in {SECONDS:g} s", ("mabel", *OTHERS), 8, more=True),
}


# --- who acts ---------------------------------------------------------------------------------------------------------


class Mean:
    """A policy, and the mean of its actions so far."""

    def __init__(self, act: Act) -> None:
        self._act, self._sum, self._count = act, np.zeros(0), 0

    def __call__(self, seen: np.ndarray) -> np.ndarray:
        action = self._act(seen)
        self._sum = action.sum(axis=0) if self._count == 0 else self._sum + action.sum(axis=0)
        self._count += len(action)
        return action

    @property
    def action(self) -> list[float]:
        """The mean action."""
        return np.round(self._sum / max(self._count, 1), 6).tolist()


def constant(actions: np.ndarray) -> Act:
    """Actions (n, k), or one for all (k,), whatever is seen."""
    return lambda seen: np.broadcast_to(actions, (len(seen), actions.shape[-1]))


def bang_bang(description: Mapping[str, Any], chain: Any) -> Act | None:
    """The controller of paper 004 on the hopper's observations; None on a chain whose torque it cannot feel."""
    try:
        law = BangBang(stiffness=spring_stiffness(load_chain(chain)))
    except SealegsError:
        return None
    names = description["observation_names"]
    motor, link = ([names.index(f"{joint} {side} [rad]") for joint in ("hip", "knee")]
                   for side in ("motor reading", "link angle"))  # fmt: skip
    zero, per_action = np.asarray(description["goal_at_zero"]), np.asarray(description["goal_per_action"])
    return lambda seen: np.clip((law.goals(seen[:, motor], seen[:, link]) - zero) / per_action, -1.0, 1.0)


def best_constant(task: Judged, env: dict[str, Any], chain: Any, known: np.ndarray) -> np.ndarray:
    """The constant action (k,) with the best mean measure from other starts, of ``known`` (m, k) and drawn ones."""
    drawn = np.random.default_rng(SEARCH_SEED).uniform(-1.0, 1.0, (task.drawn, known.shape[1]))
    tried = np.concatenate([known, drawn])
    seeds = np.tile(SEARCH_SEED + np.arange(task.tried), len(tried)).tolist()
    acts = constant(np.repeat(tried, task.tried, axis=0))
    scores, _ = task.measure(env, chain, acts, len(seeds), seeds)
    means = scores.reshape(len(tried), task.tried).mean(axis=1)
    return tried[np.argmax(means) if task.more else np.argmin(means)]


# --- rows -------------------------------------------------------------------------------------------------------------


def read() -> dict[tuple[str, str, str], dict[str, Any]]:
    """Rows that are there of the policies as they are now, by task, model and who acts."""
    now = {(name, actor): digest(name, actor) for name in TASKS for actor in actors(name)}
    return {
        (row["task"], row["model"], row["actor"]): row
        for row in Kept(FILE).rows
        if row["policies"] == now.get((row["task"], row["actor"]))
    }


def digest(name: str, actor: str) -> str:
    """Of the policies that a row rests on: its own, all of a constant, and the one whose robot a reference has."""
    seeds = {REFERENCE: ["seed0"], CONSTANT: seeds_of(name)}.get(actor, [actor])
    files = (POLICIES / name / seed / file for seed in seeds for file in ("policy.json", "policy.safetensors"))
    return hashlib.sha256(b"".join(hashlib.sha256(file.read_bytes()).digest() for file in files)).hexdigest()[:16]


def keep(rows: Mapping[tuple[str, str, str], dict[str, Any]]) -> None:
    """Write all rows, in the order of tasks and models."""
    order = [(task, model) for task, judged in TASKS.items() for model in judged.models]
    listed = sorted(rows.values(), key=lambda row: (order.index((row["task"], row["model"])), row["actor"]))
    write_text(FILE, "".join(json.dumps(row) + "\n" for row in listed), replace=True)


def seeds_of(name: str) -> list[str]:
    """Committed policies of a task."""
    return sorted(path.parent.name for path in POLICIES.glob(f"{name}/seed*/policy.json"))


def actors(name: str) -> list[str]:
    """Committed policies of a task, then what they are compared with."""
    return [*seeds_of(name), REFERENCE, CONSTANT]


def measure(name: str, model: str, actor: str, rows: Mapping[tuple[str, str, str], dict[str, Any]]) -> dict[str, Any]:
    """A row: the measure of each start, and the falls."""
    task = TASKS[name]
    policy, description = load_policy(POLICIES / name / (actor if actor.startswith("seed") else "seed0"))
    env = at_own_step(description["env"]) if name.startswith("biped") else description["env"]
    trained = model == task.models[0]
    chain = description["actuators"] if trained else model
    row: dict[str, Any] = {"task": name, "model": model, "actor": actor, "policies": digest(name, actor)}
    act: Act | None = Mean(policy)
    if actor == REFERENCE:
        felt = next(iter(description["actuators"].values())) if trained else model
        still = np.zeros(description["action"]["shape"])
        act = bang_bang(description, felt) if name == "hopper" else constant(still)
    elif actor == CONSTANT:
        means = [rows[name, task.models[0], seed]["mean_action"] for seed in seeds_of(name)]
        known = np.array([np.zeros_like(means[0]), *means])
        best = best_constant(task, env, chain, known)
        row["action"] = np.round(best, 6).tolist()
        act = constant(best)
    if act is None:
        return row | {"scores": None, "fell": None}
    scores, fell = task.measure(env, chain, act, task.starts, SEED)
    if isinstance(act, Mean):
        row["mean_action"] = act.action
    return row | {"scores": np.round(scores, 6).tolist(), "fell": int(fell.sum())}


# --- what they come to ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Cell:
    """What a task's policies come to on a model.

    Attributes:
        task, model: which.
        reference: that they are beside; None: the model has none.
        constant: the best constant action of those tried.
        policies: of all of them; each by itself below :data:`LEAST_POLICIES`.
        fell: falls, of :attr:`tried` starts of policies.
        tried: their number.
        against_reference, against_constant: verdicts.
    """

    task: str
    model: str
    reference: Estimate | None
    constant: Estimate
    policies: tuple[Estimate, ...]
    fell: int
    tried: int
    against_reference: str
    against_constant: str

    @property
    def mean(self) -> float:
        """Over policies and starts."""
        return float(np.mean([item.mean for item in self.policies]))

    @property
    def falls(self) -> str:
        """As a page has them; empty where nobody can fall."""
        return f"{self.fell} of {self.tried}" if self.task in FALLING else ""


def cell(rows: Mapping[tuple[str, str, str], dict[str, Any]], name: str, model: str) -> Cell | None:
    """What is told of a task on a model; None while rows are missing."""
    found = [rows.get((name, model, actor)) for actor in actors(name)]
    if None in found:
        return None
    *policies, reference, fixed = (row for row in found if row is not None)
    own, more = np.array([row["scores"] for row in policies]), TASKS[name].more
    first = None if reference["scores"] is None else np.array([reference["scores"]])
    second = np.array([fixed["scores"]])
    return Cell(
        name, model, None if first is None else estimate(first), estimate(second),
        (estimate(own),) if len(own) >= LEAST_POLICIES else tuple(estimate(row[None]) for row in own),
        sum(row["fell"] for row in policies), own.size, beside(own, first, more), beside(own, second, more),
    )  # fmt: skip


def cells(rows: Mapping[tuple[str, str, str], dict[str, Any]]) -> list[Cell]:
    """All that have their rows, in the order of tasks and models."""
    found = (cell(rows, name, model) for name, task in TASKS.items() for model in task.models)
    return [item for item in found if item is not None]


def tried(name: str) -> int:
    """Constant actions that are tried: 0, the mean of each policy, and those drawn."""
    return 1 + len(seeds_of(name)) + TASKS[name].drawn


def counts(verdicts: Sequence[str]) -> str:
    """How often policies do better and worse."""
    unjudged = verdicts.count(UNJUDGED)
    judged = [f"{verdicts.count(BETTER)} better, {verdicts.count(WORSE)} worse"] if unjudged < len(verdicts) else []
    return ", ".join(judged + [UNJUDGED] * (unjudged > 0))


HEADS = ("robot and task", "policies", "starts", "measure", "own chain", "worst other", "models", "to the reference",
         "to the best constant tried")  # fmt: skip


def counted(found: Sequence[Cell], names: Mapping[str, str]) -> list[tuple[str, ...]]:
    """By task, called as in ``names``, what :data:`HEADS` say; counts are of verdicts.

    A task is left out while what its policies do on their own chain has no rows.
    """
    lines = []
    for name, task in TASKS.items():
        of = {item.model: item for item in found if item.task == name}
        if task.models[0] not in of:
            continue
        others = [item for model, item in of.items() if model != task.models[0]]
        least = sorted(others, key=lambda item: item.mean, reverse=not task.more)[:1]
        lines.append((
            names.get(name, name), str(len(seeds_of(name))), str(task.starts), task.said,
            short(*of[task.models[0]].policies),
            "".join(f"{short(*item.policies)} on `{item.model}`" for item in least), str(len(of)),
            counts([item.against_reference for item in of.values()]),
            counts([item.against_constant for item in of.values()]),
        ))  # fmt: skip
    return lines


def worse(found: Sequence[Cell]) -> list[str]:
    """Where policies surely do worse than the reference or than a constant action."""
    return [
        f"{item.task} on `{item.model}` ({short(*item.policies)}, {what} {short(other)})"
        for item in found
        for what, verdict, other in (("reference", item.against_reference, item.reference),
                                     ("constant action", item.against_constant, item.constant))
        if verdict == WORSE and other is not None
    ]  # fmt: skip


def falls(found: Sequence[Cell]) -> list[str]:
    """Where policies fall."""
    return [f"{item.task} on `{item.model}` {item.falls}" for item in found if item.fell]


def told(rows: Mapping[tuple[str, str, str], dict[str, Any]]) -> str:
    """The results as a page of Markdown."""
    found, parts = cells(rows), list[str]()
    for name, task in TASKS.items():
        heads = ("model", "reference", f"best of {tried(name)} constant actions", "policies", "falls",
                 "to the reference", "to the constant")  # fmt: skip
        own = (
            (item.model, item.reference or "", item.constant, ", ".join(map(str, item.policies)), item.falls,
             item.against_reference, item.against_constant)
            for item in found if item.task == name
        )  # fmt: skip
        parts += [
            f"## {name}",
            f"{task.said[0].upper()}{task.said[1:]}; {'more' if task.more else 'less'} is better. "
            f"Intervals and verdicts: {over(len(seeds_of(name)), task.starts)}.",
            table(heads, own),
        ]
    return page(
        "Committed policies on every actuator model of their robot",
        f"Means over policies and starts. {RULE} Better and worse: surely so, start by start, each verdict by itself; "
        "empty: the model has no spring that the hopper's reference could feel. The first model of a task is that of "
        "the training. The constant action is the best of those tried on each model, from other starts. "
        "`make policy-matrix`",
        table(HEADS, counted(found, {})),
        *parts,
    )


@study
def main() -> None:
    """Measure, print and write."""
    parser = command(__doc__)
    parser.add_argument("tasks", nargs="*", help=f"of {', '.join(TASKS)}; default: all")
    parser.add_argument("--again", action="store_true", help="measure rows that are there anew")
    arguments = parser.parse_args()
    if unknown := set(arguments.tasks) - set(TASKS):
        raise SealegsError(f"there is no task {', '.join(sorted(unknown))}; tasks are {', '.join(TASKS)}.")
    rows = read()
    wanted = [(name, model, actor) for name in arguments.tasks or TASKS for model in TASKS[name].models
              for actor in actors(name)]  # fmt: skip
    for key in wanted:
        if key in rows and not arguments.again:
            continue
        begun = time.monotonic()
        rows[key] = measure(*key, rows)
        keep(rows)
        scores = rows[key]["scores"]
        mean = "-" if scores is None else f"{np.mean(scores):.4g}"
        print(f"{', '.join(key)}: {mean} ({time.monotonic() - begun:.0f} s)", flush=True)
    write("policy_matrix", told(rows))


if __name__ == "__main__":
    sys.exit(main())
