"""The unit of a slide's columns: metres, or what its model's range shows to be something else."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..log.finding import Finding
from .context import JointContext

MILLIMETRES_PER_METRE = 1000.0
OTHER_LENGTH_UNITS = {"cm": 100.0}
"""Other units that people measure slides in and a sidecar can say, and how many of them are a metre."""
MIN_RANGE_SHARE = 0.3  # of the range, that a column in another unit must cover to be taken for one
OTHER_UNIT_REACH = 2.0  # times as far as the range of the model reaches: more is another unit
MILLIMETRE_REACH = 1.5  # times that range up to which a column in millimetres may go
MAX_SLIDE_SPEED = 20.0
"""Speed [m/s] that no slide of a robot reaches; it tells the unit where the model gives no range."""


def check_lengths(joint: JointContext) -> Iterator[Finding]:
    """Yield what is wrong with the unit of a slide: a factor of a thousand can be mended, any other cannot.

    Nor can that one where another unit fits the range of the model as well.
    """
    for signal in ("position", "goal", "link_position"):
        values = getattr(joint.log, signal)
        if values is None or not np.isfinite(values).any():
            continue
        size = float(np.nanquantile(np.abs(values), 0.98))
        far, reason = _too_far(joint, np.asarray(values), size)
        if far is None:
            continue
        column = joint.column(signal)
        if far and (fit := [unit for unit, per in OTHER_LENGTH_UNITS.items() if _fits(joint, size / per)]):
            yield Finding(
                "unit.length", "error", joint.name, column,
                f"{column} is not in metres: {reason}; {' or '.join([*fit, 'mm'])} would fit. Say which it is in the "
                f"sidecar, units: {{{column}: {fit[0]}}}.",
                data_error=True,
            )  # fmt: skip
        elif far:
            yield Finding(
                "unit.millimetres", "error", joint.name, column,
                f"{column} is in millimetres, not in metres: {reason}; divide it by 1000.",
                value=MILLIMETRES_PER_METRE, data_error=True,
            )  # fmt: skip
        else:
            yield Finding(
                "unit.length", "error", joint.name, column,
                f"{column} is not in metres: {reason}; convert it, or correct the range in the model.",
                data_error=True,
            )  # fmt: skip


def _too_far(joint: JointContext, values: np.ndarray, size: float) -> tuple[bool | None, str]:
    """Whether a column further than the joint can go is in millimetres, and why; None where it is not too far."""
    if joint.reach is None:
        speed = float(np.nanquantile(np.abs(np.diff(values)) / np.diff(joint.time), 0.9))
        return (True if speed > MAX_SLIDE_SPEED else None), f"it moves by {speed:.3g} per second"
    if size <= OTHER_UNIT_REACH * joint.reach:
        return None, ""
    reason = f"it reaches {size:.3g}, and the joint of the model {joint.reach:.3g} m"
    return size / MILLIMETRES_PER_METRE <= MILLIMETRE_REACH * joint.reach, reason


def _fits(joint: JointContext, metres: float) -> bool:
    """Whether a column that reaches so far stays in the model's range, covering much of it."""
    return joint.reach is not None and MIN_RANGE_SHARE * joint.reach <= metres <= joint.reach
