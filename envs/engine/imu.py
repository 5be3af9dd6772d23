"""An IMU on a robot's free base: where it sits, how often and how late it is read, how far its readings are off.

One description serves training, the virtual machine and deployment. Noise and bias of a sample follow from the number
of the IMU (its key) and that of the sample alone, so batches of any size draw the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import mujoco
import numpy as np
from mujoco.batch import Batch

from . import keyed, turns

GIVES = ("roll", "pitch", "yaw")
"""Quantities of the free joint (:mod:`sealegs.envs.engine.base`) that the IMU measures, and their rates."""
COLUMNS = ("imu.w", "imu.x", "imu.y", "imu.z", "imu.turn_x", "imu.turn_y", "imu.turn_z", "imu.age")
"""Of ``base.*`` in a log: quaternion of the base in the world, turn rate about the base's axes [rad/s], and how long
before the row the sample came [s]. Cells of a row without a new sample are empty."""
OF_ALL = -(2**62)  # in place of the number of a sample: what all samples of an IMU share


@dataclass(frozen=True)
class Spread:
    """Standard deviations about each axis.

    Attributes:
        orientation: [rad].
        turn_rate: [rad/s].
    """

    orientation: float
    turn_rate: float


@dataclass(frozen=True)
class Imu:
    """An IMU that moves with the robot's free base.

    Attributes:
        joint: the free joint, as :mod:`sealegs.envs.engine.base` calls it.
        mount: quaternion that turns the IMU's axes into the base's.
        upright: quaternion of the base where the robot stands.
        rate: samples per second [Hz].
        delay: from the motion to the sample at the host [s].
        noise: of each sample.
        bias: of each IMU, the same in all its samples.
        fallen: tilt from upright at which a run ends [rad]; None: none.
        silent: time without a sample at which a run ends [s], and two cycles at least.
        switches: contact switches on its board, which its samples hold too.
        said: all of it as the robot's file may say it, for who builds it again.
    """

    joint: str
    mount: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
    upright: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
    rate: float = 100.0
    delay: float = 0.01
    noise: Spread = Spread(0.005, 0.01)
    bias: Spread = Spread(0.01, 0.005)
    fallen: float | None = 1.0
    silent: float = 0.1
    switches: tuple[Switch, ...] = ()
    said: Mapping[str, Any] = field(default_factory=dict, compare=False)

    @property
    def part(self) -> Mapping[str, Any]:
        """How a computer reads it, for deployment."""
        return self.said.get("part") or {}

    @property
    def gives(self) -> tuple[str, ...]:
        """Quantities of the base that it measures, and its switches."""
        return (*(f"{self.joint}.{key}" for key in GIVES), *(switch.column for switch in self.switches))

    @property
    def columns(self) -> tuple[str, ...]:
        """Of ``base.*`` in a log."""
        return (*COLUMNS, *(switch.column for switch in self.switches))

    def sample_at(self, time: np.ndarray, key: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Number (...) of the newest sample that a host has at ``time`` [s], and when it was taken [s].

        The clock of an IMU is its own: its samples lie anywhere in its period, as its key (...) says.
        """
        phase = keyed.uniform(key, np.zeros_like(key), 0)
        number = np.floor((np.asarray(time) - self.delay) * self.rate - phase + 1e-9)
        return number.astype(np.int64), (number + phase) / self.rate

    def measured(
        self, orientation: np.ndarray, turn_rate: np.ndarray, key: np.ndarray, number: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """What samples say of a base that turns.

        Args:
            orientation: of the base, true (..., 4).
            turn_rate: about its axes, true (..., 3) [rad/s].
            key: of the IMUs (...), uint64.
            number: of the samples (...).

        Returns:
            The same two, with noise and bias; in the base's axes.
        """
        bias, noise = keyed.normal(key, np.full_like(np.asarray(number), OF_ALL), 6), keyed.normal(key, number, 6)
        error = self.bias.orientation * bias[..., :3] + self.noise.orientation * noise[..., :3]
        rate = turn_rate + self.bias.turn_rate * bias[..., 3:] + self.noise.turn_rate * noise[..., 3:]
        return turns.multiply(orientation, turns.of_vector(error)), rate

    def raw(self, orientation: np.ndarray, turn_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Orientation and turn rate of the base (..., 4), (..., 3) as the IMU has them, in its own axes."""
        mount = np.array(self.mount)
        return turns.multiply(orientation, mount), turns.applied(turns.inverse(mount), turn_rate)

    def of_base(self, orientation: np.ndarray, turn_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Orientation and turn rate of the base (..., 4), (..., 3) from those of the IMU in its own axes."""
        mount = np.array(self.mount)
        return turns.multiply(orientation, turns.inverse(mount)), turns.applied(mount, turn_rate)

    def tilt(self, orientation: np.ndarray) -> np.ndarray:
        """How far a base (..., 4) leans from where it stands upright (...) [rad]."""
        along = (turns.projected_gravity(orientation) * turns.projected_gravity(np.array(self.upright))).sum(axis=-1)
        return np.arccos(np.clip(along, -1.0, 1.0))


class ImuHistory:
    """What the IMUs of n simulations have to say, while the simulations go on in whole control steps."""

    def __init__(self, imu: Imu, batch: Batch, places: tuple[int, int], substeps: int) -> None:
        """Prepare.

        Args:
            imu: on each of the simulations.
            batch: the simulations.
            places: addresses of the free joint in ``qpos`` and ``qvel``.
            substeps: steps of the simulation in a control step.
        """
        timestep, count = batch.model.opt.timestep, batch.nsim
        self.imu, self._batch, self._places = imu, batch, places
        self._qpos, self._qvel, self._sensors = (batch.bind(name) for name in ("qpos", "qvel", "sensordata"))
        self._switches = Switches(batch.model, imu.switches)
        fitting = [k for k in range(1, substeps + 1) if substeps % k == 0 and k * timestep * imu.rate <= 1.0 + 1e-9]
        self._every = max(fitting, default=1)
        self._spacing = self._every * timestep
        length = math.ceil((imu.delay + 1.0 / imu.rate) / self._spacing + 1e-6) + 2
        self._states = np.zeros((length, count, 7 + len(imu.switches)))
        self._head, self._since = 0, 0
        self.keys = np.zeros(count, np.uint64)

    def begin(self, chosen: np.ndarray, uniform: np.ndarray) -> None:
        """New episodes in some simulations, which stood as they stand; ``uniform`` (m,) draws their IMUs."""
        self.keys[chosen] = keyed.key_of(uniform)
        self._states[:, chosen] = self._state()[chosen]

    def carry(self, steps: int) -> None:
        """Simulate ``steps``."""
        while steps > 0:
            part = min(steps, self._every - self._since)
            self._batch.step(nstep=part)
            steps, self._since = steps - part, (self._since + part) % self._every
            if self._since == 0:
                self._head = (self._head + 1) % len(self._states)
                self._states[self._head] = self._state()

    def closed(self) -> np.ndarray:
        """1 where a switch is closed now, else 0 (n, s)."""
        return self._switches.closed(self._sensors)

    def seen(self, time: np.ndarray) -> dict[str, np.ndarray]:
        """Fields of the motion, with turn of the base and switches as measured at the end of a control step.

        Args:
            time: since the episodes started (n,) [s].
        """
        number, taken = self.imu.sample_at(time, self.keys)
        back = (time - taken) / self._spacing
        whole = np.floor(back).astype(np.int64)
        rows, length = np.arange(len(time)), len(self._states)
        newer, older = (self._states[(self._head - whole - k) % length, rows] for k in (0, 1))
        share = (back - whole)[:, None]
        orientation = turns.between(newer[:, :4], older[:, :4], share)
        turn_rate = (1.0 - share) * newer[:, 4:7] + share * older[:, 4:7]
        orientation, turn_rate = self.imu.measured(orientation, turn_rate, self.keys, number)
        at, dof = self._places
        qpos, qvel = self._qpos.copy(), self._qvel.copy()
        qpos[:, at + 3 : at + 7], qvel[:, dof + 3 : dof + 6] = orientation, turn_rate
        return {"qpos": qpos, "qvel": qvel, "switches": np.where(share > 1e-6, older, newer)[:, 7:]}

    def _state(self) -> np.ndarray:
        at, dof = self._places
        turn = self._qpos[:, at + 3 : at + 7], self._qvel[:, dof + 3 : dof + 6]
        return np.concatenate([*turn, self.closed()], axis=1)


# --- contact switches, such as those under feet: closed while what presses on their place is more than a threshold ---
#
# They are on the board of the robot's IMU: each of its samples says which of them are closed, at its rate and delay.

PREFIX = "switch."
"""Of their columns of ``base.*`` in a log, of their names in a policy's contract, and in the format of a line."""
Kind = Literal["body", "geom", "site"]
KINDS: dict[Kind, mujoco.mjtObj] = {
    "body": mujoco.mjtObj.mjOBJ_BODY,
    "geom": mujoco.mjtObj.mjOBJ_GEOM,
    "site": mujoco.mjtObj.mjOBJ_SITE,
}
"""What of a model a switch may be on; a site counts contacts of its body within its own shape."""
_FORCE, _NET_FORCE = 0b10, 3  # of a contact sensor: data, reduction


@dataclass(frozen=True)
class Switch:
    """A switch that closes under force.

    Attributes:
        name: of the switch.
        kind: of its place, a word of :data:`KINDS`.
        place: name of body, geom or site in the model.
        threshold: of the size of the contact forces' sum, above which it is closed [N].
    """

    name: str
    kind: Kind
    place: str
    threshold: float

    @property
    def column(self) -> str:
        """What logs and contracts call it."""
        return PREFIX + self.name


def add_switches(spec: mujoco.MjSpec, switches: Sequence[Switch]) -> None:
    """Give a model a contact sensor for each switch."""
    for switch in switches:
        sensor = spec.add_sensor(name=switch.column, type=mujoco.mjtSensor.mjSENS_CONTACT)
        sensor.reftype, sensor.refname = KINDS[switch.kind], switch.place
        if switch.kind == "site":
            sensor.objtype, sensor.objname = KINDS["site"], switch.place
            sensor.reftype, sensor.refname = KINDS["body"], spec.site(switch.place).parent.name
        sensor.intprm[:3] = _FORCE, _NET_FORCE, 1


class Switches:
    """Reads the switches of a model that :func:`add_switches` changed."""

    def __init__(self, model: mujoco.MjModel, switches: Sequence[Switch]) -> None:
        """Find their sensors in ``model``."""
        starts = [int(model.sensor_adr[model.sensor(switch.column).id]) for switch in switches]
        self._places = np.array(starts, np.int64)[:, None] + np.arange(3)
        self._thresholds = np.array([switch.threshold for switch in switches])

    def closed(self, sensordata: np.ndarray) -> np.ndarray:
        """1 where a switch is closed, else 0 (..., s), of ``sensordata`` (..., d)."""
        force = sensordata[..., self._places]
        return np.asarray((force * force).sum(axis=-1) > self._thresholds**2, float)
