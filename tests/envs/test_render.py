"""Pictures show the robot, follow it, and say in one sentence why there are none."""

from __future__ import annotations

from pathlib import Path

import gymnasium as gym
import imageio.v2 as imageio
import numpy as np
import pytest
import sealegs  # noqa: F401 registers
from gymnasium.wrappers import RecordVideo
from sealegs.common.errors import SealegsError
from sealegs.envs.engine.sb3 import BatchVecEnv
from sealegs.envs.engine.single import SingleEnv


@pytest.mark.long
@pytest.mark.rendering
@pytest.mark.parametrize("env_id", ["SeaLegs/Hopper-v0", "SeaLegs/Bench-v0"])
def test_a_picture_shows_the_robot_in_front_of_the_sky(env_id: str) -> None:
    env = gym.make(env_id, render_mode="rgb_array", width=160, height=120)
    env.reset(seed=0)
    picture = env.render()
    assert isinstance(picture, np.ndarray)
    assert picture.shape == (120, 160, 3)
    assert picture.dtype == np.uint8
    assert (picture.max(axis=2) < 90).mean() > 0.005  # dark parts of the robot
    assert picture[:10].mean() > 150  # sky
    env.close()


@pytest.mark.long
@pytest.mark.rendering
def test_the_camera_follows_the_hopper() -> None:
    env = gym.make("SeaLegs/Hopper-v0", render_mode="rgb_array", width=160, height=120)
    env.reset(seed=0)
    near = env.render()
    inner = env.unwrapped
    assert isinstance(inner, SingleEnv)
    inner.engine.batch.qpos[0, 0] += 3.0
    env.render()
    far = env.render()
    assert isinstance(near, np.ndarray)
    assert isinstance(far, np.ndarray)
    dark = [(picture.max(axis=2) < 90).mean() for picture in (near, far)]
    assert dark[1] == pytest.approx(dark[0], rel=0.3)
    env.close()


@pytest.mark.long
@pytest.mark.rendering
def test_drawing_does_not_change_the_motion() -> None:
    drawn, blind = (
        gym.make("SeaLegs/Hopper-v0", render_mode=mode, width=64, height=48) for mode in ("rgb_array", None)
    )
    for env in (drawn, blind):
        env.reset(seed=0)
    for _ in range(5):
        drawn.render()
        action = np.array([0.3, -0.3], np.float32)
        np.testing.assert_array_equal(drawn.step(action)[0], blind.step(action)[0])
    drawn.close()


@pytest.mark.rendering
def test_sb3_gets_a_picture_of_each_simulation() -> None:
    env = BatchVecEnv("SeaLegs/Hopper-v0", 2, seed=0, render_mode="rgb_array", width=64, height=48)
    env.reset()
    images = env.get_images()
    assert [image.shape for image in images if image is not None] == [(48, 64, 3)] * 2
    env.close()


def test_a_window_without_a_screen_is_refused_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    env = gym.make("SeaLegs/Bench-v0", render_mode="human", disable_env_checker=True)
    with pytest.raises(SealegsError, match="no screen"):
        env.reset(seed=0)


@pytest.mark.rendering
@pytest.mark.long
def test_gymnasiums_recorder_films_an_episode(tmp_path: Path) -> None:
    env = gym.make("SeaLegs/Bench-v0", render_mode="rgb_array", width=64, height=48, max_episode_steps=5)
    recorder = RecordVideo(env, str(tmp_path / "film"), episode_trigger=lambda episode: episode == 0)
    recorder.reset(seed=0)
    while not recorder.step(recorder.action_space.sample())[3]:
        pass
    recorder.close()
    (film,) = (tmp_path / "film").glob("*.mp4")
    frames = imageio.mimread(film)
    assert len(frames) == 6 and frames[0].shape == (48, 64, 3)
