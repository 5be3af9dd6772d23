"""Contact switches, such as those under feet: closed while what presses on their place is more than a threshold.

They are on the board of the robot's IMU: each of its samples says which of them are closed, at its rate and delay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

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
