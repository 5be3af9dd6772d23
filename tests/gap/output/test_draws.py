"""Machines as a diagnosed one may be: as wide as the intervals, together where the fit knows so."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from sealegs.gap.checks.bootstrap import Z95
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.measure.named import NamedCause, Value
from sealegs.gap.output.draws import spread_of, with_draws
from sealegs.gap.output.extension import extended_of
from sealegs.gap.output.hand_over import hand_over
from sealegs.gap.robot.search import ROBOT
from sealegs.gap.verdict.verdict import JointDiagnosis

from tests.small_diagnosis import small_diagnosis


@pytest.fixture(scope="module")
def small() -> tuple[JointDiagnosis, MeasuredSet]:
    return small_diagnosis()


def drawn(found: JointDiagnosis, data: MeasuredSet, *others: JointDiagnosis) -> dict[str, np.ndarray]:
    model = extended_of([found], data)
    assert model is not None
    draws = with_draws(model, [found, *others], data, "all").draws
    assert draws is not None
    return {key[3]: column for key, column in zip(draws.numbers, np.array(draws.machines).T, strict=True)}


def test_a_cause_is_drawn_as_wide_as_its_interval(small: tuple[JointDiagnosis, MeasuredSet]) -> None:
    found, data = small
    (cause,) = (one for one in found.causes if one.name == "friction.load_dependent")
    value = cause.parameters["friction.load"]
    told = drawn(found, data)["friction.load"]
    assert told.mean() == pytest.approx(value.value, rel=0.1)
    assert told.std() == pytest.approx((value.high - value.low) / (2.0 * Z95), rel=0.5)


def test_numbers_that_make_up_for_each_other_are_drawn_together(small: tuple[JointDiagnosis, MeasuredSet]) -> None:
    found, data = small
    spread = spread_of(found)
    assert spread is not None
    correlation = spread.root @ spread.root.T
    np.testing.assert_allclose(np.diag(correlation), 1.0, atol=1e-6)
    paths = [p.number for p in spread.parameters]
    apart = np.triu(np.abs(correlation), 1)
    row, column = np.unravel_index(apart.argmax(), apart.shape)
    assert apart.max() > 0.5
    told = drawn(found, data)
    seen = np.corrcoef(told[paths[row]], told[paths[column]])[0, 1]
    assert seen == pytest.approx(correlation[row, column], abs=0.35)


def test_a_latency_of_all_joints_is_drawn_once(small: tuple[JointDiagnosis, MeasuredSet]) -> None:
    found, data = small
    delay = extended_of([found], data).chains[found.joint][0].chain.value("delay.seconds")  # type: ignore[union-attr]
    latency = NamedCause(
        name="drive.delay", sentence="", joint=ROBOT, share=0.5, confidence=1.0, gain=0.5, kind="number",
        parameters={"delay.seconds": Value(delay, delay - 0.002, delay + 0.002, "s", delay)},
    )  # fmt: skip
    robot = JointDiagnosis.of(joint=ROBOT, causes=(latency,))
    joints = [
        found.changed(case=dataclasses.replace(found.case, joint=name), shared={"delay.seconds": "drive.delay"})
        for name in ("hip", "knee")
    ]
    runs = tuple(
        dataclasses.replace(
            run,
            joints=dict.fromkeys(("hip", "knee"), *run.joints.values()),
            actuators=dict.fromkeys(("hip", "knee"), *run.actuators.values()),
        )
        for run in data.runs
    )
    both = dataclasses.replace(data, runs=runs)
    model = extended_of(joints, both)
    assert model is not None
    draws = with_draws(model, [*joints, robot], both, "all").draws
    assert draws is not None
    columns = dict(zip(draws.numbers, np.array(draws.machines).T, strict=True))
    hip, knee = (columns["chain", joint, "0", "delay.seconds"] for joint in ("hip", "knee"))
    np.testing.assert_allclose(hip, knee, rtol=1e-4)
    assert hip.std() == pytest.approx(0.002 / Z95, rel=0.5)
    other = [columns["chain", joint, "0", "friction.load"] for joint in ("hip", "knee")]
    assert np.abs(other[0] - other[1]).max() > 1e-6, "the rest is each joint's own"


def test_what_is_handed_over_has_machines_and_equal_seeds_give_equal_ones(
    small: tuple[JointDiagnosis, MeasuredSet],
) -> None:
    found, data = small
    one, other = (hand_over([found], data)[0] for _ in range(2))
    assert one is not None and other is not None
    assert one.draws is not None and len(one.draws.machines) > 20
    assert one.draws == other.draws
    first = one.machines()[0]
    assert first.numbers() != one.numbers()
    assert first.numbers().keys() == one.numbers().keys()
