"""Finds the causes of a gap: screen, fit, and choose forward on data that the fit did not see."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..causes.catalogue import Cause, catalogue, retunable
from ..log.parts import FIT_A, FIT_B
from ..replay.parameters import Parameter
from ..replay.problem import Problem
from ..replay.robust import robust_loss
from .correlated import excess
from .fit import Fit, fit, merge, middle

KEEP = 10  # causes that are fitted roughly after the screen
FINALISTS = 5  # causes that are fitted fully after that
COARSE = 2.0  # times the step of play and of switching firmware, while causes are sought
ROUGH, FULL = 3, 25  # iterations of a rough fit, and at most of those that follow it
MOST_CAUSES = 6
FEWEST, FAR_OFF = 2, 2.0  # of them are fitted however far off; others only below so many times the error of the first
HOPELESS = 1.5  # times the least error after one iteration: no further ones
OUTRUN = 1.15  # times the error of a cause's better variant: not fitted fully
# least squared error that a cause must remove, in parts of that of the noise: ripple of ticks and steps can do less
SEEN = 0.04
LEFT = 0.04  # loss per value beyond that of the noise from which another cause is looked for
# squared error left, and what of it the screen must promise for a round to be worth its time
SMALL, PROMISE = 0.3, 0.015
SHOWN = 0.01  # of what removes little, least part in what is judged sample by sample, the joint's own motion
COLUMNS_ALONE = 0.12  # or else least that it must remove in all: when a drive reports duty and current may do less
PAYS = 0.08  # least share of the excess error that a further cause must remove
ALIKE = 0.4  # least ratio of a parameter's distance from doing nothing in one part to that in the other
MATERIAL = 0.01  # relative change of a number below which it is no finding: none is known better, nor is the simulation
EXCEPTIONS = 2e-3  # share of samples that may contradict a cause
WARMED = 2.0  # [K] least change of the temperature that can show a thermal effect
SURE = 0.975  # least probability, over resampled blocks, that it removes any
# a cause that removes little, or a further one, that is the best in fewer draws is left to the next experiment: the
# data cannot tell it from others
TOLD_APART = 0.5
RIVAL = 0.05  # causes that are better than the winner in more than this share of draws cannot be told from it
DRAWS = 2000
# relative error of each candidate's total that all data share, such as ripple of steps and of ticks, so that no
# resampling shows it: causes that are closer than this are not told apart by any amount of data
SHARED = 0.02
CHARGE = 0.02  # share of the error that a further parameter of a variant must remove
# how many times smaller the squared error of another form of a cause must be than that of its usual, first form
FORM = 1.4


@dataclass(frozen=True, eq=False)
class Candidate:
    """A cause fitted on top of what is already accepted.

    Attributes:
        cause: of the catalogue.
        variant: the parameters that it turns.
        fits: on the two parts, each judged on the other.
        blocks: squared error of each block under the fit that did not see it (b,).
        better: probability that it lowers the error at all.
        best: probability that it is the best of the round.
        gain: share of the excess error that it removes, at most 1: the excess is an estimate.
    """

    cause: Cause
    variant: tuple[Parameter, ...]
    fits: tuple[Fit, Fit]
    blocks: np.ndarray
    better: float = 0.0
    best: float = 0.0
    gain: float = 0.0


@dataclass(frozen=True, eq=False)
class Round:
    """One step of the forward selection: the error before it, and the candidates, best first."""

    before: np.ndarray
    candidates: tuple[Candidate, ...]
    accepted: bool


@dataclass(frozen=True, eq=False)
class Search:
    """What a search found.

    Attributes:
        tuned: parameters of the nominal model that are always re-tuned, tightly.
        accepted: causes in the order they were accepted.
        rounds: all rounds, the last one without a winner.
        counts: judged values per block (b,), to make means of ``blocks``.
    """

    tuned: tuple[Parameter, ...]
    accepted: tuple[Candidate, ...]
    rounds: tuple[Round, ...]
    counts: np.ndarray
    base: tuple[Fit, Fit]

    def parameters(self, without: str | None = None) -> list[Parameter]:
        """All parameters of the extended model, or of the one that lacks a cause."""
        return merge(self.tuned, *(c.variant for c in self.accepted if c.cause.name != without))


@dataclass
class Searcher:
    """A search in progress over one problem."""

    problem: Problem
    progress: Callable[[str], None] = lambda text: None
    seed: int = 0
    causes: list[Cause] = field(default_factory=list)
    tuned: tuple[Parameter, ...] = ()
    replaced: set[str] = field(default_factory=set, init=False)  # causes that a later one made redundant

    def __post_init__(self) -> None:
        self.problem = replace(self.problem, coarse=COARSE)
        self.nominal = self.problem.models[0]
        self.causes = self.causes or catalogue(self.nominal)
        if np.ptp(self.problem.temperature) < WARMED:
            self.causes = [cause for cause in self.causes if cause.name != "drive.thermal"]
        self.tuned = self.tuned or tuple(retunable(self.nominal))
        self.numbers = {parameter.path.rstrip("*") for parameter in self.tuned}
        self.parts = (self.problem.part(FIT_A), self.problem.part(FIT_B))
        self.both = self.problem.part(FIT_A, FIT_B)
        self.counts = np.concatenate([part.blocks()[1] for part in reversed(self.parts)])

    def run(self) -> Search:
        """Search until no further cause pays."""
        self.progress("re-tuning the nominal model")
        base = self._fit_both(self.tuned, None)
        blocks = self._judge(base)
        accepted: list[Candidate] = []
        rounds: list[Round] = []
        current, before = base, blocks
        while len(accepted) < MOST_CAUSES and (left := self._excess(current)) > LEFT:
            candidates = self._round(accepted, current, before, left)
            if candidates:
                current, before = self._challenged(accepted, candidates[0], current, before)
                candidates = self._rank(candidates, before, self._excess(current))
            winner = candidates[0] if candidates else None
            pays = (
                winner is not None
                and self._pays(winner, before, current)
                and (not accepted or winner.best > TOLD_APART)
            )
            rounds.append(Round(before, tuple(candidates), bool(pays)))
            if winner is None or not pays:
                break
            accepted.append(winner)
            current, before = winner.fits, winner.blocks
            self.progress(f"found {winner.cause.name} (removes {100 * winner.gain:.0f} % of what was left)")
            while len(accepted) > 1 and (alone := self._instead(accepted, rounds, base)) is not None:
                self.progress(f"which leaves nothing to explain for {accepted[-2].cause.name}")
                self.replaced.add(accepted[-2].cause.name)
                accepted[-2:], rounds[-2:] = [alone.candidates[0]], [alone]
                current, before = alone.candidates[0].fits, alone.candidates[0].blocks
        return Search(self.tuned, tuple(accepted), tuple(rounds), self.counts, base)

    def _instead(self, accepted: list[Candidate], rounds: list[Round], base: tuple[Fit, Fit]) -> Round | None:
        """The round of the last cause but one with the last one in its place, if on top of that it would not pay.

        The one that came first may only have stood in for the other.
        """
        *others, earlier, last = accepted
        fits = self._fit_both(merge(self.tuned, *(c.variant for c in others), last.variant), middle(*last.fits))
        blocks = self._judge(fits)
        if (left := self._excess(fits)) > LEFT:
            (again,) = self._rank([replace(earlier, fits=last.fits, blocks=last.blocks)], blocks, left)
            if self._pays(again, blocks, fits):
                return None
        step = rounds[-2]
        candidates = [replace(last, fits=fits, blocks=blocks)]
        candidates += [candidate for candidate in step.candidates if candidate.cause.name != last.cause.name]
        ranked = self._rank(candidates, step.before, self._excess(others[-1].fits if others else base))
        return Round(step.before, tuple(ranked), True) if ranked[0].cause.name == last.cause.name else None

    def _challenged(
        self, accepted: list[Candidate], winner: Candidate, current: tuple[Fit, Fit], before: np.ndarray
    ) -> tuple[tuple[Fit, Fit], np.ndarray]:
        """The model without the winner, fitted again from where the winner stands.

        What a better start of all else does is not its merit.
        """
        extended = merge(self.tuned, *(candidate.variant for candidate in accepted))
        again = self._fit_both(extended, middle(*winner.fits))
        blocks = self._judge(again)
        return (again, blocks) if blocks.sum() < before.sum() else (current, before)

    def _consistent(self, candidate: Candidate) -> bool:
        """Whether both parts find its parameter on the same side of doing nothing, about as far from it, and far
        enough to matter.
        """
        first = candidate.variant[0]
        neutral = 1.0 if first.path.endswith("*") else self.nominal.value(first.path)
        least = first.low if not first.logarithmic else max(first.low, 1e-12)
        none = first.to_fit(min(max(neutral, least), first.high))  # a joint without a stop has it infinitely far off
        a, b = (first.to_fit(found.values[first.path]) - none for found in candidate.fits)
        if first.logarithmic and max(abs(a), abs(b)) * first.scale < MATERIAL:
            return False
        return a * b > 0.0 and ALIKE < a / b < 1.0 / ALIKE

    def _excess(self, fits: tuple[Fit, Fit]) -> float:
        """Loss per value beyond that of the noise, each part under the fit that did not see it."""
        parts = [
            (float(part.blocks()[1].sum()), excess(part, part.simulate([found.values])[0], self.seed))
            for part, found in zip(reversed(self.parts), fits, strict=True)
        ]
        return sum(count * level for count, level in parts) / sum(count for count, _ in parts)

    def _pays(self, winner: Candidate, before: np.ndarray, current: tuple[Fit, Fit]) -> bool:
        removed = float((before.sum() - winner.blocks.sum()) / self.counts.sum())
        pays = winner.gain > PAYS and winner.better > SURE and removed > SEEN and self._consistent(winner)
        if not pays or removed > SMALL:
            return pays
        # little beyond the noise also means little to tell causes apart by; those that are close are named as rivals
        if winner.best < TOLD_APART:
            return False
        return removed > COLUMNS_ALONE or self._sampled(current) - self._sampled(winner.fits) > SHOWN

    def _sampled(self, fits: tuple[Fit, Fit]) -> float:
        """Loss per value of what is judged sample by sample, each part under the fit that did not see it."""
        total, count = 0.0, 0
        for part, found in zip(reversed(self.parts), fits, strict=True):
            channels = sum(part.weight[c] > 0.0 for c in part.sampled)
            errors = part.residual(part.simulate([found.values]))[0][: channels * int(part.judged.sum())]
            total, count = total + float(robust_loss(errors).sum()), count + len(errors)
        return total / count

    def _contradicted(self, candidate: Candidate) -> bool:
        """Whether the log itself shows that the cause is not there: duties above a limit that was fitted."""
        if candidate.cause.name != "drive.saturation" or "duty" not in self.both.channels:
            return False
        duty = self.both.channels.index("duty")
        if self.both.weight[duty] == 0.0:
            return False
        limit = min(found.values[candidate.variant[0].path] for found in candidate.fits)
        if candidate.variant[0].path.endswith("*"):
            limit *= self.nominal.value(candidate.variant[0].path[:-1])
        return float(np.mean(np.abs(self.both.measured[:, duty]) > limit * 1.004)) > EXCEPTIONS

    def _fit_both(self, parameters: Sequence[Parameter], start: Mapping[str, float] | None) -> tuple[Fit, Fit]:
        """Fits to the two parts, both from where a fit to all of it ends: less data hold more false minima.

        So what a part does not show at all stays as the other part has it.
        """
        joint = fit(self.both, parameters, start, FULL)
        a, b = (fit(part, parameters, joint.values, FULL) for part in self.parts)
        return a, b

    def _judge(self, fits: tuple[Fit, Fit]) -> np.ndarray:
        """Squared error of each block under the fit that did not see it (b,)."""
        return np.concatenate(
            [
                part.block_errors(part.simulate([found.values])[0])
                for part, found in zip(reversed(self.parts), fits, strict=True)
            ]
        )

    def _round(
        self, accepted: list[Candidate], current: tuple[Fit, Fit], before: np.ndarray, left: float
    ) -> list[Candidate]:
        taken = {candidate.cause.name for candidate in accepted} | self.replaced
        extended = merge(self.tuned, *(candidate.variant for candidate in accepted))
        chosen, promise = self._screen([cause for cause in self.causes if cause.name not in taken], extended, current)
        if left < SMALL and promise < PROMISE:
            return []
        for cause in dict.fromkeys(cause for cause, _ in chosen):  # the usual form of a cause is never left out
            if not any(variant == cause.variants[0] for other, variant in chosen if other is cause):
                chosen.append((cause, cause.variants[0]))
        # A number that is several times wrong is far from what the screen can foresee, and the likeliest error there
        # is.
        screened = {cause.name for cause, _ in chosen}
        for cause in self.causes:
            if (
                cause.error
                and cause.name not in taken | screened
                and cause.variants[0][0].path.rstrip("*") in self.numbers
            ):
                chosen.append((cause, cause.variants[0]))
        self.progress(f"trying {', '.join(dict.fromkeys(cause.name for cause, _ in chosen))}")
        start = middle(*current)
        rough = [(fit(self.both, merge(extended, variant), start, 1), cause, variant) for cause, variant in chosen]
        least = min(found.cost for found, _, _ in rough)
        rough = [
            (fit(self.both, merge(extended, variant), first.values, ROUGH - 1), cause, variant)
            if first.cost < HOPELESS * least or cause.error  # a number several times wrong needs more than one step
            else (first, cause, variant)
            for first, cause, variant in rough
        ]
        rough.sort(key=lambda row: row[0].cost * _form(row[1], row[2]))
        order = list(dict.fromkeys(cause.name for _, cause, _ in rough))
        near = {cause.name for found, cause, _ in rough if found.cost < FAR_OFF * rough[0][0].cost}
        finalists = [name for k, name in enumerate(order[:FINALISTS]) if k < FEWEST or name in near]
        found: dict[str, Candidate] = {}
        fitted: dict[str, float] = {}
        for start, cause, variant in rough:
            cost = start.cost * _form(cause, variant)
            usual = variant == cause.variants[0]  # which a rough fit may have left far from where it ends
            if cause.name not in finalists or (cost > OUTRUN * fitted.setdefault(cause.name, cost) and not usual):
                continue
            fits = self._fit_both(merge(extended, variant), start.values)
            candidate = Candidate(cause, variant, fits, self._judge(fits))
            if self._contradicted(candidate):
                continue
            if cause.name not in found or _charge(candidate) < _charge(found[cause.name]):
                found[cause.name] = candidate
        return self._rank(list(found.values()), before, left)

    def _rank(self, candidates: list[Candidate], before: np.ndarray, left: float) -> list[Candidate]:
        if not candidates:
            return []
        table = np.stack([candidate.blocks for candidate in candidates])
        rng = np.random.default_rng(self.seed)
        weights = rng.multinomial(len(before), np.full(len(before), 1.0 / len(before)), DRAWS)
        totals = weights @ table.T
        better = (totals < (weights @ before)[:, None]).mean(axis=0)
        totals = totals + SHARED * table.sum(axis=1).min() * rng.normal(size=totals.shape)
        best = np.bincount(totals.argmin(axis=1), minlength=len(candidates)) / DRAWS
        beyond = max(left * self.counts.sum(), 1e-9)
        ranked = [
            replace(
                c,
                better=float(better[k]),
                best=float(best[k]),
                gain=min(float((before.sum() - c.blocks.sum()) / beyond), 1.0),
            )
            for k, c in enumerate(candidates)
        ]
        # of a wrong number and a missing effect that do about as well, the number is meant
        return sorted(ranked, key=lambda c: c.blocks.sum() * (1.0 if c.cause.error else 1.0 + CHARGE))

    def _screen(
        self, causes: Sequence[Cause], extended: Sequence[Parameter], current: tuple[Fit, Fit]
    ) -> tuple[list[tuple[Cause, tuple[Parameter, ...]]], float]:
        """Variants worth a fit, and how much the best of them promises.

        Worth a fit are those whose effect, to first order, explains most of what is left. Every variant is simulated
        once or twice at a plausible size; the residual is projected on what that changes, beside what re-tuning can
        change anyway.
        """
        problem = self.both
        here = middle(*current)
        directions = [{p.path: p.from_fit(p.to_fit(here[p.path]) + _inward(p, here[p.path]))} for p in extended]
        variants = [(cause, variant) for cause in causes for variant in cause.variants]
        spans = []
        for _, variant in variants:
            tried = _sizes(variant)
            spans.append((len(directions), len(directions) + len(tried)))
            directions += tried
        paths = {path.rstrip("*"): path for path in here}
        rows = [here]
        for change in directions:
            replaced = {paths.get(path.rstrip("*")) for path in change}
            rows.append({**{path: value for path, value in here.items() if path not in replaced}, **change})
        error = np.concatenate([problem.residual(problem.simulate(rows[k : k + 16])) for k in range(0, len(rows), 16)])
        rest, changes = error[0], error[1:] - error[0]
        clip = 5.0 * np.sqrt(np.mean(rest**2))
        rest = np.clip(rest, -clip, clip)
        tuned = changes[: len(extended)].T
        scores = []
        for (_, variant), (a, b) in zip(variants, spans, strict=True):
            columns = [changes[a:b][k] for k in range(b - a)]
            best = np.inf
            for group in _groups(variant, len(columns)):
                basis = np.concatenate([tuned, np.stack([columns[k] for k in group], axis=1)], axis=1)
                basis = np.clip(basis, -20 * clip, 20 * clip)
                gram = basis.T @ basis
                solution = np.linalg.lstsq(gram + 1e-9 * np.trace(gram) * np.eye(len(gram)), -(basis.T @ rest))[0]
                solution[: tuned.shape[1]] = np.clip(solution[: tuned.shape[1]], -15.0, 15.0)
                solution[tuned.shape[1] :] = np.clip(solution[tuned.shape[1] :], -2.0, 4.0)
                best = min(best, float(((rest + basis @ solution) ** 2).sum()))
            scores.append(best)
        order = np.argsort(scores)
        chosen: list[tuple[Cause, tuple[Parameter, ...]]] = []
        per_cause: dict[str, int] = {}
        for k in order:
            name = variants[k][0].name
            if per_cause.get(name, 0) >= 3 or (name not in per_cause and len(per_cause) >= KEEP):
                continue
            per_cause[name] = per_cause.get(name, 0) + 1
            chosen.append(variants[k])
        step = (
            np.linalg.solve(tuned.T @ tuned + 1e-9 * np.eye(tuned.shape[1]), -(tuned.T @ rest))
            if len(extended)
            else np.zeros(0)
        )
        promise = float(((rest + tuned @ step) ** 2).sum() - scores[order[0]]) if len(order) else 0.0
        return chosen, promise / float(self.counts.sum())


def _charge(candidate: Candidate) -> float:
    """Error with a charge per parameter: of two variants that do about as well, the simpler one is meant."""
    form = _form(candidate.cause, candidate.variant)
    return float(candidate.blocks.sum()) * (1.0 + CHARGE * len(candidate.variant)) * form


def _form(cause: Cause, variant: tuple[Parameter, ...]) -> float:
    """Charge of a variant that acts in another way than the cause usually does.

    Other starts or periods of the same parameters are free; another law, such as friction with the square of the
    load, fits more and extrapolates worse, so it takes strong evidence.
    """
    return 1.0 if {p.path for p in variant} == {p.path for p in cause.variants[0]} else FORM


def _inward(parameter: Parameter, value: float, step: float = 0.1) -> float:
    """A small step of a parameter that stays within its bounds, in the optimiser's coordinate."""
    return step if parameter.to_fit(value) + step <= parameter.to_fit(parameter.high) else -step


def _sizes(variant: tuple[Parameter, ...]) -> list[dict[str, float]]:
    """Plausible sizes at which a variant is tried in the screen."""
    start = {p.path: p.start for p in variant}
    first = variant[0]
    further = {**start, first.path: first.from_fit(first.to_fit(first.start) + 1.0)}
    if (phase := next((p for p in variant if p.path.endswith("_phase")), None)) is not None:
        return [start, {**start, phase.path: phase.start + np.pi / 2.0}]
    return [start, further]


def _groups(variant: tuple[Parameter, ...], count: int) -> list[tuple[int, ...]]:
    """Which of the tried sizes are combined.

    Two phases of a ripple together, two sizes of anything else one at a time.
    """
    if any(p.path.endswith("_phase") for p in variant):
        return [tuple(range(count))]
    return [(k,) for k in range(count)]
