"""Rounds of a search: what is screened and fitted in one, and judged on data that its fit did not see."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..causes.cause import Cause, Variant
from ..checks.signal import block_weights
from ..log.parts import FIT_A, FIT_B
from ..log.progress import Progress
from ..replay.comparison import robust_loss
from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter
from ..replay.problem import Problem
from . import decide
from .correlated import excess
from .fit import Fit, fit, merge, middle
from .record import Evidence, RoundRecord
from .result import Candidate
from .rough import charged, rough_fits, to_try
from .screen import screen
from .settings import DEFAULT, SearchSettings
from .simpler import at_bound, contradicted, elaborates, gives, visited, without_friction
from .sketch import coarsened, most_iterations, sketch
from .state import Judged


@dataclass
class Rounds:
    """What the rounds of a search over one problem have in common.

    Attributes:
        problem: all parts of the data.
        causes: to choose from.
        tuned: nuisance parameters.
        progress: is told what goes on.
        seed: of all resampling.
        settings: thresholds.
        look_on: also fit rounds that the settings would skip, so that its record can be decided with looser ones.
            What is named stays the same.
        wide: nuisance parameters with the bounds of refitting, where a round is to be compared with that.
        start: values by path from which the nuisance parameters are first fitted; default: the parameters' own.
        led: keys of causes that alone are tried as long as one of them pays, and all others after them.
    """

    problem: Problem
    causes: Sequence[Cause]
    tuned: tuple[Parameter, ...]
    progress: Progress = lambda text: None
    seed: int = 0
    settings: SearchSettings = DEFAULT
    look_on: bool = False
    wide: tuple[Parameter, ...] = ()
    start: Mapping[str, float] | None = None
    led: tuple[str, ...] = ()
    replaced: set[str] = field(default_factory=set, init=False)  # causes in whose place another stands, or none
    optima: dict[frozenset[Parameter], float] = field(default_factory=dict, init=False)  # costs on the sketch

    def __post_init__(self) -> None:
        self.problem = coarsened(self.problem, self.settings)
        self.nominal = self.problem.models[0]
        self.considered = tuple(self.causes)
        warms = self.problem.temperature_range >= self.settings.least_temperature_range
        self.shown = [cause for cause in self.considered if warms or not cause.needs.temperature_range]
        self.numbers = {parameter.number for parameter in self.tuned}
        self.numbers |= {"ideal.strength"} if "ideal.stiffness" in self.numbers else set()  # of all that it gives
        self.parts = (self.problem.part(FIT_A), self.problem.part(FIT_B))
        self.both = self.problem.part(FIT_A, FIT_B)
        self.sketch = sketch(self.both, self.settings.sketched)
        self.visited = visited(self.both)
        self.shown = [seen for cause in self.shown if (seen := self.within_range(cause)).variants]
        self.counts = np.concatenate([part.blocks()[1] for part in reversed(self.parts)])

    # --- fits and their judgement ----------------------------------------------------------------------------------

    def fit_both(self, parameters: Sequence[Parameter], start: Mapping[str, float] | None) -> tuple[Fit, Fit]:
        """Fits to the two parts, both from one optimum, of a sketch of them: less data hold more local minima.

        What a part does not show at all so stays as the other part has it.
        """
        return self.fit_parts(parameters, self.fit_sketch(parameters, start).values)

    def sketch_anew(self, extended: Sequence[Parameter], here: Mapping[str, float]) -> None:
        """The sketch of a long log, with what the model is most wrong about, and the model's least cost there."""
        if self.sketch is not self.both:
            self.sketch, self.optima = sketch(self.both, self.settings.sketched, here), {}
            self.fit_sketch(extended, here)

    def fit_sketch(self, parameters: Sequence[Parameter], start: Mapping[str, float] | None) -> Fit:
        """A fit to the sketch; the least cost of each set of parameters is remembered."""
        found = fit(self.sketch, parameters, start, self.settings.iterations)
        turned = frozenset(parameters)  # with their bounds: refitting turns the same numbers further
        self.optima[turned] = min(found.cost, self.optima.get(turned, found.cost))
        return found

    def fit_parts(self, parameters: Sequence[Parameter], optimum: Mapping[str, float]) -> tuple[Fit, Fit]:
        """Fits to the two parts from the optimum of the sketch."""
        more = most_iterations(self.both, self.settings)
        a, b = (fit(part, parameters, optimum, more) for part in self.parts)
        return a, b

    def judged(self, fits: tuple[Fit, Fit]) -> Judged:
        """The loss of a model, each part under the fit that did not see it."""
        blocks, total, count = [], 0.0, 0
        for part, found in zip(reversed(self.parts), fits, strict=True):
            simulated = part.simulate([found.values])
            blocks.append(part.block_errors(simulated[0]))
            channels = sum(part.weight[c] > 0.0 for c in part.sampled)
            errors = part.residual(simulated)[0][: channels * int(part.judged.sum())]
            total, count = total + float(robust_loss(errors).sum()), count + len(errors)
        return Judged(fits, np.concatenate(blocks), total / max(count, 1))

    def parameters(self, accepted: Sequence[Candidate]) -> list[Parameter]:
        """What a model with these causes turns."""
        return merge(self.tuned, *(candidate.variant for candidate in accepted))

    def of(self, candidate: Candidate) -> Judged:
        """The model that a candidate makes."""
        return Judged(candidate.fits, candidate.evidence.blocks, candidate.evidence.sampled)

    def excess(self, fits: tuple[Fit, Fit]) -> float:
        """Loss per value beyond that of the noise, each part under the fit that did not see it."""
        parts = [
            (float(part.blocks()[1].sum()), excess(part, part.simulate([found.values])[0], self.seed))
            for part, found in zip(reversed(self.parts), fits, strict=True)
        ]
        return sum(count * level for count, level in parts) / sum(count for count, _ in parts)

    def held_back(self, fits: tuple[Fit, Fit]) -> bool:
        """Whether a tuned number is at an end of its tolerance, and refitting is to be considered."""
        held = {p.path for p in self.tuned if p.factor}
        return bool(self.wide) and any(held.intersection(one.at_bound) for one in fits)

    def refitting_beats(self, accepted: Sequence[Candidate], fits: tuple[Fit, Fit], blocks: np.ndarray) -> bool:
        """Whether refitted numbers, in place of tuned ones beside these causes, clearly beat a loss per block (b,).

        They are tried where a tuned number is at an end of its tolerance.
        """
        if not self.held_back(fits):
            return False
        parameters = merge(self.wide, *(candidate.variant for candidate in accepted))
        freed = self.judged(self.fit_both(parameters, middle(*fits))).blocks
        if not freed.sum() < self.settings.clearly_less * blocks.sum():
            return False
        weights = block_weights(len(blocks), self.settings.draws, np.random.default_rng(self.seed))
        return bool((weights @ freed < weights @ blocks).mean() > self.settings.least_certainty)

    def candidate(self, cause: Cause, variant: Variant, judged: Judged) -> Candidate:
        """A cause with what is decided on."""
        first = variant[0]
        neutral = first.neutral(self.nominal)
        none = first.nothing(self.nominal)
        # another cause may have taken the number over
        a, b = (float(first.to_fit(found.values.get(first.path, neutral)) - none) for found in judged.fits)
        evidence = Evidence(
            name=cause.key,
            number=cause.error,
            parameters=len(variant),
            usual=cause.is_usual(variant),
            blocks=judged.blocks,
            sampled=judged.sampled,
            distances=(a, b),
            scale=first.scale if first.logarithmic else 1.0,
            contradicted=contradicted(self.both, cause, variant, judged.fits),
            values=(judged.fits[0].values, judged.fits[1].values),
            limit="" if cause.degenerates_to is None else cause.degenerates_to.cause,
        )
        return Candidate(cause, variant, judged.fits, evidence)

    # --- one round -------------------------------------------------------------------------------------------------

    def fit_round(
        self,
        accepted: Sequence[Candidate],
        current: Judged,
        left: float,
    ) -> tuple[list[Candidate], float]:
        """Fitted variants of a round in the order of their rough costs, and what the screen promised.

        Args:
            accepted: causes of the model.
            current: the model.
            left: its loss per value beyond that of the noise.
        """
        extended = self.parameters(accepted)
        here = middle(*current.fits)
        self.sketch_anew(extended, here)
        shown = self.open_causes(accepted)
        if leaders := [c for c in shown if c.key in self.led]:
            shown = leaders
        else:
            self.led = ()
        screened = screen(self.sketch, shown, extended, here, self.settings)
        if not self.look_on and not decide.promising(left, screened.promise, self.settings):
            return [], screened.promise
        chosen = to_try(screened.chosen, shown, self.numbers, blind=left > self.settings.far)
        found = self.fitted(chosen, accepted, current, left)
        return [*found, *self.parted(chosen, accepted, current, left)], screened.promise

    def parted(
        self, chosen: Sequence[tuple[Cause, Variant]], accepted: Sequence[Candidate], current: Judged, left: float
    ) -> list[Candidate]:
        """What first lets motor and link turn apart, beside causes on the motor's side of it; arguments as of
        :meth:`fitted`.

        Until then both sides are one quantity, and no round could tell on which of them a cause was.
        """
        giving = [(cause, variant) for cause, variant in chosen if gives(variant)]
        moved = tuple(replace(c, variant=c.cause.at_motor or c.variant) for c in accepted)
        alike = all(a.variant == b.variant for a, b in zip(moved, accepted, strict=True))
        if not giving or alike or self.apart(accepted):
            return []
        here = self.judged(self.fit_both(self.parameters(moved), middle(*current.fits)))
        return [replace(one, beside=moved) for one in self.fitted(giving, moved, here, left)]

    def apart(self, accepted: Sequence[Candidate]) -> bool:
        """Whether motor and link turn apart, as nominal or by what was accepted."""
        nominal = isinstance(self.nominal, JointModel) and self.nominal.chain.gives()
        return nominal or gives(self.parameters(accepted))

    def fitted(
        self,
        chosen: Sequence[tuple[Cause, Variant]],
        accepted: Sequence[Candidate],
        current: Judged,
        left: float,
        instead: Candidate | None = None,
        most: int | None = None,
    ) -> list[Candidate]:
        """Variants fitted on top of a model in the order of their rough costs, less those that are far behind.

        Args:
            chosen: variants, the likeliest first.
            accepted: causes of the model.
            current: the model.
            left: its loss per value beyond that of the noise.
            instead: a cause in whose place they are tried.
            most: causes that are fitted to convergence; default: as the settings say.
        """
        if not chosen:
            return []
        settings, extended, here = self.settings, self.parameters(accepted), middle(*current.fits)
        self.progress(f"trying {', '.join(dict.fromkeys(cause.key for cause, _ in chosen))}")
        known, starts = None, [here]
        if instead is not None:
            there = middle(*instead.fits)
            turned = [p for p in self.parameters((*accepted, instead)) if p.path in there]
            known = fit(self.sketch, turned, there, 0).cost
            starts.append({p.path: there[p.path] for p in extended if p.path in there})
        rough = rough_fits(self.sketch, chosen, extended, starts, settings, known)
        least = rough[0][0].cost if known is None else min(known, rough[0][0].cost)
        order = list(dict.fromkeys(cause.key for _, cause, _ in rough))
        near = {cause.key for found, cause, _ in rough if found.cost < settings.finalist_cost * least}
        sure = settings.sure_finalists if known is None else 0
        finalists = [n for k, n in enumerate(order[: settings.finalists]) if k < sure or n in near]
        finalists += [cause.key for cause, _ in chosen[: settings.foreseen] if cause.key not in finalists]
        finalists += [cause.key for cause, _ in chosen if cause.seen and cause.key not in finalists]
        found: list[Candidate] = []
        passed: list[tuple[Fit, Cause, Variant]] = []
        best, joined = dict[str, float](), dict[str, float]()
        before = fit(self.sketch, extended, here, 0).cost
        least = before if known is None else min(known, before)
        optimum = self.optima.get(frozenset(extended), before)
        for start, cause, variant in rough:
            cost = charged(start, cause, variant, settings)
            # a rough fit may have left the usual form far from its optimum
            outrun = cost > settings.outrun_cost * best.setdefault(cause.key, cost) and variant != cause.variants[0]
            if cause.key in finalists and not outrun:
                joint = self.fit_sketch(merge(extended, variant), start.values)
                least = min(least, joint.cost)
                if not self.look_on and decide.hopeless(
                    joint.cost, least, before, optimum, left, settings, further=bool(accepted) and not self.led
                ):
                    passed.append((joint, cause, variant))
                    continue
                cost = charged(joint, cause, variant, settings)
                if cost > (1.0 + settings.shared_error) * joined.setdefault(cause.key, cost) and not self.look_on:
                    continue  # another of its cause's variants does better
                joined[cause.key] = min(cost, joined[cause.key])
                found.append(self.finalist(extended, joint, cause, variant))
                if len(joined) == most:
                    break
        if passed and not found and instead is None:  # a round says what came nearest
            found = [self.finalist(extended, *min(passed, key=lambda row: charged(*row, settings)))]
        shown = self.open_causes([*accepted, *([] if instead is None else [instead])])
        return self.simplest(found, extended, {cause.key for cause in shown})

    def finalist(self, extended: Sequence[Parameter], optimum: Fit, cause: Cause, variant: Variant) -> Candidate:
        """A cause that is fitted to both parts, from its fit to the sketch."""
        fits = self.fit_parts(merge(extended, variant), optimum.values)
        return self.candidate(cause, variant, self.judged(fits))

    def open_causes(self, accepted: Sequence[Candidate], *, replaced: bool = False) -> list[Cause]:
        """What the data can show beside a model, less what another took the place of unless that is asked for."""
        taken = {c.cause.key for c in accepted} | (set() if replaced else self.replaced)
        taken |= without_friction(self.shown, self.parameters(accepted), self.nominal)
        apart = self.apart(accepted)
        return [cause.parted() if apart else cause for cause in self.shown if cause.key not in taken]

    def simplest(self, found: Sequence[Candidate], extended: Sequence[Parameter], shown: set[str]) -> list[Candidate]:
        """Candidates less those that are the simpler cause which they degenerate to; that one is always tried.

        At the edge of its own shape a cause is the simpler one. With any other number at a bound it is, where the
        simpler one does about as well.
        """
        kept = [candidate for candidate in found if not self.at_edge(candidate)]
        best = min(found, key=lambda c: float(c.blocks.sum()), default=None)
        tried = {candidate.cause.key: candidate for candidate in found}
        for candidate in found:
            limit, edge = candidate.cause.degenerates_to, self.at_edge(candidate)
            if limit is None or not (edge or candidate is best or at_bound(candidate)):
                continue
            other = next((cause for cause in self.shown if cause.name == limit.cause), None)
            if other is None:  # what it is there is not to be considered
                kept += [candidate] * edge
            elif other.key in shown:
                if other.key not in tried:
                    fits = self.fit_both(merge(extended, other.variants[0]), middle(*candidate.fits))
                    tried[other.key] = self.candidate(other, other.variants[0], self.judged(fits))
                    kept.append(tried[other.key])
                simple = float(tried[other.key].blocks.sum())
                as_good = simple < (1.0 + self.settings.shared_error) * float(candidate.blocks.sum())
                if as_good and not edge and at_bound(candidate):
                    kept.remove(candidate)
        return [one for one in kept if not any(elaborates(one, other, self.settings) for other in kept)]

    def repeats(self, count: float) -> bool:
        """Whether the joint visits enough of what comes so many times a turn for it to be told from a constant."""
        return self.visited / (2.0 * np.pi) * count >= self.settings.least_periods

    def within_range(self, cause: Cause) -> Cause:
        """A cause less the variants with so few periods a turn that the joint visits next to nothing of one."""
        if cause.degenerates_to is None or not cause.degenerates_to.by_range:
            return cause
        edges = [cause.edge(variant) for variant in cause.variants]
        kept = [v for v, edge in zip(cause.variants, edges, strict=True) if edge is None or self.repeats(edge.high)]
        return replace(cause, variants=tuple(kept))

    def at_edge(self, candidate: Candidate) -> bool:
        """Whether a cause is at the edge of its own shape: by its upper bound, or by speeds or range of the log."""
        limit, edge = candidate.cause.degenerates_to, candidate.cause.edge(candidate.variant)
        if limit is None or edge is None:
            return False
        if limit.by_range:
            return not self.repeats(max(found.values[edge.path] for found in candidate.fits))
        end = self.settings.shape_edge * edge.high
        if limit.by_speed:
            simulated = self.parts[0].simulate([candidate.fits[0].values])[0]
            speed = self.parts[0].covariates(simulated).get("speed", np.full(1, np.inf))
            fastest = float(np.nanquantile(np.abs(speed), self.settings.speed_quantile))
            end = min(end, max(fastest, edge.low))
        return min(found.values[edge.path] for found in candidate.fits) >= end

    def recorded(
        self,
        accepted: Sequence[Candidate],
        fitted: Sequence[Candidate],
        current: Judged,
        begin: float,
        promise: float,
        instead: Candidate | None = None,
    ) -> tuple[RoundRecord, Judged]:
        """The round to decide on, and the baseline that its candidates are compared with.

        The baseline is refitted from the winner's optimum, so that the winner gets no credit for leaving a local
        minimum; that in whose place others are tried was fitted from there.
        """
        evidence = tuple(candidate.evidence for candidate in fitted)
        order = decide.ranked(evidence, self.settings)
        left = begin
        if order:
            winner = fitted[order[0]]
            if winner is not instead:
                again = self.judged(self.fit_both(self.parameters(accepted), middle(*winner.fits)))
                current = again if again.blocks.sum() < current.blocks.sum() else current
                left = self.excess(current.fits)
            asked = replace(winner.evidence, excess=self.excess(winner.fits))
            evidence = tuple(asked if one is winner.evidence else one for one in evidence)
        led = bool(self.led)
        record = RoundRecord(
            self.counts,
            before=current.blocks,
            sampled=current.sampled,
            excess=begin,
            left=left,
            promise=promise,
            candidates=evidence,
            led=led,
            barred=tuple(sorted(self.replaced)),
        )
        return record, current

    def standings(
        self, record: RoundRecord, fitted: Sequence[Candidate]
    ) -> tuple[list[decide.Standing], list[Candidate]]:
        """How the best variants of causes stand in a round, best first, and the same as candidates."""
        order = decide.standings(record, self.settings, self.seed)
        return order, [replace(fitted[s.index], better=s.better, best=s.best, gain=s.gain) for s in order]
