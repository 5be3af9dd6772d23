"""The last stage of an identification: stretch of the cables under load (paper 003, (25) to (27))."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .identification import IdentificationError, Record


@dataclass(frozen=True)
class Cable:
    """Cable stretch model (27), at the motor.

    Attributes:
        stiffness: [N.m/rad].
        damping: [N.m.s/rad].
    """

    stiffness: float
    damping: float


def fit_cable(
    record: Record,
    stretch: np.ndarray,
    motor_constant: float,
    motor_inertia: float,
    friction: float,
    bias: float,
    window: float = 0.08,
) -> Cable:
    """Stiffness and damping from motor and stretch under load, without speeds: the motor's equation

        J q'' = (u + b) / K_T - mu q' - K s - D s'

    times smooth windows that begin and end at zero, integrated by parts until positions are left.

    Args:
        record: of the motor.
        stretch: of the cable (n,) [rad at the motor]: motor less what its joints say, (25).
        motor_constant: from :func:`sealegs.papers.biped.identification.fit_motor`.
        motor_inertia: of rotor and pulleys at the motor [kg.m2].
        friction: from :func:`sealegs.papers.biped.identification.fit_leg` [N.m.s/rad].
        bias: in commanded torque [N.m].
        window: length of a window [s]; about a swing of what is looked for.

    Raises:
        IdentificationError: the record is too short, or the cable hardly stretches.
    """
    period = record.period
    if len(stretch) != len(record.time) or np.std(stretch) < 1e-3:
        raise IdentificationError("the cable hardly stretches in this record: load it more, as by hopping.")
    span = round(window / period)
    x = np.linspace(0.0, 1.0, span + 1)
    length = span * period
    bump = np.sin(np.pi * x) ** 4
    slope = 4.0 * np.pi * np.sin(np.pi * x) ** 3 * np.cos(np.pi * x) / length
    bend = (12.0 * np.sin(np.pi * x) ** 2 * np.cos(np.pi * x) ** 2 - 4.0 * np.sin(np.pi * x) ** 4) * (
        np.pi / length
    ) ** 2

    def windowed(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return np.convolve(values, weights[::-1], mode="valid")[:: max(span // 4, 1)]

    # a command is held until the next sample, so it acts half a period later than its sample says
    delivered = (record.command + bias) / motor_constant
    held = 0.5 * (delivered + np.concatenate([delivered[:1], delivered[:-1]]))
    known = (
        windowed(held, bump)
        + friction * windowed(record.position, slope)
        - motor_inertia * windowed(record.position, bend)
    )
    columns = np.stack([windowed(stretch, bump), -windowed(stretch, slope)], axis=1)
    stiffness, damping = np.linalg.lstsq(columns, known, rcond=None)[0]
    return Cable(float(stiffness), float(damping))
