"""Where the part kept for the test goes further than anything that was fitted, and errs for it."""

from __future__ import annotations

import numpy as np

from ..log.finding import Finding
from ..log.parts import TEST
from ..replay.problem import Problem
from ..search.settings import DEFAULT, SearchSettings


def unseen_range(
    problem: Problem, simulated: np.ndarray, joint: str, settings: SearchSettings = DEFAULT
) -> Finding | None:
    """Says so if only the test part reaches an angle, and the model is wrong in the pieces that do.

    A stop that the joint meets there alone is neither found nor excluded by what was fitted.

    Args:
        problem: all parts, judged by position; of any other there is nothing to say.
        simulated: columns of the extended model (n, 4).
        joint: its name.
        settings: of the search.
    """
    if problem.signal != ("position", "rad"):
        return None
    position = problem.measured[:, 0]
    error = simulated[:, 0] - position
    good = problem.judged & np.isfinite(error)
    sizes = np.diff(problem.starts)
    test = np.repeat([unit.part == TEST for unit in problem.units], sizes)
    low, high = position[good & ~test].min(), position[good & ~test].max()
    further = np.maximum(low - position, position - high)
    out = good & test & (further > settings.further * (high - low))
    piece = np.repeat(np.arange(len(sizes)), sizes)
    beyond = np.isin(piece, piece[out])
    if not out.any() or not (good & ~beyond).any():
        return None
    there, elsewhere = (float(np.sqrt(np.mean(error[rows] ** 2))) for rows in (good & beyond, good & ~beyond))
    if there <= settings.worse_there * elsewhere:
        return None
    furthest = float(position[out][np.argmax(further[out])])
    return Finding(
        "test.beyond", "note", joint, None,
        f"Only in the part kept for the test does '{joint}' go as far as {furthest:.2f} rad (what was fitted lies "
        f"between {low:.2f} and {high:.2f}), and where it does the error is {1e3 * there:.1f} mrad, else "
        f"{1e3 * elsewhere:.1f}. What happens out there, a stop for instance, cannot be learnt from these data: record "
        "that motion three times.",
        value=furthest,
    )  # fmt: skip
