"""Where a model is far off, pieces of a second are fitted in place of whole runs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import Chain, load_chain
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.parts import FIT_A, FIT_B, LEAST_START, cut, state_at, steady
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.search.forward import Searcher
from sealegs.gap.search.settings import DEFAULT
from sealegs.gap.search.sketch import sketch
from sealegs.gap.search.windows import SHORTEST, WINDOW, in_windows, split
from sealegs.gap.verdict.verdict import EXPLAINED

from testbed import hidden_bench

CHAIN = load_chain("sts3215")


def problem(chain: Chain = CHAIN) -> FreeProblem:
    data, _ = hidden_bench({}, 5, runs=1, duration=6.3)
    units = cut(data.runs, "servo")
    return free_problem(data.runs, "servo", [JointModel(chain)], units, {"position": 1.0 / 6e-4})


def test_windows_hold_every_sample_once_and_start_where_the_joint_was() -> None:
    whole = problem()
    cut_up = split(whole)
    assert len(cut_up.units) > len(whole.units)
    np.testing.assert_array_equal(cut_up.time, whole.time)
    assert set(whole.starts) <= set(cut_up.starts)
    lengths = [cut_up.time[b - 1] - cut_up.time[a] for a, b in zip(cut_up.starts[:-1], cut_up.starts[1:], strict=True)]
    assert max(lengths) < WINDOW + SHORTEST
    np.testing.assert_allclose(cut_up.states[:, 0], cut_up.measured[cut_up.starts[:-1], 0], atol=3e-3)


def test_the_first_moments_of_a_window_are_not_judged() -> None:
    cut_up = split(problem())
    for a, b in zip(cut_up.starts[:-1], cut_up.starts[1:], strict=True):
        early = cut_up.time[a:b] < cut_up.time[a] + LEAST_START
        assert not cut_up.judged[a:b][early].any()
    assert not (cut_up.judged & ~problem().judged).any()


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
    whole = problem()
    assert in_windows(whole, []) is whole


def test_a_joint_with_a_state_that_nobody_measured_keeps_its_whole_runs() -> None:
    always = replace(DEFAULT, window_error=0.0)
    assert len(in_windows(problem(), [], always).units) > len(problem().units)
    springy = problem(JointModel(CHAIN).with_values({"compliance.stiffness": 20.0}).chain)
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
    whole = problem().part(FIT_A, FIT_B)
    part = sketch(whole, 0.8)
    assert {unit.start for unit in part.units} < {unit.start for unit in whole.units}
    kept = [k for k, unit in enumerate(whole.units) if unit.start in {mine.start for mine in part.units}]
    rows = np.concatenate([np.arange(whole.starts[k], whole.starts[k + 1]) for k in kept])
    np.testing.assert_array_equal(part.simulate([{}]), whole.simulate([{}])[:, rows])
