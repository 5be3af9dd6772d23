"""Draws and films each robot: ``python -m docs.generate.robot_films [bench|hopper|small_biped|rover ...]``.

Writes ``docs/pictures/<robot>.png`` and ``docs/pictures/<robot>.mp4``. Needs OpenGL (without a screen, EGL).
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import sealegs  # isort: skip  # noqa: F401 chooses how MuJoCo draws, before that is imported
import imageio.v2 as imageio
import imageio_ffmpeg
import mujoco
import numpy as np
from PIL import Image
from sealegs.agents.make_env import checked_env, make_single_env
from sealegs.agents.policy_files import load_policy
from sealegs.agents.video import record_video
from sealegs.common.documents import read_yaml
from sealegs.envs.engine.scene import CAMERA
from sealegs.papers.hopper.paper import CONTROL_STEP, Legs

CHECKOUT = Path(__file__).resolve().parents[2]
FOLDER = CHECKOUT / "docs" / "pictures"
WIDTH, HEIGHT, SECONDS = 640, 480, 8.0


def bench(film: Path) -> None:
    """The servo turns its pendulum to targets, commanded directly."""
    env = make_single_env(checked_env({"id": "SeaLegs/Bench-v0"}), None, WIDTH, HEIGHT)
    count = 0

    def act(observation: np.ndarray) -> np.ndarray:
        nonlocal count
        count += 1
        return np.full((1, 1), np.sin(2.0 * np.pi * 0.4 * count / 50.0) * 1.0 / np.pi, np.float32)

    record_video(film, act, env, SECONDS, 0)
    env.close()


def hopper(film: Path) -> None:
    """The leg hops under the controller of its paper."""
    legs = Legs("sv1270tg")
    model, data = legs.model, legs.data
    model.vis.global_.fovy = float(model.camera(CAMERA).fovy[0])
    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation, camera.distance = 90.0, -11.0, 1.1
    at, across = data.subtree_com[0][:2]
    writer: Any = imageio.get_writer(film, fps=30)
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer, writer:
        for k in range(round(SECONDS / CONTROL_STEP)):
            legs.step()
            if k % round(1.0 / 30.0 / CONTROL_STEP) == 0:
                at += 0.15 * (data.subtree_com[0][0] - at)  # follows the walk, not the hop
                camera.lookat = (at, across, 0.25)
                renderer.update_scene(data, camera)
                writer.append_data(renderer.render())


def arm(film: Path) -> None:
    """The tool follows the line of the paper, led by the goals that a policy would correct."""
    env = make_single_env(checked_env({"id": "SeaLegs/Arm-v0"}), None, WIDTH, HEIGHT)
    record_video(film, lambda *_: np.zeros((1, 3), np.float32), env, SECONDS, 0)
    env.close()


def _policy(folder: str, **changes: float) -> Callable[[Path], None]:
    def film_it(film: Path) -> None:
        act, description = load_policy(CHECKOUT / "policies" / folder)
        env = make_single_env(checked_env({**description["env"], **changes}), description["actuators"], WIDTH, HEIGHT)
        record_video(film, act, env, SECONDS, 0)
        env.close()

    return film_it


def _unlearned(task: str, **changes: float) -> Callable[[Path], None]:
    """As the reference of a task of any robot moves it, without corrections."""

    def film_it(film: Path) -> None:
        given = read_yaml(CHECKOUT / "configs" / "env" / f"{task}.yaml", "the task")
        env = make_single_env(checked_env({**given, "stand_share": 0.0, **changes}), None, WIDTH, HEIGHT)
        still = np.zeros((1, *(env.action_space.shape or ())), np.float32)
        record_video(film, lambda *_: still, env, SECONDS, 0)
        env.close()

    return film_it


ROBOTS: dict[str, Callable[[Path], None]] = {
    "bench": bench,
    "hopper": hopper,
    "hexapod": _policy("hexapod/seed4"),
    "biped": _policy("biped/seed0", speed=0.8),
    "leg": _policy("leg/seed0"),
    "arm": arm,
    "small_biped": _unlearned("walk_biped", forward=0.1, sideways=0.0, turn=0.15),
    "rover": _unlearned("drive", forward=0.15, turn=0.6),
}


def main(names: list[str]) -> None:
    """Film the robots that are named, or all."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in names or ROBOTS:
        with tempfile.TemporaryDirectory() as folder:
            whole = Path(folder) / "film.mp4"
            ROBOTS[name](whole)
            film = FOLDER / f"{name}.mp4"
            options = "-an -crf 30 -preset slow -pix_fmt yuv420p -movflags +faststart"
            command = [imageio_ffmpeg.get_ffmpeg_exe(), *["-y", "-loglevel", "error", "-i"], str(whole)]
            subprocess.run([*command, *options.split(), str(film)], check=True)
            reader: Any = imageio.get_reader(whole)
            with reader:
                middle = reader.get_data(round(SECONDS / 2.0 * reader.get_meta_data()["fps"]))
        picture = FOLDER / f"{name}.png"
        Image.fromarray(middle).quantize(128).save(picture, optimize=True)
        print(
            f"{name}: {film.stat().st_size / 1024:.0f} KiB, picture {picture.stat().st_size / 1024:.0f} KiB", flush=True
        )


if __name__ == "__main__":
    main(sys.argv[1:])
