"""The sign of a current that a servo reports as a magnitude.

Whether present_current has a sign differs by servo and firmware, and no register tells. A servo that has ever reported
a negative count has one. Of another one the current has the sign of what drives it: duty times voltage less back-EMF.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .robot import Reading, ServoRobot

SURE = 10  # readings against the drive after which a servo counts as one that reports magnitudes


class CurrentSign:
    """Gives the readings of one run their signs."""

    def __init__(self, robot: ServoRobot) -> None:
        """Prepare for the servos of ``robot``."""
        self._ids = robot.ids
        self._constants = np.zeros(len(robot.ids))  # back-EMF [V.s/rad]
        for k, name in enumerate(robot.names):
            chain = robot.chains[name]
            if chain.find("dc_motor") is not None:
                self._constants[k] = chain.value("dc_motor.motor_constant") * chain.gear_ratio()
        self._signed = np.zeros(len(robot.ids), bool)
        self._against = np.zeros(len(robot.ids), int)

    def mended(self, reading: Reading) -> Reading:
        """The reading, its currents signed."""
        if reading.state is None:
            return reading
        raw = reading.state.raw["present_current"][: len(self._ids)]
        drive = reading.duty * reading.voltage - self._constants * reading.velocity
        wanted = np.where(drive < 0.0, -1.0, 1.0)
        self._signed |= raw < 0
        flip = ~self._signed & (raw > 0)
        signed = np.where(flip, wanted * np.abs(reading.current), reading.current)
        self._against += flip & (signed != reading.current)
        return replace(reading, current=signed)

    @property
    def magnitudes(self) -> list[int]:
        """Ids of the servos that report magnitudes."""
        found = ~self._signed & (self._against >= SURE)
        return [servo for servo, unsigned in zip(self._ids, found.tolist(), strict=True) if unsigned]
