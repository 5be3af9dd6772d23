"""The row of a measured log that a control cycle makes."""

from __future__ import annotations

import numpy as np

from .measured_log import MeasuredLog
from .robot import Reading


def write_cycle(log: MeasuredLog, reading: Reading, goal: np.ndarray, sent: float, zero: float) -> None:
    """Append a cycle, if all of it was read in it: a row holds nothing older.

    Args:
        log: to write.
        reading: of the cycle.
        goal: that the servos have (k,) [rad].
        sent: clock as the goals went out [s]; NaN where none did.
        zero: clock at the start of the run [s].
    """
    state = reading.state
    if state is not None and state.missing:
        return
    values = {"goal": goal, "link_position": reading.link, **vars(reading)}
    columns = [values[signal] for signal in log.signals]
    host = (reading.before - zero, reading.after - zero, sent - zero)
    status = state.status[: len(goal)] if state is not None else ()
    log.write(reading.time - zero, np.stack(columns, axis=1), reading.base_position, host, status)
