"""Numbers that look drawn and follow from a key, a number and a column: alike in batches of any size, at any time."""

from __future__ import annotations

import numpy as np

KEYS = 2**53  # that can be told apart


def key_of(uniform: np.ndarray) -> np.ndarray:
    """Keys (...) from uniform numbers in [0, 1)."""
    return (np.asarray(uniform) * KEYS).astype(np.uint64)


def uniform(key: np.ndarray, number: np.ndarray, column: int | np.ndarray) -> np.ndarray:
    """Uniform in [0, 1) (...), where the three are broadcast."""
    step = np.uint64(0x9E3779B97F4A7C15)
    with np.errstate(over="ignore"):
        value = _mixed(np.asarray(key, np.uint64) + step)
        value = _mixed(value + np.asarray(number).astype(np.int64).astype(np.uint64) * step)
        value = _mixed(value + np.asarray(column + 1).astype(np.uint64) * step)
    return (value >> np.uint64(11)) / float(KEYS)


def normal(key: np.ndarray, number: np.ndarray, columns: int) -> np.ndarray:
    """Standard normal (..., columns), from the uniform numbers of twice as many columns (Box and Muller)."""
    drawn = uniform(np.asarray(key)[..., None], np.asarray(number)[..., None], np.arange(2 * columns))
    return np.sqrt(-2.0 * np.log1p(-drawn[..., 0::2])) * np.cos(2.0 * np.pi * drawn[..., 1::2])


def _mixed(value: np.ndarray) -> np.ndarray:
    """SplitMix64's output function (Steele, Lea and Flood, 2014)."""
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))
