"""Uneven ground: one height field over the floor, on which each episode starts in a place of its own.

The engine shares a height field among all simulations. So it is rougher the further one goes along y, and its steps are
higher the further one goes along x, and an episode starts where both are as high as it drew.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter

from .robot import Robot
from .scene import FLOOR

TERRAIN = "terrain"
CELLS = 12  # of the field in a robot's length; assumed
LENGTHS = 80  # of the robot in the field's side: room for a walk of half a minute; assumed
STARTS = 0.25  # of the side, in which episodes start
WAVES = 0.25  # robot's lengths of the smoothing of rough ground; assumed
BELOW = 1e-3  # [m] of the floor under the field, which touches nothing where the field is level
SEED = 0


@dataclass(frozen=True)
class Terrain:
    """A field and where on it episodes start.

    Attributes:
        length: of the robot [m].
        spans: lowest and highest value that is drawn, by ``rough`` and ``steps`` [m].
        heights: of the field, square, rows along y and columns along x [m].
        tops: the highest of it under a robot in each place [m].
    """

    length: float
    spans: Mapping[str, tuple[float, float]]
    heights: np.ndarray
    tops: np.ndarray

    @classmethod
    def under(cls, model: mujoco.MjModel, spans: Mapping[str, tuple[float, float]]) -> Terrain:
        """A field for the robot of a model, from the spans of ``rough`` and ``steps`` [m]."""
        length = _length(model)
        count = LENGTHS * CELLS
        random = np.random.default_rng(SEED)
        along = np.clip(((np.arange(count) + 0.5) / count - 0.5) / STARTS + 0.5, 0.0, 1.0)
        heights = np.zeros((count, count))
        if "rough" in spans:
            waves = gaussian_filter(random.standard_normal((count, count)), WAVES * CELLS)
            low, high = np.quantile(waves, (0.05, 0.95))
            heights += np.clip((waves - low) / (high - low), 0.0, 1.0) * _between(spans["rough"], along)[:, None]
        if "steps" in spans:
            blocks = random.random((LENGTHS, LENGTHS)).repeat(CELLS, axis=0).repeat(CELLS, axis=1)
            heights += blocks * _between(spans["steps"], along)[None]
        edge = np.minimum(np.arange(count), np.arange(count)[::-1]) / CELLS
        heights *= np.clip(np.minimum(edge[:, None], edge[None]), 0.0, 1.0)  # level with the floor at the border
        return cls(length, dict(spans), heights, maximum_filter(heights, CELLS + 1))

    @property
    def side(self) -> float:
        """Length of a side of the field [m]."""
        return LENGTHS * self.length

    def on(self, robot: Robot) -> Robot:
        """The robot with the field over its floor."""

        def build(values: Mapping[str, float]) -> mujoco.MjSpec:
            spec = robot.build(values)
            floor, count = spec.geom(FLOOR), len(self.heights)
            top, half = max(float(self.heights.max()), BELOW), 0.5 * self.side
            spec.add_hfield(
                name=TERRAIN, nrow=count, ncol=count, size=(half, half, top, BELOW), userdata=self.heights.ravel()
            )
            spec.worldbody.add_geom(
                name=TERRAIN,
                type=mujoco.mjtGeom.mjGEOM_HFIELD,
                hfieldname=TERRAIN,
                material=floor.material,
                rgba=floor.rgba,
                friction=floor.friction,
                condim=floor.condim,
                contype=floor.contype,
                conaffinity=floor.conaffinity,
                solref=floor.solref,
                solimp=floor.solimp,
                margin=floor.margin,
                priority=floor.priority,
            )
            # the tree of boxes around the world's shapes is the compiled one, and a slope turns the field out of it
            spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE
            floor.pos = floor.pos - np.array([0.0, 0.0, BELOW])
            return spec

        return dataclasses.replace(robot, build=build)

    def starts(self, drawn: Mapping[str, np.ndarray], random: np.ndarray) -> np.ndarray:
        """Places where episodes start (m, 3) [m]: x, y, and what the robot has to stand higher by.

        Args:
            drawn: values of ``rough`` and ``steps``, (m,) each [m], those that the field has.
            random: uniform numbers in [0, 1), (m, 2), for an axis along which nothing changes.
        """
        shares = random.copy()
        for column, name in ((0, "steps"), (1, "rough")):
            low, high = self.spans.get(name, (0.0, 0.0))
            if high > low:
                shares[:, column] = (drawn[name] - low) / (high - low)
        places = (shares - 0.5) * STARTS * self.side
        cells = np.clip(((places / self.side + 0.5) * len(self.heights)).astype(int), 0, len(self.heights) - 1)
        return np.column_stack([places, self.tops[cells[:, 1], cells[:, 0]]])


def floors(model: mujoco.MjModel) -> list[int]:
    """Geoms of the floor and of the field over it."""
    return [number for number in range(model.ngeom) if model.geom(number).name in (FLOOR, TERRAIN)]


def _between(span: tuple[float, float], share: np.ndarray) -> np.ndarray:
    low, high = span
    return low + (high - low) * share


def _length(model: mujoco.MjModel) -> float:
    """Longest horizontal extent of the robot as its model has it [m]."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    own = np.flatnonzero(model.geom_bodyid > 0)
    reach = model.geom_rbound[own, None]
    ends = data.geom_xpos[own, :2]
    return float(((ends + reach).max(axis=0) - (ends - reach).min(axis=0)).max())
