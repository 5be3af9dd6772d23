"""Errors planted in the logs of a bench that hides nothing: named, mended in all runs, and no physics beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.gap.checks.data_set import FAULTS, Fault, check_run, check_set, corrected
from sealegs.gap.checks.drive import released
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.finding import Finding
from sealegs.gap.log.reader import measured_set
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet
from sealegs.gap.prepare.checking import check_log
from sealegs.gap.verdict.verdict import EXPLAINED, NOTHING

from testbed import hidden_bench
from tests.logged_robots import JOINT, signal, with_log
from tests.logged_robots import with_torque as torque_logged
from tests.quick import quick

SCHEDULES = (("chirp", "steps"), ("multisine", "triangle"), ("lift_and_drop", "chirp"))
GEAR = 345.0

Plant = Callable[[MeasuredRun, float, np.random.Generator], dict[str, Any]]


@cache
def clean(seed: int) -> tuple[MeasuredSet, dict[str, Any]]:
    return hidden_bench({}, seed, ("light", "medium", "heavy"), duration=8.0, schedules=SCHEDULES)


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
    "velocity of the other sign": (times("velocity"), (-1.0,), "velocity.sign", "velocity.sign"),
    "position of the other sign": (times("position"), (-1.0,), "position.sign", "position.sign"),
    "velocity before the gear": (times("velocity"), (6.0, GEAR), "velocity.gear_side", "sensor.scale"),
    "velocity of a wrong scale": (times("velocity"), (0.93, 1.1), "velocity.scale", "sensor.scale"),
    "late velocity": (late_velocity, (0.008, 0.015), "velocity.lag", "sensor.delay"),
    "supply never read": (never_read, (0.0,), "column.stuck", "column.stuck"),
    "link in degrees": (link(np.degrees), (0,), "unit.degrees", "unit.degrees"),
    "link of the other sign": (link(np.negative), (0,), "link_position.sign", "link_position.sign"),
    "link wraps": (link(turned), (0,), "link_position.wrap", "link_position.wrap"),
    "aliased supply": (aliased, (0.8, 2.5), "voltage.aliased", "voltage.aliased"),
}
MEASURED = ("unit.current", "unit.duty", "unit.velocity", "velocity.gear_side", "velocity.scale", "velocity.lag")
"""Errors whose size is measured as it was planted."""
REFUSED = (
    *("unit.degrees", "position.wrap", "link_position.wrap", "position.sign"),
    *("velocity.sign", "velocity.gear_side", "unit.velocity"),
)
"""Errors of columns that cannot be used as they are; others are warnings."""
CASES = [(name, size) for name, (_, sizes, _, _) in ERRORS.items() for size in sizes]


def planted(name: str, size: float, seed: int) -> MeasuredSet:
    plant, rng = ERRORS[name][0], np.random.default_rng(seed)
    data = clean(seed)[0]
    return replace(data, runs=tuple(with_log(run, **plant(run, size, rng)) for run in data.runs))


def with_torque(seed: int, **column: float) -> MeasuredSet:
    return torque_logged(*clean(seed), **column)


@pytest.mark.parametrize("seed", quick((1, 2, 3), 3))
def test_clean_logs_with_every_column_have_no_data_error(seed: int) -> None:
    assert [f.code for f in check_set(with_torque(seed)) if f.data_error] == []


@pytest.mark.parametrize("seed", quick((1, 2), 2))
@pytest.mark.parametrize(("name", "size"), CASES)
def test_a_data_error_is_found_alone_and_mended(name: str, size: float, seed: int) -> None:
    _, _, code, told = ERRORS[name]
    data = planted(name, size, seed)
    seen = [f for f in check_set(data) if f.code == code]
    assert {f.cause or f.code for f in seen} == {told}
    assert {f.severity == "error" for f in seen} == {code in REFUSED}
    if code in MEASURED:
        assert all(f.value == pytest.approx(size, rel=0.03, abs=0.0015) for f in seen)
        assert all((f.low or size) <= 1.03 * size and (f.high or size) >= 0.97 * size for f in seen)
    if name == "wrap":
        assert all(f.value == pytest.approx(2 * np.pi, rel=0.01) for f in seen)
    data, findings = corrected(data, check_set(data))
    assert {f.code for f in findings if f.data_error} == {code}
    assert [f.code for f in check_set(data) if f.data_error] == []


@pytest.mark.parametrize("seed", quick((1, 2), 2))
@pytest.mark.parametrize(("delay", "code"), [(0.010, "torque.lag"), (0.020, "torque.lag"), (-0.012, "torque.lead")])
def test_a_torque_column_out_of_step_is_measured(delay: float, code: str, seed: int) -> None:
    faults = [f for f in check_set(with_torque(seed, delay=delay)) if f.data_error]
    assert [(f.code, f.cause) for f in faults] == [(code, "sensor.delay")]
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


# --- a fault of a column is a property of the machine: decided over all its runs with the drive on, mended in all ----


@cache
def four_runs() -> MeasuredSet:
    return hidden_bench({}, 3, runs=4, duration=6.0, schedules=SCHEDULES)[0]


def mended(data: MeasuredSet) -> MeasuredSet:
    return corrected(data, check_set(data))[0]


def half_off(run: MeasuredRun) -> MeasuredRun:
    """The drive is off for most of the run, and somebody moves the joint against the goal of the time."""
    off = run.time > 1.5
    turned = signal(run, "position").copy()
    turned[off] = 1.2 * signal(run, "goal")[off]
    return with_log(run, position=turned, enabled=np.where(off, 0.0, 1.0), duty=None, current=None, velocity=None)


def test_a_sign_is_mended_in_all_runs_though_one_has_its_drive_off() -> None:
    """It was mended in three runs of four, and physics then fitted the fourth."""
    data = four_runs()
    runs = [*data.runs[:3], half_off(data.runs[3])]
    wrong = replace(data, runs=tuple(with_log(run, position=-signal(run, "position")) for run in runs))
    for run, right in zip(mended(wrong).runs, runs, strict=True):
        np.testing.assert_allclose(signal(run, "position"), signal(right, "position"))


def test_a_joint_that_is_pushed_about_in_one_run_has_no_wrong_sign() -> None:
    data = four_runs()
    odd = with_log(data.runs[3], position=-0.5 * signal(data.runs[3], "goal"), velocity=None, duty=None, current=None)
    same = mended(replace(data, runs=(*data.runs[:3], odd)))
    np.testing.assert_allclose(signal(same.runs[0], "position"), signal(data.runs[0], "position"))


def test_one_run_of_four_in_degrees_is_converted() -> None:
    """It was kept as radians: 3228 mrad, and a proposed motion up to 50 rad."""
    data = four_runs()
    last = data.runs[3]
    odd = with_log(last, **{name: np.degrees(signal(last, name)) for name in ("goal", "position")}, velocity=None)
    for run, right in zip(mended(replace(data, runs=(*data.runs[:3], odd))).runs, data.runs, strict=True):
        for name in ("goal", "position"):
            np.testing.assert_allclose(signal(run, name), signal(right, name), atol=1e-9)


def test_runs_in_radians_stay_as_they_are() -> None:
    assert not [f for f in corrected(four_runs(), check_set(four_runs()))[1] if f.data_error]


def test_a_drive_that_looks_off_is_told_and_taken_as_off() -> None:
    """It read "stuck duty", and 611 mrad of nonsense."""
    data = four_runs()
    last = data.runs[3]
    off = (last.time > 2.0) & (last.time < 5.0)
    hanging = np.where(off, 0.002 * np.sin(9.0 * last.time), signal(last, "position"))
    loose = with_log(last, position=hanging, duty=np.where(off, 0.0, signal(last, "duty")), velocity=None)
    seen, findings = released(replace(data, runs=(*data.runs[:3], loose)))
    (finding,) = findings
    assert finding.code == "drive.looks_off" and f"log {JOINT}.enabled" in finding.sentence
    enabled = signal(seen.runs[3], "enabled") < 0.5
    assert (enabled & off).sum() > 0.9 * off.sum() and (enabled & ~off).sum() < 0.05 * off.sum()
    assert all(run.joints[JOINT].enabled is None for run in seen.runs[:3])
    assert "column.stuck" not in {f.code for f in check_set(seen)}


@pytest.mark.parametrize("wrong", [np.degrees, np.negative])
def test_no_drive_looks_off_for_a_position_that_is_mended(wrong: Callable[[np.ndarray], np.ndarray]) -> None:
    """An eighth of a log in degrees was taken as off, by a goal that looked far away, and replayed without a drive."""
    data = four_runs()
    runs = tuple(with_log(run, position=wrong(signal(run, "position")), velocity=None) for run in data.runs)
    seen, findings, _ = check_log(replace(data, runs=runs), lambda text: None)
    assert "drive.looks_off" not in {finding.code for finding in findings}
    for run, right in zip(seen.runs, data.runs, strict=True):
        assert run.joints[JOINT].enabled is None
        np.testing.assert_allclose(signal(run, "position"), signal(right, "position"), atol=1e-9)


# --- joints faster or farther than their model's: in degrees or radians as motor, velocity and range say -------------

TIME = np.arange(0.0, 12.0, 0.005)
TURN = 2.0 * np.pi
GEARLESS = [
    *({"position_p": {"gain": 0.5}}, {"supply": {"volts": 24.0}}),
    *({"dc_motor": {"motor_constant": 0.1, "resistance": 0.5}}, {"friction": {"coulomb": 0.01}}),
]
"""A motor that turns 240 rad/s without a load."""


def late(column: np.ndarray) -> np.ndarray:
    return np.interp(TIME - 0.01, TIME, column)


def spun(per: float = 1.0, rate: float | None = 1.0, chain: str | list = "ideal", units: str = "") -> MeasuredRun:
    """A wheel that is sent to and fro at up to 75 rad/s.

    Args:
        per: of its columns in rad.
        rate: of its velocity in rad/s; None: there is none.
        chain: of its motor.
        units: that the sidecar says of the position.
    """
    speed = 12.0 * TURN * np.sin(TURN * TIME / 6.0)
    angle = np.cumsum(speed) * 0.005
    velocity = None if rate is None else rate * late(speed)
    joint = JointLog(per * angle, per * late(angle), velocity)
    meta = {"units": {"wheel.position": units}} if units else {}
    return MeasuredRun("spin", TIME, {"wheel": joint}, actuators={"wheel": chain}, meta=meta)


def codes(run: MeasuredRun) -> dict[str, Finding]:
    return {f"{finding.code} {finding.column}": finding for finding in check_run(run) if finding.severity != "note"}


@pytest.mark.parametrize(
    "run",
    [spun(), spun(rate=180.0 / np.pi), spun(rate=60.0 / TURN), spun(rate=None, chain=GEARLESS), spun(chain=GEARLESS)],
    ids=["rad/s", "deg/s", "rpm", "no velocity", "both"],
)
def test_a_fast_joint_whose_velocity_or_motor_agrees_is_not_converted(run: MeasuredRun) -> None:
    """A direct drive at 75 rad/s was divided by 57.3."""
    said = codes(run)
    assert not [name for name in said if name.startswith("unit.degrees")]
    assert said["position.fast wheel.position"].severity == "warning"
    assert "goal.fast wheel.goal" not in said
    mended, _ = corrected(MeasuredSet((run,), "x"), check_set(MeasuredSet((run,), "x")))
    np.testing.assert_array_equal(mended.runs[0].joints["wheel"].position, run.joints["wheel"].position)


def test_the_sidecar_can_say_that_a_fast_joint_is_in_radians() -> None:
    for rate in (1.0, None):
        said = codes(spun(rate=rate, units="rad"))
        assert not [name for name in said if name.startswith(("unit.degrees", "position.fast", "goal.fast"))]
    sentence = codes(spun())["position.fast wheel.position"].sentence
    assert "units: {wheel.position: rad}" in sentence


@pytest.mark.parametrize(
    "run",
    [
        spun(rate=None),
        spun(rate=np.pi / 180.0),  # a velocity in rad/s beside a position in degrees
        spun(rate=None, chain="sts3215"),
        spun(chain="sts3215"),  # all columns in degrees, of a servo of 6 rad/s
    ],
    ids=["nothing said", "velocity in rad/s", "servo", "all of a servo"],
)
def test_a_speed_that_nothing_allows_is_of_degrees(run: MeasuredRun) -> None:
    said = codes(run)
    assert {"unit.degrees wheel.position", "unit.degrees wheel.goal"} <= said.keys()
    assert not [name for name in said if ".fast " in name]


def test_a_goal_that_jumps_far_is_in_doubt_where_the_motor_may_follow_it() -> None:
    """The position lags behind; its own speed tells nothing."""
    run = spun(rate=None, chain=GEARLESS)
    joint = run.joints["wheel"]
    slow = replace(run, joints={"wheel": replace(joint, position=0.5 * joint.position)})
    assert "goal.fast wheel.goal" in codes(slow)
    slow = replace(slow, actuators={"wheel": "sts3215"})
    assert "unit.degrees wheel.goal" in codes(slow)


SLOW_TIME = np.arange(0.0, 20.0, 0.01)
ARM = """<mujoco><compiler angle="radian"/><worldbody><body><joint name="elbow" axis="0 1 0"{range}/>
<geom size="0.1" pos="0 0 -0.2" mass="1"/></body></worldbody></mujoco>"""


def columns_in_degrees(folder: Path, position: float, goal: float, range_: str = ' range="-1.57 1.57"') -> set[str]:
    """Columns that are told to be in degrees; both go slowly over a swing, to either side by so much."""
    (folder / "arm.xml").write_text(ARM.format(range=range_))
    late = np.sin(2.0 * np.pi * 0.2 * (SLOW_TIME - 0.05))
    noise = 1e-4 * position * np.random.default_rng(0).normal(size=len(SLOW_TIME))
    columns = {
        "time": SLOW_TIME,
        "elbow.goal": goal * np.sin(2.0 * np.pi * 0.2 * SLOW_TIME),
        "elbow.position": position * late + noise,
    }
    run = measured_set([columns], {"robot": str(folder / "arm.xml"), "actuators": {"elbow": "sts3215"}}, "log").runs[0]
    return {str(finding.column) for finding in check_run(run) if finding.code == "unit.degrees"}


@pytest.mark.parametrize(
    ("position", "goal", "wrong"),
    [
        (45.0, 45.0, {"elbow.position", "elbow.goal"}),
        (45.0, 45.0 * np.pi / 180.0, {"elbow.position"}),
        (1.5, 1.5, set()),
        (4.0, 4.0, set()),  # somewhat beyond: a zero or a range that is off
    ],
)
def test_degrees_are_told_by_the_range_of_the_joint(
    tmp_path: Path, position: float, goal: float, wrong: set[str]
) -> None:
    """45 rad were replayed on a joint that ends at 1.57, since nothing else of so slow a log tells its unit."""
    assert columns_in_degrees(tmp_path, position, goal) == wrong


def test_a_joint_without_a_range_may_turn_as_often_as_it_likes(tmp_path: Path) -> None:
    assert columns_in_degrees(tmp_path, 45.0, 45.0, range_="") == set()
