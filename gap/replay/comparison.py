"""Channels of a joint compared: some sample by sample, others as means over groups of samples.

How much an error counts: squared while it is small against the noise, by its size beyond that. One jam, or one run that
went another way, then neither steers a fit nor decides between causes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

ROBUST = 6.0  # noise floors


def rms(error: np.ndarray) -> float:
    """Root of the mean square of an error (n,)."""
    return float(np.sqrt(np.mean(error**2)))


def robust_loss(error: np.ndarray) -> np.ndarray:
    """Loss of each error, which is in noise floors: nearly its square up to :data:`ROBUST`."""
    return 2.0 * ROBUST**2 * (np.sqrt(1.0 + (error / ROBUST) ** 2) - 1.0)


def robust_weight(error: np.ndarray) -> np.ndarray:
    """Slope of the loss over that of the square: 1 for small errors, falling beyond :data:`ROBUST`."""
    return 1.0 / np.sqrt(1.0 + (error / ROBUST) ** 2)


@dataclass(frozen=True, eq=False)
class Groups:
    """Groups of samples over which channels are averaged.

    Attributes:
        rows: samples that are averaged (r,).
        starts: where each group starts among them (g,).
        sizes: how many samples it has (g,).
    """

    rows: np.ndarray
    starts: np.ndarray
    sizes: np.ndarray

    @staticmethod
    def of(group: np.ndarray) -> Groups:
        """The groups by the number of each sample (n,), -1 where it is in none."""
        rows = np.flatnonzero(group >= 0)
        starts = np.flatnonzero(np.diff(group[rows], prepend=-1))
        return Groups(rows, starts, np.diff(np.append(starts, len(rows))))

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def first(self) -> np.ndarray:
        """First sample of each group (g,)."""
        return self.rows[self.starts]

    def means(self, signal: np.ndarray) -> np.ndarray:
        """Means (..., g) of a signal (..., n); NaN where one of its samples is missing."""
        chosen = signal[..., self.rows]
        return np.add.reduceat(chosen, self.starts, axis=-1) / self.sizes if len(self.rows) else chosen


@dataclass(frozen=True, eq=False)
class Comparison:
    """What is compared of a joint, and with what weight.

    Attributes:
        sampled, averaged: channels compared sample by sample, and as means over groups.
        measured: channels (n, 4), NaN where not logged.
        weight: one over the noise of each channel (4,), 0 where it does not count.
        reliability: factor on the weight of averaged channels (n, 4).
        judged: samples that count (n,).
        block: number of the block of each sample (n,).
        groups: of the averaged channels.
    """

    sampled: tuple[int, ...]
    averaged: tuple[int, ...]
    measured: np.ndarray
    weight: np.ndarray
    reliability: np.ndarray
    judged: np.ndarray
    block: np.ndarray
    groups: Groups

    def residual(self, simulated: np.ndarray, every: int = 1) -> np.ndarray:
        """Weighted errors (v, m) of simulated channels (v, n, 4).

        Of (every so many of) the judged samples, then of the groups of samples. What was not logged is zero.
        """
        rows = np.flatnonzero(self.judged)[::every]
        errors = [
            (simulated[:, rows, c] - self.measured[rows, c]) * self.weight[c]
            for c in self.sampled
            if self.weight[c] > 0.0
        ]
        first, means = self.groups.first, self.groups.means
        errors += [
            (means(simulated[:, :, c] - self.measured[:, c]) * (self.weight[c] * self.reliability[first, c]))[
                :, ::every
            ]
            for c in self.averaged
            if self.weight[c] > 0.0
        ]
        error = np.concatenate(errors, axis=1)
        return np.clip(np.where(np.isfinite(error), error, 0.0), -1e6, 1e6)

    @cached_property
    def blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Block of each entry of :meth:`residual` (m,), counted from zero, and entries per block (b,)."""
        parts = [self.block[self.judged] for c in self.sampled if self.weight[c] > 0.0]
        parts += [self.block[self.groups.first] for c in self.averaged if self.weight[c] > 0.0]
        _, number = np.unique(np.concatenate(parts), return_inverse=True)
        return number, np.bincount(number)
