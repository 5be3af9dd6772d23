"""Stretches of samples in which something holds."""

from __future__ import annotations

import numpy as np


def stretches(holds: np.ndarray) -> list[tuple[int, int]]:
    """First sample and end of each stretch in which all of ``holds`` (n,) is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
