"""The proposal: which excitation, and where no motion helps which load, tells best apart what a log leaves open.

Each hypothesis (a rival, or any cause of the catalogue where the log shows none) predicts the new measurement. What
counts is how far two predictions differ after each of them was allowed to fit the other as well as it can, with all
that may be tuned beside it, on the old log and the new measurement together: a difference that a little more
friction would hide tells nothing apart.
"""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..checks.drive import predicted
from ..checks.stops import Stop
from ..log.finding import MAX_TOLD
from ..log.parts import FIT_A, FIT_B, PARTS, Unit
from ..log.sidecar import Sidecar, named_beside, sidecar_text
from ..log.types import JointLog, LogError, MeasuredRun
from ..replay.free import free_problem
from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter, numbers
from ..replay.problem import JointProblem
from ..replay.simulator import CHANNELS
from ..search.bounded import bounded_step
from ..search.fit import merge, middle
from ..search.result import Search
from ..search.simpler import without_friction
from ..search.structure import listed
from .excitations import GOAL_RATE, GRAVITY_STALL_SHARE, Limits, abilities, default_limits, excitations, visited, within

Along = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""What a joint of a robot works against (n, T_COLUMNS) on a planned motion: of times (n,) [s] and goals (n,) [rad]."""
MIN_SEPARATION = 1.0  # noise floors (rms) by which rivals must differ; below that another load is proposed
VISIBLE_DIFFERENCE = 0.3  # noise floors (rms) that a search can still see: below that nothing is told apart
MAX_SEPARATION = 3.0  # noise floors beyond which a pair needs no more
COLUMNS = ("current", "duty")
"""Columns of a drive that tell causes apart which the position alone does not."""
NOTHING_MORE = "nothing more"
"""Name of the hypothesis that no further cause is there."""
EXPERIMENT_REPEATS = len(PARTS)  # times the excitation is to be run: once for each part of the data
LOAD_FACTORS = (2.0, 1.5, 0.5)  # of the mass on the shaft, the heavier first: it shows more
NORMAL_RIDGE = 1e-9  # of the normal equations, relative and absolute
MAX_SHRINKS = 9  # of a motion that a hypothesis predicts to leave the limits, by up to 2 each: to less than a hundredth
MAX_OLD_SAMPLES = 6000  # of the old log that the hypotheses must also fit


@dataclass(frozen=True, eq=False)
class Experiment:
    """A proposed measurement.

    Attributes:
        name: of the excitation.
        sentence: what to do and what it tells apart.
        separation: root mean squared difference of the two rivals that differ least on it, in noise floors.
        time, goal: the excitation (n,) [s], [rad].
        table: separation by excitation.
        load: bench parameters of the measurement.
        repeats: times to run it.
        rivals: what it tells apart.
    """

    name: str
    sentence: str
    separation: float
    time: np.ndarray
    goal: np.ndarray
    table: dict[str, float]
    load: dict[str, float] = dataclasses.field(default_factory=dict)
    repeats: int = EXPERIMENT_REPEATS
    rivals: tuple[str, ...] = ()


@dataclass(frozen=True)
class Hypothesis:
    """What may be true: values by path, and the parameters that may still move if it is, its own last.

    Attributes:
        own: paths of the parameters that make it this hypothesis.
    """

    name: str
    values: dict[str, float]
    parameters: tuple[Parameter, ...]
    own: tuple[str, ...] = ()

    @property
    def beside(self) -> int:
        """How many parameters are not its own."""
        return sum(p.path not in self.own for p in self.parameters)


def _hypothesis(
    name: str, values: dict[str, float], before: Sequence[Parameter], own: Sequence[Parameter]
) -> Hypothesis:
    taken = {p.number for p in own}
    beside = [p for p in before if p.number not in taken]
    return Hypothesis(name, values, (*beside, *own), tuple(p.path for p in own))


@dataclass(frozen=True, eq=False)
class Prediction:
    """Weighted signals that a hypothesis predicts (m,), their change by each parameter (m, p), and how far each
    parameter may move down and up (p,), in the coordinates of the fit. The first ``beside`` of them are not its own.
    """

    signal: np.ndarray
    change: np.ndarray
    low: np.ndarray
    high: np.ndarray
    beside: int

    @cached_property
    def gram(self) -> np.ndarray:
        """Products of the changes (p, p)."""
        return self.change.T @ self.change


def propose(
    problem: JointProblem,
    search: Search,
    limits: Limits | None = None,
    seed: int = 0,
    blind: bool = False,
    stops: Sequence[Stop] = (),
    along: Along | None = None,
) -> Experiment | None:
    """The measurement that best tells the rivals of a search apart.

    Args:
        problem: of the log.
        search: what was found in it.
        limits: of the joint; default: :func:`sealegs.gap.experiment.excitations.default_limits`.
        seed: of the excitations.
        blind: the log shows too little: tell all causes of the catalogue apart, not only rivals.
        stops: of the joint, which no motion goes near.
        along: of a joint of a robot, its load on a planned motion; it stays within what the log has visited.

    Returns:
        None where the search left nothing open, or where the servo can hold no load within the limits.
    """
    hypotheses = everything(problem, search) if blind else _rivals(search)
    if len(hypotheses) < 2:
        return None
    position = problem.measured[:, 0]
    limits = limits or (default_limits(position) if along is None else visited(position))
    limits = limits and within(limits, stops)
    if limits is None:
        return None
    old = thinned(problem.part(FIT_A, FIT_B))
    known = [predict(old, h) for h in hypotheses]
    nominal = problem.models[0]
    best: Experiment | None = None
    table: dict[str, float] = {}
    loads = _distinct(problem.params)
    for step, load in enumerate([*loads, *_other_loads(nominal, loads[0])]):
        if step >= len(loads) and best is not None and best.separation >= MIN_SEPARATION:
            break
        for name, goal in excitations(limits, nominal, load, seed).items():
            goal = kept_within(problem, load, goal, hypotheses, limits, along)
            if goal is None:
                continue
            label = name if load == loads[0] else f"{name}, {load['mass']:.3g} kg"
            new = measurement(problem, load, goal, along)
            predicted = [predict(new, h) for h in hypotheses]
            apart = _distances(known, predicted)
            score = float(np.mean(np.minimum(apart, MAX_SEPARATION))) if blind else float(apart.min())
            table[label] = score
            # another load is work: it must tell a good deal more apart
            dearer = best is not None and load not in loads and best.load in loads
            if best is None or score > best.separation * (1.5 if dearer else 1.0):
                time = np.arange(len(goal)) / GOAL_RATE
                best = Experiment(
                    name, "", score, time, goal, table, dict(load), rivals=tuple(h.name for h in hypotheses)
                )
    if best is None:
        return None
    sentence = experiment_sentence(best, loads, blind, alone=along is None, lacking=lacking(problem))
    return dataclasses.replace(best, sentence=sentence)


def lacking(problem: JointProblem) -> list[str]:
    """Columns of the effort that would tell more of a joint: its chain predicts them, and its log has none."""
    logged = {name for c, name in enumerate(problem.channels) if np.isfinite(problem.measured[:, c]).any()}
    driven = problem.free_joint is None
    wanted = (name for name in predicted(problem.models[0].chain) if driven or name != "torque")
    return [name for name in wanted if name not in logged]


def experiment_sentence(
    best: Experiment,
    loads: Sequence[Mapping[str, float]],
    blind: bool,
    *,
    alone: bool = True,
    lacking: Sequence[str] = COLUMNS,
) -> str:
    """What to run, and what it tells; what else would, of columns those that the log is lacking."""
    seconds = best.time[-1] + 1.0 / GOAL_RATE
    what = (
        f"Run '{best.name}' {best.repeats} times ({seconds:g} s each, goals between {best.goal.min():.2f} and "
        f"{best.goal.max():.2f} rad; see that the joint is free there)"
    )
    if not alone:
        what += " with the other joints held in the middle of where they were"
    if best.load not in loads:
        what += f" with {best.load['mass']:.3g} kg on the arm instead of {loads[0]['mass']:.3g} kg"
    elif len(loads) > 1:
        what += f" with {best.load['mass']:.3g} kg at {best.load['length']:.3g} m"
    what += " and diagnose these logs together with the old ones"
    names = "the causes of the catalogue apart" if blind else _apart(best.rivals)
    mean = " on average" if blind else ""
    if best.separation < VISIBLE_DIFFERENCE:
        it = "one of these" if blind or len(best.rivals) > 2 else "it"
        more = f", log more columns ({', '.join(lacking)})," if lacking else ""
        return (
            f"Within the limits of motion, no motion and no load of the library tells {names} (at most "
            f"{best.separation:.2f} times the noise{mean}): allow a wider motion (limits=[lower,upper]){more} or "
            f"measure {it} directly."
        )
    if blind:
        return f"{what}: the causes of the catalogue differ there by {best.separation:.1f} times the noise{mean}."
    return f"{what}: it tells {names}, by {best.separation:.1f} times the noise."


def _apart(rivals: Sequence[str]) -> str:
    """What an experiment tells: hypotheses from each other, or, where nothing else may be there, whether one is."""
    causes = [name for name in rivals if name != NOTHING_MORE]
    if len(causes) == len(rivals):
        return f"{listed(causes)} apart"
    return f"whether {causes[0]} is there" if len(causes) == 1 else f"{listed(causes)} apart, or whether any is there"


# --- hypotheses ----------------------------------------------------------------------------------------------------


def _rivals(search: Search) -> list[Hypothesis]:
    """The candidates that the first undecided round leaves, beside the other causes that were accepted."""
    for k, step in enumerate(search.rounds):
        close = [*step.candidates[:1], *search.close(step)][:MAX_TOLD]
        before = merge(search.tuned, *(c.variant for j, c in enumerate(search.accepted) if j != k))
        found = [_hypothesis(c.cause.name, middle(*c.fits), before, c.variant) for c in close]
        if found and not step.accepted:  # a round that ends the search leaves open whether anything is missing at all
            fits = search.accepted[k - 1].fits if k else search.base
            found.append(_hypothesis(NOTHING_MORE, middle(*fits), before, ()))
        if len(found) > 1:
            return found
    return []


def everything(problem: JointProblem, search: Search) -> list[Hypothesis]:
    """Every cause of the catalogue at a plausible size on top of what was found, and none of them."""
    nominal = problem.models[0]
    last = search.fits
    here, moving = middle(*last), search.parameters()
    taken = {c.cause.name for c in search.accepted} | without_friction(search.causes, moving, nominal)
    found = [_hypothesis(NOTHING_MORE, here, moving, ())]
    for cause in search.causes:
        variant = cause.variants[0]
        if cause.name in taken or (cause.needs.temperature_range and np.ptp(problem.temperature) == 0.0):
            continue
        turned = {p.number for p in variant}
        values = {path: here[path] for number, path in numbers(here).items() if number not in turned}
        values |= {p.path: p.start for p in variant}
        first = variant[0]
        if first.start == first.neutral(nominal):
            values[first.path] = first.from_fit(first.to_fit(first.start) + 1.0)
        found.append(_hypothesis(cause.name, values, moving, variant))
    return found


# --- measurements and predictions ----------------------------------------------------------------------------------


def _distinct(params: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
    loads: list[dict[str, float]] = []
    for one in params:
        if dict(one) not in loads:
            loads.append(dict(one))
    return loads[:3]


def _other_loads(nominal: JointModel, load: Mapping[str, float]) -> list[dict[str, float]]:
    """The same arm with another mass that the servo can still hold."""
    found = []
    for factor in LOAD_FACTORS if load.get("mass", 0.0) > 0.0 else ():  # what to hang on an empty shaft is not known
        changed = {**load, "mass": float(f"{load['mass'] * factor:.2g}")}
        if nominal.load.gravity_torque(changed) <= GRAVITY_STALL_SHARE * abilities(nominal)[0]:
            found.append(changed)
    return found


def measurement(
    problem: JointProblem, load: Mapping[str, float], goal: np.ndarray, along: Along | None = None
) -> JointProblem:
    """A measurement yet to be made, laid out as the log is; its measured signals are zero."""
    time = np.arange(len(goal)) / GOAL_RATE
    nothing = np.zeros(len(goal))
    logged = {c: nothing for c in CHANNELS if c != "position" and problem.weight[CHANNELS.index(c)] > 0.0}
    warm = np.full(len(goal), float(np.median(problem.temperature)))
    log = JointLog(goal=goal, position=nothing, temperature=warm, **logged)
    robot = "bench" if along is None else "robot"
    run = MeasuredRun("next", time, {"joint": log}, robot=robot, robot_params=dict(load))
    unit = Unit(0, FIT_A, 0, len(goal), 1, (float(goal[0]), 0.0))
    weight: dict[str, float] = dict(zip(map(str, CHANNELS), problem.weight, strict=True))
    terms = None if along is None else [along(time, goal)]
    laid = free_problem([run], "joint", problem.models[:1], [unit], weight, terms)
    return dataclasses.replace(laid, step=problem.step)


def kept_within(
    problem: JointProblem,
    load: Mapping[str, float],
    goal: np.ndarray,
    hypotheses: Sequence[Hypothesis],
    limits: Limits,
    along: Along | None = None,
) -> np.ndarray | None:
    """The goals (n,), smaller where a hypothesis predicts that the joint shoots beyond its limits.

    They shrink about their own middle: that of the limits may lie where the servo cannot hold its load. None where a
    hypothesis predicts that of ever so small a motion: this moves metal.
    """
    spare = 0.05 * limits.reach
    centre = 0.5 * (goal.min() + goal.max())
    for _ in range(MAX_SHRINKS):
        planned = measurement(problem, load, goal, along)
        out = planned.simulate([h.values for h in hypotheses])[:, :, 0]
        out = np.clip(out, -1e2, 1e2) - centre
        beyond = max(
            float(out.max()) / (limits.upper + spare - centre), float(-out.min()) / (centre - limits.lower + spare)
        )
        if beyond <= 1.0 + 1e-6:
            return goal
        goal = centre + (goal - centre) / min(beyond, 2.0)
    return None


def thinned(problem: JointProblem) -> JointProblem:
    """Few enough units of a long log, spread over it."""
    sizes = np.diff(problem.starts)
    every = max(int(np.ceil(sizes.sum() / MAX_OLD_SAMPLES)), 1)
    if every == 1 or len(sizes) <= every:
        return problem
    chosen = set(range(0, len(sizes), every))
    marked = tuple(dataclasses.replace(u, part=FIT_A if k in chosen else FIT_B) for k, u in enumerate(problem.units))
    return dataclasses.replace(problem, units=marked).part(FIT_A)


def predict(problem: JointProblem, hypothesis: Hypothesis) -> Prediction:
    """What a hypothesis says of a motion, to first order in its nuisance parameters."""
    parameters = hypothesis.parameters
    u = np.array([p.to_fit(min(max(hypothesis.values.get(p.path, p.start), p.low), p.high)) for p in parameters])
    low = np.array([p.to_fit(p.low) if p.low > 0.0 or not p.logarithmic else -1e3 for p in parameters])
    high = np.array([p.to_fit(p.high) for p in parameters])
    reach = np.array([p.difference for p in parameters])
    steps = np.where(u + reach <= high, reach, -reach)

    def values(row: np.ndarray) -> dict[str, float]:
        moved = {p.path: p.from_fit(x) for p, x in zip(parameters, row, strict=True)}
        return {**hypothesis.values, **moved}

    rows = [values(u), *(values(row) for row in u[None] + np.diag(steps))]
    measured = problem.measured
    blank = dataclasses.replace(problem, measured=np.where(np.isfinite(measured), 0.0, np.nan))
    signals = blank.residual(blank.simulate(rows))
    change = ((signals[1:] - signals[0]) / steps[:, None]).T
    return Prediction(signals[0], change, low - u, high - u, hypothesis.beside)


def _distances(known: Sequence[Prediction], predicted: Sequence[Prediction]) -> np.ndarray:
    """How far each two hypotheses differ on a new measurement, (h (h - 1) / 2,), in noise floors (rms)."""
    found = []
    for a in range(len(predicted)):
        for b in range(a):
            one = unlike(known[a], known[b], predicted[a], predicted[b])
            other = unlike(known[b], known[a], predicted[b], predicted[a])
            found.append(min(one, other))
    return np.array(found)


def unlike(old_a: Prediction, old_b: Prediction, new_a: Prediction, new_b: Prediction) -> float:
    """Worst-case separation of two hypotheses on the new measurement (rms).

    ``a`` is true, of the size it has. Its nuisance parameters, and all parameters of ``b``, minimise the difference,
    subject to the old log.
    """
    own = new_a.beside
    beside = slice(0, own)
    # of the move of both: first the nuisance parameters of a, then all of b; repeats weigh as several measurements
    change = np.concatenate([-new_a.change[:, beside], new_b.change], axis=1)
    rest = new_b.signal - new_a.signal
    gram, slope = EXPERIMENT_REPEATS * (change.T @ change), EXPERIMENT_REPEATS * (change.T @ rest)
    gram[:own, :own] += old_a.gram[beside, beside]
    gram[own:, own:] += old_b.gram
    slope[own:] += old_b.change.T @ (old_b.signal - old_a.signal)
    low, high = np.append(new_a.low[beside], new_b.low), np.append(new_a.high[beside], new_b.high)
    moved = bounded_step(gram + np.diag(NORMAL_RIDGE * gram.diagonal() + NORMAL_RIDGE), slope, low, high)
    return float(np.sqrt(np.mean((rest + change @ moved) ** 2)))


# --- A proposed experiment on disk: goals that ``deploy.py`` runs, and the sidecar for the log that comes of it ------
#
# The goals are a CSV with the columns ``time`` [s] and ``<joint>.goal`` [rad], each goal held until the next row. The
# sidecar beside it (docs/log-format.md) says what must hang on the shaft while it runs.


def goal_table(experiment: Experiment, joint: str) -> str:
    """The goals as CSV text."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["time", f"{joint}.goal"])
    rows.writerows(zip(np.round(experiment.time, 6), np.round(experiment.goal, 6), strict=True))
    return text.getvalue()


def write_experiment(
    experiment: Experiment,
    joint: str,
    folder: Path,
    actuator: str | list | None,
    prefix: str = "",
    robot: str = "bench",
    frame: Mapping[str, float] | None = None,
    final: Path | None = None,
) -> dict[str, Path]:
    """Write ``next_experiment.csv`` and ``next_experiment.yaml``.

    Args:
        experiment: to write.
        joint: that it moves.
        folder: to write into.
        actuator: chain of the joint as the sidecars name it; None where the robot's file does.
        prefix: of the file names.
        robot: as the sidecars name it.
        frame: ``zero`` and ``direction`` of the joint in the log, whose goals these are, where they are not the
            model's; they go into the sidecar, and who runs the goals on the model's machine turns them.
        final: where the files come to lie, if that is another folder: the sidecar names others as they lie beside it.

    Returns:
        Paths by ``experiment`` and ``experiment_sidecar``.
    """
    goals, sidecar = folder / f"{prefix}next_experiment.csv", folder / f"{prefix}next_experiment.yaml"
    goals.write_text(goal_table(experiment, joint), encoding="utf-8")
    notes: dict[str, Any] = {"notes": f"{experiment.name}: {experiment.sentence}"}
    if frame is not None:
        notes["frames"] = {joint: dict(frame)}
    said = Sidecar(robot, dict(experiment.load), {} if actuator is None else {joint: actuator}, notes)
    sidecar.write_text(sidecar_text(named_beside(said, folder if final is None else final)), encoding="utf-8")
    return {"experiment": goals, "experiment_sidecar": sidecar}


def read_goals(path: Path) -> tuple[str, np.ndarray, np.ndarray]:
    """Read the goals of an experiment.

    Returns:
        Joint, times (n,) [s], goals (n,) [rad].

    Raises:
        LogError: the file is not one.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            header, *rows = [row for row in csv.reader(file) if row]
        if len(header) != 2 or header[0] != "time" or not header[1].endswith(".goal"):
            raise ValueError
        table = np.array(rows, float)
        if table.ndim != 2 or len(table) < 2 or not np.isfinite(table).all() or (np.diff(table[:, 0]) <= 0.0).any():
            raise ValueError
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError:
        raise LogError(
            f"{path}: is no experiment; it needs the columns time and <joint>.goal, with numbers and increasing times."
        ) from None
    return header[1].removesuffix(".goal"), table[:, 0], table[:, 1]
