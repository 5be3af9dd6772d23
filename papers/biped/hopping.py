"""The hopping experiment of paper 003, section VIII: the reference controller sees what the biped's computer sees."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, fields

import mujoco
import numpy as np

from ...actuators import Chain, Drivetrain
from ...common.errors import SealegsError
from ...envs.biped.drive import ANGLE, ENCODER, SHAPE, SPRING_RATIO, torque_chain
from ...envs.biped.kinematics import TURNED, centre_of_mass, feet, place, segments
from ...envs.biped.parameters import SIDES
from ...envs.biped.robot import BIPED, coordinate, foot
from .controller import PERIOD, RATIOS, Gait, HoppingController, Phase

JOINT_TICKS = 2**17  # steps per turn of the encoders on joints, torso and boom, assumed
SPEED_WINDOW = 10  # periods over which the computer differentiates the centre of mass, assumed
SETTLED = 8  # hops after which the period is taken, assumed
STEADY = 20  # hops in 30 s that count as steady, assumed
DROP = 0.05  # [m] from which the experiment starts, assumed
ANGLES, SHAPES = slice(0, 4, 2), slice(1, 4, 2)  # of the coordinates, in the robot's order
NAMES = tuple(item.name for item in BIPED.coordinates)


@dataclass(frozen=True)
class Hopping:
    """A recording at 1 kHz; columns of four are the robot's coordinates in their order, at the motor where said.

    Attributes:
        time: (n,) [s].
        hip: forward and up (n, 2) [m].
        pitch: of the torso (n,) [rad].
        link: leg angles and leg shapes (n, 4) [rad].
        motor: positions (n, 4) [rad at the motor].
        torque: commanded (n, 4) [N.m at the motor].
        stretch: of the cables (n, 4) [rad at the motor].
        spring: deflection of the pulleys (n, 2) [rad].
        phase: of the controller (n,).
        hop: touchdowns so far (n,).
        fell: whether the biped fell.
    """

    time: np.ndarray
    hip: np.ndarray
    pitch: np.ndarray
    link: np.ndarray
    motor: np.ndarray
    torque: np.ndarray
    stretch: np.ndarray
    spring: np.ndarray
    phase: np.ndarray
    hop: np.ndarray
    fell: bool

    def rows(self, chosen: slice | np.ndarray) -> Hopping:
        """Some of the samples."""
        arrays = {item.name: getattr(self, item.name)[chosen] for item in fields(self) if item.name != "fell"}
        return Hopping(**arrays, fell=self.fell)

    def then(self, later: Hopping) -> Hopping:
        """This recording and one that goes on where it ends."""
        arrays = {
            item.name: np.concatenate([getattr(self, item.name), getattr(later, item.name)])
            for item in fields(self)
            if item.name != "fell"
        }
        return Hopping(**arrays, fell=later.fell)

    @property
    def hops(self) -> int:
        """Touchdowns before the end or the fall."""
        return int(self.hop[-1]) if len(self.hop) else 0


def rigid_cables(name: str) -> Chain:
    """The torque-commanded drive with cables that do not stretch."""
    return torque_chain(name).without_stage("compliance")


def quantised(values: np.ndarray, ticks: float) -> np.ndarray:
    """Encoder readings [rad] of true positions [rad]."""
    step = 2.0 * np.pi / ticks
    return np.floor(values / step + 0.5) * step


class HoppingExperiment:
    """The biped in the engine, its encoders and its controller."""

    def __init__(
        self,
        gait: Gait | None = None,
        chains: Callable[[str], Chain] = torque_chain,
        params: Mapping[str, float] | None = None,
        joint_ticks: float = JOINT_TICKS,
        substeps: int = 1,
    ) -> None:
        """Build the model and put the biped a little over the floor.

        Args:
            gait: of the controller.
            chains: makes the chain of a coordinate; it must take torques.
            params: numbers of the robot other than its own.
            joint_ticks: steps per turn of the encoders on joints, torso and boom.
            substeps: of the engine in a period of the controller.
        """
        self.gait = gait or Gait()
        self.values = BIPED.parameters(params)
        spec = BIPED.build_spec(params)
        spec.option.timestep = PERIOD / substeps
        self.substeps = substeps
        self.drivetrain = Drivetrain(spec, {name: chains(name) for name in NAMES}, BIPED.coordinates)
        self.model = self.drivetrain.model
        self.data = mujoco.MjData(self.model)
        self.controller = HoppingController(self.gait)
        self.joint_ticks = joint_ticks
        identity = np.eye(self.model.nq)
        self._link = np.stack([self.drivetrain.position(name, identity, "link") for name in NAMES])
        self._motor = np.stack([self.drivetrain.position(name, identity, "motor") for name in NAMES])
        self._springs = np.stack([self._spring(identity, side) for side in SIDES])
        self._feet = [self.model.geom(foot(side)).id for side in SIDES]
        self._radius = self.values["foot_radius"]
        half = 0.5 * self.gait.leg_spread
        for side, angle, shape in zip(SIDES, (-half, half), self.gait.shape, strict=True):
            self.drivetrain.set_position(coordinate(side, SHAPE), self.data.qpos, shape)
            self.drivetrain.set_position(coordinate(side, ANGLE), self.data.qpos, angle)
        ends, centre = feet(self.values), centre_of_mass(self.values)
        posture = segments(0.0, np.array([-half, self.gait.shape[0], half, self.gait.shape[1]]))
        lowest = min(float(place(end, posture)[1]) for end in ends)
        self.data.qpos[1] = DROP + self.values["foot_radius"] - lowest
        self._over_feet = centre - ends.mean(axis=0)
        mujoco.mj_forward(self.model, self.data)
        self._places: list[float] = []

    def _spring(self, identity: np.ndarray, side: str) -> np.ndarray:
        """Row that takes a spring's deflection, at the leg, from ``qpos``; zeros where springs are blocked."""
        joint = f"{coordinate(side, SHAPE)}_spring"
        names = [self.model.joint(number).name for number in range(self.model.njnt)]
        return identity[self.model.joint(joint).qposadr[0]] if joint in names else np.zeros(self.model.nq)

    def start_from(self, other: HoppingExperiment) -> None:
        """Go on from the state of an experiment whose model may have other cables: joints that both have move alike."""
        shared = {self.model.joint(number).name for number in range(self.model.njnt)}
        for number in range(other.model.njnt):
            if (name := other.model.joint(number).name) in shared:
                self.data.joint(name).qpos, self.data.joint(name).qvel = (
                    other.data.joint(name).qpos,
                    other.data.joint(name).qvel,
                )
        self.data.time, self.controller, self._places = other.data.time, deepcopy(other.controller), [*other._places]
        mujoco.mj_forward(self.model, self.data)

    def step(self) -> np.ndarray:
        """One period of the controller; the torques it commanded (4,) [N.m at the motor]."""
        data, values, ticks = self.data, self.values, self.joint_ticks
        link = quantised(self._link @ data.qpos, ticks)
        motor = quantised(self._motor @ data.qpos * RATIOS, ENCODER)
        pitch, turn = quantised(np.array([data.qpos[2], data.qpos[0] / values["boom_length"]]), ticks)
        contact = np.array([data.geom_xpos[number, 2] < self._radius for number in self._feet])
        torque = self.controller.torques(
            data.time, pitch, link[ANGLES], motor[SHAPES], contact, self._speed(pitch, link), turn
        )
        data.ctrl[:] = torque * RATIOS
        mujoco.mj_step(self.model, data, self.substeps)
        return torque

    def _speed(self, pitch: float, link: np.ndarray) -> float:
        """Forward speed of the centre of mass over the feet [m/s], from encoders alone."""
        angles = TURNED[:, 0] * pitch + TURNED[:, 1:] @ link
        forward = self._over_feet[:, 0] @ np.cos(angles) - self._over_feet[:, 1] @ np.sin(angles)
        self._places.append(float(forward))
        del self._places[: -SPEED_WINDOW - 1]
        return (self._places[-1] - self._places[0]) / (max(len(self._places) - 1, 1) * PERIOD)

    def run(self, hops: int, seconds: float = 120.0) -> Hopping:
        """Hop until the next touchdown after ``hops`` hops, the time is over, or the biped falls.

        Raises:
            SealegsError: the simulation became unstable.
        """
        rows, fell = [], False
        ratios = RATIOS
        for _ in range(round(seconds / PERIOD)):
            torque = self.step()
            data, controller = self.data, self.controller
            link, motor = self._link @ data.qpos, self._motor @ data.qpos
            spring = self._springs @ data.qpos
            stretch = (motor - link) * ratios
            stretch[SHAPES] += spring * ratios[SHAPES]
            state = (data.time, *data.qpos[:3]), link, motor * ratios, torque, stretch, spring
            rows.append(np.concatenate([*state, (controller.phase, controller.hops)]))
            fell = bool(data.qpos[1] < 0.5 or abs(data.qpos[2]) > 1.0)
            if fell or controller.hops > hops:
                break
        if any(warning.number for warning in self.data.warning[int(mujoco.mjtWarning.mjWARN_BADQPOS) :]):
            raise SealegsError("the simulation of the biped became unstable; take a smaller step.")
        table = np.array(rows)
        columns = np.split(table, np.cumsum([1, 2, 1, 4, 4, 4, 4, 2, 1]), axis=1)
        time, hip, pitch, link, motor, torque, stretch, spring, phase, hop = columns
        spring = spring * SPRING_RATIO
        return Hopping(
            time[:, 0],
            hip=hip,
            pitch=pitch[:, 0],
            link=link,
            motor=motor,
            torque=torque,
            stretch=stretch,
            spring=spring,
            phase=phase[:, 0],
            hop=hop[:, 0],
            fell=fell,
        )


def hop_times(hopping: Hopping) -> np.ndarray:
    """Times of the touchdowns (hops,) [s]."""
    return hopping.time[np.flatnonzero(np.diff(hopping.hop, prepend=0.0) > 0.0)]


def flight_share(hopping: Hopping) -> float:
    """Share of the time after the first touchdown in which the controller sees both feet in the air."""
    later = hopping.hop >= 1
    return float(np.isin(hopping.phase[later], (Phase.FLIGHT, Phase.RETRACT)).mean()) if later.any() else 0.0
