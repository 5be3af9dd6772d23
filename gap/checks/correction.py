"""Repairs of a log: a column in a known unit is converted, a false one is set aside."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from ..log.finding import Finding
from ..log.types import Array, JointLog, MeasuredRun
from .motion import FULL_TURN, on_turn_of, unwrapped
from .recording import held_again, regular, unheld

Mend = Callable[[Array, float], Array]

CONVERTED: dict[str, Mend] = {
    "unit.millimetres": lambda values, size: values / size,
    "unit.degrees": lambda values, size: values * np.pi / 180.0,
    "position.sign": lambda values, size: -values,
    "link_position.sign": lambda values, size: -values,
    "unit.duty": lambda values, size: values / size,
    "unit.current": lambda values, size: values / size,
    "unit.voltage": lambda values, size: values / size,
    "duty.sign": lambda values, size: -values,
    "current.sign": lambda values, size: -values,
    "unit.temperature": lambda values, size: values - size,
    "unit.velocity": lambda values, size: values / size,
    "velocity.gear_side": lambda values, size: values / size,
    "velocity.sign": lambda values, size: -values,
    "goal.interpolated": lambda values, size: held_again(values, int(size)),
    "column.behind": lambda values, size: np.concatenate([values[int(size) :], np.repeat(values[-1:], int(size))]),
}
"""Column and the finding's value to the column as it should have been, by code."""
WRAPS = ("position.wrap", "link_position.wrap", "goal.wrap")
HELD = "column.held"
STAMPS = "clock.late_stamps"

SET_ASIDE = (
    "current.unsigned",
    "voltage.aliased",
    "column.stuck",
    "column.empty",
    "velocity.scale",
    "velocity.lag",
)
"""Findings whose column says too little to be used."""


def mendable(finding: Finding) -> bool:
    """Whether a log can be diagnosed in spite of a finding, with its column converted or set aside."""
    return finding.code in CONVERTED or finding.code in SET_ASIDE or finding.code in (*WRAPS, HELD, STAMPS)


def mended(run: MeasuredRun, findings: Iterable[Finding]) -> MeasuredRun:
    """The run as its findings say that it should have been recorded; what was recorded stays in its file."""
    joints, time = dict(run.joints), run.time
    for finding in findings:
        if finding.code == STAMPS and (grid := regular(run.time)) is not None:
            time = grid
        if finding.joint not in joints or finding.column is None or not mendable(finding):
            continue
        signal = finding.column.rpartition(".")[2]
        joints[finding.joint] = _mended(joints[finding.joint], signal, finding)
    return replace(run, joints=joints, time=time)


def _mended(log: JointLog, signal: str, finding: Finding) -> JointLog:
    values = getattr(log, signal)
    if values is None:
        return log
    if finding.code in SET_ASIDE:
        return replace(log, **{signal: None})
    if finding.code in WRAPS:
        if signal == "goal":
            return replace(log, goal=on_turn_of(unwrapped(values), unwrapped(log.position)))
        other = log.goal if signal == "position" else log.position
        return replace(log, **{signal: _unwrapped(values, other, float(finding.value or FULL_TURN))})
    if finding.code == "unit.degrees" and signal == "goal" and log.goal_velocity is not None:
        log = replace(log, goal_velocity=CONVERTED[finding.code](log.goal_velocity, 1.0))
    if finding.code == HELD:
        angle = signal in ("position", "link_position")
        return replace(log, **{signal: unheld(values, int(finding.value or 1.0), angle=angle)})
    return replace(log, **{signal: CONVERTED[finding.code](values, float(finding.value or 1.0))})


def _unwrapped(values: Array, other: Array | None, jump: float) -> Array:
    """An angle without its jumps, on the turn of another one that goes with it: the goal, or the motor's position."""
    period = FULL_TURN if abs(jump / FULL_TURN - 1.0) < 0.1 else jump
    angle = np.unwrap(values, period=period)
    return angle if other is None else on_turn_of(angle, other, period)


def told(finding: Finding) -> Finding:
    """The finding, saying what was done about it."""
    done = "set aside" if finding.code in SET_ASIDE else "converted"
    severity = "warning" if finding.severity == "error" else finding.severity
    return replace(finding, severity=severity, sentence=f"{finding.sentence} For this diagnosis it was {done}.")
