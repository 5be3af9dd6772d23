"""Contact switches in training: closed under force, observed as late as the IMU's board says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sealegs
from sealegs.common.errors import SealegsError
from sealegs.envs.any_robot.walk import WalkTask
from sealegs.envs.engine.batch import BatchEngine
from sealegs.envs.robots import get_robot

from tests.switched_dog import FEET, SWITCHES, switched

PLACES = {"shin": {"geom": "fl_shin", "threshold": 0.5}, "sole": {"site": "fl_sole", "threshold": 0.5}}


def walking(path: Path, count: int, **imu: Any) -> BatchEngine:
    """Dogs with a switch on every foot, beside them one on a geom and one on a site."""
    robot = switched(path, switches=SWITCHES | PLACES, **imu)
    found = BatchEngine(WalkTask.on(robot)(switches=True), count, autoreset=False)
    found.seed(0)
    found.reset()
    return found


def moved(engine: BatchEngine, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Switches as observed and as they are, and the forces on the feet [N] (steps, n, ...), while legs are thrown."""
    seen, true, forces, random = [], [], [], np.random.default_rng(0)
    for _ in range(steps):
        action = random.uniform(-1.0, 1.0, (engine.num_envs, 8))
        seen.append(engine.step(action).observation[:, -6:])
        true.append(engine.motion(action).switches.copy())
        forces.append(np.linalg.norm(engine.world.contact_force([f"{leg}2" for leg in FEET]), axis=2))
    return np.array(seen, float), np.array(true), np.array(forces)


def test_a_switch_is_closed_while_more_than_its_threshold_presses_on_body_geom_or_site(tmp_path: Path) -> None:
    _, true, forces = moved(walking(tmp_path, 4), 60)
    assert np.array_equal(true[..., :4], forces > 0.5)
    assert 0.1 < true[..., :4].mean() < 0.99, "feet come off the ground"
    assert np.array_equal(true[..., 4], true[..., 0])
    assert true[..., 5].any() and (true[..., 5] <= true[..., 0]).all(), "a site feels no contact outside its shape"


def test_a_policy_observes_switches_as_late_as_delay_and_rate_say(tmp_path: Path) -> None:
    seen, true, _ = moved(walking(tmp_path, 4, delay=0.04, rate=1000), 60)
    off = [np.abs(seen[5:] - true[5 - rows : len(true) - rows]).mean() for rows in range(5)]
    assert np.argmin(off) == 2 and off[2] < 0.3 * min(off[1], off[3])


def test_the_quadruped_of_the_collection_feels_its_feet_take_turns_in_its_gait() -> None:
    task = WalkTask.on("quadruped")(switches=True, forward=0.2, sideways=0.0, turn=0.0, stand_share=0.0, cadence=2.0)
    names = ("front_left", "front_right", "rear_left", "rear_right")
    assert task.observation_names()[-4:] == tuple(f"contact switch {name} [-]" for name in names)
    engine = BatchEngine(task, 4, autoreset=False)
    engine.seed(0)
    seen = [engine.reset()]
    seen += [engine.step(np.zeros((4, 12))).observation for _ in range(150)]
    closed = np.array(seen[50:], float)[..., -4:]
    assert set(np.unique(closed)) == {0.0, 1.0}
    assert (closed.sum(axis=-1) >= 1.0).mean() > 0.95, "it does not jump"
    alike = np.corrcoef(closed.reshape(-1, 4).T)
    assert alike[0, 3] > 0.1 and alike[1, 2] > 0.1, "feet across swing together"
    assert alike[0, 1] < -0.2 and alike[2, 3] < -0.5, "and in turn with those beside them"


def test_walking_takes_switches_only_where_it_is_asked_for_and_the_robot_has_them(tmp_path: Path) -> None:
    robot = switched(tmp_path)
    assert WalkTask.on(robot)(switches=True).observation_names()[-1] == "contact switch hr_foot [-]"
    assert not any("switch" in name for name in WalkTask.on(robot)().observation_names())
    with pytest.raises(SealegsError, match=r"'small_biped' has no contact switches to observe .* imu: \{switches: "):
        sealegs.make_env("walk", robot="small_biped", switches=True)
    with pytest.raises(SealegsError, match="switches takes true or false, not 1"):
        sealegs.make_env("walk", switches=1)


@pytest.mark.parametrize(
    ("said", "refused"),
    [
        ({"body": "fl3"}, r"imu\.switches\.foot\.body: the model has no body 'fl3' \(did you mean 'fl[12]'\?\)"),
        ({"body": "fl2", "site": "fl_sole"}, r"imu\.switches\.foot needs one place: body, geom or site; it has 2"),
        ({}, "it has 0"),
        ({"body": "fl2", "threshold": 0}, r"imu\.switches\.foot\.threshold must be more than 0"),
        ({"body": "fl2", "treshold": 1}, r"did you mean 'threshold'"),
    ],
)
def test_a_switch_that_cannot_be_is_refused_in_a_sentence(said: dict[str, Any], refused: str, tmp_path: Path) -> None:
    with pytest.raises(SealegsError, match=refused):
        switched(tmp_path, switches={"foot": said})


def test_a_place_that_touches_nothing_is_refused(tmp_path: Path) -> None:
    robot = switched(tmp_path)
    path = tmp_path / "dog.xml"
    path.write_text(path.read_text().replace('name="fl_shin"', 'name="fl_shin" contype="0" conaffinity="0"'))
    assert robot.file is not None
    with pytest.raises(SealegsError, match="fl2 has no shape that touches anything"):
        get_robot(robot.file.path)
