"""Torque that is no longer on, though nobody switched it off: a servo that restarted, or lost its torque otherwise.

After a restart a servo answers as before, with its torque off and its torque limit as at power-on. So both registers
are read back, with the readings of a cycle, often enough to name the loss within a tenth of a second.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from .safety import Fault
from .servo_state import ServoState

LOOK = 0.05  # [s] between two looks; costs 16 bytes a servo each time


class TorqueWatch:
    """Asked in every cycle in which torque is meant to be on."""

    def __init__(self, period: float) -> None:
        """Watch a loop of the period ``period`` [s]."""
        self._every = max(math.floor(LOOK / period), 1)
        self._cycle = 0

    def due(self) -> bool:
        """Whether this cycle reads the registers back."""
        self._cycle += 1
        return self._cycle % self._every == 0

    def judge(self, state: ServoState, marks: Mapping[int, int]) -> Fault | None:
        """The servo that has lost its torque, if any.

        Args:
            state: as read.
            marks: torque limit of each servo that must have torque, by id.
        """
        if state.torque is None or state.limit is None:
            return None
        for servo, torque, limit in zip(state.ids, state.torque.tolist(), state.limit.tolist(), strict=True):
            if servo not in marks or servo in state.missing or torque == 1:
                continue
            if torque == 0 and limit != marks[servo]:
                sentence = (
                    f"servo {servo} has restarted: its torque is off, and its torque limit is {limit} as after "
                    f"power-on, no longer {marks[servo]}; check its supply, wires and connectors."
                )
                return Fault("restart", sentence, (servo,))
            sentence = (
                f"servo {servo} has lost its torque: register 'torque_enable' is {torque}, though nobody switched it; "
                "find out what else talks to it, or what it protects itself from."
            )
            return Fault("torque", sentence, (servo,))
        return None
