"""Joints faster or farther than their model's: in degrees or radians as motor, velocity and range say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.checks.data_set import check_run, check_set, corrected
from sealegs.gap.log.arrays import measured_set
from sealegs.gap.log.finding import Finding
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet

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
