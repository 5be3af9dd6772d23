"""The temperature of a motor between the steps of its column, from the heat that its current brings."""

from __future__ import annotations

import numpy as np

COARSE = 0.5  # [K] step of a column from which the current tells more than the column
MOST_RANGE = 8.0  # [K] of a column; one that goes further shows the warming itself
TIMES = (3.0, 6.0, 12.0, 25.0, 50.0, 100.0, 200.0, 400.0)  # [s] in which heat leaves: of motors of servos, assumed
WITHIN = 0.6  # rms of the difference to the column, in parts of its step; rounding alone leaves 0.29
SHORTEST = 2.0  # [s] of a run below which nothing warms


def heated(time: np.ndarray, temperature: np.ndarray, current: np.ndarray | None) -> np.ndarray:
    """The temperature (n,) [degC] with what rounding hid of it, where current and column agree.

    The winding takes heat with the square of the current and loses it to its surroundings: ``dT/dt = a i^2 - (T - T0) /
    tau``. ``a``, ``T0`` and the start are fitted to the column, for each of a few ``tau``.

    Args:
        time: of the samples (n,) [s].
        temperature: as logged, in steps (n,) [degC].
        current: of the motor (n,) [A]; None where it was not logged.
    """
    if current is None or time[-1] - time[0] < SHORTEST:
        return temperature
    read, known = np.isfinite(temperature), np.isfinite(current)
    if read.sum() < 100 or known.mean() < 0.5:
        return temperature
    levels = np.unique(temperature[read])
    step = float(np.min(np.diff(levels))) if len(levels) > 1 else 1.0
    if step < COARSE or len(levels) < 2 or np.ptp(levels) > MOST_RANGE:
        return temperature
    heat = np.interp(time, time[known], current[known]) ** 2
    best, least = temperature, WITHIN * step
    for tau in TIMES:
        warm, start = _filtered(time, heat, tau), np.exp(-(time - time[0]) / tau)
        terms = np.stack([warm, np.ones(len(time)), start], axis=1)
        scale = np.maximum(np.abs(terms).max(axis=0), 1e-12)
        size = np.linalg.lstsq(terms[read] / scale, temperature[read], rcond=1e-6)[0] / scale
        estimate = terms @ size
        error = float(np.sqrt(np.mean((estimate - temperature)[read] ** 2)))
        if size[0] > 0.0 and error < least:
            best, least = estimate, error
    return best


def _filtered(time: np.ndarray, heat: np.ndarray, tau: float) -> np.ndarray:
    """Warming (n,) by heat (n,) that leaves within ``tau`` [s], from none."""
    kept = np.exp(-np.diff(time) / tau)
    out = np.zeros(len(time))
    level = 0.0
    for k, share in enumerate(kept):
        level = share * level + (1.0 - share) * heat[k]
        out[k + 1] = level
    return out
