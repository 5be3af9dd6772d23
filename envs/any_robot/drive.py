"""Drive as commanded on wheels: forward and turning, with any robot whose base is free and whose wheels take speeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import mujoco
import numpy as np

from ...actuators import Drivetrain
from ...common.errors import SealegsError
from ..engine.model_poses import stand
from ..engine.robot import Robot
from ..engine.task import Motion, option
from ..robots import get_robot
from .task import Commanded, Numbers

COMMANDS = ("forward [m/s]", "turn [rad/s]")
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Rolling:
    """How wheels carry a robot where episodes start; the world's x is its forward, and z is up.

    Attributes:
        forward: the forward direction in the base's frame (3,).
        up: the vertical in the base's frame (3,).
        per_forward: speed of each coordinate at a metre a second forward (k,) [rad/m]; 0 of one that is no wheel.
        per_turn: the same at a radian a second about the base (k,) [-].
        wheels: numbers of the coordinates that are wheels.
    """

    forward: np.ndarray
    up: np.ndarray
    per_forward: np.ndarray
    per_turn: np.ndarray
    wheels: tuple[int, ...]


def rolling(robot: Robot) -> Rolling:
    """How the wheels of ``robot`` carry it.

    Raises:
        SealegsError: its base is not free, or none of its joints on the ground is told speeds.
    """
    drivetrain = robot.drivetrain()
    model = drivetrain.model
    free = [k for k in range(model.njnt) if model.jnt_type[k] == mujoco.mjtJoint.mjJNT_FREE]
    turning = [item.name for item in drivetrain.coordinates if drivetrain.chains[item.name].command == "goal_velocity"]
    if not free or not turning:
        what = "has no free base" if not free else "has no wheel: no chain of its joints is told speeds (velocity_pi)"
        raise SealegsError(f"robot '{robot.name}' {what}, and cannot drive; see the page Wheels of the documentation.")
    data, home = mujoco.MjData(model), np.array(model.qpos0)[None].copy()
    stand(model, robot.pose, home)
    data.qpos[:] = home[0]
    mujoco.mj_kinematics(model, data)
    base = int(model.jnt_bodyid[free[0]])
    count = len(drivetrain.coordinates)
    per_forward, per_turn, wheels = np.zeros(count), np.zeros(count), []
    for k, item in enumerate(drivetrain.coordinates):
        number = model.joint(drivetrain.terms(item.name)[-1][0]).id
        radius, axis = float(data.xanchor[number][2]), data.xaxis[number]
        level = np.hypot(axis[0], axis[1])
        if item.name not in turning or radius <= 0.0 or level < 0.5:  # a mower's blade turns, and carries nothing
            continue
        ahead = np.array([axis[1], -axis[0]]) / level  # of its axle as it rolls: axis x up
        place = data.xanchor[number][:2] - data.xpos[base][:2]
        per_forward[k] = ahead[0] / radius
        per_turn[k] = (ahead[1] * place[0] - ahead[0] * place[1]) / radius
        wheels.append(k)
    if not wheels:
        raise SealegsError(f"robot '{robot.name}' has no wheel over its floor; give its YAML floor and height.")
    turn = data.xmat[base].reshape(3, 3)
    return Rolling(turn[0].copy(), turn[2].copy(), per_forward, per_turn, tuple(wheels))


@dataclass(frozen=True)
class DriveTask(Commanded):
    """The options of :class:`sealegs.envs.any_robot.env.DriveEnv`."""

    forward: float | Sequence[float] = option((-0.2, 0.3), "commanded speed, or from which to which", "m/s")
    turn: float | Sequence[float] = option((-1.0, 1.0), "the same about the vertical", "rad/s")
    stand_share: float = option(0.1, "see Starting State")
    command_interval: float = option(0.0, "between commands of an episode; 0: it has one", "s")
    correction: float = option(0.2, "see Action Space")
    tolerance: float = option(0.05, "see Rewards", "m/s")
    turn_tolerance: float = option(0.2, "see Rewards", "rad/s")
    tracking_weight: float = 1.0
    turn_weight: float = 1.0
    smooth_weight: float = 0.05
    energy_weight: float = 0.01
    healthy_tilt: float = option(0.7, "see Termination", "rad")

    robot = get_robot("rover")
    ranges = ("forward", "turn")
    per_joint = 0
    per_robot = len(COMMANDS) + 1
    takes_speeds = True
    rolls: ClassVar[Rolling]

    def __post_init__(self) -> None:
        super().__post_init__()
        type(self).rolling_of()

    @classmethod
    def on(cls, robot: Robot | str | Path) -> type[Self]:
        kind = super().on(robot)
        kind.rolling_of()
        return kind

    @classmethod
    def rolling_of(cls) -> Rolling:
        """How the class's robot rolls, found once.

        Raises:
            SealegsError: it does not.
        """
        if "rolls" not in vars(cls):
            cls.rolls = rolling(cls.robot)
        return cls.rolls

    def asked_names(self) -> tuple[str, ...]:
        return COMMANDS

    def place(
        self, drivetrain: Drivetrain, numbers: Numbers, random: np.ndarray, qpos: np.ndarray, qvel: np.ndarray
    ) -> np.ndarray:
        del numbers
        return self.placed(drivetrain, np.broadcast_to(self.centre, (len(random), len(self.centre))), qpos, qvel)

    def reference(
        self, time: np.ndarray, command: np.ndarray, numbers: Numbers
    ) -> tuple[np.ndarray, np.ndarray] | None:
        del time, numbers
        speeds: Any = command[:, :1] * self.rolls.per_forward + command[:, 1:] * self.rolls.per_turn
        return self.centre + speeds, self.correction * self.half

    def observation_names(self) -> tuple[str, ...]:
        return (
            *(f"commanded {name}" for name in COMMANDS),
            *(f"gravity along {axis} of the base" for axis in AXES),
            *(f"turn rate about {axis} of the base [rad/s]" for axis in AXES),
            *self.named(("motor speed", "{unit}/s"), ("last action", "-")),
        )

    def observe(self, motion: Motion) -> tuple[np.ndarray, ...]:
        m = motion
        return m.command, m.gravity, m.turn_rate, m.reading_speed, m.action

    def _upright(self, motion: Motion) -> np.ndarray:
        """Cosine of the tilt of the base from the start (n,)."""
        return -(motion.gravity * self.rolls.up).sum(axis=1)

    def velocity(self, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        """Of the base, forward (n,) [m/s], and its turn about the vertical (n,) [rad/s]."""
        assert motion.base is not None  # rolling asks for a free one
        w, x, y, z = motion.orientation.T
        first, second, third = self.rolls.forward
        ahead = (1.0 - 2.0 * (y * y + z * z)) * first + 2.0 * (x * y - w * z) * second + 2.0 * (x * z + w * y) * third
        aside = 2.0 * (x * y + w * z) * first + (1.0 - 2.0 * (x * x + z * z)) * second + 2.0 * (y * z - w * x) * third
        along, across = motion.qvel[:, motion.base[1]], motion.qvel[:, motion.base[1] + 1]
        forward = (along * ahead + across * aside) / np.maximum(np.hypot(ahead, aside), 1e-9)
        return forward, -(motion.turn_rate * motion.gravity).sum(axis=1)

    def rewards(self, motion: Motion) -> dict[str, np.ndarray]:
        m = motion
        change = m.action - m.previous_action
        terms = {
            "reward_smooth": -self.smooth_weight * (change**2).mean(axis=1),
            "reward_energy": -self.energy_weight * np.abs(m.torque * m.motor_speed).sum(axis=1),
        }
        if not m.world.simulated:
            return terms
        forward, turn = self.velocity(m)
        off, astray = (forward - m.command[:, 0]) / self.tolerance, (turn - m.command[:, 1]) / self.turn_tolerance
        return {
            "reward_tracking": self.tracking_weight * np.exp(-(off**2)),
            "reward_turn": self.turn_weight * np.exp(-(astray**2)),
            **terms,
        }

    def errors(self, motion: Motion) -> dict[str, np.ndarray]:
        forward, turn = self.velocity(motion)
        return {
            "speed [m/s]": np.abs(forward - motion.command[:, 0]),
            "turning [rad/s]": np.abs(turn - motion.command[:, 1]),
        }

    def failed(self, motion: Motion) -> np.ndarray:
        return self._upright(motion) < np.cos(self.healthy_tilt)
