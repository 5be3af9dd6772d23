"""The torque that a measured motion needs against the torque that was logged, and how far the two are apart in time.

The equation of motion is tested in its weak form: both sides are averaged with a smooth window, and derivatives are
moved from the noisy position onto the window by partial integration, so nothing measured is ever differentiated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..log.types import Array
from .bootstrap import block_weights

STEP = 1e-3  # [s] grid that logs are brought to
WINDOW = 0.12  # [s] of the weak form: short against the motion, long against the noise of positions
SHIFTS = np.arange(-40, 41) * STEP  # [s] tried: the motion of now against the torque of that much earlier
BLOCK = 0.5  # [s] errors closer than this are taken as one observation
SLIP = 0.05  # [rad/s] over which dry friction turns around
DRAWS = 300
SYSTEMATIC = 2e-3
"""What the shift is off by on perfect data [s] (simulated logs: smoothing moves the reversals of friction)."""
GAP = 0.03  # [s] without torque that a straight line bridges: a quarter of the window
EVERY = 5  # grid points between two rows: neighbours within the window say the same
TERMS = ("inertia [believed]", "gravity torque [believed]", "coulomb [N.m]", "viscous [N.m.s/rad]", "offset [N.m]")


@dataclass(frozen=True, eq=False)
class TorqueBalance:
    """Rows of the balance ``torques = terms @ numbers`` of one or several runs.

    Attributes:
        terms: torque of the believed inertia and of the believed gravity [N.m], direction, speed and one, averaged
            (m, 5).
        torques: logged torque, averaged, at every one of :data:`SHIFTS` (m, shifts).
        block: number of the block of each row (m,), counted from zero.
        run: index of the run of each row (m,).
    """

    terms: Array
    torques: Array
    block: np.ndarray
    run: np.ndarray

    def only(self, rows: np.ndarray) -> TorqueBalance:
        """The balance of some rows: what is not in it cannot be seen by accident."""
        _, block = np.unique(self.block[rows], return_inverse=True)
        return TorqueBalance(self.terms[rows], self.torques[rows], block, self.run[rows])

    def fit(self, shift: int) -> Array:
        """Numbers of :data:`TERMS` that explain the torque at a shift best (5,)."""
        return np.asarray(np.linalg.lstsq(self.terms, self.torques[:, shift], rcond=None)[0], dtype=np.float64)

    def r2(self, shift: int) -> float:
        """Share of the torque's variance that the best numbers explain at a shift."""
        torque = self.torques[:, shift]
        rest = torque - self.terms @ self.fit(shift)
        return 1.0 - float(np.var(rest) / max(np.var(torque), 1e-300))


@dataclass(frozen=True)
class Shift:
    """How far the torque column is apart from the motion columns.

    Attributes:
        seconds: positive where the column is ahead of the motion, negative where it is late [s].
        low, high: 95 % interval from resampled blocks [s].
        index: of the nearest of :data:`SHIFTS`.
        same_side: share of the resamplings with this sign.
    """

    seconds: float
    low: float
    high: float
    index: int
    same_side: float

    @property
    def size(self) -> tuple[float, float]:
        """95 % interval of the absolute value, widened by :data:`SYSTEMATIC` [s].

        It does not cover the choice of :data:`WINDOW`.
        """
        low, high = sorted((abs(self.low), abs(self.high)))
        return (max(low - SYSTEMATIC, 0.0) if self.low * self.high > 0.0 else 0.0), high + SYSTEMATIC


AT_ONCE = int(np.argmin(np.abs(SHIFTS)))
"""Index of no shift."""


def torque_balance(
    runs: Sequence[tuple[Array, Array, Array]], loads: Sequence[tuple[float, float]]
) -> TorqueBalance | None:
    """Return the balance of all runs together.

    Args:
        runs: time [s], position [rad] and torque [N.m] of each, all (n,); torque is NaN where none was logged, and no
            row reaches into more than :data:`GAP` of that.
        loads: believed inertia [kg.m2] and gravity torque at a quarter turn [N.m] of each.

    Returns:
        None where all runs are too short.
    """
    shortest = 4.0 * (WINDOW + len(SHIFTS) * STEP)
    pieces = {
        k: _weak_form(*run, *load)
        for k, (run, load) in enumerate(zip(runs, loads, strict=True))
        if run[0][-1] - run[0][0] > shortest
    }
    if not any(len(piece[2]) for piece in pieces.values()):
        return None
    terms, torques = (np.concatenate([piece[k] for piece in pieces.values()]) for k in (0, 1))
    _, block = np.unique(np.concatenate([p[2] + 100_000 * k for k, p in pieces.items()]), return_inverse=True)
    return TorqueBalance(terms, torques, block, np.repeat(list(pieces), [len(piece[2]) for piece in pieces.values()]))


def torque_shift(balance: TorqueBalance) -> Shift:
    """Return the shift between torque and motion: the centre of what resampled blocks say, since one pass over a few
    seconds hangs on single manoeuvres.
    """
    rng = np.random.default_rng(0)
    count = int(balance.block.max()) + 1
    rows = np.concatenate([balance.terms, balance.torques], axis=1)
    order = np.argsort(balance.block, kind="stable")
    starts = np.searchsorted(balance.block[order], np.arange(count))
    grams = np.stack([part.T @ part for part in np.split(rows[order], starts[1:])])
    weights = block_weights(count, DRAWS, rng)
    drawn = np.array([SHIFTS[_best_shift(np.einsum("b,bij->ij", weight, grams))] for weight in weights])
    seconds = float(np.median(drawn))
    low, high = np.percentile(drawn, [2.5, 97.5])
    same = float(np.mean(np.sign(drawn) == np.sign(seconds))) if seconds else 0.0
    return Shift(seconds, float(low), float(high), int(np.argmin(np.abs(SHIFTS - seconds))), same)


def _best_shift(gram: Array) -> int:
    """Index of the shift that leaves least of the torque's own size, from the Gram matrix of terms and torques."""
    k = len(TERMS)
    scale = np.sqrt(np.maximum(np.diag(gram)[:k], 1e-300))
    inner = gram[:k, :k] / np.outer(scale, scale) + 1e-9 * np.eye(k)
    cross = gram[:k, k:] / scale[:, None]
    size = np.maximum(np.diag(gram)[k:], 1e-300)
    explained = (cross * np.linalg.solve(inner, cross)).sum(axis=0)
    return int(np.argmin((size - explained) / size))


def _weak_form(
    time: Array, position: Array, torque: Array, inertia: float, gravity: float
) -> tuple[Array, Array, np.ndarray]:
    """Terms (m, 5), torque at every shift (m, shifts) and block (m,) of one run."""
    torque = _bridged(time, torque)
    grid = np.arange(time[0], time[-1], STEP)
    angle = np.interp(grid, time, position)
    half = int(WINDOW / STEP / 2)
    s = np.linspace(-1.0, 1.0, 2 * half + 1)
    width = half * STEP
    window = (1 - s**2) ** 4
    first = -8 * s * (1 - s**2) ** 3 / width
    second = (-8 * (1 - s**2) ** 3 + 48 * s**2 * (1 - s**2) ** 2) / width**2

    def averaged(values: Array, kernel: Array) -> Array:
        return np.convolve(values, kernel[::-1], "same") / window.sum()

    speed = -averaged(angle, first)
    columns = [
        inertia * averaged(angle, second),
        gravity * averaged(np.sin(angle), window),
        averaged(np.tanh(speed / SLIP), window),
        speed,
        np.ones_like(grid),
    ]
    shifted = np.stack([averaged(np.interp(grid - shift, time, torque), window) for shift in SHIFTS], axis=1)
    inside = np.arange(half + len(SHIFTS), len(grid) - half - len(SHIFTS), EVERY)
    inside = inside[np.isfinite(shifted[inside]).all(axis=1)]  # a missing torque makes all that it touches NaN
    block = ((grid[inside] - grid[0]) / BLOCK).astype(int)
    return np.stack(columns, axis=1)[inside], shifted[inside], block


def _bridged(time: Array, torque: Array) -> Array:
    """The torque (n,) with straight lines over missing values, NaN where they last longer than :data:`GAP`."""
    known = np.flatnonzero(np.isfinite(torque))
    if len(known) == len(torque):
        return torque
    before = np.searchsorted(known, np.arange(len(torque)), side="right") - 1
    after = np.searchsorted(known, np.arange(len(torque)))
    near = (before >= 0) & (after < len(known))
    length = np.full(len(torque), np.inf)
    length[near] = time[known[after[near]]] - time[known[before[near]]]
    bridge = near & (length <= GAP)  # a known value lies between itself and itself
    out = np.full(len(torque), np.nan)
    if bridge.any():
        out[bridge] = np.interp(time[bridge], time[known], torque[known])
    return out
