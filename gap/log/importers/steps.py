"""Positions as steps of a servo's encoder, or in percent of the joint's range: what shows it, and how they are read."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ..types import Array
from .evidence import whole_numbers
from .expression import quoted

TICKS, PERCENT = "ticks", "percent"
"""Words of ``unit=`` that no column is converted by alone: a turn and a zero, or a range belong to them."""
TURN, ZERO = 4096, 2048
"""Steps of a turn and the step at 0 rad that ``unit=ticks`` takes: of Feetech STS and Dynamixel X servos (their
registers in hw/bus/registers), mounted with 0 rad in the middle (assumed)."""
REGISTER = 32768.0
"""Steps that a register of 16 bits with a sign does not hold."""
FEW = 1023
"""Largest step of a servo that has 1024 of them over 300 degrees (hw/bus/registers/scs0009.yaml)."""
WHOLE_TURN = 360.0
"""Whole numbers beyond this are hardly degrees."""
WITHIN = 2.0
"""Share of a range [percent] by which a reading may lie outside it; assumed."""
ASKED = (
    f"encoder steps of a servo (unit={TICKS}: {TURN} a turn and {ZERO} at 0 rad, as in these lines), degrees "
    "(unit=deg), rad (unit=rad) or mm of a slide (unit=mm)? Whole numbers within 0..4095 are probably steps"
)
ASKED_OF_FEW = (
    f"{ASKED}; those of a servo with 1024 steps over 300 degrees (SCS, AX) are (<column> - 512)*300/1024*pi/180"
)
TURN_OF_FEW = (
    f"how many steps are a turn? {TURN} is taken, and no step goes beyond {FEW}: a servo with 1024 of them over 300 "
    "degrees (SCS, AX) needs (<column> - 512)*300/1024*pi/180 in these lines. Keep them if it has more"
)


def may_be_steps(values: Array, goals: Sequence[Array]) -> bool:
    """Whether a position (n,) and its goals, each (n,), are whole numbers that a register of 12 bits holds."""
    return all(
        whole_numbers(one) and float(np.nanmin(one)) >= 0.0 and float(np.nanmax(one)) < TURN for one in (values, *goals)
    )


def beyond_degrees(values: Array) -> bool:
    """Whether a column (n,) goes further than an angle in degrees does."""
    return float(np.nanmax(values)) > WHOLE_TURN


def steps_text(name: str) -> str:
    """A column of encoder steps as an angle in rad."""
    return f"({quoted(name)} - {ZERO})*2*pi/{TURN}"


def step_size(text: str) -> float:
    """One encoder step [rad] by the line of its column."""
    turn = re.search(r"\*2\*pi/(\d+)", text)
    return 2.0 * np.pi / float(turn[1] if turn else TURN)


def is_percent(values: Array) -> bool:
    """Whether a column (n,) stays within 0 to 100."""
    return float(np.nanmin(values)) >= -WITHIN and float(np.nanmax(values)) <= 100.0 + WITHIN
