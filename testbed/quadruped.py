"""An independent walking robot that hides effects in its ground: one rigid body on four legs that are moved.

Own equations of motion of a rigid body, semi-implicit steps at 20 kHz, legs without mass whose joints follow a gait,
ground as a spring and damper with a tangential spring that slips at the friction limit. Shares no code with sealegs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
from scipy.spatial.transform import Rotation

from .bench import nominal_chain
from .recording import Recording

STEP = 5e-5  # [s]
SAMPLE_PERIOD = 0.005  # [s]
TICK = 2.0 * math.pi / 4096
ENCODER_NOISE = 3.9e-4  # [rad]
POSITION_NOISE, TURN_NOISE = 3e-4, 1e-3  # [m], [rad] of the camera
MASS, INERTIA = 2.0, (0.012, 0.02, 0.028)  # [kg], [kg.m2]
HIPS = ((0.13, 0.1), (0.13, -0.1), (-0.13, 0.1), (-0.13, -0.1))  # [m]
LEGS = ("front_left", "front_right", "rear_left", "rear_right")
UPPER, LOWER, FOOT = 0.1, 0.1, 0.012  # [m]
LIGHT = 1e-4  # [kg] of a leg's bodies in the model file: the plant's have none
AFTER, STANCE = (0.0, 0.5, 0.75, 0.25), 0.8  # of a stride: when each leg steps, and how long it stands
JOINTS = tuple(f"{leg}_{part}" for leg in LEGS for part in ("hip", "knee"))
GROUND_EFFECTS = {
    "contact.friction": {"clear": 0.3, "moderate": 0.5},
    "contact.stiffness": {"clear": 900.0, "moderate": 1800.0},
    "contact.slope": {"clear": 0.08, "moderate": 0.03},
}
"""What can be hidden: friction [1], stiffness under a foot [N/m], rise along x [rad]."""
STRANGERS = {"wind": {"clear": 3.0, "moderate": 1.5}}
"""What no catalogue has: a force on the body across its way [N] that comes and goes."""


class Floor(NamedTuple):
    """The ground: friction, stiffness [N/m] and damping [N.s/m] under a foot, and along the surface, slope [rad]
    (positive: rising along x), and the largest force of the wind [N].
    """

    friction: float = 0.9
    stiffness: float = 40_000.0
    damping: float = 300.0
    shear_stiffness: float = 40_000.0
    shear_damping: float = 200.0
    slope: float = 0.0
    wind: float = 0.0


MODEL = """<mujoco model="walker">
  <compiler angle="radian"/>
  <option timestep="0.001"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 0.05" friction="0.9 0.005 0.0001" solref="0.011 1"/>
    <body name="trunk" pos="0 0 0.2">
      <freejoint name="trunk"/>
      <inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia}"/>
      <geom type="box" size="0.15 0.08 0.03" contype="0" conaffinity="0"/>
{legs}
    </body>
  </worldbody>
</mujoco>
"""
LEG = """      <body name="{leg}_upper" pos="{x} {y} 0">
        <joint name="{leg}_hip" axis="0 1 0" range="-1.5 1.5"/>
        <inertial pos="0 0 -{half}" mass="{light}" diaginertia="1e-6 1e-6 1e-6"/>
        <body name="{leg}_lower" pos="0 0 -{upper}">
          <joint name="{leg}_knee" axis="0 1 0" range="-0.2 2.4"/>
          <inertial pos="0 0 -{half}" mass="{light}" diaginertia="1e-6 1e-6 1e-6"/>
          <geom name="{leg}_foot" type="sphere" pos="0 0 -{lower}" size="{foot}" friction="0.9 0.005 0.0001"
                solref="0.011 1"/>
        </body>
      </body>"""


def model_file(folder: Path) -> Path:
    """Write the walker's MJCF, as its maker believes it to be."""
    folder.mkdir(parents=True, exist_ok=True)
    legs = [
        LEG.format(leg=leg, x=x, y=y, half=UPPER / 2, upper=UPPER, lower=LOWER, foot=FOOT, light=LIGHT)
        for leg, (x, y) in zip(LEGS, HIPS, strict=True)
    ]
    inertia = " ".join(f"{value:g}" for value in INERTIA)
    path = folder / "walker.xml"
    path.write_text(MODEL.format(mass=MASS, inertia=inertia, legs="\n".join(legs)), encoding="utf-8")
    return path


@numba.njit(cache=True)
def _turn(q: np.ndarray) -> np.ndarray:
    """Matrix of a quaternion, w first."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@numba.njit(cache=True)
def walk(
    friction: float, stiffness: float, damping: float, shear: float, shear_damping: float, slope: float,
    feet: np.ndarray, moving: np.ndarray, force: np.ndarray, mass: float, inertia: np.ndarray, radius: float,
    start: np.ndarray, every: int,
) -> np.ndarray:  # fmt: skip
    """Positions and quaternions of the body, and what presses on each foot [N] (samples, 11).

    ``feet`` and ``moving`` are places and speeds of the feet in the body's frame (steps, 4, 3), ``force`` what pushes
    the body along y (steps,).
    """
    steps = len(feet)
    place, turned = start.copy(), np.array([1.0, 0.0, 0.0, 0.0])
    speed, spin = np.zeros(3), np.zeros(3)
    normal = np.array([-np.sin(slope), 0.0, np.cos(slope)])
    held, touching = np.zeros((4, 3)), np.zeros(4)
    out, pressed = np.empty((steps // every + 1, 11)), np.zeros(4)
    rows = 0
    for k in range(steps):
        if k % every == 0:
            out[rows, :3], out[rows, 3:7], out[rows, 7:] = place, turned, pressed
            rows += 1
        matrix = _turn(turned)
        total, torque = np.array([0.0, force[k], -mass * 9.81]), np.zeros(3)
        for leg in range(4):
            arm = matrix @ feet[k, leg] - radius * normal
            point = place + arm
            rate = speed + matrix @ moving[k, leg] + np.cross(matrix @ spin, arm)
            depth = -(point @ normal)
            if depth <= 0.0:
                touching[leg], pressed[leg] = 0.0, 0.0
                continue
            push = max(stiffness * depth - damping * (rate @ normal), 0.0)
            along = point + depth * normal
            if touching[leg] == 0.0:
                held[leg], touching[leg] = along, 1.0
            slide = rate - (rate @ normal) * normal
            stretch = along - held[leg]
            pull = -shear * stretch - shear_damping * slide
            size, most = np.sqrt(pull @ pull), friction * push
            if size > most:
                pull = pull * (most / size)
                held[leg] = along + (pull + shear_damping * slide) / shear
            pushed = push * normal + pull
            pressed[leg] = np.sqrt(pushed @ pushed)
            total += pushed
            torque += np.cross(arm, pushed)
        own = matrix.T @ torque
        spin = spin + STEP * (own - np.cross(spin, inertia * spin)) / inertia
        speed = speed + STEP * total / mass
        place = place + STEP * speed
        w, x, y, z = turned
        a, b, c = spin
        change = [-x * a - y * b - z * c, w * a + y * c - z * b, w * b - x * c + z * a, w * c + x * b - y * a]
        turned = turned + 0.5 * STEP * np.array(change)
        turned = turned / np.sqrt(turned @ turned)
    return out[:rows]


def gait(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Angles of all joints (n, 8) [rad]: a walk, one leg after the other, whose stride, lift, rate and turn change."""
    angles = np.empty((len(time), 8))
    edges = np.arange(0.0, time[-1] + 3.0, 3.0)
    stride, turn = rng.uniform(0.1, 0.35, len(edges)), rng.uniform(-0.15, 0.15, len(edges))
    lift, rate = rng.uniform(0.3, 0.5, len(edges)), rng.uniform(0.8, 1.6, len(edges))
    smooth = [np.interp(time, edges, values) for values in (stride, turn, lift, rate)]
    phase = np.cumsum(smooth[3]) * (time[1] - time[0])
    begin = np.clip(time / 0.8, 0.0, 1.0)
    for k, (_, side) in enumerate(HIPS):
        at = (phase + AFTER[k]) % 1.0
        swing = np.clip((at - STANCE) / (1.0 - STANCE), 0.0, 1.0)
        back = np.where(at < STANCE, 1.0 - 2.0 * at / STANCE, -np.cos(np.pi * swing))
        raised = begin * smooth[2] * np.sin(np.pi * swing) ** 2
        angles[:, 2 * k] = -0.5 - begin * (smooth[0] - np.sign(side) * smooth[1]) * back - 0.5 * raised
        angles[:, 2 * k + 1] = 1.0 + raised
    return angles


def _feet(angles: np.ndarray) -> np.ndarray:
    """Places of the feet in the body's frame (n, 4, 3) [m]."""
    out = np.empty((len(angles), 4, 3))
    for leg, (x, y) in enumerate(HIPS):
        hip, knee = angles[:, 2 * leg], angles[:, 2 * leg] + angles[:, 2 * leg + 1]
        out[:, leg, 0] = x - UPPER * np.sin(hip) - LOWER * np.sin(knee)
        out[:, leg, 1] = y
        out[:, leg, 2] = -UPPER * np.cos(hip) - LOWER * np.cos(knee)
    return out


def record_walker(
    effects: Mapping[str, float | str],
    seed: int,
    folder: Path,
    *,
    duration: float = 8.0,
    runs: int = 3,
    imu: BoughtImu | None = None,
) -> tuple[list[Recording], dict[str, Any]]:
    """Runs of a walker whose ground is not what its model file says; effects by magnitude or value.

    Args:
        effects: of :data:`GROUND_EFFECTS` and :data:`STRANGERS`.
        seed: of everything drawn.
        folder: where its model file goes.
        duration: of a run [s].
        runs: how many.
        imu: on the body; None: a camera sees it instead.
    """
    sizes = {
        name: ({**GROUND_EFFECTS, **STRANGERS}[name][value] if isinstance(value, str) else float(value))
        for name, value in effects.items()
    }
    fields = {name.rpartition(".")[2]: value for name, value in sizes.items()}
    rng = np.random.default_rng(seed)
    floor = Floor()._replace(**fields)
    path = model_file(folder)
    every = round(SAMPLE_PERIOD / STEP)
    recordings = []
    for k in range(runs):
        fine = np.arange(round(duration / STEP)) * STEP
        goals = gait(fine, rng)
        angles = np.empty_like(goals)
        lagging = goals[0].copy()
        share = 1.0 - math.exp(-STEP / 0.02)
        for row in range(len(fine)):
            lagging += share * (goals[row] - lagging)
            angles[row] = lagging
        feet = _feet(angles)
        start = np.array([0.0, 0.0, FOOT + float(-feet[0, :, 2].min())])
        force = floor.wind * np.clip(np.sin(2.0 * np.pi * (0.4 * fine + rng.uniform())), 0.0, None)
        path_of_body = walk(
            floor.friction, floor.stiffness, floor.damping, floor.shear_stiffness, floor.shear_damping, floor.slope,
            feet, np.gradient(feet, STEP, axis=0), force, MASS, np.array(INERTIA), FOOT, start, every,
        )  # fmt: skip
        recordings.append(
            _log(f"walk-{k}", fine[::every], goals[::every], angles[::every], path_of_body, path, rng, imu)
        )
    return recordings, {"seed": seed, "effects": sizes}


def _log(
    name: str, time: np.ndarray, goals: np.ndarray, angles: np.ndarray, body: np.ndarray, path: Path,
    rng: np.random.Generator, imu: BoughtImu | None,
) -> Recording:  # fmt: skip
    joints = {
        joint: {
            "goal": goals[:, k].copy(),
            "position": TICK * np.round((angles[:, k] + rng.normal(0.0, ENCODER_NOISE, len(time))) / TICK),
        }
        for k, joint in enumerate(JOINTS)
    }
    w, x, y, z = body[:, 3:7].T
    turns = {
        "roll": np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        "pitch": np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0)),
        "yaw": np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    }
    base = {key: body[:, k] + rng.normal(0.0, POSITION_NOISE, len(time)) for k, key in enumerate("xyz")}
    base |= {key: turn + rng.normal(0.0, TURN_NOISE, len(time)) for key, turn in turns.items()}
    base = base if imu is None else {**imu.columns(time, body[:, 3:7], rng), **imu.pressed(time, body[:, 7:])}
    return Recording(
        name=name, time=time, joints=joints, base=base, robot=str(path), robot_params={},
        actuators=dict.fromkeys(JOINTS, nominal_chain()),
    )  # fmt: skip


# --- its IMU: axes, delays, noise and faults -------------------------------------------------------------------------


CLOSES = 1.0  # [N] of a contact switch
NOISE = {"turn": 0.005, "rate": 0.02}  # [rad], [rad/s] of a sample


@dataclass(frozen=True)
class BoughtImu:
    """What is true of an IMU, whatever its owner believes.

    Attributes:
        delay: from the motion to its sample [s].
        filtered: how much later still its orientation is than its turn rate [s].
        mount: how it sits on the body.
        axes: what its driver makes of the turn rates that it measures (3, 3).
        unit: of the turn rates, in rad/s.
        inverse: whether its quaternion turns the other way.
        feet: leg on whose foot each contact switch is, by the name of the leg that its owner believes; "": nothing
            presses on it.
        opened: switches that a foot opens.
    """

    delay: float = 0.01
    filtered: float = 0.0
    mount: Rotation = field(default_factory=Rotation.identity)
    axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    unit: float = 1.0
    inverse: bool = False
    feet: Mapping[str, str] = field(default_factory=dict)
    opened: tuple[str, ...] = ()

    def pressed(self, time: np.ndarray, forces: np.ndarray) -> Mapping[str, np.ndarray]:
        """What a log has of the switches, by the name after ``base.``, from forces on the feet (n, 4) [N]."""
        late = forces[np.clip(np.searchsorted(time, time - self.delay), 0, len(time) - 1)]
        closed = dict(zip(LEGS, late.T > CLOSES, strict=True)) | {"": np.zeros(len(time), bool)}
        return {
            f"switch.{name}": (closed[leg] ^ (name in self.opened)).astype(float) for name, leg in self.feet.items()
        }

    def columns(self, time: np.ndarray, turned: np.ndarray, random: np.random.Generator) -> Mapping[str, np.ndarray]:
        """What a log has of it, by the name after ``base.``.

        Args:
            time: of the log (n,) [s].
            turned: quaternion of the body, w first (n, 4).
            random: of its noise.
        """
        body = Rotation.from_quat(turned, scalar_first=True)
        steps = (body[:-1].inv() * body[1:]).as_rotvec() / np.diff(time)[:, None]
        both = np.concatenate([steps[:1], steps]), np.concatenate([steps, steps[-1:]])
        rates = 0.5 * (both[0] + both[1])  # of the intervals before and behind each row

        def row(late: float) -> np.ndarray:
            return np.clip(np.searchsorted(time, time - late), 0, len(time) - 1)

        late = Rotation.from_quat(turned[row(self.delay + self.filtered)], scalar_first=True)
        own = late * self.mount
        own = own * Rotation.from_rotvec(NOISE["turn"] * random.normal(size=(len(time), 3)))
        quaternion = (own.inv() if self.inverse else own).as_quat(scalar_first=True)
        spin = self.mount.inv().apply(rates[row(self.delay)]) + NOISE["rate"] * random.normal(size=(len(time), 3))
        spin = spin @ self.axes.T / self.unit
        found = {f"imu.{key}": quaternion[:, k] for k, key in enumerate("wxyz")}
        found |= {f"imu.turn_{key}": spin[:, k] for k, key in enumerate("xyz")}
        return found | {"imu.age": np.zeros(len(time))}
