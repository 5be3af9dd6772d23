"""Which part of a run counts."""

from __future__ import annotations

import numpy as np
import pytest
from sealegs.gap.log.parts import cut
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
    runs = [recorded(seconds, link) for _ in range(6)]
    for unit in cut(runs, "servo"):
        assert runs[unit.run].time[unit.judged] == pytest.approx(unjudged, abs=0.01)
