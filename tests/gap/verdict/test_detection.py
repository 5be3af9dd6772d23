"""What finding nothing is worth, what a first look says, and that a model which spoils others is not handed over."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.common.errors import SealegsError
from sealegs.gap.experiment import DetectionLimit
from sealegs.gap.finder.diagnosis import diagnose, first_look
from sealegs.gap.measure.case import ROBOT
from sealegs.gap.measure.unseen import harm_of
from sealegs.gap.output.extension import changes
from sealegs.gap.output.terminal import lines_of
from sealegs.gap.prepare.request import Request
from sealegs.gap.verdict.verdict import NOT_IDENTIFIABLE, NOTHING, JointDiagnosis

from testbed import hidden_bench, hidden_wide
from testbed.everyday import drawn
from testbed.logs import hidden_everyday

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


LATE = 0.0223  # [s] of the machine below


def test_a_first_look_tells_what_moves_a_joint_most() -> None:
    data, _ = hidden_bench({"drive.delay": 0.012, "friction.coulomb": "clear"}, seed=3, duration=5.0)
    found = first_look(data, Request())
    assert found.latency is None  # one joint shares nothing
    lines = list(lines_of(found))
    assert "provisional" in lines[0]
    told = [line.split()[0] for line in lines if line.startswith("  ")]
    assert told[0] == "drive.delay" and "friction.coulomb" in told
    assert any("delay.seconds = 0.017" in line for line in lines)


@pytest.mark.long
def test_a_first_look_is_at_the_joints_that_were_asked_for(tmp_path: Path) -> None:
    """It ignored joints=."""
    data, _ = hidden_everyday(replace(drawn(1, 101), duration=7.0, runs=3), tmp_path)
    found = first_look(data, Request(), ["tilt"])
    assert list(found.joints) == ["tilt"] and found.latency is None
    with pytest.raises(SealegsError, match="no joint 'lift'"):
        first_look(data, Request(), ["lift"])


@pytest.mark.long
def test_a_latency_of_the_bus_is_told_once_and_is_in_the_chain_of_each_joint(tmp_path: Path) -> None:
    """A late bus, 10 mrad of friction at one joint: the search named a delay at each, with another number."""
    data, _ = hidden_everyday(replace(drawn(1, 101), duration=7.0, runs=3), tmp_path)
    found = {one.joint: one for one in diagnose(data, causes=["drive.delay", "friction.coulomb"])}
    told = found[ROBOT].causes[0]
    value = told.parameters["delay.seconds"]
    assert told.name == "drive.delay" and told.confidence > 0.9 and value.low <= LATE <= value.high
    for joint in ("pan", "tilt"):
        assert "drive.delay" not in [cause.name for cause in found[joint].causes]
        row = next(row for row in changes(found[joint]) if row["path"] == "delay.seconds")
        assert row["why"] == "drive.delay" and row["to"] == pytest.approx(LATE, abs=1e-3)
    assert found["pan"].verdict == "explained" and "latency of all joints" in found["pan"].sentence


NOISE = 1e-3
BLOCK = np.repeat(np.arange(10), 50)
RNG = np.random.default_rng(0)
QUIET = NOISE * RNG.standard_normal(500)


def after_a_trip(size: float) -> np.ndarray:
    """Errors that are noise until something trips in the last third."""
    return QUIET + np.where(BLOCK >= 7, size, 0.0)


def test_a_model_that_is_off_where_the_believed_one_was_exact_does_harm() -> None:
    """An overload trip was handed over as fivefold friction: 16 mrad off where the believed model was exact."""
    assert harm_of(after_a_trip(0.1), QUIET + 0.016, BLOCK, 10, NOISE) > 0.015


def test_a_model_that_mends_the_rest_and_stays_near_the_noise_does_none() -> None:
    assert harm_of(after_a_trip(0.1), 1.5 * QUIET, BLOCK, 10, NOISE) == 0.0


def test_a_believed_model_that_is_right_almost_nowhere_says_nothing() -> None:
    nominal = QUIET + np.where(BLOCK >= 1, 0.05, 0.0)
    assert harm_of(nominal, QUIET + 0.016, BLOCK, 10, NOISE) == 0.0
