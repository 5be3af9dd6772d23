"""Signals of a log: quantisation, noise, derivatives on the actual time stamps, and delays between signals."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..log.types import Array

BOOTSTRAP_DRAWS = 300  # for an interval of a delay or shift
ERROR_BLOCK = 1.0  # [s] errors closer than this are taken as one observation, since they are not independent
Z95 = NormalDist().inv_cdf(0.975)  # half of a 95 % interval of normal errors, in standard deviations
NORMAL_OVER_MEDIAN = 1.0 / NormalDist().inv_cdf(0.75)  # standard deviation over the median size, of normal errors


def block_weights(blocks: int, draws: int, rng: np.random.Generator) -> np.ndarray:
    """How often each block is in each resampled data set (draws, blocks), of as many blocks as there are."""
    return rng.multinomial(blocks, np.full(blocks, 1.0 / blocks), draws)


DERIVATIVE_WINDOW = 0.05
"""Length of the local polynomial fits [s]: short against servo motion, long against encoder noise."""
LAG_REACH = 0.06
"""Largest delay or advance of a column that is looked for [s]."""
LAG_STEP = 2e-3  # [s] between two that are tried
LAG_BLOCKS = 24
MIN_STAY_SECONDS = 0.3  # [s] for which a joint must stay away from its goal: a reversal or a dead band takes less
OTHER_ERROR_RATIO = 0.5  # of the squared error, to which another reading or column must bring it to be what is meant
FOLLOWS_SHARE = 0.9  # of a column's variance, that another must explain for it to be what this one follows
ANOTHER_UNIT_RATIO = 3.0
"""Ratio of two columns beyond which one is not badly calibrated but in another unit, or of something else: assumed,
between what wrong numbers of a machine make and the nearest other unit, a turn of 2 pi."""
AT_LIMIT = 0.98  # of the largest effort, from which it may be at its limit
MIN_SAMPLES = 100  # of a column, from which it is judged
MIN_NOISE_SAMPLES = 20  # samples of a piece from which its noise can be told
_BLOCK_SAMPLES = 1 << 15


def same_unit(ratio: float) -> bool:
    """Whether two columns of this ratio may be in one unit."""
    return 1.0 / ANOTHER_UNIT_RATIO < ratio < ANOTHER_UNIT_RATIO


def quantisation_step(values: Array) -> float:
    """Return the step of the lattice that the values lie on, 0 where they lie on none."""
    levels = np.unique(values[np.isfinite(values)])
    if len(levels) < 3:
        return 0.0
    scale = float(np.max(np.abs(levels)))
    gaps = np.diff(levels)
    gaps = gaps[gaps > max(1e-6 * scale, 1e-12)]  # float32 logs carry rounding of their own
    if len(gaps) < 2:
        return 0.0
    step = float(np.median(gaps[gaps < 1.5 * gaps.min()]))
    multiples = gaps / step
    on_lattice = np.abs(multiples - np.round(multiples)) < 0.02 * np.maximum(multiples, 1.0)
    # A continuous signal has gaps of every size: its smallest ones explain no other.
    return step if on_lattice.mean() > 0.9 and step > 1e-5 * (levels[-1] - levels[0]) else 0.0


def derivatives(time: Array, values: Array, window: float = DERIVATIVE_WINDOW) -> tuple[Array, Array, Array]:
    """Return smoothed value, first and second derivative of ``values``, each (n,), by local cubic least squares.

    The fits use the actual time stamps (Savitzky-Golay on an irregular clock). The window holds at least 7 samples.
    """
    period = float(np.median(np.diff(time)))
    half = min(max(round(0.5 * window / period), 3), (len(time) - 1) // 2)
    order = min(3, 2 * half)
    width = 2 * half + 1
    scale = half * period
    out = np.empty((3, len(time)))
    windows_t, windows_x = sliding_window_view(time, width), sliding_window_view(values, width)
    for start in range(0, len(windows_t), _BLOCK_SAMPLES):
        part = slice(start, start + _BLOCK_SAMPLES)
        centre = time[half : len(time) - half][part]
        fit = _local_fit((windows_t[part] - centre[:, None]) / scale, windows_x[part], order)
        out[:, half + start : half + start + len(centre)] = fit[:, :3].T
    for edge, centres in ((0, np.arange(half)), (len(windows_t) - 1, np.arange(len(time) - half, len(time)))):
        local = (windows_t[edge][None, :] - time[centres][:, None]) / scale
        out[:, centres] = _local_fit(local, np.broadcast_to(windows_x[edge], local.shape), order)[:, :3].T
    return out[0], out[1] / scale, 2.0 * out[2] / scale**2


def _local_fit(t: Array, x: Array, order: int) -> Array:
    powers = np.stack([t**k for k in range(order + 1)], axis=-1)
    gram = powers.transpose(0, 2, 1) @ powers
    right = powers.transpose(0, 2, 1) @ x[..., None]
    fit = np.linalg.solve(gram, right)[..., 0].astype(np.float64)
    return fit if order >= 2 else np.pad(fit, ((0, 0), (0, 2 - order)))


CENTRE_WEIGHTS = {3: 0.567, 4: 0.417}
"""Weight of the middle sample in the local fit to it and so many neighbours on each side: the fit follows that part."""


def high_frequency_noise(time: Array, values: Array, *, half: int = 4, jumps: bool = False) -> float:
    """Return the standard deviation of what a local polynomial cannot follow, over the samples where the signal moves.

    Args:
        time, values: of the column (n,).
        half: neighbours on either side that the polynomial is fitted to, of :data:`CENTRE_WEIGHTS`.
        jumps: whether the column jumps often, as a height does on impacts: the median counts then.
    """
    if len(values) < 16:
        return 0.0
    window = (2 * half + 1) * float(np.median(np.diff(time)))
    smooth, _, _ = derivatives(time, values, window)
    residual = (values - smooth)[half:-half]
    moving = np.abs(values[2 * half :] - values[: -2 * half]) > 0
    residual = residual[moving] if moving.sum() > 50 else residual
    if jumps:
        return NORMAL_OVER_MEDIAN * float(np.median(np.abs(residual))) / float(np.sqrt(1.0 - CENTRE_WEIGHTS[half]))
    # trimmed: impacts and reversals are no noise
    residual = residual[np.abs(residual) <= np.quantile(np.abs(residual), 0.99)]
    return float(np.sqrt(np.mean(residual**2) / (1.0 - CENTRE_WEIGHTS[half])))


def sample_noise(time: Array, values: Array, *, half: int = 4, jumps: bool = False) -> float:
    """Return the rms error of one sample of a column: quantisation, or the faster noise where that is larger.

    Args:
        time, values, half, jumps: as of :func:`high_frequency_noise`.
    """
    faster = high_frequency_noise(time, values, half=half, jumps=jumps)
    return max(quantisation_step(values) / float(np.sqrt(12.0)), faster)


def typical_noise(time: Array, values: Array, starts: np.ndarray) -> float:
    """Return the median of :func:`sample_noise` over pieces of a column; missing samples are left out.

    Args:
        time, values: of all pieces one behind the other (n,).
        starts: first sample of each piece and the end of the last (u + 1,).
    """
    noises = []
    for a, b in itertools.pairwise(starts):
        good = np.isfinite(values[a:b])
        if good.sum() > MIN_NOISE_SAMPLES:
            noises.append(sample_noise(time[a:b][good], values[a:b][good]))
    return float(max(np.median(noises), 1e-9)) if noises else 1e-9


@dataclass(frozen=True)
class Lag:
    """How late a column is of the signals that explain it.

    Attributes:
        seconds, low, high: best delay and its 95 % block bootstrap interval [s]; positive: the column is late.
        coefficients: of the signals at the best delay, the last one the constant.
        spread: bootstrap standard deviation of the coefficients.
        coefficients_now: of the signals without delay.
        r2: explained variance at the best delay.
        r2_now: explained variance without delay.
    """

    seconds: float
    low: float
    high: float
    coefficients: Array
    spread: Array
    coefficients_now: Array
    r2: float
    r2_now: float


def fit_lag(
    time: Array,
    column: Array,
    signals: list[Array],
    keep: np.ndarray | None = None,
    reach: float = LAG_REACH,
) -> Lag | None:
    """Regress ``column`` on delayed ``signals`` and a constant; return the delay that explains it best.

    Delays are fractional: signals are interpolated at shifted times. Signals and column must be smooth, because
    interpolation between samples averages noise, which would favour delays of half a sample.

    Args:
        keep: samples that count, (n,) bool.
        reach: largest delay or advance tried [s].

    Returns:
        None where too few samples count or the column does not vary.
    """
    grams = lag_grams(time, column, signals, keep, reach)
    return None if grams is None else solve_lag(grams, reach)


def lag_grams(
    time: Array, column: Array, signals: list[Array], keep: np.ndarray | None = None, reach: float = LAG_REACH
) -> Array | None:
    """Return the Gram matrices of `fit_lag`, (delays, blocks, k + 2, k + 2): signals, constant and column.

    Those of several runs may be joined along the blocks and solved together.
    """
    inside = (time > time[0] + reach) & (time < time[-1] - reach) & np.isfinite(column)
    inside &= np.logical_and.reduce([np.isfinite(signal) for signal in signals])
    if keep is not None:
        inside &= keep
    index = np.flatnonzero(inside)
    if len(index) < 20 * (len(signals) + 1) or np.ptp(column[index]) == 0.0:
        return None
    blocks = min(LAG_BLOCKS, len(index) // 10)
    starts = (np.arange(blocks) * len(index)) // blocks
    delays = _delays(reach)
    size = len(signals) + 2
    grams = np.empty((len(delays), blocks, size, size))
    rows = np.ones((size, len(index)))
    rows[-1] = column[index]
    for at, delay in enumerate(delays):
        for row, signal in enumerate(signals):
            rows[row] = np.interp(time[index] - delay, time, signal)
        for i in range(size):
            grams[at, :, i, :] = np.add.reduceat(rows * rows[i], starts, axis=1).T
    return grams


def solve_lag(grams: Array, reach: float = LAG_REACH) -> Lag:
    """Return the best delay for the Gram matrices of `lag_grams`, with an interval from resampling their blocks."""
    delays = _delays(reach)
    blocks = grams.shape[1]
    scale = np.sqrt(np.maximum(grams[len(delays) // 2].sum(axis=0).diagonal(), 1e-300))
    grams = grams / (scale[:, None] * scale)
    rng = np.random.default_rng(0)
    weights = np.vstack([np.ones(blocks), block_weights(blocks, BOOTSTRAP_DRAWS, rng)])
    total = np.tensordot(weights, grams, axes=(1, 1))
    ridge = 1e-9 * np.eye(len(scale) - 1)
    fit = np.linalg.solve(total[..., :-1, :-1] + ridge, total[..., :-1, -1:])[..., 0]
    left = total[..., -1, -1] - (fit * total[..., :-1, -1]).sum(axis=-1)
    best = np.argmin(left, axis=1)
    draw = np.arange(len(weights))
    inner = np.clip(best, 1, len(delays) - 2)
    before, here, after = left[draw, inner - 1], left[draw, inner], left[draw, inner + 1]
    curvature = before - 2 * here + after
    shift = np.clip(0.5 * (before - after) / np.where(curvature > 0, curvature, np.inf), -1, 1)
    seconds = delays[inner] + shift * (delays[1] - delays[0])
    variance = total[0, :, -1, -1] - total[0, :, -2, -1] ** 2 / total[0, :, -2, -2]
    r2 = 1.0 - left[0] / np.maximum(variance, 1e-300)
    back = scale[-1] / scale[:-1]
    low, high = np.quantile(seconds[1:], (0.025, 0.975))
    return Lag(
        seconds=float(seconds[0]),
        low=float(low),
        high=float(high),
        coefficients=fit[0, best[0]] * back,
        spread=np.std(fit[draw[1:], best[1:]], axis=0) * back,
        coefficients_now=fit[0, len(delays) // 2] * back,
        r2=float(r2[best[0]]),
        r2_now=float(r2[len(delays) // 2]),
    )


def _delays(reach: float) -> Array:
    return np.linspace(-reach, reach, 2 * round(reach / LAG_STEP) + 1)
