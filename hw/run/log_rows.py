"""The row of a measured log that a control cycle makes."""

from __future__ import annotations

import numpy as np

from ...envs.engine.imu import COLUMNS
from ..machine.robot import Reading
from .measured_log import MeasuredLog


def write_cycle(
    log: MeasuredLog,
    reading: Reading,
    fresh: tuple[np.ndarray, np.ndarray, np.ndarray],
    goal: np.ndarray,
    sent: float,
    zero: float,
) -> None:
    """Append a cycle, if all joints were read in it: a row holds nothing older, and a log needs every position.

    What an encoder beside them measures is NaN where it stayed silent.

    Args:
        log: to write.
        reading: of the cycle.
        fresh: which joints, far sides of springs and quantities of the base were read in it, as
            :meth:`sealegs.hw.machine.robot.ServoRobot.fresh` says.
        goal: that the servos have (k,) [rad].
        sent: clock as the goals went out [s]; NaN where none did.
        zero: clock at the start of the run [s].
    """
    joints, links, base = fresh
    if not joints.all():
        return
    state = reading.state
    values = {"goal": goal, "link_position": np.where(links, reading.link, np.nan), **vars(reading)}
    columns = [values[signal] for signal in log.signals]
    host = (reading.before - zero, reading.after - zero, sent - zero)
    status = state.status[: len(goal)] if state is not None else ()
    measured = [*np.where(base, reading.base_position, np.nan), *_turn(reading)][: log.base]
    log.write(reading.time - zero, np.stack(columns, axis=1), measured, host, status)


def _turn(reading: Reading) -> np.ndarray:
    """Cells of :data:`sealegs.envs.engine.imu.COLUMNS`, NaN where the IMU has said nothing new."""
    turn = reading.imu
    if turn is None or not turn.fresh:
        return np.full(len(COLUMNS), np.nan)
    return np.array([*turn.orientation, *turn.turn_rate, reading.time - turn.time])
