"""Checks of duty, current, voltage and temperature against what the chain of the joint can do: another unit shows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...actuators.chain import Chain
from ..log.finding import Finding
from ..log.types import Array
from .context import JointContext
from .signal import MIN_EXPLAINED_SHARE

COLUMN_UNITS: dict[str, dict[str, float]] = {
    "duty": {"percent": 100.0, "counts of 885": 885.0, "per mille": 1000.0, "counts of 1023": 1023.0},
    "current": {"milliamperes": 1000.0},
    "voltage": {"tenths of a volt": 10.0, "millivolts": 1000.0},
}
"""How many times too large a column is in another unit."""
CHAIN_RATIO_RANGE = (0.3, 3.0)
"""Ratio of a column to what the chain says that a wrong number of the chain may make."""
KELVIN_TEMPERATURE = 200.0
"""Temperature that no running motor has in degC."""


def check_drive(joint: JointContext) -> Iterator[Finding]:
    """Yield the columns of the drive that are in another unit, on the other side of a gear or of the other sign."""
    temperature = joint.log.temperature
    if temperature is not None and np.nanmedian(temperature) > KELVIN_TEMPERATURE:
        yield Finding(
            "unit.temperature", "warning", joint.name, joint.column("temperature"),
            f"{joint.column('temperature')} is in kelvin, not in degC: it is {np.nanmedian(temperature):.0f}.",
            value=273.15, cause="sensor.offset", data_error=True,
        )  # fmt: skip
    if (chain := joint.chain) is None:
        return
    duty = _duty(joint, chain)
    for signal, expected in (("duty", duty), ("current", _current(joint, chain))):
        values = getattr(joint.log, signal)
        if duty is None or values is None or expected is None or (ratio := _ratio(values, expected)) is None:
            continue
        if not _named(signal, ratio):  # a duty at its limit has no scale: a late command may hold it there throughout
            free = np.abs(duty) < 0.98 * np.max(np.abs(duty))
            ratio = _ratio(values[free], expected[free])
        if ratio is not None:
            yield from _finding(joint, signal, ratio)
    supply, voltage = chain.find("supply"), joint.log.voltage
    if voltage is not None and np.isfinite(voltage).any():
        if (usual := float(np.nanmedian(voltage))) <= 0.0:
            yield Finding(
                "column.stuck", "warning", joint.name, joint.column("voltage"),
                f"{joint.column('voltage')} is {usual:.3g} V although the joint moves: it was not read.",
                value=usual, data_error=True,
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
    if len(a) < 100 or np.ptp(a) == 0.0 or np.ptp(b) == 0.0 or np.corrcoef(a, b)[0, 1] ** 2 < MIN_EXPLAINED_SHARE:
        return None
    return float(a @ b / (b @ b))


def _named(signal: str, ratio: float) -> bool:
    """Whether a ratio is that of a right column, of the other sign, or of a unit that is known."""
    sizes = [abs(ratio), *(ratio / size for size in COLUMN_UNITS[signal].values())]
    return any(CHAIN_RATIO_RANGE[0] < size < CHAIN_RATIO_RANGE[1] for size in sizes)


def _finding(joint: JointContext, signal: str, ratio: float) -> Iterator[Finding]:
    if CHAIN_RATIO_RANGE[0] < ratio < CHAIN_RATIO_RANGE[1]:
        return
    column = joint.column(signal)
    if CHAIN_RATIO_RANGE[0] < -ratio < CHAIN_RATIO_RANGE[1]:
        yield Finding(
            f"{signal}.sign", "warning", joint.name, column,
            f"{column} has the wrong sign: it is {ratio:.3g} times what goal, position and chain say.",
            value=-1.0, cause="sensor.scale", data_error=True,
        )  # fmt: skip
        return
    unit = min(COLUMN_UNITS[signal], key=lambda name: abs(np.log(abs(ratio) / COLUMN_UNITS[signal][name])))
    if ratio > 0.0 and CHAIN_RATIO_RANGE[0] < ratio / COLUMN_UNITS[signal][unit] < CHAIN_RATIO_RANGE[1]:
        value, what = COLUMN_UNITS[signal][unit], f"is in {unit}"
    else:
        value, what = ratio, "is in another unit or of the other side of a gear"
    yield Finding(
        f"unit.{signal}", "warning", joint.name, column,
        f"{column} {what}: it is {ratio:.3g} times what goal, position and chain say.",
        value=value, cause="sensor.scale", data_error=True,
    )  # fmt: skip
