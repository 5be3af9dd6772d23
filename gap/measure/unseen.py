"""Which of the fitted models may be handed over: what holds on data that nothing was fitted to.

Four rules, in this order. A cause whose interval reaches the value at which it does nothing is no finding, unless data
that no fit saw miss it. Nor is one that may be put back to what is believed without a larger loss. Causes that leave
the error of the test part no smaller than nominal or tuned numbers do are withdrawn, all of them. Where turning the
nominal numbers alone does clearly better on all data that its fits did not see, that is the finding, and the model that
is handed over. These data are the test part, and each half under the fit to the other: a test part alone may be the
slow stretches of a chirp.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..causes.cause import Variant
from ..checks.signal import block_weights
from ..log.finding import Finding
from ..log.parts import FIT_A, FIT_B, TEST
from ..replay.comparison import rms
from ..replay.parameters import Parameter, about
from ..replay.problem import Nominal, Problem
from ..search.delays import with_centred_times
from ..search.fit import Fit, fit, middle
from ..search.intervals import intervals
from ..search.result import Candidate, Search
from ..search.settings import DEFAULT, SearchSettings
from ..search.sketch import coarsened, fit_from_sketch, most_iterations
from ..search.structure import fine, told_in
from .confidence import THRESHOLDS
from .named import NEAR_MISS, WITHDRAWN, OpenCause


@dataclass(frozen=True, eq=False)
class Model:
    """The extended model with those causes that have an effect.

    Attributes:
        search: less the causes that have none.
        fitted: all its parameters, to all that may be fitted.
        bounds: 95 % intervals by path; that of a cause that unseen data miss ends before it reaches no effect.
        withdrawn: causes that were taken out.
        spread: the intervals as they were: what confidence counts.
    """

    search: Search
    fitted: Fit
    bounds: Mapping[str, tuple[float, float]]
    withdrawn: tuple[OpenCause, ...] = ()
    spread: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def with_fit(self, fitted: Fit) -> Model:
        """The model with other values; its intervals reach them."""
        bounds, spread = (
            {
                path: (min(low, fitted.values.get(path, low)), max(high, fitted.values.get(path, high)))
                for path, (low, high) in told.items()
            }
            for told in (self.bounds, self.spread)
        )
        return replace(self, fitted=fitted, bounds=bounds, spread=spread)


def effective(fitting: Problem, search: Search, seed: int) -> Model:
    """Fit the extended model to all that may be fitted; take out the causes that may as well do nothing.

    One at a time, the last one that was found first: where two trade off against each other, neither can be told from
    none while the other is there, and one of them stays. So does one that unseen data miss: an interval is a parabola
    about the optimum, and says less of a model without the cause than that model's own fit.
    """
    fitted, coarse = fitting.part(FIT_A, FIT_B), coarsened(fitting, search.settings)
    idled: list[OpenCause] = []
    while True:
        parts = search.fits
        found = fit(fitted, search.parameters(), middle(*parts), most_iterations(fitted, search.settings))
        found = with_centred_times(fitted, search.parameters(), found)
        if not search.accepted:
            return Model(search, found, {}, tuple(idled))
        spread = intervals(fitted, search.parameters(), found, seed, parts)
        bounds = dict(spread)
        for candidate in reversed([c for c in search.accepted if _idle(c, bounds, fitting.models[0])]):
            away = _away_from_none(candidate, bounds, (found, *parts), fitting.models[0])
            if not (away and missed(coarse, search, candidate, seed)):
                why = f"its size cannot be told from none ({_interval(candidate, bounds)})"
                idled += withdrawn([candidate.cause.name], why)
                search = without(coarse, search, [candidate.cause.key])
                break
            bounds |= away
        else:
            return Model(search, found, bounds, tuple(idled), spread)


def with_effect(problem: Problem, fitting: Problem, model: Model) -> Model:
    """The model less the causes that may be put back to what is believed, all else as it is, without a larger loss.

    In windows that begin anew, a replay may go beyond where the joint goes, and a stop there holds it back. In the
    pieces that are judged, nothing ever meets it. One at a time, the last one that was found first.

    Args:
        problem: all data as they are judged.
        fitting: the same as the search saw them.
        model: fitted to them.
    """
    fitted = problem.part(FIT_A, FIT_B)
    count = float(fitted.blocks()[1].sum())
    while model.search.accepted:
        values = model.fitted.values
        less = [_less(values, candidate.variant) for candidate in model.search.accepted]
        here, *losses = (fitted.block_errors(row).sum() / count for row in fitted.simulate([values, *less]))
        least = here + model.search.settings.least_removed
        idle = [k for k, loss in enumerate(losses) if loss < least]
        if not idle:
            return model
        candidate = model.search.accepted[idle[-1]]
        gone = withdrawn([candidate.cause.name], "the model fits as well without it")
        model = replace(
            model,
            search=without(coarsened(fitting, model.search.settings), model.search, [candidate.cause.key]),
            fitted=replace(model.fitted, values=less[idle[-1]]),
            withdrawn=(*model.withdrawn, *gone),
        )
    return model


def _less(values: Mapping[str, float], variant: Variant) -> dict[str, float]:
    """Values of a model without those that a cause turns."""
    own = {p.path for p in variant}
    return {path: value for path, value in values.items() if path not in own}


def missed(problem: Problem, search: Search, candidate: Candidate, seed: int) -> bool:
    """Whether unseen data miss a cause: all else refitted without it, the loss is clearly larger.

    Each half of the data is judged under the fit to the other.

    Args:
        problem: the data with the steps of the search, whose losses these are compared with.
        search: with the cause.
        candidate: the cause.
        seed: of the bootstrap.
    """
    parts = (problem.part(FIT_A), problem.part(FIT_B))
    less = search.less([candidate.cause.key])
    other = refitted(parts, less.parameters(), search.fits, search.settings)[1]
    blocks = search.accepted[-1].blocks
    if not blocks.sum() < THRESHOLDS.missed * other.sum():
        return False
    weights = block_weights(len(blocks), search.settings.draws, np.random.default_rng(seed))
    return bool((weights @ blocks < weights @ other).mean() > THRESHOLDS.certainly)


def refitted(
    parts: tuple[Problem, Problem], parameters: Sequence[Parameter], begun: tuple[Fit, Fit], settings: SearchSettings
) -> tuple[tuple[Fit, Fit], np.ndarray]:
    """Fits of some parameters to both parts of the data, and the loss of each block under the one that did not see it.

    Args:
        parts: FIT_A and FIT_B.
        parameters: to fit.
        begun: fits, of other parameters too, from whose values it starts.
        settings: of the search.
    """
    starts = [{p.path: found.values[p.path] for p in parameters if p.path in found.values} for found in begun]
    a, b = (fit_from_sketch(part, parameters, start, settings) for part, start in zip(parts, starts, strict=True))
    crossed = zip(reversed(parts), (a, b), strict=True)
    return (a, b), np.concatenate([p.block_errors(p.simulate([f.values])[0]) for p, f in crossed])


def _away_from_none(
    candidate: Candidate, bounds: Mapping[str, tuple[float, float]], fits: Sequence[Fit], nominal: Nominal
) -> dict[str, tuple[float, float]]:
    """Intervals of those sizes of a cause that all fits put on one side of none, which end half way to the nearest."""
    found = {}
    for p in candidate.variant:
        if not p.is_size or p.path not in bounds:
            continue
        low, high = (p.to_fit(end) for end in bounds[p.path])
        none, values = p.nothing(nominal), [p.to_fit(one.values[p.path]) for one in fits]
        if none < min(values):
            found[p.path] = p.from_fit(max(low, 0.5 * (none + min(values)))), bounds[p.path][1]
        elif none > max(values):
            found[p.path] = bounds[p.path][0], p.from_fit(min(high, 0.5 * (none + max(values))))
    return found


def without(fitting: Problem, search: Search, keys: Collection[str]) -> Search:
    """A search without some of its causes; those that were accepted on top of one of them are fitted anew.

    Args:
        fitting: the data as the search saw them.
        search: with the causes.
        keys: of those to leave out.
    """
    kept = search.less(keys)
    first = next((k for k, c in enumerate(search.accepted) if c.cause.key in keys), len(search.accepted))
    if not kept.accepted or first >= len(kept.accepted):  # nothing stood on what is left out
        return kept
    last, parts = kept.accepted[-1], (fitting.part(FIT_A), fitting.part(FIT_B))
    fits, blocks = refitted(parts, kept.parameters(), last.fits, search.settings)
    values = (fits[0].values, fits[1].values)
    last = replace(last, fits=fits, evidence=replace(last.evidence, blocks=blocks, values=values))
    return replace(kept, accepted=(*kept.accepted[:-1], last))


def _idle(candidate: Candidate, bounds: Mapping[str, tuple[float, float]], nominal: Nominal) -> bool:
    """Whether every size of the variant may be what it is where the cause does nothing."""
    return all(does_nothing(p, bounds[p.path], nominal) for p in candidate.variant if p.is_size and p.path in bounds)


def does_nothing(parameter: Parameter, bounds: tuple[float, float], nominal: Nominal) -> bool:
    """Whether an interval reaches the value at which the parameter changes nothing, or that end of what was tried."""
    low, high = (parameter.to_fit(end) for end in (parameter.low, parameter.high))
    none = parameter.nothing(nominal)
    margin = THRESHOLDS.at_rest * (high - low)
    return parameter.to_fit(bounds[0]) <= none + margin and parameter.to_fit(bounds[1]) >= none - margin


def _interval(candidate: Candidate, bounds: Mapping[str, tuple[float, float]]) -> str:
    first = candidate.variant[0]
    low, high = bounds[first.path]
    return f"{first.number} {low:.3g} to {high:.3g}{'' if first.unit == '1' else ' ' + first.unit}"


@dataclass(frozen=True)
class Handed:
    """Which model is handed over, and why its causes were withdrawn.

    Attributes:
        model: ``extended``, or where its causes do not hold ``tuned``, ``nominal`` or ``refitted``.
        why: the causes are withdrawn; empty where they stand.
    """

    model: str
    why: str = ""


def handed_over(
    errors: Mapping[str, np.ndarray],
    unit: str,
    seed: int,
    draws: int,
    *,
    named: bool,
    crossed: Callable[[str], np.ndarray] | None = None,
    loose: bool = False,
    noise: float = 0.0,
    of_robot: bool = False,
) -> Handed:
    """The model that unseen data support: the one place where named causes are withdrawn.

    Args:
        errors: on the test part (n,), of the models ``nominal``, ``tuned``, ``refitted`` and ``extended``.
        unit: of the errors.
        seed, draws: of the bootstrap.
        named: whether the extended model has any cause.
        crossed: gives the errors of a model on the halves of what may be fitted (m,), each under the fit to the other;
            asked only where refitted numbers do better on the test part.
        loose: whether the numbers were refitted beside the causes: ``tuned`` is ``refitted`` then, and judged as that.
        noise: floor of the errors: causes that reach it are not outdone by numbers.
        of_robot: whether it is a joint of a robot, where neither is a model without causes that reaches it.
    """
    size = {name: rms(error) for name, error in errors.items()}
    model, why = "extended", ""
    others = ("nominal",) if loose else ("nominal", "tuned")
    if named and not all(lowers(errors["extended"], errors[other]) for other in others):
        model, why = "tuned", f"on unseen data the error {_rise(size, unit)}"
    if (why or not named) and not lowers(errors["tuned"], errors["nominal"]):
        model = "nominal"
    if clearly_lowers(errors["refitted"], errors[model], seed, draws):
        unseen = {
            name: errors[name] if crossed is None else np.concatenate([errors[name], crossed(name)])
            for name in ("refitted", model)
        }
        at_noise = rms(unseen[model]) <= THRESHOLDS.at_noise * noise and (of_robot or (named and not why))
        if not at_noise and clearly_lowers(unseen["refitted"], unseen[model], seed, draws):
            beaten = f"{told_in(unit)[0] * rms(unseen['refitted']):.3g} against {fine(rms(unseen[model]), unit)}"
            model, why = "refitted", why or f"refitted numbers do better: {beaten}"
    return Handed(model, why if named else "")


def crossed_errors(problem: Problem, values: Sequence[Mapping[str, float]]) -> np.ndarray:
    """Errors of a model on both halves of what may be fitted (m,), each under the values fitted to the other.

    Args:
        problem: all data.
        values: of the fit to the first half, and of that to the second.
    """
    halves = (problem.part(FIT_B), problem.part(FIT_A))
    return np.concatenate([h.position_error(h.simulate([v])[0]) for h, v in zip(halves, values, strict=True)])


def lowers(error: np.ndarray, other: np.ndarray) -> bool:
    """Whether the mean square of errors (n,) is below that of others."""
    return float(np.mean(error**2)) < float(np.mean(other**2))


def clearly_lowers(error: np.ndarray, other: np.ndarray, seed: int, draws: int) -> bool:
    """The same, by more than chance and rounding, and in most draws of a bootstrap over stretches of the test part."""
    a, b = error**2, other**2
    if not a.mean() < THRESHOLDS.clearly * b.mean():
        return False
    count = max(min(len(a) // 50, 40), 2)
    blocks = np.array_split(np.stack([a, b], axis=1), count)
    sums = np.stack([block.sum(axis=0) for block in blocks])
    drawn = block_weights(count, draws, np.random.default_rng(seed)) @ sums
    return bool((drawn[:, 0] < drawn[:, 1]).mean() > THRESHOLDS.certainly)


def _rise(errors: Mapping[str, float], unit: str) -> str:
    """``rises from 35.2 to 41.5 mrad``: against the nominal model, else against its tuned numbers."""
    after = errors["extended"]
    other = "nominal" if after >= errors["nominal"] else "tuned"
    than = "" if other == "nominal" else " of the tuned numbers alone"
    factor, words = told_in(unit)
    first, last = (f"{factor * size:.3g}" for size in (errors[other], after))
    if first == last:
        return f"stays at {first} {words}{than}"
    return f"rises from {first}{than} to {last} {words}"


def withdrawn(names: Iterable[str], why: str) -> tuple[OpenCause, ...]:
    """Causes that were named and do not hold."""
    return tuple(OpenCause(name, WITHDRAWN, why) for name in dict.fromkeys(names))


def outdone(search: Search, why: str) -> tuple[Search, tuple[OpenCause, ...]]:
    """The search without any cause, and the causes that it named as withdrawn."""
    less = search.less([c.cause.key for c in search.accepted])
    return less, withdrawn((c.cause.name for c in search.accepted), why)


def near_misses(search: Search, most: int = 3) -> tuple[OpenCause, ...]:
    """Candidates of the last round that nearly were named, with what they lack and the sizes that both parts found."""
    from ..search import decide

    steps = [step for step in search.record.steps if step.place is None and step.round.candidates]
    if not steps or steps[-1].winner is not None or not search.rounds or search.rounds[-1].accepted:
        return ()  # it ended otherwise, or only its record went on
    found = []
    record = steps[-1].round
    for standing in decide.standings(record, search.settings, search.record.seed):
        lacks = decide.shortfalls(record, standing, search.settings, further=bool(search.accepted))
        if not decide.is_near(lacks, standing, search.settings):
            continue
        evidence = record.candidates[standing.index]
        cause = next((c for c in search.causes if c.key == evidence.name), None)
        first = None if cause is None else cause.variants[0][0]
        sizes = [v[first.path] for v in evidence.values if first is not None and first.path in v]
        told = f"{first.number} {sizes[0]:.4g} and {sizes[1]:.4g} in the two parts" if first and len(sizes) == 2 else ""
        sentence = f"{' and '.join(lack.sentence for lack in lacks)}{'; ' * bool(told)}{told}"
        found.append(OpenCause(evidence.name if cause is None else cause.name, NEAR_MISS, sentence))
    return tuple(found[:most])


def refitted_numbers(wide: Sequence[Parameter], values: Mapping[str, float], known: Sequence[Parameter] = ()) -> str:
    """The numbers that refitting turned furthest, for people; only those turned beyond the tolerances of ``known``.

    Factors are those on a number of the chain, and the scale of a torque and of a load's mass.
    """
    ends = {p.number: (p.low, p.high) for p in known if p.relative}
    turned = [(p.number, values[p.path]) for p in wide if p.relative and p.path in values]
    return furthest([(name, factor) for name, factor in turned if not about(factor, *ends.get(name, (1.0, 1.0)))])


def furthest(factors: Sequence[tuple[str, float]], most: int = 3) -> str:
    """Numbers with their factors, those that were turned furthest, for people."""
    turned = sorted(factors, key=lambda row: -abs(math.log(max(row[1], 1e-9))))
    return first(turned, most)


def first(factors: Sequence[tuple[str, float]], most: int = 3) -> str:
    """The first numbers of several with their factors, for people."""
    return ", ".join(f"{number} x {factor:.3g}" for number, factor in factors[:most])


def unseen_range(
    problem: Problem, simulated: np.ndarray, joint: str, settings: SearchSettings = DEFAULT
) -> Finding | None:
    """Says so if only the test part reaches an angle, and the model is wrong in the pieces that do.

    A stop that the joint meets there alone is neither found nor excluded by what was fitted.

    Args:
        problem: all parts, judged by position; of any other there is nothing to say.
        simulated: columns of the extended model (n, 4).
        joint: its name.
        settings: of the search.
    """
    if problem.signal != ("position", "rad"):
        return None
    position = problem.measured[:, 0]
    error = simulated[:, 0] - position
    good = problem.judged & np.isfinite(error)
    sizes = np.diff(problem.starts)
    test = np.repeat([unit.part == TEST for unit in problem.units], sizes)
    low, high = position[good & ~test].min(), position[good & ~test].max()
    further = np.maximum(low - position, position - high)
    out = good & test & (further > settings.further * (high - low))
    piece = np.repeat(np.arange(len(sizes)), sizes)
    beyond = np.isin(piece, piece[out])
    if not out.any() or not (good & ~beyond).any():
        return None
    there, elsewhere = (float(np.sqrt(np.mean(error[rows] ** 2))) for rows in (good & beyond, good & ~beyond))
    if there <= settings.worse_there * elsewhere:
        return None
    furthest = float(position[out][np.argmax(further[out])])
    return Finding(
        "test.beyond", "note", joint, None,
        f"Only in the part kept for the test does '{joint}' go as far as {furthest:.2f} rad (what was fitted lies "
        f"between {low:.2f} and {high:.2f}), and where it does the error is {1e3 * there:.1f} mrad, else "
        f"{1e3 * elsewhere:.1f}. What happens out there, a stop for instance, cannot be learnt from these data: record "
        "that motion three times.",
        value=furthest,
    )  # fmt: skip


# --- where the believed model is right, no other may be wrong ---------------------------------------------------------
# An effect that begins late, as an overload that trips, leaves the believed model exact until then. What stands in for
# it lowers the error as a whole and spoils what was right, so it is not the cause.

RIGHT_ERROR = 1.2  # noise floors (rms of a block) up to which the believed model is right there
HELD_BLOCKS = 0.2  # of all blocks that must be so, for a model to be judged by them
HARM_ERROR = 4.0  # noise floors (rms over these blocks) beyond which another model harms them: no match


def harm(problem: Problem, nominal: np.ndarray, handed: np.ndarray) -> float:
    """Error of a model where the believed one is at the noise, in the unit of the signal; 0 where it does no harm.

    Args:
        problem: all data.
        nominal, handed: channels of the believed model and of the other (n, 4).
    """
    errors = [problem.position_error(row) for row in (nominal, handed)]
    numbers, sizes = problem.blocks()
    return harm_of(errors[0], errors[1], numbers[: len(errors[0])], len(sizes), problem.noise)


def harm_of(nominal: np.ndarray, handed: np.ndarray, block: np.ndarray, blocks: int, noise: float) -> float:
    """:func:`harm` of errors (m,), by the block of each (m,)."""
    count = np.bincount(block, minlength=blocks)
    held = count > 0
    before, after = (np.bincount(block, error**2, blocks)[held] / count[held] for error in (nominal, handed))
    right = before <= (RIGHT_ERROR * noise) ** 2
    if right.mean() < HELD_BLOCKS:
        return 0.0
    error = float(np.sqrt(np.average(after[right], weights=count[held][right])))
    return error if error > HARM_ERROR * noise else 0.0
