"""Which part of a run counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sealegs.gap.log.parts import FIT_A, FIT_B, TEST, cut
from sealegs.gap.log.types import JointLog, MeasuredRun


def recorded(seconds: float, link: bool = False) -> MeasuredRun:
    time = np.arange(0.0, seconds, 0.005)
    angle = 0.3 * np.sin(6.0 * time)
    log = JointLog(goal=angle, position=angle, link_position=angle if link else None)
    return MeasuredRun("run", time, {"servo": log}, robot="bench")


@pytest.mark.parametrize(
    ("seconds", "link", "unjudged"),
    [(1.5, False, 0.1), (10.0, False, 0.4), (60.0, False, 1.0), (10.0, True, 1.25), (60.0, True, 1.5)],
)
def test_what_came_before_a_run_is_forgotten_before_it_is_judged(seconds: float, link: bool, unjudged: float) -> None:
    runs = [replace(recorded(seconds, link), meta={"group": str(k % 3)}) for k in range(6)]
    for unit in cut(runs, "servo"):
        assert runs[unit.run].time[unit.judged] == pytest.approx(unjudged, abs=0.01)


@pytest.mark.parametrize(("seconds", "whole"), [(12.0, True), (70.0, False)])
def test_each_part_gets_of_every_run_that_is_long(seconds: float, whole: bool) -> None:
    """Of eight motions of a public arm, the limit of the acceleration showed in one part, and was no cause in both."""
    runs = [recorded(seconds) for _ in range(8)]
    parts = [{unit.part for unit in cut(runs, "servo") if unit.run == k} for k in range(8)]
    assert all(len(of_run) == (1 if whole else 3) for of_run in parts)
    mixed = [*runs[:7], recorded(70.0)]
    found = cut(mixed, "servo")
    assert {unit.part for unit in found if unit.run == 7} == {FIT_A, FIT_B, TEST}
    assert all(len([unit for unit in found if unit.run == k]) == 1 for k in range(7)) or not whole


@pytest.mark.parametrize("seconds", [8.0, 60.0])
@pytest.mark.parametrize("first", [True, False])
def test_a_single_run_beside_the_test_group_is_fitted_in_both_parts(seconds: float, first: bool) -> None:
    """Part B was empty, and the refusal called logs of any length too short."""
    kept = replace(recorded(seconds), name="kept", meta={"group": "kept"})
    runs = [recorded(seconds), kept] if first else [kept, recorded(seconds)]
    units = cut(runs, "servo", "kept")
    assert [unit.part for unit in units if runs[unit.run] is kept] == [TEST]
    fitted = [unit for unit in units if runs[unit.run] is not kept]
    assert {unit.part for unit in fitted} == {FIT_A, FIT_B} and len(fitted) >= 4
    judged = [set(range(unit.start + unit.judged, unit.stop)) for unit in fitted]
    assert max(unit.stop for unit in fitted) == len(kept.time)
    assert sum(map(len, judged)) <= len(set().union(*judged)) + len(fitted), "no sample is judged in both parts"
