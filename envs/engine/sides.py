"""Sums over many coordinates, in one order at any batch size, so that batches equal single environments to the bit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...actuators import Drivetrain


class Sides:
    """Positions and speeds of all coordinates at once, each summed in one order at any batch size."""

    def __init__(self, drivetrain: Drivetrain, names: Sequence[str], side: str) -> None:
        model = drivetrain.model
        weights = np.stack([drivetrain.position(name, np.eye(model.nq), side) for name in names])
        speeds = np.stack([drivetrain.speed(name, np.eye(model.nv), side) for name in names])
        self._positions, self._speeds = self._terms(weights), self._terms(speeds)

    @staticmethod
    def _terms(weights: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        order = np.argsort(weights == 0.0, axis=1, kind="stable")
        count = int((weights != 0.0).sum(axis=1).max())
        return [(order[:, k], np.take_along_axis(weights, order[:, k : k + 1], axis=1)[:, 0]) for k in range(count)]

    def __call__(self, qpos: np.ndarray) -> np.ndarray:
        """Positions (b, coordinates)."""
        return self._sum(self._positions, qpos)

    def speed(self, qvel: np.ndarray) -> np.ndarray:
        """Speeds (b, coordinates)."""
        return self._sum(self._speeds, qvel)

    @staticmethod
    def _sum(terms: list[tuple[np.ndarray, np.ndarray]], values: np.ndarray) -> np.ndarray:
        columns, weights = terms[0]
        total = values[:, columns] * weights
        for columns, weights in terms[1:]:
            total += values[:, columns] * weights
        return total
