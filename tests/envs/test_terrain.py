"""Uneven ground, and commands that change while an episode runs."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
import sealegs
from sealegs.common.errors import SealegsError
from sealegs.envs.any_robot.stand import Standing
from sealegs.envs.any_robot.walk import WalkTask
from sealegs.envs.engine.batch import BatchEngine
from sealegs.envs.engine.sb3 import BatchVecEnv

ROUGH: dict[str, Any] = {"floor": {"rough": [0.0, 0.03], "steps": [0.01, 0.02], "friction": [0.4, 0.9]}}
STANDING: dict[str, Any] = {"forward": 0.0, "sideways": 0.0, "turn": 0.0, "start_noise": 0.0}


def started(count: int, floor: dict[str, Any] | None, **arguments: Any) -> BatchEngine:
    engine = BatchEngine(WalkTask(**arguments), count, randomization=floor, autoreset=False)
    engine.seed(0)
    engine.reset()
    return engine


def standing(engine: BatchEngine) -> Standing:
    assert isinstance(engine.task, WalkTask)
    return engine.task.stance


def ground_under(engine: BatchEngine, simulation: int, x: float, y: float) -> float:
    """Height of the ground in a place [m], by a ray from above."""
    data, model = engine.look(simulation, mujoco.MjData(engine.drivetrain.model)), engine.seen
    base = int(model.jnt_bodyid[0])
    found = np.zeros(1, np.int32)
    groups, way = np.ones(6, np.uint8), np.array([0.0, 0.0, -1.0])
    away = mujoco.mj_ray(model, data, np.array([x, y, 1.0]), way, groups, 1, base, found)
    return 1.0 - away


@pytest.mark.parametrize(("kind", "length"), [("rough", 0.5), ("steps", 0.5)])
def test_the_ground_where_an_episode_starts_is_as_uneven_as_it_drew(kind: str, length: float) -> None:
    engine = started(40, {"floor": {kind: [0.0, 0.04]}}, **STANDING)
    spread = []
    for number in range(engine.num_envs):
        x, y = engine._qpos[number, :2]
        places = np.linspace(-length, length, 9)
        spread.append(np.ptp([ground_under(engine, number, x + a, y + b) for a in places for b in places]))
    drawn = engine.drawn[f"floor.{kind}"]
    assert np.corrcoef(drawn, spread)[0, 1] > 0.8
    assert (np.array(spread) < drawn + 0.006).all()  # a metre further on it is a little rougher


def test_robots_start_above_uneven_ground_and_come_to_stand_on_it() -> None:
    engine = started(12, ROUGH, **STANDING)
    assert not engine.step(np.zeros((12, 12))).terms["reward_collision"].any()
    for _ in range(50):
        assert not engine.step(np.zeros((12, 12))).terminated.any()
    assert (engine.world.touching(standing(engine).feet).sum(axis=1) >= 3).all()
    heights = [ground_under(engine, k, *engine._qpos[k, :2]) for k in range(12)]
    assert max(heights) > 0.005


def test_uneven_ground_has_the_friction_that_was_drawn_and_leans_with_the_slope() -> None:
    engine = started(6, {"floor": {"rough": [0.0, 0.02], "friction": [0.4, 0.9], "slope": [0.1, 0.1]}}, **STANDING)
    terrain = engine.drivetrain.model.geom("terrain").id
    friction = engine.batch.expanded("geom_friction")
    assert friction is not None
    np.testing.assert_array_equal(friction[:, terrain, 0], engine.drawn["floor.friction"])
    for _ in range(50):
        assert not engine.step(np.zeros((6, 12))).terminated.any()
    assert engine.world.touching(standing(engine).feet).any(axis=1).all()
    heights = [ground_under(engine, k, *engine._qpos[k, :2]) for k in range(6)]
    np.testing.assert_allclose(engine._qpos[:, 2] - heights, standing(engine).height, atol=0.02)
    assert np.abs(heights).max() > 0.05


def test_a_picture_shows_the_slope_that_the_robot_stands_on() -> None:
    env = sealegs.make_env("walk", render_mode="rgb_array", randomization={"floor": {"slope": [0.2, 0.2]}})
    env.reset(seed=1)
    engine = env.unwrapped.engine  # pyright: ignore[reportAttributeAccessIssue]
    picture, data = env.render(), env.unwrapped.data  # pyright: ignore[reportAttributeAccessIssue]
    assert isinstance(picture, np.ndarray) and picture.std() > 10.0
    up = data.geom("floor").xmat.reshape(3, 3)[:, 2]
    assert up[2] == pytest.approx(np.cos(0.2))
    assert data.body("trunk").xmat.reshape(3, 3)[:, 2] @ up == pytest.approx(1.0, abs=1e-6)
    assert engine.seen.geom("floor").quat[0] == pytest.approx(np.cos(0.1))


def test_a_batch_on_uneven_ground_moves_as_single_ones() -> None:
    many = BatchVecEnv("SeaLegs/Walk-v0", 3, seed=5, randomization=ROUGH, command_interval=0.1)
    singles = [sealegs.make_env("walk", randomization=ROUGH, command_interval=0.1) for _ in range(3)]
    np.testing.assert_array_equal(many.reset(), [env.reset(seed=5 + k)[0] for k, env in enumerate(singles)])
    for _ in range(12):
        steps = [env.step(np.zeros(12, np.float32)) for env in singles]
        np.testing.assert_array_equal(many.engine.step(np.zeros((3, 12))).observation, [step[0] for step in steps])


def test_commands_change_when_their_interval_is_over() -> None:
    engine = started(4, None, command_interval=0.2, stand_share=0.0)
    asked = [engine._command.copy()]
    seen = []
    for _ in range(40):
        seen.append(engine.step(np.zeros((4, 12))).observation[:, :3])
        asked.append(engine._command.copy())
    changed = [k for k in range(1, 41) if (asked[k] != asked[k - 1]).any(axis=1).all()]
    assert changed == [10, 20, 30, 40]
    assert all((asked[k] == asked[k - 1]).all() for k in range(1, 41) if k not in changed)
    np.testing.assert_allclose(seen, asked[1:], rtol=1e-6)  # the policy sees the command that is judged next
    assert (np.abs(np.array(asked)[..., 0] - 0.05) <= 0.25).all()


def test_a_command_interval_below_zero_is_refused() -> None:
    with pytest.raises(SealegsError, match="command_interval is -1 s; it must be above 0, or 0 for none"):
        WalkTask(command_interval=-1.0)


def test_a_robot_on_a_fixed_base_has_no_uneven_ground() -> None:
    with pytest.raises(SealegsError, match=r"randomization.floor.rough: the base of the robot is not free"):
        sealegs.make_env("track", robot="bench", randomization={"floor": {"rough": [0.0, 0.1]}})
