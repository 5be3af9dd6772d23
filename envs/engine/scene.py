"""What surrounds every robot: floor, sky, light, and a camera. None of it moves or weighs."""

from __future__ import annotations

import mujoco

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
