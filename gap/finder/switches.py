"""The contact switches of a robot on legs, held against the feet that its legs put down.

What a switch says is 0 or 1, so the share of the time in which it and a foot differ is a squared error. As with any
column, another reading is what is meant where it brings that error to half (:data:`OTHER_ERROR_RATIO`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from ...envs.engine.imu import PREFIX
from ..checks.imu import IMU
from ..checks.signal import BOOTSTRAP_DRAWS, OTHER_ERROR_RATIO, block_weights
from ..log.finding import Finding
from ..log.types import Array


class Switched:
    """Switches beside feet: how often each differs from each.

    Attributes:
        names: of the switches (s,), and of the feet that they are believed to be on.
        off: share of the time in which a switch (rows) differs from a foot (s, s).
        down: share of the time in which each foot is down (s,).
        stuck: whether a switch never changes (s,).
        closed: whether it was ever closed (s,).
    """

    def __init__(self, names: Sequence[str], blocks: Sequence[tuple[Array, Array]]) -> None:
        """Count.

        Args:
            names: of the switches.
            blocks: of the log: what the switches said, and what the feet did (n, s): 1 closed or down, else 0.
        """
        self.names = tuple(names)
        both = [np.concatenate(part) for part in zip(*blocks, strict=True)]
        self.down, self.closed = both[1].mean(axis=0), np.asarray(both[0].any(axis=0))
        self.stuck = np.ptp(both[0], axis=0) == 0.0
        counts = np.array([len(said) for said, _ in blocks], float)
        differ = np.array([np.abs(said[:, :, None] - feet[:, None]).sum(axis=0) for said, feet in blocks])
        self.off = differ.sum(axis=0) / counts.sum()
        weights = block_weights(len(blocks), BOOTSTRAP_DRAWS, np.random.default_rng(0))
        self._drawn = np.tensordot(weights, differ, axes=(1, 0)) / (weights @ counts)[:, None, None]
        self._own = np.diagonal(self._drawn, axis1=1, axis2=2)

    def agreement(self) -> float:
        """Share of the time in which switches and their feet agree, mean of all."""
        return float(1.0 - np.diag(self.off).mean())

    def findings(self) -> list[Finding]:
        """Switches that never change, are inverted, or are on other feet than is believed."""
        changing = [k for k in range(len(self.names)) if not self.stuck[k]]
        found = [self._stuck(k, changing) for k in range(len(self.names)) if self.stuck[k]]
        inverted = [k for k in changing if _half(1.0 - self._own[:, k], self._own[:, k])]
        found += [self._inverted(k) for k in inverted]
        plain = [k for k in changing if k not in inverted]
        return [*(item for item in found if item is not None), *self._elsewhere(plain)]

    def _stuck(self, k: int, changing: Sequence[int]) -> Finding | None:
        usual = np.median(self._own[:, [*changing]], axis=1) if changing else 1.0 - self._own[:, k]
        if not _half(usual, self._own[:, k]):
            return None
        state, foot = ("opens", 1.0 - self.down[k]) if self.closed[k] else ("closes", self.down[k])
        where = "lift its foot" if self.closed[k] else "stand on its foot"
        return self._finding(
            "imu.switch_stuck",
            k,
            f"Contact switch {self.names[k]} never {state}, and the legs {where} in {100.0 * foot:.0f} % of the time: "
            "its wire, the switch, or its threshold.",
        )

    def _inverted(self, k: int) -> Finding:
        return self._finding(
            "imu.switch_inverted",
            k,
            f"Contact switch {self.names[k]} is closed where its foot is in the air: it differs from the legs in "
            f"{100.0 * self.off[k, k]:.0f} % of the time. Read it the other way round.",
        )

    def _elsewhere(self, plain: Sequence[int]) -> list[Finding]:
        if not plain:
            return []
        cost = self.off[np.ix_(plain, plain)].copy()
        np.fill_diagonal(cost, OTHER_ERROR_RATIO * np.diag(cost))
        pairs = [(plain[row], plain[column]) for row, column in zip(*linear_sum_assignment(cost), strict=True)]
        moved = [(k, foot) for k, foot in pairs if k != foot and _half(self._drawn[:, k, foot], self._own[:, k])]
        if not moved:
            return []
        rows = ", ".join(
            f"{self.names[k]} is on the foot of {self.names[foot]} (they differ in {100.0 * self.off[k, foot]:.0f} % "
            f"of the time, and {100.0 * self.off[k, k]:.0f} % of its own)"
            for k, foot in moved
        )
        return [self._finding("imu.switches", moved[0][0], f"Contact switches are swapped: {rows}.")]

    def _finding(self, code: str, k: int, sentence: str) -> Finding:
        return Finding(code, "warning", IMU, f"base.{PREFIX}{self.names[k]}", sentence, data_error=True)


def _half(less: Array, than: Array) -> bool:
    """Whether one error is at most half of another, and surely smaller, over the draws of both (d,)."""
    return bool(np.mean(less - OTHER_ERROR_RATIO * than) < 0.0 and np.quantile(less - than, 0.975) < 0.0)
