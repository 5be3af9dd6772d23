"""Which of two causes stays, on a small bench and with no others to choose from."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.causes.catalogue import adjustable, catalogue
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.parts import FIT_A, FIT_B, cut
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.problem import converged
from sealegs.gap.search.decide import Standing, decide
from sealegs.gap.search.fit import merge
from sealegs.gap.search.forward import Judged, Searcher
from sealegs.gap.search.record import RoundRecord
from sealegs.gap.search.result import Candidate, Round
from sealegs.gap.search.settings import SearchSettings

from testbed import hidden_bench
from testbed.bench import JOINT, NOISE_FLOOR

NEAR = {
    "friction.coulomb": {"friction.coulomb*": 2.7},
    "friction.viscous": {"friction.viscous*": 1.2},
    "friction.load_dependent": {"friction.load": 0.1},
}


@cache
def bench(*effects: str) -> FreeProblem:
    data, _ = hidden_bench(dict.fromkeys(effects, "clear"), 5, ("light", "medium", "heavy"), duration=8.0)
    runs = list(data.runs)
    models = [JointModel(load_chain(run.actuators[JOINT])) for run in runs]
    return converged(free_problem(runs, JOINT, models, cut(runs, JOINT), {"position": 1.0 / NOISE_FLOOR}))


def searched(problem: FreeProblem, *names: str) -> tuple[Searcher, list[Candidate], list[Round]]:
    """A search that has accepted these causes one after the other."""
    causes = {cause.name: cause for cause in catalogue(problem.models[0], names)}
    searcher = Searcher(problem, [causes[name] for name in names], tuple(adjustable(problem.models[0])))
    accepted: list[Candidate] = []
    rounds: list[Round] = []
    before, start = searcher.judged(searcher.fit_both(searcher.tuned, None)), {}
    for name in names:
        variant = causes[name].variants[0]
        start |= NEAR[name]
        fits = searcher.fit_both(merge(searcher.tuned, *(c.variant for c in accepted), variant), start)
        candidate = searcher.candidate(causes[name], variant, searcher.judged(fits))
        rounds.append(Round(before.blocks, (candidate,), True, searcher.excess(before.fits)))
        accepted.append(candidate)
        before, start = searcher.of(candidate), start | fits[0].values
    return searcher, accepted, rounds


def test_what_wider_bounds_reach_is_no_optimum_of_the_tuned_numbers() -> None:
    """The causes of a wrong number turn what is tuned, only further: all further ones were passed over beside them."""
    problem = bench("friction.coulomb")
    searcher = Searcher(problem, (), tuple(adjustable(problem.models[0])))
    tuned = searcher.fit_sketch(searcher.tuned, None).cost
    (cause,) = catalogue(problem.models[0], ["friction.coulomb"])
    wide = searcher.fit_sketch(merge(searcher.tuned, cause.variants[0]), NEAR["friction.coulomb"]).cost
    assert wide < 0.8 * tuned and searcher.optima[frozenset(searcher.tuned)] == tuned


@pytest.mark.long
def test_three_wrong_numbers_are_named_one_after_the_other() -> None:
    effects: dict[str, dict[str, float] | str | float] = {
        "friction.viscous": 0.15,
        "drive.motor_constant": 0.7,
        "friction.coulomb": 0.1,
    }
    data, _ = hidden_bench(effects, 5, duration=6.0)
    (found,) = diagnose(data, causes=[*effects, "transmission.backlash"])
    assert found.search is not None and {one.cause.name for one in found.search.accepted} == set(effects)


@pytest.mark.long
def test_a_round_whose_finalists_cannot_pay_says_which_came_nearest() -> None:
    problem = bench("friction.coulomb")
    causes = catalogue(problem.models[0], ["sensor.offset", "drive.offset"])
    search = Searcher(problem, causes, tuple(adjustable(problem.models[0]))).run()
    assert not search.accepted and search.rounds[-1].excess > search.settings.open_excess
    assert search.rounds[-1].candidates and not decide(search.record, search.settings).open


@pytest.mark.long
def test_a_cause_that_stood_in_for_the_real_one_leaves_once_that_is_found() -> None:
    searcher, accepted, rounds = searched(bench("friction.coulomb"), "friction.load_dependent", "friction.coulomb")
    trial, alone = searcher.replacement(accepted, rounds)
    assert trial.happened and alone is not None and alone.accepted
    assert [candidate.cause.name for candidate in alone.candidates] == ["friction.coulomb", "friction.load_dependent"]
    assert alone.before is rounds[0].before
    assert alone.candidates[0].blocks.sum() < 1.2 * accepted[-1].blocks.sum()


@pytest.mark.long
def test_of_two_causes_that_are_both_there_both_stay() -> None:
    problem = bench("friction.coulomb", "friction.load_dependent")
    searcher, accepted, rounds = searched(problem, "friction.load_dependent", "friction.coulomb")
    trial, alone = searcher.replacement(accepted, rounds)
    assert not trial.happened and alone is None


@pytest.mark.long
def test_one_found_late_takes_the_place_of_all_that_stood_in_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    searcher = searched(bench("friction.coulomb"), "friction.load_dependent", "friction.viscous", "friction.coulomb")[0]
    order = list(searcher.considered)

    def one_by_one(accepted: list[Candidate], current: Judged, left: float) -> tuple[list[Candidate], float]:
        if not order:
            return [], 0.0
        cause = order.pop(0)
        variant = cause.variants[0]
        fits = searcher.fit_both(merge(searcher.tuned, *(c.variant for c in accepted), variant), NEAR[cause.name])
        return [searcher.candidate(cause, variant, searcher.judged(fits))], 1.0

    def improves(record: RoundRecord, first: Standing, settings: SearchSettings, *, further: bool) -> bool:
        added_again = np.isnan(record.promise)  # to what took its place; a round of its own has a screen
        return not added_again or first.removed * record.counts.sum() > 5.0

    monkeypatch.setattr(searcher, "fit_round", one_by_one)
    monkeypatch.setattr("sealegs.gap.search.decide.pays", improves)
    found = searcher.run()
    assert [candidate.cause.name for candidate in found.accepted] == ["friction.coulomb"]
    assert searcher.replaced == {"friction.load_dependent", "friction.viscous"}
    assert decide(found.record, searcher.settings).names == ("friction.coulomb",)


def test_causes_are_sought_with_longer_steps_of_teeth_and_switches_alone() -> None:
    problem = bench("friction.coulomb").part(FIT_A, FIT_B)
    sought = Searcher(problem, (), ()).both
    play = {"backlash.width": 0.05}
    coarse, fine = (part.simulate([play])[0] for part in (sought, problem))
    assert not np.array_equal(coarse, fine)
    assert np.sqrt(np.mean((coarse - fine)[:, 0] ** 2)) < 5.0 * NOISE_FLOOR
    assert np.array_equal(sought.simulate([{}]), problem.simulate([{}]))
