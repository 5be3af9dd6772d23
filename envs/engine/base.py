"""What a robot's base and its other undriven joints do, as scalar quantities that encoders can measure.

A hinge or slide is one quantity, called as its joint. A free joint is six: ``<joint>.x``, ``.y``, ``.z`` in the world
[m], and ``.yaw``, ``.pitch``, ``.roll`` [rad]: about the world's z axis, then the turned y axis, then the body's x. A
joint without a name is called as its body, where no joint has that name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Self

import mujoco
import numpy as np

from ...actuators import Drivetrain
from .model_poses import Label, numbers
from .robot import Robot

POSES = ("x", "y", "z", "roll", "pitch", "yaw")


class BaseLayout:
    """Where the quantities of a robot's joints stand in ``qpos`` and ``qvel``.

    Attributes:
        joints: numbers of the joints.
        names: of all quantities.
        units: rad or m, by name.
        base_name: of the first free joint, which carries the robot; "": the base is fixed.
        base: where that joint begins in ``qpos`` and ``qvel``; None: the base is fixed.
        nq, nv: sizes of ``qpos`` and ``qvel``, of the robot without what chains add behind.
    """

    def __init__(self, robot: Robot, params: Mapping[str, float] | None = None) -> None:
        """Of ``robot`` with the numbers ``params``."""
        model = robot.build_spec(params).compile()
        self._read(model, range(model.njnt))

    @classmethod
    def of_model(cls, model: mujoco.MjModel, joints: Iterable[int]) -> Self:
        """Of some joints of a compiled model, by number."""
        layout = cls.__new__(cls)
        layout._read(model, joints)
        return layout

    def _read(self, model: mujoco.MjModel, joints: Iterable[int]) -> None:
        self.nq, self.nv = model.nq, model.nv
        self.joints = tuple(joints)
        self.units: dict[str, str] = {}
        self._scalars: dict[str, tuple[int, int]] = {}
        self._free: dict[str, tuple[int, int]] = {}
        self._labels: dict[str, Label] = {}
        labels = {number: label for label, number in numbers(model).items()}
        for number in self.joints:
            own, body = labels.get(number, ("", ""))
            if not own and (not body or (body, "") in labels.values()):
                continue
            joint, name = model.joint(number), own or body
            self._labels[name] = own, body
            place = int(joint.qposadr[0]), int(joint.dofadr[0])
            if joint.type[0] == mujoco.mjtJoint.mjJNT_FREE:
                self._free[name] = place
                self.units |= {f"{name}.{key}": "m" if key in "xyz" else "rad" for key in POSES}
            elif joint.type[0] != mujoco.mjtJoint.mjJNT_BALL:
                self._scalars[name] = place
                self.units[name] = "m" if joint.type[0] == mujoco.mjtJoint.mjJNT_SLIDE else "rad"
        self.names = tuple(self.units)
        self.base_name = next(iter(self._free), "")
        self.base = self._free.get(self.base_name)

    def base_in(self, model: mujoco.MjModel) -> tuple[int, int] | None:
        """:attr:`base` in ``model``, the robot with chains."""
        if not self.base_name:
            return None
        joint = self._joint(model, self.base_name)
        return int(joint.qposadr[0]), int(joint.dofadr[0])

    def qpos(self, values: Mapping[str, float | np.ndarray], rows: int = 1) -> np.ndarray:
        """Positions (rows, nq) from quantities by name; NaN where a joint is not measured, or not all of it."""
        qpos = np.full((rows, self.nq), np.nan)
        for name, (at, _) in self._scalars.items():
            qpos[:, at] = values.get(name, np.nan)
        for name, (at, _) in self._free.items():
            pose = {key: values.get(f"{name}.{key}", np.nan) for key in POSES}
            for k, key in enumerate("xyz"):
                qpos[:, at + k] = pose[key]
            qpos[:, at + 3 : at + 7] = quaternion(pose["roll"], pose["pitch"], pose["yaw"])
        return qpos

    def qvel(
        self, values: Mapping[str, float | np.ndarray], rates: Mapping[str, float | np.ndarray], rows: int = 1
    ) -> np.ndarray:
        """Speeds (rows, nv) from quantities and their rates; turn rates of a free joint are about the body's axes."""
        qvel = np.full((rows, self.nv), np.nan)
        for name, (_, at) in self._scalars.items():
            qvel[:, at] = rates.get(name, np.nan)
        for name, (_, at) in self._free.items():
            for k, key in enumerate("xyz"):
                qvel[:, at + k] = rates.get(f"{name}.{key}", np.nan)
            roll, pitch = (np.asarray(values.get(f"{name}.{key}", np.nan)) for key in ("roll", "pitch"))
            about_x, about_y, about_z = (rates.get(f"{name}.{key}", np.nan) for key in ("roll", "pitch", "yaw"))
            qvel[:, at + 3] = about_x - about_z * np.sin(pitch)
            qvel[:, at + 4] = about_y * np.cos(roll) + about_z * np.sin(roll) * np.cos(pitch)
            qvel[:, at + 5] = -about_y * np.sin(roll) + about_z * np.cos(roll) * np.cos(pitch)
        return qvel

    def quantities(self, qpos: np.ndarray) -> np.ndarray:
        """All quantities (..., k), in the order of their names, from positions (..., nq)."""
        found = {name: qpos[..., at] for name, (at, _) in self._scalars.items()}
        for name, (at, _) in self._free.items():
            turns = np.stack(euler(np.moveaxis(qpos[..., at + 3 : at + 7], -1, 0)))
            found |= {f"{name}.{key}": qpos[..., at + k] for k, key in enumerate("xyz")}
            found |= {f"{name}.{key}": turns[k] for k, key in enumerate(POSES[3:])}
        return np.stack([found[name] for name in self.names], axis=-1)

    def values_of(self, model: mujoco.MjModel, qpos: np.ndarray) -> dict[str, float]:
        """Quantities by name from positions (model.nq,) of ``model``, a robot with chains."""
        found = {name: float(qpos[self._joint(model, name).qposadr[0]]) for name in self._scalars}
        for name in self._free:
            at = int(self._joint(model, name).qposadr[0])
            angles = euler(qpos[at + 3 : at + 7])
            found |= {f"{name}.{key}": float(v) for key, v in zip(POSES, (*qpos[at : at + 3], *angles), strict=True)}
        return found

    def rates_of(self, model: mujoco.MjModel, qvel: np.ndarray) -> dict[str, float]:
        """Rates by name from speeds (model.nv,) of ``model``, a robot with chains; 0 for the turn of a free joint."""
        found = {name: float(qvel[self._joint(model, name).dofadr[0]]) for name in self._scalars}
        for name in self._free:
            at = int(self._joint(model, name).dofadr[0])
            found |= {f"{name}.{key}": float(qvel[at + k]) if k < 3 else 0.0 for k, key in enumerate(POSES)}
        return found

    def measure(self, model: mujoco.MjModel, name: str) -> Callable[[np.ndarray], float]:
        """What gives the quantity ``name`` from positions (model.nq,) of ``model``, a robot with chains."""
        if name in self._scalars:
            place = int(self._joint(model, name).qposadr[0])
            return lambda qpos: float(qpos[place])
        joint, _, key = name.rpartition(".")
        at = int(self._joint(model, joint).qposadr[0])
        if key in "xyz":
            return lambda qpos: float(qpos["xyz".index(key) + at])
        which = ("roll", "pitch", "yaw").index(key)
        return lambda qpos: float(euler(qpos[at + 3 : at + 7])[which])

    def place(self, model: mujoco.MjModel, qpos: np.ndarray, values: Mapping[str, float]) -> None:
        """Write quantities into ``qpos`` (model.nq,) of ``model``, a robot with chains; others stay as they are."""
        for name in self._scalars:
            if name in values:
                qpos[self._joint(model, name).qposadr[0]] = values[name]
        for name in self._free:
            at = int(self._joint(model, name).qposadr[0])
            now = dict(zip(POSES, (*qpos[at : at + 3], *euler(qpos[at + 3 : at + 7])), strict=True))
            pose = {key: values.get(f"{name}.{key}", now[key]) for key in POSES}
            qpos[at : at + 3] = [pose[key] for key in "xyz"]
            qpos[at + 3 : at + 7] = quaternion(pose["roll"], pose["pitch"], pose["yaw"])

    def _joint(self, model: mujoco.MjModel, name: str) -> Any:
        """The joint of ``model``, a robot with chains, whose quantities have that name."""
        own, body = self._labels[name]
        return model.joint(own or numbers(model)["", body])


def quaternion(roll: float | np.ndarray, pitch: float | np.ndarray, yaw: float | np.ndarray) -> np.ndarray:
    """Quaternion (..., 4), w first, of a turn by yaw, then pitch, then roll [rad]."""
    (cr, sr), (cp, sp), (cy, sy) = (
        (np.cos(0.5 * np.asarray(a)), np.sin(0.5 * np.asarray(a))) for a in (roll, pitch, yaw)
    )
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=-1,
    )


def euler(turn: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Roll, pitch and yaw (...) [rad] of a quaternion (4, ...)."""
    w, x, y, z = turn / np.linalg.norm(turn, axis=0)
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    return roll, pitch, np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


# --- sums over many coordinates, in one order at any batch size, so that batches equal single environments to the
# bit.


class Sides:
    """Positions and speeds of all coordinates at once, each summed in one order at any batch size."""

    def __init__(self, drivetrain: Drivetrain, names: Sequence[str], side: str) -> None:
        model = drivetrain.model
        weights = np.stack([drivetrain.position(name, np.eye(model.nq), side) for name in names])
        speeds = np.stack([drivetrain.speed(name, np.eye(model.nv), side) for name in names])
        self._positions, self._speeds = self._terms(weights), self._terms(speeds)

    @staticmethod
    def _terms(weights: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        order = np.argsort(weights == 0.0, axis=1, kind="stable")
        count = int((weights != 0.0).sum(axis=1).max())
        return [(order[:, k], np.take_along_axis(weights, order[:, k : k + 1], axis=1)[:, 0]) for k in range(count)]

    def __call__(self, qpos: np.ndarray) -> np.ndarray:
        """Positions (b, coordinates)."""
        return self._sum(self._positions, qpos)

    def speed(self, qvel: np.ndarray) -> np.ndarray:
        """Speeds (b, coordinates)."""
        return self._sum(self._speeds, qvel)

    @staticmethod
    def _sum(terms: list[tuple[np.ndarray, np.ndarray]], values: np.ndarray) -> np.ndarray:
        columns, weights = terms[0]
        total = values[:, columns] * weights
        for columns, weights in terms[1:]:
            total += values[:, columns] * weights
        return total
