"""An arm that presses on a table that its model lacks: found, told, and left out of what is judged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.checks.stops import stops_of
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.load.resting import Resting, find_resting
from sealegs.gap.load.robot import Machine
from sealegs.gap.log.parts import LEAST_FREE, cut
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet
from sealegs.gap.prepare import resting
from sealegs.gap.prepare.checking import check_log
from sealegs.gap.prepare.resting import RESTS, without_rests
from sealegs.gap.verdict.verdict import NOTHING

from benchmarks.kept import DATA
from benchmarks.robot_logs import so101
from testbed.logs import hidden_arm
from tests.logged_robots import robot

TABLE = -0.05  # [m]
Hidden = dict[str, tuple[str, str | float]]


def dips(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Goals (k, 6) [rad] of slow motions whose lowest points are some centimetres below the table."""
    rates = np.array([0.05, 0.11, 0.07, 0.17, 0.1, 0.1])
    sizes, middles = np.array([0.4, 0.3, 0.5, 0.4, 0.3, 0.2]), np.array([0.0, 0.3, 0.6, 0.3, 0.0, 0.3])
    return middles + sizes * np.sin(2.0 * np.pi * rates * time[:, None] + rng.uniform(0.0, 2.0 * np.pi, 6))


def arm(folder: Path, hidden: Hidden, seed: int = 4, runs: int = 2, duration: float = 24.0) -> MeasuredSet:
    return hidden_arm(folder, "six_joint", hidden, seed, runs=runs, duration=duration, goals=dips)[0]


def rests(data: MeasuredSet) -> Resting | None:
    return find_resting(robot(data.runs[0]), data.runs)


@pytest.fixture(scope="module")
def pressed(tmp_path_factory: pytest.TempPathFactory) -> MeasuredSet:
    return arm(tmp_path_factory.mktemp("arm"), {"table": ("elbow_flex", TABLE)})


@pytest.mark.long
def test_a_table_is_found_at_its_height_by_the_body_that_touches_it(pressed: MeasuredSet) -> None:
    found = rests(pressed)
    assert found is not None
    assert found.body == "gripper_link"
    assert found.height == pytest.approx(TABLE, abs=0.006)
    assert 0.01 < found.deeper < 0.05
    assert found.joints == ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")


@pytest.mark.long
def test_the_contacts_are_told_and_no_piece_and_no_stop_is_taken_from_them(pressed: MeasuredSet) -> None:
    runs, (finding,) = without_rests(Machine.of(pressed.runs))
    assert finding.code == RESTS
    assert "such as a table" in finding.sentence and "left out at shoulder_pan" in finding.sentence
    for name in ("shoulder_lift", "elbow_flex"):
        for unit in cut(runs, name):
            touched = runs[unit.run].joints[name].touched
            assert touched is not None and not touched[unit.start : unit.stop].any()
            time = runs[unit.run].time[unit.start : unit.stop]
            assert time[-1] - time[unit.judged] >= LEAST_FREE - 0.01
        assert stops_of(runs, name) == ()


@pytest.mark.long
def test_one_wrong_reading_and_a_run_of_a_moment_hide_no_table(pressed: MeasuredSet) -> None:
    """A single reading far below became the lowest height, and a run of one pose ended in a traceback."""
    first, second = pressed.runs
    log = first.joints["elbow_flex"]
    wrong = log.position.copy()
    wrong[1200] += 0.6
    torn = replace(first, joints={**first.joints, "elbow_flex": replace(log, position=wrong)})
    joints = {name: JointLog(log.position[:3], log.position[:3]) for name, log in first.joints.items()}
    moment = MeasuredRun("moment", first.time[:3], joints, robot=first.robot, actuators=first.actuators)
    found = find_resting(robot(first), [torn, second, moment])
    assert found is not None and found.height == pytest.approx(TABLE, abs=0.006)


@pytest.mark.long
def test_contacts_are_kept_where_too_little_would_be_left_and_that_is_said(
    pressed: MeasuredSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resting, "MIN_JUDGED_SHARE", 0.99)
    runs, (finding,) = without_rests(Machine.of(pressed.runs))
    assert all(log.touched is None for run in runs for log in run.joints.values())
    assert "too little would be left" in finding.sentence


@pytest.mark.long
def test_numbers_that_fail_are_told_and_stop_no_diagnosis(
    pressed: MeasuredSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*given: object) -> None:
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(resting, "find_resting", fail)
    machine, (finding,) = without_rests(Machine.of(pressed.runs))
    assert (
        list(machine.runs) == list(pressed.runs)
        and "could not be told (LinAlgError: SVD did not converge)" in finding.sentence
    )


@pytest.mark.long
@pytest.mark.skipif(not (DATA / "so101_arm").is_dir(), reason="the public arm's logs are not beside the project")
def test_the_public_arm_presses_on_its_table_in_two_motions(tmp_path: Path) -> None:
    motions = ("friction_gravity", "hold_under_gravity", "single_joint_elbow")
    found = rests(check_log(so101(DATA, tmp_path, motions), lambda text: None)[0])
    assert found is not None
    assert set(found.stretches) == {"run2", "run3"}
    assert "wrist_flex" in found.joints and "gripper" not in found.joints


@pytest.mark.long
@pytest.mark.parametrize(
    "hidden",
    [
        {"friction": ("elbow_flex", 0.3)},
        pytest.param({}, marks=pytest.mark.long),
        pytest.param({"stop": ("elbow_flex", 0.8)}, marks=pytest.mark.long),
        pytest.param({"payload": ("gripper", 0.15)}, marks=pytest.mark.long),
        pytest.param({"weak_motor": ("shoulder_lift", 0.7)}, marks=pytest.mark.long),
        pytest.param({"play": ("elbow_flex", 0.12)}, marks=pytest.mark.long),
        pytest.param({"cable": ("elbow_flex", 0.6)}, marks=pytest.mark.long),
    ],
)
def test_nothing_else_is_taken_for_a_table(tmp_path: Path, hidden: Hidden) -> None:
    assert rests(arm(tmp_path, hidden)) is None


@pytest.mark.long
@pytest.mark.parametrize("friction", [False, True])
def test_behind_a_table_a_joint_is_judged_as_in_clear_air(tmp_path: Path, friction: bool) -> None:
    hidden: Hidden = {"table": ("elbow_flex", TABLE)}
    if friction:
        hidden["friction"] = ("elbow_flex", "clear")
    (found,) = diagnose(arm(tmp_path, hidden, runs=3), only=["elbow_flex"])
    assert any(finding.code == RESTS for finding in found.findings)
    if friction:
        assert found.causes[0].name == "friction.coulomb" and found.causes[0].confidence > 0.6
    else:
        assert found.verdict == NOTHING or not found.causes
        assert found.gap["nominal"].rmse < 3e-3  # 42.6 mrad with the contacts in it
