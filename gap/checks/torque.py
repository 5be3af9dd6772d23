"""Checks of the torque column of a bench against what the measured motion needs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..load.pendulum import PendulumLoad, completed
from ..log.finding import Finding
from ..log.torque_side import numbers_and_spread, said_side, side_by_load
from ..log.types import Array
from .context import JointContext
from .signal import OTHER_ERROR_RATIO
from .torque_balance import SHIFT_BIAS, Shift, TorqueBalance, shifted_balance

MIN_TORQUE_SHIFT = 2.0 * SHIFT_BIAS
"""Least shift between torque and motion that is worth a word [s]."""
TORQUE_RATIO_RANGE = (0.6, 1.67)
"""Ratio of logged to needed torque that wrong numbers of the load may make."""


def has_torque(joint: JointContext) -> bool:
    """Whether a torque column can be judged: a bench of known load that moves."""
    known = joint.run.robot == "bench" and {"mass", "length"} <= joint.run.robot_params.keys()
    torque = joint.log.torque
    return known and torque is not None and not joint.still and bool(np.isfinite(torque).any())


def check_torque(joints: Sequence[JointContext], run: str | None) -> Iterator[Finding]:
    """Yield what is wrong with the torque column of one joint in one or several runs, judged together."""
    joints = [joint for joint in joints if has_torque(joint)]
    load, loads = PendulumLoad(), [completed(j.run.robot_params) for j in joints]
    found = shifted_balance(
        [(j.time, j.log.position, j.log.torque) for j in joints if j.log.torque is not None],
        [(load.inertia(params), load.gravity_torque(params)) for params in loads],
    )
    if found is None:
        return
    balance, shift = found
    if (
        balance.r2(shift.index) < 1.0 - OTHER_ERROR_RATIO or not balance.terms[:, :2].any()
    ):  # an empty shaft needs nothing
        return
    name, column = joints[0].name, joints[0].column("torque")
    armature, friction = _inside(balance, joints)
    needed, torque = balance.terms[:, :2].sum(axis=1), balance.torques[:, shift.index]
    side = said_side([joint.run for joint in joints], name)
    if (side or side_by_load(torque, balance.terms[:, :2], armature, friction, balance.block)) == "drive":
        needed = needed + armature
    ratio, spread = _ratio(balance, shift, needed)
    if shift.least:
        pass  # further apart than any shift that was tried: their ratio says nothing
    elif not TORQUE_RATIO_RANGE[0] < abs(ratio) < TORQUE_RATIO_RANGE[1]:
        gear = 1.0 / ratio if abs(ratio) < 1.0 else ratio
        relation = f"1/{abs(gear):.3g}" if abs(ratio) < 1.0 else f"{abs(gear):.3g} times"
        yield Finding(
            "torque.gear_side", "error", name, column,
            f"{column} is {relation} of what the motion needs, if the mass of {loads[0]['mass']:.3g} kg in the sidecar "
            "is right, with which the ratio goes: it belongs to the other side of a gear or to another unit.",
            value=ratio, low=ratio - 2.0 * spread, high=ratio + 2.0 * spread,
            cause="sensor.scale", data_error=True, run=run,
        )  # fmt: skip
    elif ratio < 0:
        yield Finding(
            "torque.sign", "error", name, column,
            f"{column} has the wrong sign: it is {ratio:.3g} times what the motion needs.",
            value=ratio, data_error=True, run=run,
        )  # fmt: skip
    if abs(shift.seconds) > MIN_TORQUE_SHIFT and shift.low * shift.high > 0:
        yield _shift_finding(name, column, balance, shift, run)


def _inside(balance: TorqueBalance, joints: Sequence[JointContext]) -> tuple[Array, Array]:
    """Torques that armature and friction of the drive are believed to take (m,) [N.m]; 0 where no chain says it."""
    numbers = np.zeros((len(joints), 3))  # armature over inertia of the load, coulomb, viscous
    for k, joint in enumerate(joints):
        if joint.chain is not None:
            inertia, friction = PendulumLoad().inertia(completed(joint.run.robot_params)), joint.chain.find("friction")
            numbers[k, 0] = joint.chain.armature() / max(inertia, 1e-12)
            numbers[k, 1:] = (0.0, 0.0) if friction is None else (friction.coulomb, friction.viscous)
    torques = balance.terms[:, [0, 2, 3]] * numbers[balance.run]
    return torques[:, 0], torques[:, 1:].sum(axis=1)


def _ratio(balance: TorqueBalance, shift: Shift, needed: Array) -> tuple[float, float]:
    """Logged over needed torque (m,) of load and motion, and its standard deviation over blocks."""
    rows = np.column_stack([needed, balance.terms[:, 2:]])
    numbers, spread = numbers_and_spread(rows, balance.torques[:, shift.index], balance.block)
    return float(numbers[0]), float(spread[0])


def _shift_finding(name: str, column: str, balance: TorqueBalance, shift: Shift, run: str | None) -> Finding:
    late, size = shift.seconds < 0, abs(shift.seconds)
    low, high = shift.size
    interval = f"({low * 1e3:.0f} to {high * 1e3:.0f} ms)"
    return Finding(
        "torque.lag" if late else "torque.lead", "warning", name, column,
        f"{column} is {f'at least {low * 1e3:.0f} ms' if shift.least else f'{size * 1e3:.0f} ms {interval}'} "
        + ("late of the motion" if late else "ahead of the motion, as if position and velocity were reported late")
        + f": shifting it raises the rigid-body fit's R2 from {balance.r2(balance.at_once):.3f} to "
        f"{balance.r2(shift.index):.3f}.",
        value=size, low=low, high=None if shift.least else high, cause="sensor.delay", data_error=True, run=run,
    )  # fmt: skip
