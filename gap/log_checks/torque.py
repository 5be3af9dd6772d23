"""Checks of the torque column of a bench against what the measured motion needs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gap.log_checks.context import JointContext
from gap.log_checks.finding import Finding
from gap.log_checks.signal import Lag, derivatives, lag_grams, solve_lag
from gap.log_types import Array

GRAVITY = 9.81
WINDOW = 0.12
"""Length of the local fits [s], about 8 Hz. Chosen on the AK80-6 recordings, where 0.08 to 0.2 s gives 15 to 8 ms."""
LAG_TOLERANCE = 0.004
SYSTEMATIC = 1e-3
"""What the estimate is off by on perfect data [s] (seen on simulated logs: filters smooth the sign of friction)."""
SIGN_SPEED = 0.1
"""Speed over which the sign of dry friction changes in the regression [rad/s]."""


def needed_torque(params: dict[str, float], position: Array, acceleration: Array) -> Array:
    """Return the torque that a bench's load needs for a motion, friction excluded [N.m], shape (n,).

    Args:
        params: ``mass`` [kg] at ``length`` [m] on a uniform rod of ``arm_mass`` [kg].
        position: angle from hanging [rad].
        acceleration: [rad/s2].
    """
    mass, length, arm = params["mass"], params["length"], params.get("arm_mass", 0.0)
    inertia = mass * length**2 + arm * length**2 / 3.0
    return inertia * acceleration + GRAVITY * length * (mass + 0.5 * arm) * np.sin(position)


def has_torque(joint: JointContext) -> bool:
    """Whether a torque column can be judged: a bench of known load that moves."""
    known = joint.run.robot == "bench" and {"mass", "length"} <= joint.run.robot_params.keys()
    torque = joint.log.torque
    return known and torque is not None and not joint.still and bool(np.isfinite(torque).all())


def check_torque(joints: Sequence[JointContext], run: str | None) -> Iterator[Finding]:
    """Yield what is wrong with the torque column of one joint in one or several runs, judged together."""
    joints = [joint for joint in joints if has_torque(joint)]
    grams = [part for joint in joints if (part := _grams(joint)) is not None]
    if not grams:
        return
    lag = solve_lag(np.concatenate(grams, axis=1))
    if lag.r2 < 0.5:
        return
    name, column = joints[0].name, joints[0].column("torque")
    ratio = float(lag.coefficients[0])
    if abs(ratio) < 0.6 or abs(ratio) > 1.67:
        gear = 1.0 / ratio if abs(ratio) < 1.0 else ratio
        relation = f"1/{abs(gear):.3g}" if abs(ratio) < 1.0 else f"{abs(gear):.3g} times"
        yield Finding(
            "torque.gear_side", "error", name, column,
            f"{column} is {relation} of what the motion needs: it belongs to the other side of a gear "
            "or to another unit.",
            value=ratio, low=ratio - 2 * float(lag.spread[0]), high=ratio + 2 * float(lag.spread[0]),
            cause="sensor.scale", data_error=True, run=run,
        )  # fmt: skip
    elif ratio < 0:
        yield Finding(
            "torque.sign", "error", name, column,
            f"{column} has the wrong sign: it is {ratio:.3g} times what the motion needs.",
            value=ratio, data_error=True, run=run,
        )  # fmt: skip
    if abs(lag.seconds) > LAG_TOLERANCE and lag.low * lag.high > 0:
        yield _lag_finding(name, column, lag, run)


def _lag_finding(name: str, column: str, lag: Lag, run: str | None) -> Finding:
    late = lag.seconds > 0
    size = abs(lag.seconds)
    low, high = sorted((abs(lag.low), abs(lag.high)))
    low, high = max(low - SYSTEMATIC, 0.0), high + SYSTEMATIC
    return Finding(
        "torque.lag" if late else "torque.lead", "warning", name, column,
        f"{column} is {size * 1e3:.0f} ms ({low * 1e3:.0f} to {high * 1e3:.0f} ms) "
        + ("late of the motion" if late else "ahead of the motion, as if position and velocity were reported late")
        + f": shifting it raises the rigid-body fit's R2 from {lag.r2_now:.3f} to {lag.r2:.3f}.",
        value=size, low=low, high=high, cause="sensor.delay", data_error=True, run=run,
    )  # fmt: skip


def _grams(joint: JointContext) -> Array | None:
    position, velocity, acceleration = derivatives(joint.time, joint.log.position, WINDOW)
    torque = joint.log.torque
    assert torque is not None
    smooth = derivatives(joint.time, torque, WINDOW)[0]
    needed = needed_torque(joint.run.robot_params, position, acceleration)
    return lag_grams(joint.time, smooth, [needed, np.tanh(velocity / SIGN_SPEED), velocity])
