"""The machine SILO4: a body on four legs of paper 000, each with the printed links, motors, gears and friction.

The paper analyses one leg and prints nothing of the body. Its size, mass and place of the legs are assumed, after what
is known of the machine elsewhere: about 30 kg on a square body, two legs at each side that point outwards.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from ...actuators import Chain, DrivenCoordinate
from ...envs.engine.numbers import Number
from ...envs.engine.robot import Robot
from ...envs.engine.scene import CAMERA, FLOOR, add_scene, add_sun
from ...envs.leg import parameters
from ...envs.leg.kinematics import angles, foot
from ...envs.leg.parameters import LIMITS, STANCE
from ...envs.leg.robot import FOOT, JOINTS, TIMESTEP, WORDS, chains_of, mount_leg

BODY = "body"
LEGS = ("left_hind", "left_front", "right_hind", "right_front")
"""In the order in which the wave gait puts them forward."""
SIDE = {leg: 1.0 if leg.startswith("left") else -1.0 for leg in LEGS}
END = {leg: 1.0 if leg.endswith("front") else -1.0 for leg in LEGS}
REACH = 0.9  # [m] rough size, for light and shadows
PERIOD = 0.01  # [s] between references

NUMBERS: dict[str, Number] = {
    **{name: number for name, number in parameters.NUMBERS.items() if name != "base_height"},
    "body_mass": Number(17.5, "kg", "assumed: with four legs of 3.11 kg about the 30 kg of the machine", 1e-3),
    "body_length": Number(0.31, "m", "assumed: edge of the body along its way, between the first joints", 0.01),
    "body_width": Number(0.31, "m", "assumed: likewise across", 0.01),
    "body_height": Number(0.14, "m", "assumed: of the box, for its inertia", 0.01),
    "floor_friction": Number(0.8, "-", "assumed", 0.0, 10.0),
}

_DARK, _METAL = (0.16, 0.18, 0.22, 1), (0.76, 0.78, 0.81, 1)


def coordinate(leg: str, joint: str) -> str:
    """Name of a joint of the machine, such as ``left_front_joint_2``."""
    return f"{leg}_{joint}"


def root(values: Mapping[str, float], leg: str) -> np.ndarray:
    """First joint of a leg in the body (3,) [m]."""
    return np.array([0.5 * END[leg] * values["body_length"], 0.5 * SIDE[leg] * values["body_width"], 0.0])


def standing_height(values: Mapping[str, float]) -> float:
    """Of the first joints over the floor in the stance [m]."""
    return values["foot_radius"] - float(foot(values, np.array(STANCE))[2])


def build(values: Mapping[str, float]) -> mujoco.MjSpec:
    """The machine over the floor; ``qpos`` holds place and attitude of the body, then the joints leg by leg."""
    spec = mujoco.MjSpec()
    spec.modelname = "silo4"
    spec.compiler.degree = False
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    floor = add_scene(spec, values["floor_friction"], tile=0.1, reach=REACH)
    length, width, height = (values[f"body_{name}"] for name in ("length", "width", "height"))
    body = spec.worldbody.add_body(name=BODY, pos=(0.0, 0.0, standing_height(values)))
    body.add_freejoint(name=BODY)
    add_sun(body, REACH)
    mass = values["body_mass"]
    body.mass, body.explicitinertial, body.ipos = mass, True, (0.0, 0.0, 0.5 * height)
    body.inertia = tuple(mass / 12.0 * (a * a + b * b) for a, b in ((width, height), (length, height), (length, width)))
    box = (0.5 * length - 0.03, 0.5 * width - 0.03, 0.5 * height)
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=(0.0, 0.0, 0.5 * height), size=box, rgba=_METAL)
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, pos=(0.5 * length, 0.0, 0.5 * height), size=(0.02, 0.06, 0.03), rgba=_DARK
    )
    for leg in LEGS:
        x, y, z = (float(value) for value in root(values, leg))
        mount_leg(body, values, f"{leg}_", (x, y, z), 0.5 * np.pi * SIDE[leg])
    feet = {f"{leg}_{FOOT}" for leg in LEGS}
    for geom in spec.geoms:
        if geom.name != floor.name:
            geom.mass = 0.0
            if geom.name not in feet:
                geom.contype = geom.conaffinity = 0
    body.add_camera(
        name=CAMERA, mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACK, pos=(0.5, -1.5, 0.75),
        xyaxes=(1.0, 0.33, 0.0, -0.15, 0.45, 1.0), fovy=40.0,
    )  # fmt: skip
    return spec


def goal_limits(values: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Lowest and highest goal of each joint [rad]."""
    del values
    return {coordinate(leg, joint): LIMITS[joint] for leg in LEGS for joint in JOINTS}


def machine_chains(file: str) -> dict[str, Chain]:
    """The chains of a file of ``configs/actuator`` for the joints of one leg, on all four."""
    found = chains_of(file)
    return {coordinate(leg, joint): found[joint] for leg in LEGS for joint in JOINTS}


_NAMES = tuple(coordinate(leg, joint) for leg in LEGS for joint in JOINTS)

SILO4 = Robot(
    name="silo4",
    numbers=NUMBERS,
    coordinates=tuple(DrivenCoordinate.of_joint(name) for name in _NAMES),
    goal_limits=goal_limits,
    chains=machine_chains("silo4"),
    build=build,
    words={word: machine_chains(file) for word, file in WORDS.items()},
    start={coordinate(leg, joint): angle for leg in LEGS for joint, angle in zip(JOINTS, STANCE, strict=True)},
)


@dataclass(frozen=True)
class Wave:
    """The reference gait: one leg after the other, hind before front, each foot on the floor for most of the cycle.

    All of it is assumed; the paper moves single legs.

    Attributes:
        speed: of the body [m/s].
        stride: way of a foot on the floor, under the body [m].
        duty: share of the cycle in which a foot is on the floor; a wave gait is stable at rest from 3/4 on.
        lift: of a foot [m].
        settle: time before the first leg lifts off [s].
    """

    speed: float = 0.03
    stride: float = 0.14
    duty: float = 0.9
    lift: float = 0.05
    settle: float = 1.0

    @property
    def cycle(self) -> float:
        """Time of a step cycle [s]."""
        return self.stride / (self.speed * self.duty)

    def phase(self, leg: str, time: np.ndarray | float) -> np.ndarray:
        """Share of the cycle since a leg last lifted off."""
        late = {"left_hind": 0.0, "left_front": 1.0 - self.duty, "right_hind": 0.5, "right_front": 1.5 - self.duty}[leg]
        walked = np.maximum(np.asarray(time, float) - self.settle, 0.0) / self.cycle
        return np.mod(walked - late, 1.0)

    def foot(self, leg: str, time: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """Way of a foot ahead of its stance, and its height over the floor [m]."""
        phase, air = self.phase(leg, time), 1.0 - self.duty
        s = np.clip(phase / air, 0.0, 1.0)
        slope = -air / self.duty  # a foot leaves and meets the floor with the floor's speed
        ahead = -0.5 + slope * s + (1.0 - slope) * s**2 * (3.0 - 2.0 * s)
        standing = 0.5 - (phase - air) / self.duty
        moving = phase < air
        rise = 0.5 * self.lift * (1.0 - np.cos(2.0 * np.pi * s))
        return self.stride * np.where(moving, ahead, standing), np.where(moving, rise, 0.0)

    def goals(self, values: Mapping[str, float], time: np.ndarray | float) -> np.ndarray:
        """References of all joints (..., 12) [rad] in the robot's order; the first second brings the feet apart."""
        stance = foot(values, np.array(STANCE))
        columns = []
        for leg in LEGS:
            ahead, height = self.foot(leg, time)
            x = np.broadcast_to(stance[0], np.shape(ahead))
            # a leg that points to the left has its own y backwards, one to the right forwards
            point = np.stack([x, -SIDE[leg] * ahead, stance[2] + height], axis=-1)
            columns.append(angles(values, point))
        return np.concatenate(columns, axis=-1)


def margin(gait: Wave, values: Mapping[str, float], time: float, centre: np.ndarray | None = None) -> float:
    """How far the centre of mass lies inside the feet that stand [m]; negative outside.

    Args:
        gait: that moves the feet.
        values: numbers of the machine.
        time: [s].
        centre: of mass in the body (2,) [m]; None: its middle.
    """
    stance = float(foot(values, np.array(STANCE))[0])
    points = []
    for leg in LEGS:
        ahead, _ = gait.foot(leg, time)
        if float(gait.phase(leg, time)) >= 1.0 - gait.duty:
            x, y, _ = root(values, leg)
            points.append((x + float(ahead), y + SIDE[leg] * stance))
    corners = np.array(points) - (np.zeros(2) if centre is None else centre)
    order = np.argsort(np.arctan2(*(corners - corners.mean(axis=0)).T[::-1]))
    corners = corners[order]
    edges = np.roll(corners, -1, axis=0) - corners
    outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
    return float((outward * corners).sum(axis=1).min())


@dataclass(frozen=True)
class Walk:
    """A recording of the machine, every 10 ms.

    Attributes:
        time: (n,) [s].
        place: of the body (n, 3) [m].
        tilt: of the body from upright (n,) [rad].
        feet: heights of the soles over the floor (n, 4) [m].
        error: largest of goal minus angle over the joints (n,) [rad].
    """

    time: np.ndarray
    place: np.ndarray
    tilt: np.ndarray
    feet: np.ndarray
    error: np.ndarray


def walk(gait: Wave, seconds: float, params: Mapping[str, float] | None = None, actuator: str | None = None) -> Walk:
    """Walk from the stance.

    Args:
        gait: reference; a ``settle`` longer than ``seconds`` stands.
        seconds: simulated [s].
        params: numbers of the machine other than its own.
        actuator: word of :data:`SILO4`; None: the printed chains.

    Raises:
        SealegsError: an unknown number or word.
    """
    values = SILO4.parameters(params)
    drivetrain = SILO4.drivetrain(actuator, params)
    model, data = drivetrain.model, mujoco.MjData(drivetrain.model)
    count, steps = round(seconds / PERIOD), round(PERIOD / model.opt.timestep)
    goals = gait.goals(values, PERIOD * np.arange(count + 1))
    for name, goal in zip(_NAMES, goals[0], strict=True):
        drivetrain.set_position(name, data.qpos, goal)
    soles = [model.geom(f"{leg}_{FOOT}").id for leg in LEGS]
    addresses = [int(model.joint(name).qposadr[0]) for name in _NAMES]
    rows = np.empty((count, 10))
    for k in range(count):
        data.ctrl[:] = goals[k]
        mujoco.mj_step(model, data, steps)
        upright = data.body(BODY).xmat[8]
        rows[k, :5] = data.time, *data.qpos[:3], np.arccos(min(float(upright), 1.0))
        rows[k, 5:9] = data.geom_xpos[soles, 2] - values["foot_radius"]
        rows[k, 9] = np.abs(goals[k] - data.qpos[addresses]).max()
    return Walk(rows[:, 0], rows[:, 1:4], rows[:, 4], rows[:, 5:9], rows[:, 9])


__all__ = [
    "BODY",
    "FLOOR",
    "LEGS",
    "NUMBERS",
    "SILO4",
    "Walk",
    "Wave",
    "build",
    "coordinate",
    "margin",
    "standing_height",
    "walk",
]
