"""What screen and rough fits see of a long log, and that they keep what the screen puts first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.log.parts import FIT_A, FIT_B, Unit, cut
from sealegs.gap.log.types import JointLog, MeasuredRun
from sealegs.gap.replay.free import free_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.search import rough
from sealegs.gap.search import screen as screening
from sealegs.gap.search import sketch as sketching
from sealegs.gap.search.fit import Fit
from sealegs.gap.search.screen import screen
from sealegs.gap.search.settings import DEFAULT
from sealegs.gap.search.sketch import coarsened, sketch, spread

from tests.smooth_bench import CHAIN, PARAMS

RATE = 50  # [1/s]
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
    size = round((PIECE + WARM) * RATE)
    units = [
        Unit(0, (FIT_A, FIT_B)[k % 2], k * size, (k + 1) * size, round(WARM * RATE), (0.0, 0.0)) for k in range(pieces)
    ]
    return Pieces(tuple(units), size * np.arange(pieces + 1), np.arange(pieces * size) / RATE)


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
    time = np.arange(0.0, 240.0, 1.0 / RATE)
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
    assert 30.0 * RATE <= anew.judged.sum() < 45.0 * RATE
    assert len({unit.part for unit in anew.units}) == 1
    before = {(unit.run, unit.start) for unit in evenly.units}
    assert before < {(unit.run, unit.start) for unit in anew.units}


def test_what_the_model_is_most_wrong_about_counts_by_its_length() -> None:
    """Of runs of four and of 24 seconds, the short ones at fault, 11 seconds were kept of the thirty asked for."""
    runs: list[MeasuredRun] = []
    for k in range(24):
        time = np.arange(0.0, (24.0, 4.0)[k % 2], 1.0 / RATE)
        goal = 0.5 * np.sin((0.5, 12.0)[k % 2] * time)
        log = {"servo": JointLog(goal, goal)}
        runs.append(MeasuredRun(f"run{k}", time, log, {}, "bench", dict(PARAMS), {"servo": CHAIN}))
    models = [JointModel(load_chain(CHAIN))] * len(runs)
    whole = free_problem(runs, "servo", models, cut(runs, "servo"), {"position": 1e3})
    evenly, anew = (sketch(whole.part(FIT_A, FIT_B), 30.0, v).judged.sum() / RATE for v in (None, {}))
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
    time = np.arange(0.0, 120.0, 1.0 / RATE)
    log = JointLog(np.sin(time), np.sin(time - 0.05))
    runs = [MeasuredRun(f"run{k}", time, {"servo": log}, {}, "bench", dict(PARAMS), {"servo": CHAIN}) for k in range(8)]
    models = [JointModel(load_chain(CHAIN))] * 8
    whole = free_problem(runs, "servo", models, cut(runs, "servo", "run7"), {"position": 1e3})
    kept = short(whole.part(FIT_A, FIT_B), 30.0)
    assert len({unit.run for unit in kept.units}) >= 4
    assert (20.0 if short is sketch else 30.0) * RATE <= kept.judged.sum() < 50.0 * RATE
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
    rough.rough_fits(nothing, chosen, (), {}, DEFAULT)
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


@dataclass(frozen=True, eq=False)
class Stepped:
    """A joint's problem as far as its steps go."""

    step: float
    terms: np.ndarray | None

    @property
    def joint(self) -> Stepped:
        return self

    def with_step_factor(self, factor: float) -> float:
        return factor


@pytest.mark.parametrize(("step", "longer"), [(5e-3, True), (2.5e-3, True), (1.7e-3, False)])
def test_joints_of_robots_that_converge_at_long_steps_are_searched_with_longer_ones(step: float, longer: bool) -> None:
    """A gripper that missed the longest step by a hair was searched four times as long."""
    robot: Any = Stepped(step, np.zeros((1, 1)))
    bench: Any = Stepped(step, None)
    assert coarsened(robot, DEFAULT) == (DEFAULT.coarse_robot_step if longer else DEFAULT.coarse_step)
    assert coarsened(bench, DEFAULT) == DEFAULT.coarse_step
