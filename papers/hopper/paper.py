"""The paper's experiment: ten seconds of hopping with and without actuator (paper 004, IV-D and IV-E)."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import mujoco
import numpy as np

from ...actuators import Drivetrain
from ...actuators.layout import S_TORQUE
from ...common.errors import SealegsError
from ...envs.engine.robot import ChainSource
from ...envs.hopper.controller import BangBang, spring_stiffness
from ...envs.hopper.robot import BASE, FOOT, HIP, HOPPER, KNEE

CONTROL_STEP = 0.001  # [s], IV-D: sensors and controllers at 1 kHz
SETTLING = 2.0  # [s] of the start that no figure looks at, assumed
PEAK = 0.3  # [rad/s] by which a peak of a motor's speed stands out, assumed
LEG_DISTANCE = 0.12  # [m] between the legs of the model with four, assumed; they do not touch


@dataclass(frozen=True)
class Printed:
    """What the paper prints for one case (IV-E).

    Attributes:
        frequency: hops per second [Hz].
        height: jumping height [m].
    """

    frequency: float
    height: float


PRINTED = {
    "hardware": Printed(2.9, 0.10),
    "with actuator": Printed(2.5, 0.12),
    "without actuator": Printed(4.0, 0.04),
}
CHAINS = {"with actuator": "sv1270tg", "without actuator": "ideal"}


@dataclass(frozen=True)
class Hops:
    """A recording at the control rate; coordinates in the order hip, knee.

    Attributes:
        time: (n,) [s].
        height: of the hip over the floor (n,) [m].
        forward: of the base (n,) [m].
        clearance: of the foot over the floor (n,) [m].
        goal, motor, link: positions (n, 2) [rad]; without a series spring the motor is its goal, as in the paper.
        motor_speed, link_speed: (n, 2) [rad/s].
        torque: of the motors (n, 2) [N.m].
    """

    time: np.ndarray
    height: np.ndarray
    forward: np.ndarray
    clearance: np.ndarray
    goal: np.ndarray
    motor: np.ndarray
    link: np.ndarray
    motor_speed: np.ndarray
    link_speed: np.ndarray
    torque: np.ndarray


@dataclass(frozen=True)
class Figures:
    """What is compared with the paper.

    Attributes:
        frequency: hops per second [Hz].
        way: of the hip from its lowest to its highest point, mean over the hops [m].
        rise: of the hip over standing [m].
        clearance: of the foot over the floor [m].
        speed: forward [m/s].
        regularity: standard deviation of the period over its mean.
        torque: largest motor torque [N.m].
    """

    frequency: float
    way: float
    rise: float
    clearance: float
    speed: float
    regularity: float
    torque: float

    @property
    def height(self) -> float:
        """Of a jump [m]; the paper does not say from where: `height_of_a_jump` in the list of chosen numbers."""
        return self.way


class Legs:
    """One or more hoppers side by side in one model, each with its own base, under the reference controller."""

    def __init__(
        self,
        actuator: ChainSource,
        count: int = 1,
        params: Mapping[str, float] | None = None,
        timestep: float | None = None,
        integrator: mujoco.mjtIntegrator | None = None,
    ) -> None:
        """Build the model.

        Args:
            actuator: chain of all coordinates.
            count: number of legs.
            params: numbers of the robot other than its own.
            timestep: other than the robot's own [s].
            integrator: other than the robot's own.

        Raises:
            SealegsError: a wrong chain or parameter.
        """
        spec = HOPPER.build_spec(params)
        if timestep is not None:
            spec.option.timestep = timestep
        if integrator is not None:
            spec.option.integrator = integrator
        prefixes = [""] + [f"leg{k}_" for k in range(2, count + 1)]
        for k, prefix in enumerate(prefixes[1:], 1):
            frame = spec.worldbody.add_frame(pos=(0.0, k * LEG_DISTANCE, 0.0))
            frame.attach_body(HOPPER.build_spec(params).body(BASE), prefix, "")
        coordinates = [
            replace(
                item,
                name=prefix + item.name,
                terms=tuple((prefix + joint, weight) for joint, weight in item.terms),
                motor_body=prefix + BASE,
            )
            for prefix in prefixes
            for item in HOPPER.coordinates
        ]
        names = [item.name for item in coordinates]
        self.drivetrain = Drivetrain(spec, dict.fromkeys(names, actuator), coordinates)
        self.model = self.drivetrain.model
        self.chain = self.drivetrain.chains[HIP]
        self.controller = BangBang(stiffness=spring_stiffness(self.chain))
        self.elastic = self.chain.find("spring") is not None
        self.count = count
        identity = np.eye(self.model.nq)
        self._link = np.stack([self.drivetrain.position(name, identity, "link") for name in names])
        self._motor = np.stack([self.drivetrain.position(name, identity, "motor") for name in names])
        self._torques = [self.drivetrain.state_addresses[name] + S_TORQUE for name in (HIP, KNEE)]
        self._foot = self.model.geom(FOOT).id
        self._substeps = round(CONTROL_STEP / self.model.opt.timestep)
        self.data = mujoco.MjData(self.model)
        for name in names:
            rest = self.controller.rest[0 if name.endswith(HIP) else 1]
            self.drivetrain.set_position(name, self.data.qpos, rest)
        self.data.ctrl[:] = np.tile(self.controller.rest, count)

    def step(self) -> None:
        """One period of the controller."""
        link = self._link @ self.data.qpos
        motor = self._motor @ self.data.qpos if self.elastic else self.data.ctrl
        self.data.ctrl[:] = self.controller.goals(motor.reshape(-1, 2), link.reshape(-1, 2)).reshape(-1)
        mujoco.mj_step(self.model, self.data, self._substeps)

    def hop(self, seconds: float) -> Hops:
        """Hop and record the first leg.

        Raises:
            SealegsError: the simulation became unstable.
        """
        count = round(seconds / CONTROL_STEP)
        one, pair = np.empty((4, count)), np.empty((6, count, 2))
        radius = self.model.geom_size[self._foot, 0]
        for k in range(count):
            self.step()
            data = self.data
            one[:, k] = data.time, data.qpos[1], data.qpos[0], data.geom_xpos[self._foot, 2] - radius
            pair[0, k], pair[2, k] = data.ctrl[:2], self._link[:2] @ data.qpos
            pair[1, k] = self._motor[:2] @ data.qpos if self.elastic else data.ctrl[:2]
            pair[5, k] = data.userdata[self._torques]
        if any(warning.number for warning in self.data.warning[int(mujoco.mjtWarning.mjWARN_BADQPOS) :]):
            raise SealegsError("the simulation of the hopper became unstable; take a smaller step.")
        for source, target in ((1, 3), (2, 4)):
            pair[target] = np.gradient(pair[source], CONTROL_STEP, axis=0)
        goal, motor, link, motor_speed, link_speed, torque = pair
        time, height, forward, clearance = one
        return Hops(
            time,
            height=height,
            forward=forward,
            clearance=clearance,
            goal=goal,
            motor=motor,
            link=link,
            motor_speed=motor_speed,
            link_speed=link_speed,
            torque=torque,
        )

    def real_time_factor(self, seconds: float) -> float:
        """Simulated time over the time it takes, controller included."""
        count = round(seconds / CONTROL_STEP)
        started = time.perf_counter()
        for _ in range(count):
            self.step()
        return count * CONTROL_STEP / (time.perf_counter() - started)


def flexions(hops: Hops) -> np.ndarray:
    """Samples at which the leg is flexed most: the lowest height between one flight and the next."""
    chosen = np.flatnonzero(hops.time > SETTLING)
    height = hops.height[chosen]
    level = 0.5 * (height.min() + height.max())
    rising = np.flatnonzero((height[:-1] < level) & (height[1:] >= level)) + 1
    starts = [first + int(np.argmin(height[first:last])) for first, last in pairwise(rising)]
    return chosen[np.array(starts, dtype=int)] if len(starts) else np.array([], dtype=int)


def measure(hops: Hops) -> Figures:
    """Frequency and heights of a recording.

    Raises:
        SealegsError: the leg does not hop.
    """
    starts = flexions(hops)
    if len(starts) < 3 or np.ptp(hops.height[hops.time > SETTLING]) < 5e-3:
        raise SealegsError("the leg does not hop: there are no periods to measure.")
    periods = np.diff(hops.time[starts])
    cycles = list(pairwise(starts))
    top = np.mean([hops.height[a:b].max() for a, b in cycles])
    bottom = hops.height[starts].mean()
    return Figures(
        frequency=float(1.0 / periods.mean()),
        way=float(top - bottom),
        rise=float(top - hops.height[0]),
        clearance=float(np.mean([hops.clearance[a:b].max() for a, b in cycles])),
        speed=float(
            (hops.forward[starts[-1]] - hops.forward[starts[0]]) / (hops.time[starts[-1]] - hops.time[starts[0]])
        ),
        regularity=float(periods.std() / periods.mean()),
        torque=float(np.abs(hops.torque[starts[0] : starts[-1]]).max()),
    )


def by_period(hops: Hops, values: np.ndarray, points: int = 200) -> np.ndarray:
    """``values`` (n, ...) of each period, resampled over its length: (periods, points, ...)."""
    starts = flexions(hops)
    grid = np.linspace(0.0, 1.0, points)
    rows = []
    for first, last in pairwise(starts):
        own = np.linspace(0.0, 1.0, last - first + 1)
        columns = values[first : last + 1].reshape(last - first + 1, -1)
        rows.append(np.stack([np.interp(grid, own, column) for column in columns.T], axis=1))
    return np.array(rows).reshape(len(rows), points, *values.shape[1:])
