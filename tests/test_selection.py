"""Which of two causes stays, on a small bench and with no others to choose from."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.log.parts import FIT_A, FIT_B, cut
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.problem import Problem, converged, lay_out
from sealegs.gap.search.fit import Fit, fit, merge
from sealegs.gap.search.forward import Candidate, Round, Searcher

from testbed import hidden_bench
from testbed.bench import JOINT, NOISE_FLOOR

NEAR = {
    "friction.coulomb": {"friction.coulomb*": 2.7},
    "friction.viscous": {"friction.viscous*": 1.2},
    "friction.load_dependent": {"friction.load": 0.1},
}


@cache
def bench(*effects: str) -> Problem:
    data, _ = hidden_bench(dict.fromkeys(effects, "clear"), 5, ("light", "medium", "heavy"), duration=8.0)
    runs = list(data.runs)
    models = [JointModel(load_chain(run.actuators[JOINT])) for run in runs]
    return converged(lay_out(runs, JOINT, models, cut(runs, JOINT), {"position": 1.0 / NOISE_FLOOR}))


def searched(problem: Problem, *names: str) -> tuple[Searcher, list[Candidate], list[Round], tuple[Fit, Fit]]:
    """A search that has accepted these causes one after the other, and the fits that it began with."""
    causes = {cause.name: cause for cause in catalogue(problem.models[0])}
    searcher = Searcher(problem, causes=[causes[name] for name in names])
    accepted: list[Candidate] = []
    rounds: list[Round] = []
    base = searcher._fit_both(searcher.tuned, None)
    before, start = searcher._judge(base), {}
    for name in names:
        variant = causes[name].variants[0]
        start |= NEAR[name]
        fits = searcher._fit_both(merge(searcher.tuned, *(c.variant for c in accepted), variant), start)
        candidate = Candidate(causes[name], variant, fits, searcher._judge(fits))
        rounds.append(Round(before, (candidate,), True))
        accepted.append(candidate)
        before, start = candidate.blocks, start | fits[0].values
    return searcher, accepted, rounds, base


def test_a_cause_that_stood_in_for_the_real_one_leaves_once_that_is_found() -> None:
    search = searched(bench("friction.coulomb"), "friction.load_dependent", "friction.coulomb")
    searcher, accepted, rounds, base = search
    alone = searcher._instead(accepted, rounds, base)
    assert alone is not None and alone.accepted
    assert [candidate.cause.name for candidate in alone.candidates] == ["friction.coulomb", "friction.load_dependent"]
    assert alone.before is rounds[0].before
    assert alone.candidates[0].blocks.sum() < 1.2 * accepted[-1].blocks.sum()


def test_of_two_causes_that_are_both_there_both_stay() -> None:
    problem = bench("friction.coulomb", "friction.load_dependent")
    searcher, accepted, rounds, base = searched(problem, "friction.load_dependent", "friction.coulomb")
    assert searcher._instead(accepted, rounds, base) is None


def test_one_found_late_takes_the_place_of_all_that_stood_in_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    searcher = searched(bench("friction.coulomb"), "friction.load_dependent", "friction.viscous", "friction.coulomb")[0]
    order = list(searcher.causes)

    def one_by_one(
        accepted: list[Candidate], current: tuple[Fit, Fit], before: np.ndarray, left: float
    ) -> list[Candidate]:
        if not order:
            return []
        cause = order.pop(0)
        variant = cause.variants[0]
        fits = searcher._fit_both(merge(searcher.tuned, *(c.variant for c in accepted), variant), NEAR[cause.name])
        return searcher._rank([Candidate(cause, variant, fits, searcher._judge(fits))], before, left)

    monkeypatch.setattr(searcher, "_round", one_by_one)
    monkeypatch.setattr(searcher, "_pays", lambda winner, before, current: winner.blocks.sum() < before.sum() - 5.0)
    found = searcher.run()
    assert [candidate.cause.name for candidate in found.accepted] == ["friction.coulomb"]
    assert searcher.replaced == {"friction.load_dependent", "friction.viscous"}


def test_little_that_only_duty_and_current_show_is_not_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    searcher, accepted, _, _ = searched(bench("friction.coulomb"), "friction.coulomb")
    found = accepted[0]
    won = Candidate(found.cause, found.variant, found.fits, found.blocks, better=1.0, best=1.0, gain=1.0)
    monkeypatch.setattr(searcher, "_sampled", lambda fits: 0.7)  # the joint's own motion is as it was

    def pays(removed: float) -> bool:
        before = found.blocks + removed * searcher.counts
        return searcher._pays(won, before, found.fits)

    assert not pays(0.1) and pays(0.15)
    monkeypatch.setattr(searcher, "_sampled", lambda fits: 0.7 if fits is found.fits else 0.75)
    other = fit(searcher.both, [])
    assert searcher._pays(won, found.blocks + 0.1 * searcher.counts, (other, other))


def test_causes_are_sought_with_longer_steps_of_teeth_and_switches_alone() -> None:
    problem = bench("friction.coulomb").part(FIT_A, FIT_B)
    sought = Searcher(problem).both
    play = {"backlash.width": 0.05}
    coarse, fine = (part.simulate([play])[0] for part in (sought, problem))
    assert not np.array_equal(coarse, fine)
    assert np.sqrt(np.mean((coarse - fine)[:, 0] ** 2)) < 5.0 * NOISE_FLOOR
    assert np.array_equal(sought.simulate([{}]), problem.simulate([{}]))
