"""What surrounds every robot: floor, sky, light, and a camera. None of it moves or weighs."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter

from .robot import Robot

FLOOR = "floor"
CAMERA = "track"

_SKY_TOP, _SKY_BOTTOM = (0.62, 0.74, 0.86), (0.95, 0.96, 0.97)
TILE = (0.88, 0.89, 0.90)
_TILE_DARK, _TILE_EDGE = (0.80, 0.82, 0.84), (0.72, 0.74, 0.77)


def add_sun(body: mujoco.MjsBody, reach: float) -> None:
    """Light a body wherever it goes, with a shadow on the floor.

    Args:
        body: to follow.
        reach: rough size of the robot [m].
    """
    body.add_light(
        name="sun",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACK,
        pos=(-0.6 * reach, -1.2 * reach, 2.4 * reach),
        dir=(0.25, 0.5, -1.0),
        diffuse=(0.55, 0.55, 0.53),
        castshadow=True,
    )


def add_scene(spec: mujoco.MjSpec, friction: float = 1.0, tile: float = 0.1, reach: float = 0.5) -> mujoco.MjsGeom:
    """Add sky and a checkered floor at z = 0 whose tiles are a scale to read distances from.

    Args:
        spec: specification to edit.
        friction: sliding friction coefficient of the floor.
        tile: edge of a tile [m].
        reach: rough size of the robot [m]; sets the clipping planes and the shadows.

    Returns:
        The floor's geom.
    """
    spec.visual.headlight.ambient = (0.35, 0.35, 0.35)
    spec.visual.headlight.diffuse = (0.45, 0.45, 0.45)
    spec.visual.headlight.specular = (0.1, 0.1, 0.1)
    spec.visual.quality.shadowsize = 4096
    spec.visual.quality.offsamples = 8
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1080
    spec.visual.rgba.haze = (*_SKY_BOTTOM, 1.0)
    spec.visual.map.znear, spec.visual.map.zfar = 0.02, 60.0
    spec.visual.map.shadowclip = 2.0  # times the extent
    spec.stat.extent, spec.stat.center = reach, (0.0, 0.0, 0.5 * reach)
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=_SKY_TOP,
        rgb2=_SKY_BOTTOM,
        width=256,
        height=1536,
    )
    checker = spec.add_texture(
        name="checker",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        mark=mujoco.mjtMark.mjMARK_EDGE,
        rgb1=TILE,
        rgb2=_TILE_DARK,
        markrgb=_TILE_EDGE,
        width=512,
        height=512,
    )
    material = spec.add_material(name="tiles", texrepeat=(0.5 / tile, 0.5 / tile), texuniform=True, reflectance=0.08)
    textures = list(material.textures)
    textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = checker.name
    material.textures = textures
    return spec.worldbody.add_geom(
        name=FLOOR,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=(0.0, 0.0, 0.05),
        material="tiles",
        friction=(friction, 0.005, 0.0001),
        condim=3,
        contype=1,  # whatever the defaults of a file are
        conaffinity=1,
    )


# --- uneven ground: one height field over the floor, on which each episode starts in a place of its own --------------

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
