"""The block bootstrap: resampling of blocks, since errors are autocorrelated within a block."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

BOOTSTRAP_DRAWS = 300  # for an interval of a delay or shift
BLOCK_SECONDS = 1.0  # [s] of the errors of an IMU, which are alike for shorter
Z95 = NormalDist().inv_cdf(0.975)  # half of a 95 % interval of normal errors, in standard deviations
NORMAL_OVER_MEDIAN = 1.0 / NormalDist().inv_cdf(0.75)  # standard deviation over the median size, of normal errors


def block_weights(blocks: int, draws: int, rng: np.random.Generator) -> np.ndarray:
    """How often each block is in each resampled data set (draws, blocks), of as many blocks as there are."""
    return rng.multinomial(blocks, np.full(blocks, 1.0 / blocks), draws)
