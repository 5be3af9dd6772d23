"""Ratios of columns judged together: a unit and a gear make the same ratio, and one gear shows in several columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from ..log.finding import Finding

VELOCITY_RATIOS = ("unit.velocity", "velocity.gear_side")
TORQUE_RATIO = "torque.gear_side"
SAME_RATIO_TOLERANCE = 0.08
"""Relative difference up to which two ratios may be one: of a scale with some percent of error each."""


def together(findings: Sequence[Finding]) -> list[Finding]:
    """Findings of which those on one gear say so: both readings are told where both fit."""
    torques = {f.joint: f for f in findings if f.code == TORQUE_RATIO and f.value}
    measured = (f for f in findings if f.code in VELOCITY_RATIOS and not (f.column or "").endswith(".goal_velocity"))
    speeds = {f.joint: f for f in measured if f.value}
    found = []
    for finding in findings:
        torque, speed = torques.get(finding.joint), speeds.get(finding.joint)
        if torque is None or speed is None or finding not in (torque, speed) or not _one_gear(torque, speed):
            found.append(finding)
            continue
        gear = _size(torque)
        if finding is torque:
            said = f"The velocity of the same log has a ratio of {_size(speed):.3g} as well: one gear would make both."
        else:
            what = "the unit is one reading, the" if finding.code == "unit.velocity" else "the"
            said = f"The torque of the same log has a ratio of {gear:.3g} as well: {what} other side of a gear another."
        found.append(replace(finding, sentence=f"{finding.sentence} {said}"))
    return found


def _size(finding: Finding) -> float:
    value = abs(finding.value or 1.0)
    return max(value, 1.0 / value)


def _one_gear(torque: Finding, speed: Finding) -> bool:
    return abs(math.log(_size(torque) / _size(speed))) < SAME_RATIO_TOLERANCE
