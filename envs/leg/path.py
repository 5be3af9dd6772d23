"""Paths of the foot: straight lines to and fro, bang-bang in acceleration as the paper's (section 4.3)."""

from __future__ import annotations

import numpy as np

BOX_LOW, BOX_HIGH = np.array([0.20, -0.12, -0.28]), np.array([0.32, 0.12, -0.14])
"""Where paths begin and end, from the first joint [m]; assumed. All of it is within reach of the joints."""
SHORTEST = 0.06  # [m] way that a shorter line is given the time of


def share(phase: np.ndarray) -> np.ndarray:
    """Share of the way from the begin at a phase: 0 to 1 there, 1 to 2 back, and again."""
    back = np.abs(np.mod(phase, 2.0) - 1.0)  # 1 at the begin, 0 at the end
    return np.where(back > 0.5, 2.0 * (1.0 - back) ** 2, 1.0 - 2.0 * back**2)


def position(command: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Where the foot should be (n, 3) [m].

    Args:
        command: begin and end of the path [m], and the time that each way takes [s] (n, 7).
        time: since the start (n,) [s].
    """
    begin, end = command[:, :3], command[:, 3:6]
    return begin + (end - begin) * share(time / command[:, 6])[:, None]


def drawn(random: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Commands (m, 7) from uniform numbers (m, 6), and the mean speed of the foot (m,) [m/s]."""
    ends = np.concatenate([BOX_LOW, BOX_LOW]) + random * np.concatenate([BOX_HIGH - BOX_LOW] * 2)
    way = np.maximum(np.sqrt(np.square(ends[:, 3:] - ends[:, :3]).sum(axis=1)), SHORTEST)
    return np.concatenate([ends, (way / speed)[:, None]], axis=1)
