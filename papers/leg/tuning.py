"""Tunes the leg's PID as well as a search can: ``python -m sealegs.papers.leg.tuning [evaluations]``.

Nelder-Mead over the logarithms of all nine gains and the preview of the goals, from several starts, for the smallest
root mean square of the foot's error on twelve random paths; the result is told on 64 others. The gains of
``configs/actuator/silo4.yaml`` and the ``preview`` of docs/leg.md are its result.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.optimize import minimize

from ...envs.leg.robot import JOINTS
from .control import errors, paths, rms, with_gains

KEYS: tuple[str, ...] = ("gain", "integral", "damping")
STARTS = ((60.0, 300.0, 0.8), (200.0, 2000.0, 2.0))  # duty per rad, per rad s, s per rad
MOST = np.log([9e3, 9e5, 900.0] * 3)
MILLISECOND = 1e-3


def gains_of(point: np.ndarray) -> tuple[dict[str, dict[str, float]], float]:
    """Gains by joint and preview [s] at a point of the search."""
    values = np.exp(np.minimum(point[:-1], MOST)).reshape(3, 3)
    gains = {name: dict(zip(KEYS, row.tolist(), strict=True)) for name, row in zip(JOINTS, values, strict=True)}
    return gains, MILLISECOND * float(point[-1])


def tune(evaluations: int) -> tuple[dict[str, dict[str, float]], float]:
    """The best gains and preview [s] found with so many simulations of each start."""
    command, best, least = paths(12, seed=1), None, np.inf

    def cost(point: np.ndarray) -> float:
        nonlocal best, least
        gains, preview = gains_of(point)
        value = 1e3 * rms(errors(with_gains(gains), command, 1.6, preview))
        if value < least:
            best, least = point.copy(), value
            print(f"{value:.4f} mm, preview {1e3 * preview:.2f} ms, {gains}", flush=True)
        return min(value, 1e3)

    for start in STARTS:
        point = np.append(np.log(np.array(start * 3)), 1.0)
        around = np.vstack([point, *(point + step for step in np.diag([0.7, 1.0, -0.7] * 3 + [2.0]))])
        minimize(cost, point, method="Nelder-Mead", options={"maxfev": evaluations, "initial_simplex": around})
    assert best is not None
    return gains_of(best)


def main() -> None:
    """Tune, and tell what comes out on paths that the search has not seen."""
    gains, preview = tune(int(sys.argv[1]) if len(sys.argv) > 1 else 300)
    found = errors(with_gains(gains), paths(64, seed=2), 3.0, preview)
    print(f"on 64 other paths: {1e3 * rms(found):.4f} mm rms, {1e3 * found.max():.3f} mm at most")
    for name, values in gains.items():
        print(name, {key: round(value, 4) for key, value in values.items()})
    print(f"preview: {preview:.5f}")


if __name__ == "__main__":
    main()
