"""Where the believed model is right, no other may be wrong: what a new model must not do to stretches at the noise.

An effect that begins late, as an overload that trips, leaves the believed model exact until then. What stands in
for it lowers the error as a whole and spoils what was right, so it is not the cause.
"""

from __future__ import annotations

import numpy as np

from ..replay.problem import Problem

AT_NOISE = 1.2  # noise floors (rms of a block) up to which the believed model is right there
LEAST = 0.2  # of all blocks that must be so, for a model to be judged by them
HARM = 4.0  # noise floors (rms over these blocks) beyond which another model harms them: several times what is a match


def harm(problem: Problem, nominal: np.ndarray, handed: np.ndarray) -> float:
    """Error of a model where the believed one is at the noise, in the unit of the signal; 0 where it does no harm.

    Args:
        problem: all data.
        nominal, handed: channels of the believed model and of the other (n, 4).
    """
    errors = [problem.position_error(row) for row in (nominal, handed)]
    numbers, sizes = problem.blocks()
    return harm_of(errors[0], errors[1], numbers[: len(errors[0])], len(sizes), problem.noise)


def harm_of(nominal: np.ndarray, handed: np.ndarray, block: np.ndarray, blocks: int, noise: float) -> float:
    """:func:`harm` of errors (m,), by the block of each (m,)."""
    count = np.bincount(block, minlength=blocks)
    held = count > 0
    before, after = (np.bincount(block, error**2, blocks)[held] / count[held] for error in (nominal, handed))
    right = before <= (AT_NOISE * noise) ** 2
    if right.mean() < LEAST:
        return 0.0
    error = float(np.sqrt(np.average(after[right], weights=count[held][right])))
    return error if error > HARM * noise else 0.0
