"""Goals that are written only where they change: each holds until the next."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..types import Array
from .expression import hold, quoted
from .units import LIKELY, SURE, Read

SPARSE = 0.5
"""Share of the samples without a goal from which it is taken to hold between its changes."""


def held_goal(values: Array) -> Array | None:
    """A goal held between its changes; None where most samples have one, or none has."""
    known = np.isfinite(values)
    return hold(values) if known.any() and 1.0 - known.mean() > SPARSE else None


def held_read(read: Read, name: str, values: Array) -> Read:
    """The line of a goal that is held."""
    known = int(np.isfinite(values).sum())
    return replace(
        read,
        text=read.text.replace(quoted(name), f"hold({quoted(name)})", 1),
        trust=LIKELY if read.trust == SURE else read.trust,
        why=f"{read.why}; {known} of {len(values)} samples have a goal: each is held until the next",
    )


def kept_samples(goal: str, held: Array, position: str, values: Array) -> list[str]:
    """Factors of ``where`` that leave out what stands before the first goal, and rows of goals alone."""
    return [f"known(hold({quoted(goal)}))"] * bool(np.isnan(held).any()) + [f"known({quoted(position)})"] * bool(
        np.isnan(values).any()
    )
