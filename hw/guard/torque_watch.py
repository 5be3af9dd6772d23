"""Torque that is no longer on, though nobody switched it off: a servo that restarted, or lost its torque otherwise.

After a restart a servo answers as before. Its torque is off, or on again where its firmware sees to that, and the
register that marked it is as at power-on. So both are read back, with the readings of a cycle, often enough to name
the loss within a tenth of a second.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..bus.servo_state import ServoState
from .safety import Fault

LOOK = 0.05  # [s] between two looks; costs 16 bytes a servo each time


class TorqueWatch:
    """Asked in every cycle in which torque is meant to be on."""

    def __init__(self, period: float) -> None:
        """Watch a loop of the period ``period`` [s]."""
        self._least, self._looked = LOOK - 0.75 * period, -math.inf

    def due(self, now: float) -> bool:
        """Whether the cycle at ``now`` [s] reads the registers back."""
        if now - self._looked < self._least:
            return False
        self._looked = now
        return True

    def judge(self, state: ServoState, marks: Mapping[int, int | None]) -> Fault | None:
        """The servo that has lost its torque or has stopped by itself, if any; not one that says itself what is wrong.

        Args:
            state: as read.
            marks: what each servo that must have torque got in the register that tells a restart, by id.
        """
        if state.torque is None or state.mark is None or state.watchdog is None:
            return None
        told = {servo for fault in state.faults() for servo in fault.servos}  # who says itself what is wrong
        rows = zip(state.ids, state.torque.tolist(), state.mark.tolist(), state.watchdog.tolist(), strict=True)
        for servo, torque, mark, watchdog in rows:
            if servo not in marks or servo in state.missing or servo in told or torque < 0:
                continue
            if marks[servo] is not None and mark != marks[servo]:
                now = "its torque is off" if torque == 0 else f"register 'torque_enable' is {torque} again"
                sentence = (
                    f"servo {servo} has restarted: {now}, and what marked it at torque on is {mark} as after power-on, "
                    f"no longer {marks[servo]}; check its supply, wires and connectors."
                )
                return Fault("restart", sentence, (servo,))
            if torque != 1:
                sentence = (
                    f"servo {servo} has lost its torque: register 'torque_enable' is {torque}, though nobody switched "
                    "it; find out what else talks to it, or what it protects itself from."
                )
                return Fault("torque", sentence, (servo,))
            if watchdog < 0:
                sentence = (
                    f"servo {servo} has stopped by itself: it heard nothing for the time of its bus watchdog, and "
                    "takes no goals any more; find out what kept the computer or the adapter busy."
                )
                return Fault("watchdog", sentence, (servo,))
        return None
