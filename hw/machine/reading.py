"""One reading of a robot's servos, as angles of its joints."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..bus.servo_state import ServoState


@dataclass(frozen=True)
class BaseTurn:
    """How the base of a robot turns.

    Attributes:
        time: clock of the host as the sample came [s].
        orientation: of the base in a world whose z axis points up, a quaternion, w first (4,).
        turn_rate: about the axes of the base (3,) [rad/s].
        fresh: whether the reading before had an older sample.
        switches: 1 where a contact switch is closed, else 0 (s,).
    """

    time: float
    orientation: np.ndarray
    turn_rate: np.ndarray
    fresh: bool = True
    switches: np.ndarray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Reading:
    """One reading of all joints, in the order of the robot.

    Attributes:
        before: host's monotonic clock as the request went out [s].
        after: the same once all replies had come in [s].
        position: (k,) [rad].
        velocity: (k,) [rad/s].
        duty: (k,), 1 = full.
        current: (k,) [A].
        voltage: (k,) [V].
        temperature: (k,) [degC].
        link: position on the far side of a series spring (k,) [rad]; where nothing measures it, ``position``.
        base_position, base_velocity: of the robot's base, as far as it is measured (b,) [m or rad], per second.
        state: as the bus gave it; None in simulation.
        imu: how the base turns, as its IMU says; None: it has none, or that has said nothing yet.
        taken: when each servo and sensor of the robot was read last (n,) [s], before ``time`` where a reply is missing;
            None: all of them at ``time``.
    """

    before: float
    after: float
    position: np.ndarray
    velocity: np.ndarray
    duty: np.ndarray
    current: np.ndarray
    voltage: np.ndarray
    temperature: np.ndarray
    link: np.ndarray
    base_position: np.ndarray
    base_velocity: np.ndarray
    state: ServoState | None
    taken: np.ndarray | None = None
    imu: BaseTurn | None = None

    @property
    def time(self) -> float:
        """Middle of the transaction [s]: when the servos looked at their sensors, as well as the host can tell."""
        return 0.5 * (self.before + self.after)
