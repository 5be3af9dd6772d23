"""Tunes the leg's PID: ``python -m sealegs.papers.leg.tuning [evaluations]``.

Nelder-Mead over the logarithms of all nine gains and the preview of the goals, from several starts, for the smallest
root mean square of the foot's error on twelve random paths; the result is told on 64 others. The gains of
``configs/actuator/silo4.yaml`` are its result; the preview that it found is none. They are no minimum:
:func:`further` goes on from them.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping

import numpy as np
from scipy.optimize import minimize

from ...actuators import Chain
from ...envs.leg.robot import JOINTS, chains_of
from .control import errors, paths, rms, with_gains

KEYS: tuple[str, ...] = ("gain", "integral", "damping")
STARTS = ((60.0, 300.0, 0.8), (200.0, 2000.0, 2.0))  # duty per rad, per rad s, s per rad
MOST = np.log([9e3, 9e5, 900.0] * 3)
MILLISECOND = 1e-3
OWN_SECONDS = 1.6  # that a path is followed in a search
OTHER_SECONDS = 3.0  # that others are, at most
LARGE = np.array([0.7, 1.0, -0.7] * 3 + [2.0])  # first steps of a search: of log gains, and of the preview [ms]
SMALL = np.array([0.2, 0.3, -0.2] * 3 + [0.5])  # of one that goes on


def gains_of(point: np.ndarray) -> tuple[dict[str, dict[str, float]], float]:
    """Gains by joint and preview [s] at a point of the search."""
    values = np.exp(np.minimum(point[:-1], MOST)).reshape(3, 3)
    gains = {name: dict(zip(KEYS, row.tolist(), strict=True)) for name, row in zip(JOINTS, values, strict=True)}
    return gains, MILLISECOND * float(point[-1])


def own_paths() -> np.ndarray:
    """The paths that gains are tuned on (12, 7)."""
    return paths(12, seed=1)


def other_paths() -> np.ndarray:
    """Paths that no search has seen (64, 7)."""
    return paths(64, seed=2)


def point_of(chains: Mapping[str, Chain]) -> np.ndarray:
    """The point of the search at the gains of these chains, without preview."""
    gains = [chains[name].value(f"position_pi.{key}") for name in JOINTS for key in KEYS]
    return np.append(np.log(gains), 0.0)


def further(evaluations: int) -> tuple[dict[str, dict[str, float]], float]:
    """The best gains and preview [s] that so many simulations find from the shipped gains on."""
    return gains_of(_search(point_of(chains_of("silo4")), SMALL, evaluations))


def _search(point: np.ndarray, steps: np.ndarray, evaluations: int) -> np.ndarray:
    """The best point that Nelder-Mead finds in so many simulations."""
    command, best, least = own_paths(), point, np.inf

    def cost(trial: np.ndarray) -> float:
        nonlocal best, least
        gains, preview = gains_of(trial)
        value = 1e3 * rms(errors(with_gains(gains), command, OWN_SECONDS, preview))
        if value < least:
            best, least = trial.copy(), value
        return min(value, 1e3)

    around = np.vstack([point, *(point + step for step in np.diag(steps))])
    minimize(cost, point, method="Nelder-Mead", options={"maxfev": evaluations, "initial_simplex": around})
    return best


def tune(evaluations: int) -> tuple[dict[str, dict[str, float]], float]:
    """The best gains and preview [s] found with so many simulations of each start."""
    starts = (np.append(np.log(np.array(start * 3)), 1.0) for start in STARTS)
    found = [_search(point, LARGE, evaluations) for point in starts]

    def cost(point: np.ndarray) -> float:
        gains, preview = gains_of(point)
        return rms(errors(with_gains(gains), own_paths(), OWN_SECONDS, preview))

    return gains_of(min(found, key=cost))


def main() -> None:
    """Tune, and tell what comes out on paths that the search has not seen."""
    gains, preview = tune(int(sys.argv[1]) if len(sys.argv) > 1 else 300)
    found = errors(with_gains(gains), other_paths(), 3.0, preview)
    print(f"on 64 other paths: {1e3 * rms(found):.4f} mm rms, {1e3 * found.max():.3f} mm at most")
    for name, values in gains.items():
        print(name, {key: round(value, 4) for key, value in values.items()})
    print(f"preview: {preview:.5f}")


if __name__ == "__main__":
    main()
