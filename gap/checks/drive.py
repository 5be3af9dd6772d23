"""Checks of the drive: columns in another unit than its chain can have, and stretches in which it looks switched off.

A drive that is on answers an error of position. Where the duty stays at zero while the goal is further away than where
the same machine works elsewhere, the motor was released. Replayed as if it were on, such a stretch is hundreds of mrad
of error that no cause of the drive explains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ...actuators.chain import Chain
from ...actuators.stages import Quantity
from ..log.finding import Finding
from ..log.parts import stretches
from ..log.types import Array, MeasuredSet
from .context import JointContext, joint_contexts
from .signal import AT_LIMIT, MIN_SAMPLES, MIN_STAY_SECONDS, OTHER_ERROR_RATIO, same_unit

EFFORTS = ("torque", "current", "duty")  # of a drive, the most direct first
COLUMN_UNITS: dict[str, dict[str, float]] = {
    "duty": {"percent": 100.0, "counts of 885": 885.0, "per mille": 1000.0, "counts of 1023": 1023.0},
    "current": {"milliamperes": 1000.0},
    "voltage": {"tenths of a volt": 10.0, "millivolts": 1000.0},
}
"""How many times too large a column is in another unit."""
KELVIN_TEMPERATURE = 200.0
"""Temperature that no running motor has in degC."""

NO_EFFORT_SHARE = 0.01  # of the largest effort of the machine, up to which an effort is none
OFF_ERROR_RATIO = 1.5  # times the error at which the drive typically works, from which one that does nothing is off
FAR_GOAL_SHARE = 0.3  # of a stretch without effort in which the goal must be that far away


def predicted(chain: Chain) -> tuple[str, ...]:
    """Those of :data:`EFFORTS` that a chain predicts: without a motor there is no current, and an ideal servo has no
    duty either.
    """
    says = {
        "torque": True,
        "current": chain.find("dc_motor") is not None,
        "duty": any(stage.gives == Quantity.DUTY for stage in chain.stages),
    }
    return tuple(effort for effort in EFFORTS if says[effort])


def check_drive(joint: JointContext) -> Iterator[Finding]:
    """Yield the columns of the drive that are in another unit, on the other side of a gear or of the other sign."""
    temperature = joint.log.temperature
    if temperature is not None and np.nanmedian(temperature) > KELVIN_TEMPERATURE:
        yield joint.fault(
            "unit.temperature", "warning", "temperature", 273.15,
            f"is in kelvin, not in degC: it is {np.nanmedian(temperature):.0f}.",
            cause="sensor.offset",
        )  # fmt: skip
    if (chain := joint.chain) is None:
        return
    duty = _duty(joint, chain)
    for signal, expected in (("duty", duty), ("current", _current(joint, chain))):
        values = getattr(joint.log, signal)
        if duty is None or values is None or expected is None or (ratio := _ratio(values, expected)) is None:
            continue
        if not _named(signal, ratio):  # a duty at its limit has no scale: a late command may hold it there throughout
            free = np.abs(duty) < AT_LIMIT * np.max(np.abs(duty))
            ratio = _ratio(values[free], expected[free])
        if ratio is not None:
            yield from _finding(joint, signal, ratio)
    supply, voltage = chain.find("supply"), joint.log.voltage
    if voltage is not None and np.isfinite(voltage).any():
        if (usual := float(np.nanmedian(voltage))) <= 0.0:
            yield joint.fault(
                "column.stuck", "warning", "voltage", usual,
                f"is {usual:.3g} V although the joint moves: it was not read.",
            )  # fmt: skip
        elif supply is not None:
            yield from _finding(joint, "voltage", usual / supply.volts)


def _duty(joint: JointContext, chain: Chain) -> Array | None:
    controller = chain.find("position_p") or chain.find("position_pd")
    if controller is None or joint.log.goal is None or not joint.natural:
        return None
    limit = chain.find("duty_limit")
    most = limit.limit if limit is not None else 1.0
    return np.clip(controller.gain * (joint.log.goal - joint.log.position), -most, most)


def _current(joint: JointContext, chain: Chain) -> Array | None:
    motor, supply, duty = chain.find("dc_motor"), chain.find("supply"), _duty(joint, chain)
    if motor is None or supply is None or duty is None:
        return None
    logged = joint.log.duty  # if it can be one, it knows what a late command does
    if logged is not None and np.nanmax(np.abs(logged), initial=0.0) <= 1.0 and np.isfinite(logged).any():
        duty = logged
    back_emf = motor.back_emf * chain.gear_ratio() * joint.velocity
    return (duty * supply.volts - back_emf) / motor.resistance


def _ratio(values: Array, expected: Array) -> float | None:
    """Column over what the chain says, by least squares where the two go together."""
    good = np.isfinite(values) & np.isfinite(expected)
    a, b = values[good], expected[good]
    if (
        len(a) < MIN_SAMPLES
        or np.ptp(a) == 0.0
        or np.ptp(b) == 0.0
        or np.corrcoef(a, b)[0, 1] ** 2 < 1.0 - OTHER_ERROR_RATIO
    ):
        return None
    return float(a @ b / (b @ b))


def _named(signal: str, ratio: float) -> bool:
    """Whether a ratio is that of a right column, of the other sign, or of a unit that is known."""
    sizes = [abs(ratio), *(ratio / size for size in COLUMN_UNITS[signal].values())]
    return any(map(same_unit, sizes))


def _finding(joint: JointContext, signal: str, ratio: float) -> Iterator[Finding]:
    if same_unit(ratio):
        return
    if same_unit(-ratio):
        yield joint.fault(
            f"{signal}.sign", "warning", signal, -1.0,
            f"has the wrong sign: it is {ratio:.3g} times what goal, position and chain say.",
            cause="sensor.scale",
        )  # fmt: skip
        return
    unit = min(COLUMN_UNITS[signal], key=lambda name: abs(np.log(abs(ratio) / COLUMN_UNITS[signal][name])))
    if ratio > 0.0 and same_unit(ratio / COLUMN_UNITS[signal][unit]):
        value, what = COLUMN_UNITS[signal][unit], f"is in {unit}"
    else:
        value, what = ratio, "is in another unit or of the other side of a gear"
    yield joint.fault(
        f"unit.{signal}", "warning", signal, value,
        f"{what}: it is {ratio:.3g} times what goal, position and chain say.",
        cause="sensor.scale",
    )  # fmt: skip


# --- a drive that looks off -----------------------------------------------------------------------------------------


def released(data: MeasuredSet) -> tuple[MeasuredSet, list[Finding]]:
    """The runs with an ``enabled`` column for each joint whose drive looks off somewhere, and what is said about it."""
    findings: list[Finding] = []
    for name in dict.fromkeys(joint for run in data.runs for joint in run.joints):
        contexts = {
            k: joint
            for k, run in enumerate(data.runs)
            for joint in joint_contexts(run)
            if joint.name == name and len(joint.time) == len(run.time)  # excerpts of long logs come as windows
        }
        masks = dict(zip(contexts, looks_off(list(contexts.values())), strict=True))
        runs = list(data.runs)
        for k, off in masks.items():
            if off is None or not off.any():
                continue
            run, log = runs[k], runs[k].joints[name]
            findings.append(_looks_off(contexts[k], off))
            runs[k] = replace(run, joints={**run.joints, name: replace(log, enabled=np.where(off, 0.0, 1.0))})
        data = replace(data, runs=tuple(runs))
    return data, findings


def _looks_off(joint: JointContext, off: np.ndarray) -> Finding:
    first, last = joint.time[off][[0, -1]]
    return joint.remark(
        "drive.looks_off", "warning", "enabled", float(off.mean()),
        f"The drive of {joint.name} looks off in {off.mean():.0%} of the samples, {first:.3g} to {last:.3g} s: the "
        f"duty stays at zero while the goal is away. It is taken as off there; log {joint.column('enabled')}.",
        run=joint.run.name,
    )  # fmt: skip


def looks_off(joints: Sequence[JointContext]) -> list[np.ndarray | None]:
    """Samples (n,) at which the drive looks off in each run of one joint; None where that cannot be told.

    What is usual is judged over all runs: one of them may be off throughout.
    """
    efforts = [_effort(joint) for joint in joints]
    known = [k for k, effort in enumerate(efforts) if effort is not None]
    if not known:
        return [None] * len(joints)
    largest = max(float(np.nanmax(np.abs(effort), initial=0.0)) for effort in efforts if effort is not None)
    found: list[np.ndarray | None] = [None] * len(joints)
    away, idle = {}, {}
    for k in known:
        goal, effort = joints[k].log.goal, efforts[k]
        if goal is None or effort is None:
            continue
        away[k] = np.abs(goal - joints[k].log.position)
        idle[k] = np.abs(np.nan_to_num(effort, nan=np.inf)) <= NO_EFFORT_SHARE * largest
    if not away or largest == 0.0:
        return found
    working = np.concatenate([away[k][~idle[k]] for k in away])
    if len(working) < MIN_SAMPLES:
        return found
    far = OFF_ERROR_RATIO * float(np.median(working))
    for k in away:
        found[k] = _stretches(joints[k].time, idle[k], away[k] > far)
    return found


def _effort(joint: JointContext) -> np.ndarray | None:
    """What the drive does; None where that is not logged, or where a column says when it is on."""
    if joint.log.enabled is not None or joint.log.goal is None or joint.still:
        return None
    return joint.log.duty


def _stretches(time: np.ndarray, idle: np.ndarray, far: np.ndarray) -> np.ndarray:
    """Samples (n,) of the long stretches without effort in which the goal is mostly far away."""
    off = np.zeros(len(time), bool)
    for a, b in stretches(idle):
        if time[b - 1] - time[a] >= MIN_STAY_SECONDS and far[a:b].mean() > FAR_GOAL_SHARE:
            off[a:b] = True
    return off
