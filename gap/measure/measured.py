"""What the models do on data that nothing was fitted to, and what each named cause is worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from ..causes.catalogue import adjustable
from ..causes.cause import Cause, Variant
from ..causes.load import STOPS, as_logged
from ..log.parts import FIT_A, FIT_B, TEST
from ..replay.comparison import robust_loss
from ..replay.parameters import Parameter
from ..replay.problem import Nominal, Problem
from ..search.alike import with_alike
from ..search.fit import Fit, fit, middle
from ..search.led import of_run
from ..search.refit import refit
from ..search.result import Search
from ..search.settings import DEFAULT
from ..search.sketch import most_iterations
from ..search.structure import Structure, structure, told_in
from .adrift import begun_fit, left_by
from .case import Replay
from .confidence import THRESHOLDS, Adrift, Thresholds, as_noise_allows, by_effect, confidence, law_error, standing
from .named import Error, NamedCause, OpenCause, Value
from .rivals import beside_rivals, intervals_of
from .signatures import Signature, disagreeing, signatures
from .unseen import (
    Handed,
    Model,
    crossed_errors,
    effective,
    handed_over,
    harm,
    near_misses,
    outdone,
    refitted_numbers,
    with_effect,
)

NOT_TUNED = Error(float("nan"), float("nan"))


@dataclass(frozen=True, eq=False)
class Measured:
    """Errors, causes and what is left of a search's models.

    Attributes:
        gap: error of each model on the test part, by ``nominal``, ``refitted`` (its own numbers up to fivefold, nothing
            added), ``extended`` (with the causes), ``noise_floor``.
        tuned_error: error there of the nominal model, tuned within its tolerance.
        values: of all parameters of the extended model, by path; a ``*`` marks a factor.
        simulated: channels of the models over the whole problem, by model name (n, 4).
        left: share of the nominal mean squared error beyond the noise that stays on the test part.
        unexplained: the same, at least what the structure is of it.
        structure: what is left of the error that is not noise.
        causes: largest share first.
        tuned: numbers of the nominal model that moved within their tolerance, as factors; where ``model`` is
            ``refitted``, up to fivefold.
        tuned_share: share that the extended model owes to its tuned numbers.
        shared_shares: the same of what all joints share, by cause.
        shared: causes of all joints, by the number of this joint's chain that each of them changes.
        open_causes: withdrawn ones, and near misses with what they lack.
        model: which model is handed over: ``extended``, ``refitted`` or ``nominal``.
        turned: the numbers that refitting turned furthest, where that is the model.
        beside: the same, where they were refitted beside the causes by more than their tolerance.
        removed: where numbers were refitted beside the causes, the share of what these numbers leave on all data that
            no fit saw, and that the causes remove; None elsewhere: on the test part, of what tuned numbers leave.
        adrift: of a joint of a robot that nothing holds, what its replay may be off by anyway.
        whole_runs: whether the test part is whole runs, not pieces of runs that were fitted elsewhere.
        of_robot: whether it is of a joint of a robot, whose other bodies are believed.
    """

    gap: Mapping[str, Error] = field(default_factory=dict)
    tuned_error: Error = NOT_TUNED
    values: Mapping[str, float] = field(default_factory=dict)
    simulated: Mapping[str, np.ndarray] = field(default_factory=dict)
    left: float = 0.0
    unexplained: float = 0.0
    structure: Structure | None = None
    causes: tuple[NamedCause, ...] = ()
    tuned: Mapping[str, float] = field(default_factory=dict)
    tuned_share: float = 0.0
    shared_shares: Mapping[str, float] = field(default_factory=dict)
    shared: Mapping[str, str] = field(default_factory=dict)
    open_causes: tuple[OpenCause, ...] = ()
    model: str = "extended"
    turned: str = ""
    beside: str = ""
    removed: float | None = None
    adrift: Adrift | None = None
    whole_runs: bool = True
    of_robot: bool = False

    def settled(self, limit: Thresholds = THRESHOLDS) -> bool:
        """As :func:`as_noise_allows`, of the model that is handed over."""
        error, noise = self.gap["extended"].rmse, self.gap["noise_floor"].rmse
        return self.structure is None or as_noise_allows(self.structure, error, noise, self.of_robot, limit)

    def adds_up(self, limit: Thresholds = THRESHOLDS) -> bool:
        """Whether what is left is no more than what adds up in a replay that nothing holds."""
        return self.adrift is not None and self.adrift.allows(self.gap["noise_floor"].rmse, limit)

    def only_starts(self, limit: Thresholds = THRESHOLDS) -> bool:
        """Whether what is left is no more than where pieces begin does to a replay that nothing holds."""
        return self.adrift is not None and self.adrift.at_noise(self.gap["noise_floor"].rmse, limit)


def measure(replay: Replay, search: Search, joint: str, seed: int) -> Measured:
    """Fit the models once more to all that may be fitted, and judge them on the test part.

    Args:
        replay: that was searched.
        search: what was found.
        joint: its name.
        seed: of all resampling.
    """
    problem, fitting, wide = replay.problem, replay.fitting, replay.wide
    fitted, test = fitting.part(FIT_A, FIT_B), problem.part(TEST)
    evaluations = most_iterations(fitted, search.settings)
    model = effective(fitting, search, seed)
    refitted = refit(fitted, wide, (model.fitted.values,), search.settings)
    if problem.open_loop and len(fitting.units) > len(problem.units):  # sought in windows, judged on whole pieces
        most = search.settings.iterations
        refitted = whole_fit(problem, wide, refitted, most)
        model = model.with_fit(whole_fit(problem, model.search.parameters(), model.fitted, most))
    drifts = problem.joint if problem.open_loop and replay.of_robot else None
    if drifts is not None and model.search.accepted:
        model = model.with_fit(begun_fit(drifts, model.search.parameters(), model.fitted, search.settings.iterations))
    model = with_effect(problem, fitting, model)
    sought, open_causes = model.search, model.withdrawn
    tuned = model.fitted
    if sought.accepted:
        tuned = fit(fitted, search.tuned, middle(*search.base), evaluations)
    found = {"nominal": {}, "refitted": refitted.values, "tuned": tuned.values, "extended": model.fitted.values}
    unseen = {name: test.position_error(test.simulate([values])[0]) for name, values in found.items()}
    errors = {name: error_of(error) for name, error in unseen.items()}

    @cache
    def halves(name: str) -> Sequence[Mapping[str, float]]:
        if name == "nominal":
            return [{}, {}]
        if name == "refitted":
            parts = (fitting.part(FIT_A), fitting.part(FIT_B))
            return [fit(part, wide, refitted.values, evaluations).values for part in parts]
        return [f.values for f in (model.search.fits if name == "extended" else search.base)]

    @cache
    def crossed(name: str) -> np.ndarray:
        return crossed_errors(problem, halves(name))

    draws = search.settings.verdict_draws
    named = bool(sought.accepted)
    chosen = handed_over(
        unseen, problem.signal[1], seed, draws,
        named=named, crossed=crossed, loose=search.loose, noise=problem.noise, of_robot=replay.of_robot,
    )  # fmt: skip
    if chosen.model != "nominal" and problem.joint is not None:
        rows = problem.simulate([{}, found[chosen.model]])
        if spoiled := harm(problem, *rows):
            factor, words = told_in(problem.signal[1])
            said = f"where the believed model is right to the noise, it would be {factor * spoiled:.3g} {words} off"
            chosen = Handed("nominal", said if named else "")
    handed = chosen.model
    if chosen.why:
        sought, given_up = outdone(sought, chosen.why)
        open_causes = (*open_causes, *given_up)
    drift = None
    if drifts is not None:
        handed, drift = left_by(drifts, found, handed, bool(sought.accepted), seed)
    values = found[handed]

    gap = {name: errors[name] for name in ("nominal", "refitted")} | {"extended": errors[handed]}
    if handed != "extended" and model.search.accepted:
        gap["withdrawn"] = errors["extended"]
    gap["noise_floor"] = Error(problem.noise, problem.noise * float(np.sqrt(2.0 / np.pi)))
    models = {"nominal": {}, "refitted": refitted.values, "extended": values}
    simulated = {name: problem.simulate([numbers])[0] for name, numbers in models.items()}
    rest = structure(problem, simulated["extended"], seed, search.settings)
    everywhere = float(np.mean(problem.position_error(simulated["extended"]) ** 2))
    # the noise as it is, where the floor was estimated with a margin
    white = min(everywhere - rest.rms**2, problem.noise**2)
    excess = max(gap["nominal"].rmse ** 2 - white, 1e-12)
    left = float(np.clip((gap["extended"].rmse ** 2 - white) / excess, 0.0, 1.0))
    unexplained = left
    if rest.noticed:  # structure that the test part shows less of than the rest is not explained for that
        before = float(np.mean(problem.position_error(simulated["nominal"]) ** 2)) - white
        unexplained = max(left, min(rest.rms**2 / max(before, 1e-12), 1.0))
    unnamed = rest
    if drift is not None and sought.accepted and drift.at_noise(problem.noise):  # the rest is where pieces begin
        unexplained, unnamed = 0.0, replace(rest, level=drift.level)
    features: dict[str, tuple[Signature, ...]] = {}
    keys = {c.cause.key: c.cause.signature for c in sought.accepted if c.cause.signature}
    if keys:
        without = problem.simulate([tuned.values])[0]
        features = {name: signatures(key, problem, without, simulated["extended"]) for name, key in keys.items()}
    beyond = 1.0
    rival = rival_of(wide)
    if (rest.noticed or search.loose) and sought.accepted:
        both = (np.concatenate([unseen[name], crossed(name)]) for name in (rival, "extended"))
        beyond = beyond_refitting(*(float(np.mean(error**2)) - white for error in both))
    charge = beyond if rest.noticed else 1.0
    led: dict[str, Led] = {}
    if rest.noticed and sought.accepted and sought.leader is not None:  # the other runs cannot show what led
        both = (unseen_in(problem, sought.leader, found[name], halves(name)) for name in (rival, "extended"))
        before, after = (max(float(np.mean(error**2)) - white, 0.0) for error in both)
        left_there = float(robust_loss(np.sqrt(after / problem.noise**2)))
        led = {key: Led(removed, left_there, beyond_refitting(before, after)) for key, removed in sought.led.items()}
    sought_in = excess  # counted where causes were sought: in windows that restart, or in whole pieces
    if fitting is not problem:
        sought_in = float(np.mean(fitting.position_error(fitting.simulate([{}])[0]) ** 2))
    own = problem.joint.models[0] if problem.joint else None
    turned = with_alike({p.number for p in wide}, own)
    account = Account(1.0 - unexplained, sought_in / problem.noise**2, charge, turned, led)
    freed = own if handed == "extended" and sought.loose else None
    if sought.accepted:
        at = intervals_of(fitted, search.settings.rough_iterations, seed)
        model = replace(model, bounds=beside_rivals(sought, model.bounds, at))
    causes, tuned_share = _name_causes(replay, sought, model, joint, account, unnamed, features)
    return Measured(
        gap=gap,
        tuned_error=errors["tuned"],
        values=values,
        simulated=simulated,
        left=left,
        unexplained=unexplained,
        structure=rest,
        causes=causes,
        tuned={p.number: values[p.path] for p in search.tuned if p.path in values},
        tuned_share=tuned_share,
        open_causes=(*open_causes, *near_misses(search)),
        model="extended" if handed == "tuned" else handed,
        turned=refitted_numbers(wide, refitted.values) if handed == "refitted" else "",
        beside="" if freed is None else refitted_numbers(_others(wide, causes), values, adjustable(freed)),
        removed=beyond if search.loose and sought.accepted else None,
        adrift=drift,
        whole_runs=whole_runs(problem),
        of_robot=replay.of_robot,
    )


def _others(wide: Sequence[Parameter], causes: Sequence[NamedCause]) -> list[Parameter]:
    """The numbers that no named cause is of."""
    named = {number for cause in causes for number in cause.parameters}
    return [p for p in wide if p.number not in named]


def whole_fit(problem: Problem, parameters: Sequence[Parameter], found: Fit, most: int = DEFAULT.iterations) -> Fit:
    """A fit to windows, carried on to whole pieces, whose errors add up small ones; as it was where that is no better.

    Args:
        problem: all data, in whole pieces.
        parameters: of the fit.
        found: to windows of the same data.
        most: iterations.
    """
    if not parameters:
        return found
    fitted = problem.part(FIT_A, FIT_B)
    again = fit(fitted, parameters, found.values, most)
    before, after = (fitted.position_error(fitted.simulate([one.values])[0]) for one in (found, again))
    return again if np.mean(after**2) < np.mean(before**2) else found


def whole_runs(problem: Problem) -> bool:
    """Whether the runs of the test part are in no other part."""
    runs = [{unit.run for unit in problem.units if (unit.part == TEST) is test} for test in (True, False)]
    return not runs[0] & runs[1]


def error_of(error: np.ndarray) -> Error:
    """The size of errors (n,)."""
    return Error(float(np.sqrt(np.mean(error**2))), float(np.mean(np.abs(error))))


def unseen_in(
    problem: Problem, run: int, values: Mapping[str, float], halves: Sequence[Mapping[str, float]]
) -> np.ndarray:
    """Errors of a model on all of one run that its fits did not see (n,).

    Args:
        problem: all data.
        run: its number.
        values: fitted to all that may be fitted, for the test part.
        halves: fitted to the first half of that, and to the second.
    """
    own = of_run(problem, run, (FIT_A, FIT_B, TEST))
    errors = [crossed_errors(own, halves)]
    if any(unit.part == TEST for unit in own.units):
        test = own.part(TEST)
        errors.append(test.position_error(test.simulate([values])[0]))
    return np.concatenate(errors)


@dataclass(frozen=True)
class Led:
    """A cause in the one run of many that showed it first, as of :func:`sealegs.gap.measure.confidence.confidence`.

    Attributes:
        removed: loss per value that it removes there.
        residual: loss per value of what is left there.
        beyond: share of what refitted numbers leave there.
    """

    removed: float
    residual: float
    beyond: float


@dataclass(frozen=True)
class Account:
    """What the causes of a joint explain together.

    Attributes:
        explained: share of the nominal mean squared error beyond the noise.
        size: that error, in squares of the noise floor.
        beyond: as of :func:`sealegs.gap.measure.confidence.confidence`.
        numbers: that refitting turns, or their like: of a wrong one it must do as well.
        led: the same in the run that showed a cause first, by the cause's key.
    """

    explained: float
    size: float
    beyond: float
    numbers: frozenset[str] | set[str]
    led: Mapping[str, Led]


def rival_of(wide: Sequence[Parameter]) -> str:
    """The model that causes are held against: the refitted one, or, where nothing may be refitted, the tuned one.

    Of what joints share nothing is refitted, and what each of them was found to have before is not their gain.
    """
    return "refitted" if wide else "tuned"


def beyond_refitting(refitted: float, extended: float) -> float:
    """Share of the squared error beyond the noise that refitted numbers leave, and that the causes remove."""
    return float(np.clip(1.0 - extended / refitted, 0.0, 1.0)) if refitted > 0.0 else 0.0


def _name_causes(
    replay: Replay,
    search: Search,
    model: Model,
    joint: str,
    account: Account,
    rest: Structure,
    features: Mapping[str, tuple[Signature, ...]],
) -> tuple[tuple[NamedCause, ...], float]:
    """Causes with shares, confidence, rivals and intervals, and the share of the tuned numbers."""
    if not search.accepted:
        return (), account.explained
    fitting = replay.fitting
    values = model.fitted.values
    parts = [{p.path for p in candidate.variant} for candidate in search.accepted]
    parts.append(set(values).difference(*parts))
    *shares, tuned_share = map(float, account.explained * by_effect(replay.problem, values, parts))
    rounds = [r for r in search.rounds if r.accepted]
    residual = float(robust_loss(np.sqrt(rest.level))) if rest.noticed else 0.0
    neighbours = float(robust_loss(np.sqrt(THRESHOLDS.neighbours))) if replay.of_robot else 0.0
    named = []
    for k, (candidate, share) in enumerate(zip(search.accepted, shares, strict=True)):
        before, after = rounds[k].before.sum(), candidate.blocks.sum()
        removed = float((before - after) / search.counts.sum())
        rivals = search.rivals(k)
        wrong = float(robust_loss(np.sqrt(law_error(account.size * (account.explained - share)))))
        led = account.led.get(candidate.cause.key, Led(removed, residual, account.beyond))
        beyond = 1.0 if candidate.variant[0].number in account.numbers else led.beyond
        sure = confidence(min(candidate.best, candidate.better), led.removed, led.residual + neighbours + wrong, beyond)
        simpler = not_excluded(candidate.cause, candidate.variant, model.spread, search.settings.shape_edge)
        if simpler and simpler not in {c.cause.name for c in search.accepted}:
            rivals, sure = tuple(dict.fromkeys((*rivals, simpler))), sure * THRESHOLDS.at_bound
        sizes = [p for p in candidate.variant if p.is_size]
        sure *= min((measured(p, model.spread[p.path]) for p in sizes), default=1.0)
        if any(p.path in model.fitted.at_bound for p in sizes):
            sure *= THRESHOLDS.at_bound
        seen = features.get(candidate.cause.key, ())
        contradicted = disagreeing(seen) is not None
        sure *= THRESHOLDS.contradicted if contradicted else 1.0
        named.append(
            NamedCause(
                name=candidate.cause.name,
                sentence=candidate.cause.sentence,
                joint=joint,
                share=share,
                confidence=sure,
                parameters={
                    p.number: _value(p, model.fitted, model.bounds, fitting.models[0])
                    for p in candidate.variant
                    if p.path in model.fitted.values
                },
                gain=max(1.0 - float(np.sqrt(after / before)), 0.0),
                kind=candidate.cause.kind,
                picture=candidate.cause.picture,
                rivals=rivals,
                standing=standing(sure, rivals, contradicted=contradicted),
                signatures=seen,
                against=candidate.cause.against,
            )
        )
    return tuple(sorted(named, key=lambda cause: -cause.share)), tuned_share


def not_excluded(cause: Cause, variant: Variant, bounds: Mapping[str, tuple[float, float]], edge: float) -> str:
    """The simpler law that a cause is at the edge of its shape, where the shape's interval reaches that; else "".

    Args:
        cause: that was named.
        variant: its parameters.
        bounds: intervals by path.
        edge: share of the shape's upper bound from which it is the simpler law.
    """
    limit, shape = cause.degenerates_to, cause.edge(variant)
    if limit is None or shape is None or limit.by_range or shape.path not in bounds:
        return ""
    return limit.cause if bounds[shape.path][1] >= edge * shape.high else ""


def measured(parameter: Parameter, bounds: tuple[float, float]) -> float:
    """Factor on the confidence: 1 for an interval within half of the range tried, 0 for one that fills it."""
    low, high, least, most = (parameter.to_fit(x) for x in (*bounds, parameter.low, parameter.high))
    return float(np.clip(2.0 * (1.0 - (high - low) / max(most - least, 1e-12)), 0.0, 1.0))


def _value(parameter: Parameter, extended: Fit, bounds: Mapping[str, tuple[float, float]], nominal: Nominal) -> Value:
    found = (extended.values[parameter.path], *bounds[parameter.path])
    value, low, high = (float(parameter.physical(number, nominal)) for number in found)
    if parameter.number in STOPS:  # angles of the link, which a person looks up in the log
        value, low, high = (as_logged(angle, extended.values, nominal) for angle in (value, low, high))
    unit = nominal.unit(parameter.number) if parameter.factor else parameter.unit
    return Value(value, low, high, unit, float(nominal.value(parameter.number)))
