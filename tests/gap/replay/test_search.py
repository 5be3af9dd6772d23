"""The finder against the hidden bench, a sample for every test run; ``make hidden`` runs all of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log import read_measured
from sealegs.gap.verdict.verdict import EXPLAINED, NOT_IDENTIFIABLE, NOTHING, PARTLY, JointDiagnosis
from sealegs.gap.virtual.bench import LOADS as BENCH
from sealegs.gap.virtual.bench import record

from testbed import hidden_bench

LOADS = ("light", "medium", "heavy")
SCHEDULES = (("chirp", "steps"), ("multisine", "triangle"), ("lift_and_drop", "chirp"))


def diagnosed(effects: dict[str, Any], seed: int, duration: float = 9.0) -> JointDiagnosis:
    data, _ = hidden_bench(effects, seed, LOADS, duration=duration, schedules=SCHEDULES)
    (found,) = diagnose(data)
    return found


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "path", "true"),
    [
        ("friction.load_dependent", "friction.load", 0.133),
        pytest.param("sensor.delay", "encoder.latency", 0.00408, marks=pytest.mark.weekly),
        pytest.param("friction.drag", "friction.drag", 0.00837, marks=pytest.mark.weekly),
        pytest.param("drive.acceleration_limit", "rate_limit.acceleration", 40.0, marks=pytest.mark.weekly),
        pytest.param("drive.goal_filter", "goal_filter.time_constant", 0.00527, marks=pytest.mark.weekly),
    ],
)
def test_a_clear_effect_is_named_with_its_size(effect: str, path: str, true: float) -> None:
    found = diagnosed({effect: "clear"}, seed=11)
    assert found.verdict == EXPLAINED, found.sentence
    assert found.causes[0].name == effect
    assert found.causes[0].confidence > 0.9
    assert found.causes[0].parameters[path].value == pytest.approx(true, rel=0.1)


@pytest.mark.long
@pytest.mark.weekly
def test_a_d_term_is_named_first_with_its_size() -> None:
    """Its firmware takes differences once a millisecond, which a filter is not: after jumps of the goal some stays."""
    found = diagnosed({"drive.derivative": "clear"}, seed=11)
    first = found.causes[0]
    assert first.name == "drive.derivative" and first.confidence > 0.6, found.sentence
    size = first.parameters["derivative.gain"]
    assert size.low <= 0.0438 <= size.high and size.value == pytest.approx(0.0438, rel=0.1)
    assert found.gap["extended"].rmse < 0.3 * found.gap["nominal"].rmse


@pytest.mark.long
def test_nothing_hidden_is_nothing_to_explain() -> None:
    found = diagnosed({}, seed=12)
    assert found.verdict == NOTHING, found.sentence
    assert not found.causes


@pytest.mark.long
def test_a_machine_in_the_engine_that_is_as_believed_is_nothing_to_explain(tmp_path: Path) -> None:
    record(tmp_path, "sts3215", {}, loads=BENCH[1:], excitations=("chirp", "steps", "slow triangle"))
    (found,) = diagnose(read_measured(tmp_path))
    assert found.verdict == NOTHING, found.sentence


@pytest.mark.long
def test_a_stranger_is_not_explained_by_the_few_causes_that_are_considered() -> None:
    data, _ = hidden_bench({"stranger.jams": "clear"}, 13, LOADS, duration=6.0, schedules=SCHEDULES)
    (found,) = diagnose(data, causes=("friction.viscous", "drive.delay"))
    assert found.verdict in (NOT_IDENTIFIABLE, PARTLY), found.sentence
    assert found.unexplained > 0.5


@pytest.mark.long
def test_a_stranger_is_not_explained_by_a_known_cause() -> None:
    found = diagnosed({"stranger.jams": "clear"}, seed=13, duration=12.0)
    assert found.verdict in (NOT_IDENTIFIABLE, PARTLY), found.sentence
    assert found.unexplained > 0.5
