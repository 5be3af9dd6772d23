"""The block bootstrap: resampling of blocks, since errors are autocorrelated within a block."""

from __future__ import annotations

import numpy as np

BOOTSTRAP_DRAWS = 300  # for an interval of a delay or shift


def block_weights(blocks: int, draws: int, rng: np.random.Generator) -> np.ndarray:
    """How often each block is in each resampled data set (draws, blocks), of as many blocks as there are."""
    return rng.multinomial(blocks, np.full(blocks, 1.0 / blocks), draws)
