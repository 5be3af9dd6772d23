"""Errors planted in the logs of a bench that hides nothing: named, and no physics beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline
from sealegs.gap.checks.data_set import check_set, corrected
from sealegs.gap.checks.faults import FAULTS, Fault
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.types import MeasuredRun, MeasuredSet
from sealegs.gap.verdict.verdict import EXPLAINED, NOTHING

from testbed import hidden_bench
from tests.changed_logs import signal, with_log
from tests.quick import quick

SCHEDULES = (("chirp", "steps"), ("multisine", "triangle"), ("lift_and_drop", "chirp"))
GEAR = 345.0

Plant = Callable[[MeasuredRun, float, np.random.Generator], dict[str, Any]]


@cache
def clean(seed: int) -> tuple[MeasuredSet, tuple[np.ndarray, ...]]:
    data, truth = hidden_bench({}, seed, ("light", "medium", "heavy"), duration=8.0, schedules=SCHEDULES)
    return data, tuple(truth["clean_position"])


def times(name: str) -> Plant:
    return lambda run, size, rng: {name: size * signal(run, name)}


def degrees(run: MeasuredRun, size: float, rng: np.random.Generator) -> dict[str, Any]:
    return {name: np.degrees(signal(run, name)) for name in (("position",), ("goal",), ("goal", "position"))[int(size)]}


def wrapped(run: MeasuredRun, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """An encoder whose turn ends at an angle that the motion passes."""
    return {"position": (signal(run, "position") - size) % (2 * np.pi) + size}


def magnitude(run: MeasuredRun, size: float, rng: np.random.Generator) -> dict[str, Any]:
    return {"current": np.abs(signal(run, "current"))}


def aliased(run: MeasuredRun, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A supply reading that falls anywhere within the PWM period: it rings up and down while the bridge switches."""
    ripple = size * np.abs(signal(run, "duty")) * rng.choice([-1.0, 1.0], len(run.time))
    return {"voltage": np.round(signal(run, "voltage") + ripple, 1)}


def never_read(run: MeasuredRun, size: float, rng: np.random.Generator) -> dict[str, Any]:
    return {"voltage": np.full(len(run.time), size)}


def turned(angle: np.ndarray) -> np.ndarray:
    return (angle - 0.3) % (2 * np.pi) + 0.3


def link(mistake: Callable[[np.ndarray], np.ndarray]) -> Plant:
    """A link behind a stiff spring, with a mistake of its own encoder."""
    return lambda run, size, rng: {"link_position": mistake(0.95 * signal(run, "position"))}


def late_velocity(run: MeasuredRun, size: float, rng: np.random.Generator) -> dict[str, Any]:
    return {"velocity": np.interp(run.time - size, run.time, signal(run, "velocity"))}


ERRORS: dict[str, tuple[Plant, tuple[float, ...], str, str]] = {
    "degrees": (degrees, (0, 1, 2), "unit.degrees", "unit.degrees"),
    "wrap": (wrapped, (-0.2, 0.3), "position.wrap", "position.wrap"),
    "unsigned current": (magnitude, (1.0,), "current.unsigned", "current.unsigned"),
    "milliamperes": (times("current"), (1000.0,), "unit.current", "sensor.scale"),
    "current of the other sign": (times("current"), (-1.0,), "current.sign", "sensor.scale"),
    "duty in another unit": (times("duty"), (100.0, 885.0), "unit.duty", "sensor.scale"),
    "velocity in degrees": (times("velocity"), (180.0 / np.pi,), "unit.velocity", "sensor.scale"),
    "velocity before the gear": (times("velocity"), (6.0, GEAR), "velocity.gear_side", "sensor.scale"),
    "velocity of a wrong scale": (times("velocity"), (0.93, 1.1), "velocity.scale", "sensor.scale"),
    "late velocity": (late_velocity, (0.008, 0.015), "velocity.lag", "sensor.delay"),
    "supply never read": (never_read, (0.0,), "column.stuck", "column.stuck"),
    "link in degrees": (link(np.degrees), (0,), "unit.degrees", "unit.degrees"),
    "link of the other sign": (link(np.negative), (0,), "link_position.sign", "link_position.sign"),
    "link wraps": (link(turned), (0,), "link_position.wrap", "link_position.wrap"),
    "aliased supply": (aliased, (0.8, 2.5), "voltage.aliased", "voltage.aliased"),
}
CASES = [(name, size) for name, (_, sizes, _, _) in ERRORS.items() for size in sizes]


def planted(name: str, size: float, seed: int) -> MeasuredSet:
    plant, rng = ERRORS[name][0], np.random.default_rng(seed)
    data = clean(seed)[0]
    return replace(data, runs=tuple(with_log(run, **plant(run, size, rng)) for run in data.runs))


def with_torque(seed: int, delay: float = 0.0, factor: float = 1.0) -> MeasuredSet:
    """Logs with the torque that the true motion needs, and some dry friction."""
    data, positions = clean(seed)
    rng, runs = np.random.default_rng(seed), []
    for run, position in zip(data.runs, positions, strict=True):
        motion = make_smoothing_spline(run.time, position, lam=1e-9)
        velocity, acceleration = motion.derivative(1)(run.time), motion.derivative(2)(run.time)
        mass, length, arm = (run.robot_params[key] for key in ("mass", "length", "arm_mass"))
        torque = (mass * length**2 + arm * length**2 / 3) * acceleration + 0.05 * np.sign(velocity)
        torque += 9.81 * length * (mass + arm / 2) * np.sin(position) + rng.normal(0, 0.005, len(position))
        runs.append(with_log(run, torque=factor * np.interp(run.time - delay, run.time, torque)))
    return replace(data, runs=tuple(runs))


@pytest.mark.parametrize("seed", quick((1, 2, 3), 3))
def test_clean_logs_with_every_column_have_no_data_error(seed: int) -> None:
    assert [f.code for f in check_set(with_torque(seed)) if f.data_error] == []


@pytest.mark.parametrize("seed", quick((1, 2), 2))
@pytest.mark.parametrize(("name", "size"), CASES)
def test_a_data_error_is_found_alone_and_mended(name: str, size: float, seed: int) -> None:
    data = planted(name, size, seed)
    data, findings = corrected(data, check_set(data))
    assert {f.code for f in findings if f.data_error} == {ERRORS[name][2]}
    assert [f.code for f in check_set(data) if f.data_error] == []


@pytest.mark.parametrize("seed", quick((1, 2), 2))
@pytest.mark.parametrize(("delay", "code"), [(0.010, "torque.lag"), (0.020, "torque.lag"), (-0.012, "torque.lead")])
def test_a_torque_column_out_of_step_is_measured(delay: float, code: str, seed: int) -> None:
    faults = [f for f in check_set(with_torque(seed, delay=delay)) if f.data_error]
    assert [f.code for f in faults] == [code]
    assert faults[0].low is not None and faults[0].high is not None
    assert faults[0].low <= abs(delay) <= faults[0].high


@pytest.mark.parametrize("seed", quick((1, 2), 2))
@pytest.mark.parametrize("factor", [1 / GEAR, 1 / 6, 6.0, 1000.0])
def test_a_torque_column_of_the_other_side_of_the_gear_is_named(factor: float, seed: int) -> None:
    faults = [f for f in check_set(with_torque(seed, factor=factor)) if f.data_error]
    assert [f.code for f in faults] == ["torque.gear_side"]
    assert faults[0].value == pytest.approx(factor, rel=0.1)


@pytest.mark.parametrize(
    ("name", "size"),
    [
        pytest.param("degrees", 2, marks=pytest.mark.long),
        pytest.param("wrap", 0.3, marks=pytest.mark.long),
        pytest.param("unsigned current", 1.0, marks=pytest.mark.long),
        pytest.param("milliamperes", 1000.0, marks=pytest.mark.long),
    ],
)
def test_a_diagnosis_names_the_data_error_and_no_physics(name: str, size: float) -> None:
    (found,) = diagnose(planted(name, size, seed=2))
    # one entry per column that is wrong
    assert {error.name for error in found.data_errors} == {ERRORS[name][3]}, found.text
    assert found.causes == (), "an error of the log is no cause of the gap"
    assert found.verdict in (EXPLAINED, NOTHING)
    assert found.reasons[0].sentence.startswith("The log is wrong")


@pytest.mark.long
def test_a_late_torque_column_is_named_by_the_diagnosis_and_no_physics() -> None:
    (found,) = diagnose(with_torque(1, delay=0.012))
    assert [error.name for error in found.data_errors] == ["sensor.delay"] and not found.causes, found.text


@pytest.mark.long
def test_a_machine_whose_both_encoders_are_in_degrees_and_backwards_is_mended() -> None:
    data = clean(1)[0]
    both = [-np.degrees(signal(run, "position")) for run in data.runs]
    runs = [with_log(run, position=wrong, link_position=wrong) for run, wrong in zip(data.runs, both, strict=True)]
    wrong = replace(data, runs=tuple(runs))
    mended, _ = corrected(wrong, check_set(wrong))
    for run, right in zip(mended.runs, data.runs, strict=True):
        for name in ("position", "link_position"):
            np.testing.assert_allclose(signal(run, name), signal(right, "position"), atol=1e-12)


def test_what_mending_does_not_cure_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    data = planted("milliamperes", 1000.0, 1)
    monkeypatch.setitem(FAULTS, "unit.current", Fault(lambda run, finding: run))
    same, findings = corrected(data, check_set(data))
    np.testing.assert_array_equal(signal(same.runs[0], "current"), signal(data.runs[0], "current"))
    assert {f.code for f in findings if f.data_error} == {"unit.current"}
