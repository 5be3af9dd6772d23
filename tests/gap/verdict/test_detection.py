"""What finding nothing in a log is worth: up to where each cause would not show."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from sealegs.gap.experiment import DetectionLimit
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.verdict.verdict import NOT_IDENTIFIABLE, NOTHING, JointDiagnosis

from testbed import hidden_bench, hidden_wide

CAUSES = ("friction.coulomb", "drive.gain", "sensor.scale", "sensor.delay", "friction.presliding")


@cache
def nothing_hidden(scale: float = 1.0) -> JointDiagnosis:
    effects: dict[str, Any] = {} if scale == 1.0 else {"sensor.scale": scale}
    schedules = (("chirp", "steps"), ("multisine", "triangle"))
    data, _ = hidden_bench(effects, 31, ("medium",), duration=6.0, schedules=schedules)
    (found,) = diagnose(data, causes=CAUSES)
    return found


def limits() -> dict[str, DetectionLimit]:
    return {limit.name: limit for limit in nothing_hidden().limits}


@pytest.mark.long
def test_each_cause_has_a_limit_around_what_is_believed() -> None:
    assert nothing_hidden().verdict == NOTHING
    assert set(limits()) == set(CAUSES)
    gain, friction, late = (limits()[name] for name in ("drive.gain", "friction.coulomb", "sensor.delay"))
    assert gain.low < gain.nominal < gain.high < 1.1 * gain.nominal
    assert friction.low < 1.06 * friction.nominal and friction.high < 1.5 * friction.nominal
    assert not np.isfinite(late.low) and 0.0 < late.high < 0.01  # a reading is never early


@pytest.mark.long
def test_bristles_hide_where_they_are_stiff() -> None:
    """Their stiffness is zero where nothing gives way: the softest of all were told not to show."""
    bristles = limits()["friction.presliding"]
    assert np.isfinite(bristles.low) and not np.isfinite(bristles.high), bristles.sentence
    assert "friction.presliding above" in bristles.sentence and bristles.hides(1e3) and not bristles.hides(0.1)


@pytest.mark.long
def test_a_number_that_tuning_takes_up_has_a_wider_limit() -> None:
    """An encoder that read 0.96 of the angle was taken up by tuned numbers, and nothing said that it might be there."""
    scale = limits()["sensor.scale"]
    assert scale.hides(0.99) and scale.hides(1.01) and not scale.hides(0.8)


@pytest.mark.long
def test_what_the_limit_does_not_hide_is_found() -> None:
    beyond = min(0.97 * limits()["sensor.scale"].low, 0.93)
    assert nothing_hidden(beyond).verdict != NOTHING


@pytest.mark.long
def test_nothing_along_a_measured_motion_names_what_it_cannot_show() -> None:
    """Friction that moved the joint by 11 noise floors was "nothing to explain" where only the current was judged."""
    (found,) = diagnose(hidden_wide(236)[0])
    assert found.verdict == NOT_IDENTIFIABLE and not found.causes, found.sentence
    assert "friction.stribeck" in found.text and "friction.asymmetric" in found.text
