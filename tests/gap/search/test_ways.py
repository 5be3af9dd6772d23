"""What leads a search: the fastest run of a long log, whose fastest pieces its fits see."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.log.parts import FIT_A, FIT_B, TEST, cut
from sealegs.gap.log.types import JointLog, MeasuredRun
from sealegs.gap.measure.measured import unseen_in
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.search import led
from sealegs.gap.search.fit import Fit
from sealegs.gap.search.led import fastest, of_run
from sealegs.gap.search.record import Evidence
from sealegs.gap.search.result import Candidate, Round, Search

from tests.smooth_bench import CHAIN, PARAMS

RATE = 50.0  # [1/s]


def run(name: str, frequency: float, seconds: float = 90.0, sweep: float = 0.0) -> MeasuredRun:
    """A sine of a frequency [Hz] that grows to ``sweep`` times that at the end, followed without error."""
    time = np.arange(0.0, seconds, 1.0 / RATE)
    phase = frequency * (time + 0.5 * max(sweep - 1.0, 0.0) * time**2 / seconds)
    goal = 0.5 * np.sin(2.0 * np.pi * phase)
    return MeasuredRun(name, time, {"servo": JointLog(goal, goal)}, {}, "bench", dict(PARAMS), {"servo": CHAIN})


def problem(*runs: MeasuredRun) -> FreeProblem:
    models = [JointModel(load_chain(CHAIN)) for _ in runs]
    return free_problem(runs, "servo", models, cut(runs, "servo"), {"position": 1e3})


@pytest.mark.parametrize("before", [0, 1, 2])
def test_both_fits_see_the_fastest_end_of_a_sweep_whichever_run_it_is(before: int) -> None:
    """As the second of eight runs a sweep had its end in the test, and one fit saw nothing of the limit there."""
    runs = [run(f"slow{k}", 0.1) for k in range(before)] + [run("sweep", 0.1, 120.0, 20.0)]
    units = [unit for unit in cut(runs, "servo") if unit.run == before]
    assert [unit.part for unit in units[-2:]] == [FIT_A, FIT_B]
    assert [sum(unit.part == part for unit in units) for part in (FIT_A, FIT_B, TEST)] == pytest.approx(
        [7, 7, 6], abs=1
    )


def test_the_fastest_run_of_a_long_log_leads() -> None:
    whole = problem(run("a", 0.1), run("fast", 0.6), run("b", 0.15))
    assert fastest(whole.part(FIT_A, FIT_B)) == 1
    alone = of_run(whole, 1)
    assert {unit.run for unit in alone.units} == {1} and {unit.part for unit in alone.units} == {FIT_A, FIT_B}


@pytest.mark.parametrize(
    "runs",
    [
        [run("a", 0.3), run("b", 0.35), run("c", 0.3)],  # none is much faster
        [run("a", 0.1), run("fast", 0.6)],  # two runs
        [run("a", 0.1, 12.0), run("fast", 0.6, 12.0), run("b", 0.1, 12.0)],  # short
        [run("a", 0.1, 62.0), run("fast", 0.6, 300.0), run("b", 0.1, 62.0)],  # nearly all of the log
    ],
)
def test_nothing_leads_where_no_run_stands_out_or_little_was_logged(runs: list[MeasuredRun]) -> None:
    assert fastest(problem(*runs).part(FIT_A, FIT_B)) is None


def test_what_led_is_as_sure_as_in_its_own_run() -> None:
    """Of eight motions seven cannot show a limit that the sweep reaches: their errors say nothing for or against it."""
    whole = problem(run("a", 0.1), run("fast", 0.6), run("b", 0.15))
    values: list[dict[str, float]] = [{"friction.coulomb": 0.1}, {"friction.coulomb": 0.2}]
    alone = problem(run("fast", 0.6))
    found = unseen_in(whole, 1, values[0], values)
    of_run_one = whole.part(TEST).errors(whole.part(TEST).simulate([values[0]])[0])
    assert len(found) < 0.5 * int(whole.judged.sum()) and len(of_run_one) > 0
    assert len(found) == pytest.approx(int(alone.judged.sum()), rel=0.1)
    rest = np.concatenate([unseen_in(whole, k, values[0], values) for k in (0, 2)])
    assert len(found) + len(rest) == int(whole.judged.sum())


@dataclass
class Sought:
    """A searcher that finds the same cause of whatever it is given, and is led by nothing afterwards."""

    problem: FreeProblem
    led: tuple[str, ...] = ()

    @property
    def both(self) -> FreeProblem:
        return self.problem.part(FIT_A, FIT_B)

    def progress(self, text: str) -> None:
        del text

    def run(self) -> Search:
        (cause,) = catalogue(self.problem.models[0], ["friction.coulomb"])
        fit = Fit({}, np.zeros(0), 1.0)
        blocks = np.ones(4)
        evidence = Evidence(cause.key, cause.error, 1, True, blocks, 1.0, (1.0, 1.0), None, 0.0, ({}, {}))
        one = Candidate(cause, cause.variants[0], (fit, fit), evidence)
        self.led = ()
        return Search((), (one,), (Round(2.0 * blocks, (one,), True),), blocks, (fit, fit), (cause,))


@pytest.mark.parametrize("loose", [False, True])
def test_all_data_are_searched_beside_refitted_numbers_where_the_leading_run_was_not(
    loose: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the run alone the search within tolerances won by a hair, and a limit that refitted numbers show was lost."""
    asked: list[tuple[str, ...]] = []

    def loosely(searcher: Sought, found: Search) -> Search:
        asked.append(searcher.led)
        return found

    monkeypatch.setattr(led, "search_loosely", loosely)
    monkeypatch.setattr(led, "beside_refitted", lambda searcher: replace(searcher.run(), loose=True))
    monkeypatch.setattr(led, "charged", lambda searcher, found: 1.0)
    searcher: Any = Sought(problem(run("a", 0.1), run("fast", 0.6), run("b", 0.15)))
    found = led.search_led(searcher, lambda one: [one.run(), *[replace(one.run(), loose=True)] * loose])
    assert found.leader == 1
    assert asked == ([] if loose else [("friction.coulomb",)])
