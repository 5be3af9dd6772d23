"""What leads a search: the fastest run of a long log, and pieces of a second where a model is far off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import Chain, load_chain
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.parts import FIT_A, FIT_B, LEAST_START, TEST, Unit, cut, state_at, steady
from sealegs.gap.log.types import JointLog, MeasuredRun
from sealegs.gap.measure.measured import unseen_in
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.search import led, rough
from sealegs.gap.search import screen as screening
from sealegs.gap.search import sketch as sketching
from sealegs.gap.search.fit import Fit
from sealegs.gap.search.forward import Searcher
from sealegs.gap.search.led import fastest, of_run
from sealegs.gap.search.record import Evidence
from sealegs.gap.search.result import Candidate, Round, Search
from sealegs.gap.search.screen import screen
from sealegs.gap.search.settings import DEFAULT
from sealegs.gap.search.sketch import sketch, spread
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
    begun: Search | None = None

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


# --- what screen and rough fits see of a long log, and that they keep what the screen puts first ---------------------

LONG_RATE = 50  # [1/s]
PIECE, WARM = 6.0, 1.5  # [s]


@dataclass(frozen=True, eq=False)
class Pieces:
    """A problem as far as its pieces go."""

    units: tuple[Unit, ...]
    starts: np.ndarray
    time: np.ndarray
    joint: str | None = "servo"

    def part(self, *parts: int) -> Pieces:
        return replace(self, units=tuple(unit for unit in self.units if unit.part in parts))


def long_log(pieces: int) -> Any:
    """Pieces of a log one behind the other, by turns of both parts."""
    size = round((PIECE + WARM) * LONG_RATE)
    units = [
        Unit(0, (FIT_A, FIT_B)[k % 2], k * size, (k + 1) * size, round(WARM * LONG_RATE), (0.0, 0.0))
        for k in range(pieces)
    ]
    return Pieces(tuple(units), size * np.arange(pieces + 1), np.arange(pieces * size) / LONG_RATE)


def test_a_log_as_long_as_those_of_benches_is_seen_whole() -> None:
    whole = long_log(8)
    assert sketch(whole, 30.0) is whole


def test_of_a_long_log_pieces_of_both_parts_are_kept_from_beginning_to_end() -> None:
    whole = long_log(40)
    kept = sketch(whole, 30.0).units
    numbers = [next(k for k, unit in enumerate(whole.units) if unit.start == chosen.start) for chosen in kept]
    assert 20.0 <= PIECE * len(kept) < 30.0
    assert sum(number % 2 for number in numbers) in (len(kept) // 2, (len(kept) + 1) // 2)
    assert numbers[0] < 10 and numbers[-1] >= 30


def test_of_a_long_log_more_is_kept_of_what_the_model_is_most_wrong_about() -> None:
    """Of eight motions only a chirp reached the limit of the acceleration, and the sketch held little of it."""
    time = np.arange(0.0, 240.0, 1.0 / LONG_RATE)
    goal = np.where((time > 100.0) & (time < 130.0), 0.5 * np.sin(12.0 * time), 0.5 * np.sin(0.5 * time))
    run = MeasuredRun("run", time, {"servo": JointLog(goal, goal)}, {}, "bench", dict(PARAMS), {"servo": CHAIN})
    whole = free_problem([run], "servo", [JointModel(load_chain(CHAIN))], cut([run], "servo"), {"position": 1e3})
    both = whole.part(FIT_A, FIT_B)
    glitches = both.measured.copy()
    glitches[np.random.default_rng(5).integers(0, len(glitches), 30), 0] += 1.0
    torn = replace(both, measured=glitches)

    def fast(kept: Any) -> float:
        ends = zip(kept.starts[:-1], kept.starts[1:], strict=True)
        return float(np.mean([100.0 < kept.time[(a + b) // 2] < 130.0 for a, b in ends]))

    evenly, anew = sketch(both, 30.0), sketch(both, 30.0, {})
    assert fast(evenly) < 0.25 <= fast(anew) <= 0.6
    assert fast(sketch(torn, 30.0, {})) >= 0.25  # a few samples of a jam do not take the place of a motion
    assert 30.0 * LONG_RATE <= anew.judged.sum() < 45.0 * LONG_RATE
    assert len({unit.part for unit in anew.units}) == 1
    before = {(unit.run, unit.start) for unit in evenly.units}
    assert before < {(unit.run, unit.start) for unit in anew.units}


def test_what_the_model_is_most_wrong_about_counts_by_its_length() -> None:
    """Of runs of four and of 24 seconds, the short ones at fault, 11 seconds were kept of the thirty asked for."""
    runs: list[MeasuredRun] = []
    for k in range(24):
        time = np.arange(0.0, (24.0, 4.0)[k % 2], 1.0 / LONG_RATE)
        goal = 0.5 * np.sin((0.5, 12.0)[k % 2] * time)
        log = {"servo": JointLog(goal, goal)}
        runs.append(MeasuredRun(f"run{k}", time, log, {}, "bench", dict(PARAMS), {"servo": CHAIN}))
    models = [JointModel(load_chain(CHAIN))] * len(runs)
    whole = free_problem(runs, "servo", models, cut(runs, "servo"), {"position": 1e3})
    evenly, anew = (sketch(whole.part(FIT_A, FIT_B), 30.0, v).judged.sum() / LONG_RATE for v in (None, {}))
    assert evenly > 18.0 and 1.5 * evenly - 1.0 < anew < 1.5 * evenly + 2 * 24.0  # up to a piece in each part


def test_a_fit_to_a_long_log_starts_from_one_to_its_sketch(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[Any, Any, int]] = []

    def fit(problem: Any, parameters: Any, start: Any, evaluations: int) -> Fit:
        asked.append((problem, start, evaluations))
        return Fit({"a": float(len(asked))}, np.zeros((3, 4)), 1.0)

    monkeypatch.setattr(sketching, "fit", fit)
    monkeypatch.setattr(sketching, "sketch", lambda problem, seconds, values: "sketch")
    short, long = long_log(8), long_log(40)
    sketching.fit_from_sketch(long, (), {"a": 0.5}, DEFAULT)
    assert asked == [
        ("sketch", {"a": 0.5}, DEFAULT.iterations),
        (long, {"a": 1.0}, DEFAULT.sketched_iterations),
    ]
    asked.clear()
    sketching.fit_from_sketch(short, (), None, DEFAULT)
    assert asked == [(short, None, DEFAULT.iterations)]
    several: Any = replace(long, joint=None)
    assert sketching.most_iterations(several, DEFAULT) == DEFAULT.iterations


def test_what_joints_share_is_sought_in_pieces_of_each_part_that_keep_their_part() -> None:
    """All pieces of all joints took nine minutes of a chirp, longer than the joints themselves."""
    whole = long_log(40)
    kept = spread(whole, 30.0).units
    assert 30.0 <= PIECE * len(kept) < 60.0
    assert {unit.part for unit in kept} == {FIT_A, FIT_B}
    assert kept[0].start < whole.starts[15] and kept[-1].start >= whole.starts[25]
    short = long_log(8)
    assert spread(short, 30.0) is short


def test_what_several_joints_share_is_sought_in_all_of_their_data() -> None:
    """Its units are those of its joints, and no field that can be replaced."""
    robot = replace(long_log(40), joint=None)
    assert sketch(robot, 30.0) is robot


@pytest.mark.parametrize("short", [sketch, spread])
def test_of_long_runs_pieces_of_each_are_kept(short: Any) -> None:
    """Of eight motions of two minutes two whole ones were kept, four minutes of the thirty seconds asked for."""
    time = np.arange(0.0, 120.0, 1.0 / LONG_RATE)
    log = JointLog(np.sin(time), np.sin(time - 0.05))
    runs = [MeasuredRun(f"run{k}", time, {"servo": log}, {}, "bench", dict(PARAMS), {"servo": CHAIN}) for k in range(8)]
    models = [JointModel(load_chain(CHAIN))] * 8
    whole = free_problem(runs, "servo", models, cut(runs, "servo", "run7"), {"position": 1e3})
    kept = short(whole.part(FIT_A, FIT_B), 30.0)
    assert len({unit.run for unit in kept.units}) >= 4
    assert (20.0 if short is sketch else 30.0) * LONG_RATE <= kept.judged.sum() < 50.0 * LONG_RATE
    ends = zip(kept.units, kept.starts[:-1], kept.starts[1:], strict=True)
    assert all(kept.judged[a:b].any() and unit.judged < b - a for unit, a, b in ends)
    assert kept.judged.sum() > 0.6 * len(kept.time)


@pytest.mark.parametrize(("place", "tries"), [(0, 2), (-1, 1)])
def test_what_the_screen_puts_first_is_not_abandoned_after_an_iteration(
    monkeypatch: pytest.MonkeyPatch, place: int, tries: int
) -> None:
    """A profile's acceleration with the loop's gain beside it was; friction that stood in for both was named."""
    chosen = [(cause, cause.variants[0]) for cause in catalogue(JointModel(load_chain(CHAIN))) if not cause.error][:6]
    numbers = [{parameter.number for parameter in variant} for _, variant in chosen]
    calls: list[int] = []

    def fit(problem: Any, parameters: Any, start: Any, evaluations: int) -> Fit:
        del problem, start, evaluations
        calls.append(numbers.index({parameter.number for parameter in parameters}))
        return Fit({}, np.zeros((3, 4)), 9.0 if calls[-1] != 1 else 1.0)

    monkeypatch.setattr(rough, "fit", fit)
    nothing: Any = None
    rough.rough_fits(nothing, chosen, (), [{}], DEFAULT)
    assert calls.count(range(len(chosen))[place]) == tries


def test_the_screen_keeps_the_numbers_that_a_variant_has_in_common_with_the_model(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A second law with the dry friction that was found before was tried with the dry friction of its own start."""
    nothing = JointModel(load_chain(CHAIN)).with_values({"friction.coulomb": 0.0})
    (cause,) = catalogue(nothing, ("friction.asymmetric",))
    rows: list[Mapping[str, float]] = []

    def residuals(problem: Any, here: Mapping[str, float], changes: Sequence[Mapping[str, float]]) -> np.ndarray:
        rows.extend({**here, **change} for change in changes)
        return np.ones((1 + len(changes), 3))

    monkeypatch.setattr(screening, "_residuals", residuals)
    monkeypatch.setattr(screening, "_left_after", lambda rest, tuned: 0.0)
    problem: Any = Judged()
    screen(problem, [cause], (), {"friction.coulomb": 0.031}, DEFAULT)
    assert {row["friction.coulomb"] for row in rows} == {0.031}
    rows.clear()
    screen(problem, [cause], (), {}, DEFAULT)
    assert {row["friction.coulomb"] for row in rows} == {cause.variants[0][1].start}, "what is new begins somewhere"


class Judged:
    """A problem as far as its blocks go."""

    def blocks(self) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros(3, int), np.array([3])
