"""An independent IMU on a body whose path is known: its axes, delays, noise and faults. Shares no code with sealegs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

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
    """

    delay: float = 0.01
    filtered: float = 0.0
    mount: Rotation = field(default_factory=Rotation.identity)
    axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    unit: float = 1.0
    inverse: bool = False

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
