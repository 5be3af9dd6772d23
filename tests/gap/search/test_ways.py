"""What leads a search: the fastest run of a long log, and pieces of a second where a model is far off."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import Chain, load_chain
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.parts import FIT_A, FIT_B, LEAST_START, TEST, cut, state_at, steady
from sealegs.gap.log.types import JointLog, MeasuredRun
from sealegs.gap.measure.measured import unseen_in
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.search import led
from sealegs.gap.search.fit import Fit
from sealegs.gap.search.forward import Searcher
from sealegs.gap.search.led import fastest, of_run
from sealegs.gap.search.record import Evidence
from sealegs.gap.search.result import Candidate, Round, Search
from sealegs.gap.search.settings import DEFAULT
from sealegs.gap.search.sketch import sketch
from sealegs.gap.search.windows import SHORTEST, WINDOW, in_windows, split
from sealegs.gap.verdict.verdict import EXPLAINED

from testbed import hidden_bench
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
        evidence = Evidence(cause.key, cause.error, 1, True, blocks, 1.0, (1.0, 1.0), 1.0, 0.0, ({}, {}))
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


SERVO = load_chain("sts3215")


def problem_of_windows(chain: Chain = SERVO) -> FreeProblem:
    data, _ = hidden_bench({}, 5, runs=1, duration=6.3)
    units = cut(data.runs, "servo")
    return free_problem(data.runs, "servo", [JointModel(chain)], units, {"position": 1.0 / 6e-4})


def test_windows_hold_every_sample_once_and_start_where_the_joint_was() -> None:
    whole = problem_of_windows()
    cut_up = split(whole)
    assert len(cut_up.units) > len(whole.units)
    np.testing.assert_array_equal(cut_up.time, whole.time)
    assert set(whole.starts) <= set(cut_up.starts)
    lengths = [cut_up.time[b - 1] - cut_up.time[a] for a, b in zip(cut_up.starts[:-1], cut_up.starts[1:], strict=True)]
    assert max(lengths) < WINDOW + SHORTEST
    np.testing.assert_allclose(cut_up.states[:, 0], cut_up.measured[cut_up.starts[:-1], 0], atol=3e-3)


def test_the_first_moments_of_a_window_are_not_judged() -> None:
    cut_up = split(problem_of_windows())
    for a, b in zip(cut_up.starts[:-1], cut_up.starts[1:], strict=True):
        early = cut_up.time[a:b] < cut_up.time[a] + LEAST_START
        assert not cut_up.judged[a:b][early].any()
    assert not (cut_up.judged & ~problem_of_windows().judged).any()


@pytest.mark.parametrize("rate", [50.0, 100.0, 200.0])
def test_the_speed_of_a_state_is_read_at_any_usual_rate(rate: float) -> None:
    """At 50 Hz three samples were too few for a parabola, and every window began at rest."""
    time = np.arange(0.0, 2.0, 1.0 / rate)
    for k in range(20, len(time) - 20, 7):
        position, speed = state_at(time, np.sin(2.0 * np.pi * time), k)
        assert position == pytest.approx(np.sin(2.0 * np.pi * time[k]), abs=0.01)
        assert speed == pytest.approx(2.0 * np.pi * np.cos(2.0 * np.pi * time[k]), abs=0.15)


def test_a_window_begins_neither_where_a_joint_starts_to_move_nor_while_a_command_may_be_under_way() -> None:
    """A knee's windows from where goals jumped were 10 mrad off; a delay of readings and an overload mended that."""
    time = np.arange(0.0, 4.0, 0.01)
    goal = (time >= 1.99).astype(float)
    late = np.maximum(time - 2.01, 0.0)
    position = 1.0 - np.exp(-late / 0.04) * (1.0 + late / 0.04)
    start = steady(time, position, goal, 1.8, 2.2)
    assert time[start] < 1.97 or time[start] > 2.15
    far = steady(time, position, 1000.0 * goal, 1.8, 2.2)  # whatever the unit of the command
    assert far == start
    assert steady(time, position, np.full(len(time), np.nan), 1.8, 2.2) >= 0


def test_a_model_that_is_near_keeps_its_whole_runs() -> None:
    whole = problem_of_windows()
    assert in_windows(whole, []) is whole


def test_a_joint_with_a_state_that_nobody_measured_keeps_its_whole_runs() -> None:
    always = replace(DEFAULT, window_error=0.0)
    assert len(in_windows(problem_of_windows(), [], always).units) > len(problem_of_windows().units)
    springy = problem_of_windows(JointModel(SERVO).with_values({"compliance.stiffness": 20.0}).chain)
    assert in_windows(springy, [], always) is springy


@pytest.mark.long
def test_an_effect_found_in_windows_is_judged_on_whole_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    searched: list[int] = []

    def searcher(problem: FreeProblem, *rest: Any, **more: Any) -> Searcher:
        searched.append(len(problem.units))
        return Searcher(problem, *rest, **more)

    monkeypatch.setattr("sealegs.gap.finder.diagnosis.Searcher", searcher)
    near = ("friction.load_dependent", "friction.stribeck", "friction.coulomb", "drive.delay")
    data, _ = hidden_bench({"friction.load_dependent": "clear"}, 11, ("light", "medium", "heavy"), duration=9.0)
    (found,) = diagnose(data, causes=near, settings=replace(DEFAULT, window_error=0.5))
    assert found.verdict == EXPLAINED and found.causes[0].name == "friction.load_dependent", found.sentence
    assert found.causes[0].parameters["friction.load"].value == pytest.approx(0.133, rel=0.1)
    assert found.problem is not None and searched[0] > 3 * len(found.problem.units)
    assert found.gap["extended"].rmse < 1.2 * found.gap["noise_floor"].rmse


def test_a_sketch_of_a_joint_replays_its_pieces_as_the_whole_does() -> None:
    whole = problem_of_windows().part(FIT_A, FIT_B)
    part = sketch(whole, 0.8)
    assert {unit.start for unit in part.units} < {unit.start for unit in whole.units}
    kept = [k for k, unit in enumerate(whole.units) if unit.start in {mine.start for mine in part.units}]
    rows = np.concatenate([np.arange(whole.starts[k], whole.starts[k + 1]) for k in kept])
    np.testing.assert_array_equal(part.simulate([{}]), whole.simulate([{}])[:, rows])
