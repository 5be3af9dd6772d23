"""How much an error counts: squared while it is small against the noise, by its size beyond that.

One jam, or one run that went another way, then neither steers a fit nor decides between causes.
"""

from __future__ import annotations

import numpy as np

ROBUST = 6.0  # noise floors


def robust_loss(error: np.ndarray) -> np.ndarray:
    """Loss of each error, which is in noise floors: nearly its square up to :data:`ROBUST`."""
    return 2.0 * ROBUST**2 * (np.sqrt(1.0 + (error / ROBUST) ** 2) - 1.0)


def robust_weight(error: np.ndarray) -> np.ndarray:
    """Slope of the loss over that of the square: 1 for small errors, falling beyond :data:`ROBUST`."""
    return 1.0 / np.sqrt(1.0 + (error / ROBUST) ** 2)
