"""The hexapod: a body on six pantograph legs, built with the loops of its mechanism closed."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from ...actuators import Chain, DrivenCoordinate, load_chain_set
from ...actuators.gravity import GRAVITY
from ...common.errors import SealegsError
from ..engine.robot import Robot
from ..engine.scene import CAMERA, FLOOR, add_scene, add_sun
from .kinematics import foot_load, leg_angle, link_angles, stance
from .parameters import GOAL_RANGE, LEGS, NUMBERS

SOLIMP = (0.358, 0.527, 0.024, 0.025, 12.0)
"""Impedance at touch and at full depth, that depth [m], and shape."""
EXPONENT = 1.5  # p_K: "chosen to fit with the Hertz's theory"
SUPPORTS = 3  # legs that stand where the penetration is printed


def impedance(depth: np.ndarray | float) -> np.ndarray:
    """Impedance at a penetration [m], as the engine computes it from :data:`SOLIMP`."""
    low, high, width, middle, power = SOLIMP
    x = np.minimum(np.abs(depth) / width, 1.0)
    early = x**power / middle ** (power - 1.0)
    late = 1.0 - (1.0 - x) ** power / (1.0 - middle) ** (power - 1.0)
    return low + (high - low) * np.where(x <= middle, early, late)


def shape(depth: np.ndarray | float) -> np.ndarray:
    """Force at rest over ``S / A``, [m]."""
    reached = impedance(depth)
    return reached**2 * np.asarray(depth) / (SOLIMP[1] ** 2 * (1.0 - reached))


def penetration(values: Mapping[str, float], load: float, weight: float) -> float:
    """How deep a foot stands in the ground under a load [N], by (19) at rest [m].

    Args:
        values: numbers of the robot.
        load: on the foot [N].
        weight: of the robot [N], whose third sinks in by the printed penetration.
    """
    return values["penetration"] * (load * SUPPORTS / weight) ** (1.0 / EXPONENT)


def soften(spec: mujoco.MjSpec, floor: mujoco.MjsGeom, values: Mapping[str, float], foot_body: str) -> None:
    """Give the floor its softness, from the weight of the robot in ``spec`` and the mobility of its feet.

    Paper 001, equations (19) and (20), as the engine's own contact. Hunt and Crossley's normal force is ``K d^1.5`` at
    a penetration ``d`` (Hertz, 4.2.1). At rest the engine's contact pushes with ``S D^2 d / (w^2 (1 - D) A)``. ``D(d)``
    is its impedance between ``D_0`` and ``w``, ``S`` its stiffness, and ``A`` the inverse mass that it assigns to the
    foot. :data:`SOLIMP` is fitted so that this is ``d^1.5`` within 3 % from 0.6 to 4 mm; ``S`` then follows from the
    penetration that the paper prints.
    """
    model = spec.compile()
    depth, mobility = values["penetration"], float(model.body_invweight0[model.body(foot_body).id, 0])
    load = float(model.body_mass.sum()) * GRAVITY / SUPPORTS
    reached = float(impedance(depth))
    stiffness = load * mobility / float(shape(depth))
    damping = values["ground_damping"] * mobility * (1.0 - reached) * SOLIMP[1] / reached
    floor.solref, floor.solimp = (-stiffness, -damping), SOLIMP
    # a foot slips with R f / b, at most slip_speed where friction is whole: the engine's friction rows have D_0
    softness = mobility * (1.0 - SOLIMP[0]) / SOLIMP[0]
    creep = softness * values["floor_friction"] * load * SOLIMP[1] / damping
    spec.option.impratio = max(creep / values["slip_speed"], 1.0)


BODY = "body"
TIMESTEP = 0.001  # [s]; convergence in benchmarks/results/hexapod_open_parameters.md
REACH = 0.9  # [m] rough size, for light and shadows
ROTATION, VERTICAL, HORIZONTAL = KINDS = ("rotation", "vertical", "horizontal")
# Loops carry a leg with less give than an encoder sees; the engine makes them as stiff as the step allows.
LOOP_SOLREF, LOOP_SOLIMP = (0.001, 1.0), (0.9999, 0.9999, 0.001, 0.5, 2.0)
FRICTIONS = {
    "none": "amru5_frictionless",
    "dry/viscous": "amru5_dry",
    "LuGre": "amru5_lugre",
    "dry/viscous 2": "amru5_load",
}
"""Files of ``configs/actuator`` with the four models of joint friction that the paper compares."""
_COMMON = {"ideal": "amru5_ideal", "regression": "amru5_regression", "net": "amru5_net"}
WORDS = {**{name: name for name in FRICTIONS.values()}, **_COMMON}
MASSLESS = 1e-4  # [kg] of the slides: table 10 has none, and their inertia is the armature of their motors

_DARK, _METAL, _BLUE = (0.16, 0.18, 0.22, 1), (0.76, 0.78, 0.81, 1), (0.20, 0.42, 0.68, 1)
_ORANGE, _GREEN, _RUBBER = (0.85, 0.52, 0.22, 1), (0.36, 0.62, 0.42, 1), (0.13, 0.13, 0.14, 1)
_CAPSULE, _CYLINDER = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER
_BOX, _SPHERE = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE
_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE


def coordinate(leg: int, kind: str) -> str:
    """Name of a driven coordinate, and of its joint."""
    return f"leg{leg}_{kind}"


def foot(leg: int) -> str:
    """Geom at the end of a leg."""
    return f"leg{leg}_foot"


def loop_joints(leg: int) -> tuple[str, str, str]:
    """Joints of AC, CF and BD, which follow from the driven ones."""
    return f"leg{leg}_ac", f"leg{leg}_cf", f"leg{leg}_bd"


def build(values: Mapping[str, float]) -> mujoco.MjSpec:
    """The hexapod, standing. ``qpos`` starts with position and quaternion of the body.

    Raises:
        SealegsError: lengths with which the pantograph cannot be put together.
    """
    spec = mujoco.MjSpec()
    spec.modelname = "hexapod"
    spec.compiler.degree = False
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC  # friction of (20) is the same in every direction
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
    floor = add_scene(spec, friction=values["floor_friction"], tile=0.1, reach=REACH)
    floor.priority = 1  # its friction and its softness count, whatever meets it
    body = spec.worldbody.add_body(name=BODY, pos=(0.0, 0.0, values["stance_height"]))
    body.add_freejoint(name="body")
    _set_inertia(body, values, "body", (0.0, 0.0, 0.0))
    add_sun(body, REACH)
    _draw_body(body, values)
    rest = stance(values)
    with np.errstate(invalid="ignore"):  # out of reach is answered below
        angles = link_angles(values, rest.vertical, rest.horizontal)
    if not np.isfinite([float(angle) for angle in angles]).all():
        raise SealegsError("robot 'hexapod': with these lengths its legs cannot reach their stance; change them back.")
    for leg in range(LEGS):
        _leg(spec, body, leg, values, float(angles[0]), float(angles[1]))
    for geom in spec.geoms:  # feet meet the floor, nothing else meets anything
        if geom.name != FLOOR:
            geom.mass, geom.contype = 0.0, 0
            if not geom.name.endswith("_foot"):
                geom.conaffinity = 0
    soften(spec, floor, values, foot_body="leg0_cf")
    spec.worldbody.add_camera(
        name=CAMERA,
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACK,
        pos=(0.0, -1.9, 1.25),
        xyaxes=(1.0, 0.0, 0.0, 0.0, 0.5, 0.9),
        fovy=40.0,
    )
    return spec


def total_mass(values: Mapping[str, float]) -> float:
    """Mass of the robot [kg]."""
    links = sum(values[f"{part}_mass"] for part in ("chassis", "ac", "bd", "de", "cf"))
    return values["body_mass"] + LEGS * (links + 3.0 * values["rotor_mass"])


def _set_inertia(body: mujoco.MjsBody, values: Mapping[str, float], part: str, centre: Sequence[float]) -> None:
    """Mass and inertia of table 10, with the centre of mass at ``centre`` [m]."""
    body.mass, body.ipos, body.explicitinertial = values[f"{part}_mass"], centre, True
    body.inertia = tuple(values[f"{part}_inertia_{axis}"] for axis in "xyz")


def _leg(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, leg: int, values: Mapping[str, float], rise: float, bend: float
) -> None:
    """One leg at its stance, where AC rises by ``rise`` (p_0) and ``bend`` (p_1) is the angle at B [rad].

    DE moves parallel to AC between D and a point of CF. Its mass rides at its two ends, which has its centre, and what
    two points have too much of its inertia is taken from AC, which turns with it: the motion is that of the whole link.
    """
    ratio, ab, bd, centre = values["ratio"], values["ab_length"], values["bd_length"], values["link_centre"]
    rest, angle = stance(values), leg_angle(leg)
    ac, cf, fold = ratio * ab, ratio * bd, np.pi - bend
    joints = loop_joints(leg)
    radius = values["leg_radius"]
    chassis = body.add_body(
        name=f"leg{leg}_chassis",
        pos=(radius * np.cos(angle), radius * np.sin(angle), 0.0),
        quat=_about((0.0, 0.0, 1.0), angle),
    )
    turn = chassis.add_joint(name=coordinate(leg, ROTATION), type=_HINGE, axis=(0.0, 0.0, -1.0))  # equation (11)
    turn.armature = values["rotor_inertia"] * values["rotation_gear"] ** 2
    _set_inertia(chassis, values, "chassis", (values["chassis_forward"], 0.0, 0.0))
    chassis.mass += 3.0 * values["rotor_mass"]
    _draw_chassis(chassis, values)
    height = float(rest.vertical)
    rotor = values["rotor_inertia"] * values["screw_gear"] ** 2
    slide_a = _slide(chassis, f"leg{leg}_a", coordinate(leg, VERTICAL), (0.0, 0.0, 1.0), height, rotor)
    link_ac = slide_a.add_body(name=joints[0], quat=_about((0.0, -1.0, 0.0), rise))
    link_ac.add_joint(name=joints[0], type=_HINGE, axis=(0.0, -1.0, 0.0), ref=rise)
    de_length, de_mass = (ratio - 1.0) * ab, values["de_mass"]
    _set_inertia(link_ac, values, "ac", (centre * ac, 0.0, 0.0))
    excess = de_mass * centre * (1.0 - centre) * de_length**2
    own = [values[f"ac_inertia_{axis}"] + values[f"de_inertia_{axis}"] for axis in "xyz"]
    link_ac.inertia = (own[0], own[1] - excess, own[2] - excess)
    if min(link_ac.inertia) <= 0.0:
        raise SealegsError("robot 'hexapod': its link DE is too heavy or too long for its inertia; change it back.")
    link_cf = link_ac.add_body(name=joints[1], pos=(ac, 0.0, 0.0), quat=_about((0.0, 1.0, 0.0), fold))
    link_cf.add_joint(name=joints[1], type=_HINGE, axis=(0.0, 1.0, 0.0), ref=fold)
    _set_inertia(link_cf, values, "cf", (centre * cf, 0.0, 0.0))
    _add_point(link_cf, centre * de_mass, bd)  # E
    link_bd = link_ac.add_body(name=joints[2], pos=(ab, 0.0, 0.0), quat=_about((0.0, 1.0, 0.0), fold))
    link_bd.add_joint(name=joints[2], type=_HINGE, axis=(0.0, 1.0, 0.0), ref=fold)
    _set_inertia(link_bd, values, "bd", (centre * bd, 0.0, 0.0))
    slide_d = _slide(
        chassis, f"leg{leg}_d", coordinate(leg, HORIZONTAL), (1.0, 0.0, 0.0), float(rest.horizontal), rotor
    )
    slide_d.mass += (1.0 - centre) * de_mass
    link_bd.add_site(name=f"leg{leg}_bd_end", pos=(bd, 0.0, 0.0), rgba=(0, 0, 0, 0))
    slide_d.add_site(name=f"leg{leg}_d", rgba=(0, 0, 0, 0))
    _close(spec, mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_SITE, f"leg{leg}_bd_end", f"leg{leg}_d")
    parallel = _close(spec, mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT, joints[1], joints[2])
    parallel.data[:5] = (0.0, 1.0, 0.0, 0.0, 0.0)
    colour = _ORANGE if leg == 0 else _BLUE
    for link, length, width, tint in (
        (link_ac, ac, 0.009, _METAL),
        (link_cf, cf, 0.011, colour),
        (link_bd, bd, 0.007, _METAL),
    ):
        link.add_geom(type=_CAPSULE, fromto=(0.0, 0.0, 0.0, length, 0.0, 0.0), size=(width, 0.0, 0.0), rgba=tint)
    link_cf.add_geom(
        name=foot(leg), type=_SPHERE, pos=(cf, 0.0, 0.0), size=(values["foot_radius"], 0.0, 0.0), rgba=_RUBBER
    )
    for slide in (slide_a, slide_d):
        slide.add_geom(type=_BOX, size=(0.012, 0.016, 0.012), rgba=_DARK)


def _slide(
    parent: mujoco.MjsBody, name: str, joint: str, axis: tuple[float, float, float], position: float, rotor: float
) -> mujoco.MjsBody:
    """A nut on a screw, ``position`` from the parent's origin [m], with the ``rotor`` that turns it [kg]."""
    body = parent.add_body(name=name, pos=tuple(position * part for part in axis), mass=MASSLESS, ipos=(0.0, 0.0, 0.0))
    body.inertia, body.explicitinertial = (1e-7, 1e-7, 1e-7), True
    body.add_joint(name=joint, type=_SLIDE, axis=axis, ref=position, armature=rotor)
    return body


def _close(spec: mujoco.MjSpec, kind: mujoco.mjtEq, what: mujoco.mjtObj, first: str, second: str) -> mujoco.MjsEquality:
    """A constraint that closes a loop of the mechanism."""
    return spec.add_equality(type=kind, objtype=what, name1=first, name2=second, solref=LOOP_SOLREF, solimp=LOOP_SOLIMP)


def _add_point(body: mujoco.MjsBody, mass: float, at: float) -> None:
    """Add a point mass [kg] at ``at`` along a link [m]."""
    centre, total = float(body.ipos[0]), float(body.mass) + mass
    moved = (float(body.mass) * centre + mass * at) / total
    extra = float(body.mass) * (moved - centre) ** 2 + mass * (moved - at) ** 2
    body.inertia = (body.inertia[0], body.inertia[1] + extra, body.inertia[2] + extra)
    body.mass, body.ipos = total, (moved, 0.0, 0.0)


def _about(axis: tuple[float, float, float], angle: float) -> tuple[float, float, float, float]:
    """Quaternion of a turn by ``angle`` [rad]."""
    x, y, z = (float(part * np.sin(angle / 2.0)) for part in axis)
    return float(np.cos(angle / 2.0)), x, y, z


def _draw_body(body: mujoco.MjsBody, values: Mapping[str, float]) -> None:
    radius = values["leg_radius"]
    body.add_geom(type=_CYLINDER, pos=(0.0, 0.0, 0.03), size=(radius, 0.045, 0.0), rgba=_DARK)
    body.add_geom(type=_CYLINDER, pos=(0.0, 0.0, 0.08), size=(0.7 * radius, 0.012, 0.0), rgba=_METAL)
    body.add_geom(type=_BOX, pos=(0.6 * radius, 0.0, 0.095), size=(0.03, 0.012, 0.008), rgba=_ORANGE)  # the front


def _draw_chassis(chassis: mujoco.MjsBody, values: Mapping[str, float]) -> None:
    top = 2.0 * float(stance(values).vertical)
    chassis.add_geom(type=_BOX, pos=(-0.012, 0.035, 0.5 * top), size=(0.02, 0.012, 0.5 * top + 0.03), rgba=_DARK)
    chassis.add_geom(type=_BOX, pos=(0.03, 0.035, 0.0), size=(0.06, 0.012, 0.014), rgba=_DARK)
    for start, end in (((0.0, 0.0, -0.01), (0.0, 0.0, top + 0.02)), ((0.0, 0.0, 0.0), (0.09, 0.0, 0.0))):  # the screws
        chassis.add_geom(type=_CYLINDER, fromto=(*start, *end), size=(0.005, 0.0, 0.0), rgba=_METAL)
    chassis.add_geom(
        type=_CYLINDER, fromto=(0.0, 0.035, top + 0.03, 0.0, 0.035, top + 0.08), size=(0.0175, 0.0, 0.0), rgba=_GREEN
    )


def goal_limits(values: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Goals reach equally far to both sides of the stance ([rad], and [m] for the screws)."""
    rest = stance(values)._asdict()
    return {
        coordinate(leg, kind): (float(rest[kind]) - GOAL_RANGE[kind], float(rest[kind]) + GOAL_RANGE[kind])
        for leg, kind in itertools.product(range(LEGS), KINDS)
    }


def _coordinates() -> tuple[DrivenCoordinate, ...]:
    """Rotation, vertical and horizontal joint of each leg; what the foot carries bends the horizontal screw (5.3)."""
    factor = foot_load({name: number.value for name, number in NUMBERS.items()})
    return tuple(
        DrivenCoordinate(
            coordinate(leg, kind),
            ((coordinate(leg, kind), 1.0),),
            pressed_by=(coordinate(leg, VERTICAL), factor) if kind == HORIZONTAL else None,
        )
        for leg, kind in itertools.product(range(LEGS), KINDS)
    )


def chains_of(file: str) -> dict[str, Chain]:
    """The chains of a file of ``configs/actuator`` by coordinate.

    Raises:
        SealegsError: the file lacks one.
    """
    kinds = load_chain_set(file) or {}
    if set(kinds) != {f"*_{kind}" for kind in KINDS}:
        raise SealegsError(f"the actuator '{file}' needs the keys {', '.join(f'*_{kind}' for kind in KINDS)}.")
    return {coordinate(leg, kind): kinds[f"*_{kind}"] for leg, kind in itertools.product(range(LEGS), KINDS)}


HEXAPOD = Robot(
    name="hexapod",
    numbers=NUMBERS,
    coordinates=_coordinates(),
    goal_limits=goal_limits,
    chains={item.name: "amru5_lugre" for item in _coordinates()},
    build=build,
    words={word: chains_of(file) for word, file in WORDS.items()},
)
