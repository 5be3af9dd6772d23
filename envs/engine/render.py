"""Pictures of a running simulation, and the window to look at it."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ...common.errors import SealegsError, nearest
from .batch import BatchEngine
from .scene import CAMERA

FOLLOW = 0.15  # share of the way to the robot that the camera goes in each picture: a hop is seen, a walk is followed


class RenderError(SealegsError):
    """Nothing can be drawn on this machine, with the reason."""


def check_render_mode(mode: str | None, modes: Sequence[str]) -> None:
    """Refuse a mode that is not among ``modes``; None draws nothing.

    Raises:
        RenderError: there is no such mode; the message names the nearest one.
    """
    if mode is not None and mode not in modes:
        raise RenderError(f"there is no render_mode '{mode}'{nearest(mode, modes)}; there are {', '.join(modes)}.")


class Scene:
    """Draws simulations of a batch, off screen or in a window."""

    def __init__(self, engine: BatchEngine, mode: str, width: int, height: int) -> None:
        """Nothing is opened before the first picture.

        Args:
            engine: whose simulations are drawn.
            mode: ``rgb_array`` or ``human``.
            width: of the picture [px].
            height: of the picture [px].
        """
        self._engine, self._mode, self._size = engine, mode, (height, width)
        self._model = engine.seen
        self._data = mujoco.MjData(self._model)
        self._renderer: mujoco.Renderer | None = None
        self._viewer: Any = None
        self._camera = mujoco.MjvCamera()
        self._centre: dict[int, float] = {}

    def draw(self, simulation: int) -> np.ndarray | None:
        """The picture of one simulation (height, width, 3), uint8; None in a window.

        Raises:
            RenderError: there is no OpenGL, or no screen for the window.
        """
        data = self._engine.look(simulation, self._data)
        if self._mode == "human":
            self._show()
            return None
        renderer = self._renderer = self._renderer or self._open()
        renderer.update_scene(data, self._follow(simulation))
        return renderer.render()

    def _follow(self, simulation: int) -> mujoco.MjvCamera:
        """The model's camera, moved along with the robot; heights stay, so that a hop is seen."""
        model, data, camera = self._model, self._data, self._camera
        level = self._engine.randomization.level
        if (number := mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, CAMERA)) < 0 or not level:
            mujoco.mjv_defaultFreeCamera(model, camera)  # of a model file: the view that it asks for
            if model.njnt and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
                axes = 2 if level else 3
                camera.lookat[:axes] = data.subtree_com[int(model.jnt_bodyid[0])][:axes]
            return camera
        where = data.subtree_com[0][0] if model.cam_mode[number] else 0.0
        at = self._centre.get(simulation, where)
        if self._engine.steps[simulation] == 0 or abs(where - at) > model.stat.extent:
            at = where
        self._centre[simulation] = at = at + FOLLOW * (where - at)
        towards = -np.asarray(model.cam_mat0[number]).reshape(3, 3)[:, 2]
        position = model.cam_pos0[number] if not model.cam_mode[number] else model.cam_pos[number]
        distance = float(np.linalg.norm(position[1]))
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        camera.lookat = (at, 0.0, position[2] + towards[2] / abs(towards[1]) * distance)
        camera.distance = distance / abs(towards[1])
        camera.azimuth, camera.elevation = 90.0, float(np.degrees(np.arcsin(towards[2])))
        return camera

    def _open(self) -> mujoco.Renderer:
        if os.environ.get("MUJOCO_GL", "glfw") == "glfw" and not _screen():  # GLFW would end the process
            raise RenderError("there is no screen: set MUJOCO_GL=egl before mujoco is imported.")
        if (number := mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_CAMERA, CAMERA)) >= 0:
            self._model.vis.global_.fovy = float(self._model.cam_fovy[number])
        try:
            return mujoco.Renderer(self._model, *self._size)
        except Exception as error:  # each OpenGL back end raises its own
            reason = str(error) or type(error).__name__
            raise RenderError(f"nothing can be drawn here ({reason}); without a screen, set MUJOCO_GL=egl.") from None

    def _show(self) -> None:
        if self._viewer is None:
            if not _screen():
                raise RenderError("there is no screen for render_mode 'human'; use 'rgb_array'.")
            import mujoco.viewer

            self._viewer = mujoco.viewer.launch_passive(
                self._model, self._data, show_left_ui=False, show_right_ui=False
            )
        if self._viewer.is_running():
            self._viewer.sync()

    def close(self) -> None:
        """Close window and renderer."""
        for item in (self._renderer, self._viewer):
            if item is not None:
                item.close()
        self._renderer = self._viewer = None


def _screen() -> bool:
    """Whether a window can be opened."""
    has_server = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(has_server) or not sys.platform.startswith("linux")
