"""The law of a chain: its stages' laws in order, as one compiled scalar function.

It is the same function for the engine (:mod:`actuators.engine`), for replays without an engine (``gap/``) and for
tests. A chain is data to it (see :mod:`sealegs.actuators.layout`), so no chain has to be compiled for itself.
"""

from __future__ import annotations

from .compiled import compiled
from .layout import (
    P_HEADER,
    P_LATENCY,
    P_LOAD_FACTOR,
    P_SCALE,
    P_STATE_SIZE,
    S_DUTY,
    S_GOAL,
    S_LIMIT,
    S_LOAD,
    S_PRESSED,
    S_READING,
    S_READY,
    S_ROW_INERTIA,
    S_SPEED,
    S_STAGE,
    S_TIME,
    S_TORQUE,
    S_VOLTAGE,
)
from .stages.command import dead_banded, delayed, rate_limited, record_delay, start_delay
from .stages.controller import advance_integral, ideal_torque, position_duty, sampled_duty
from .stages.motor import advance_current, motor_torque, regression_torque
from .stages.net import sample_net, start_net
from .stages.power import at_least, current_limited_voltage, stepped, supplied_voltage
from .stages.sensor import encoder_reading, late_position, record_latency, start_latency
from .stages.transmission import (
    advance_bristle,
    bristle_torque,
    friction_limit,
    lugre_row,
    pressed_limit,
    smooth_row,
)

FIRST, LATER, RESTART, REPEAT = 0, 1, 2, 3


@compiled()
def runge_kutta_stage(s, time, stages):
    """Which evaluation of a physics step this is; the engine does not say.

    Returns:
        FIRST of a new step, REPEAT of that first one at the same time (as ``mj_forward`` before ``mj_step``), LATER in
        a step of several ``stages``, or RESTART after a reset.
    """
    if s[S_READY] == 0.0 or time < s[S_TIME] - 1e-12:
        s[S_STAGE] = 0.0
        return RESTART
    if abs(time - s[S_TIME]) < 1e-12:
        s[S_STAGE] = 0.0
        return REPEAT
    if s[S_STAGE] >= stages - 1:
        s[S_STAGE] = 0.0
        return FIRST
    s[S_STAGE] += 1.0
    return LATER


@compiled()
def begin(p, s, time, goal, q, w):
    """Start the memory of a chain at rest: goal and position have always been what they are now."""
    for k in range(S_STAGE, int(p[P_STATE_SIZE])):
        s[k] = 0.0
    s[S_READY] = 1.0
    s[S_TIME] = time
    s[S_SPEED] = w
    s[S_READING] = encoder_reading(p, q)
    s[S_GOAL] = goal
    if p[P_LATENCY] > 0.0:
        start_latency(p, s, q)
    at = P_HEADER
    while p[at] > 0.0:
        op, m, i = int(p[at]), int(p[at + 2]), at + 3
        if op == 1:
            start_delay(s, m, goal)
        elif op == 2:
            s[m] = goal
            s[m + 1] = goal
        elif op == 4:
            goal += p[i]
        elif op == 5:
            goal *= p[i]
        elif op == 50:
            start_net(p, i, s, m, goal)
        at += int(p[at + 1])


@compiled()
def advance(p, s, time):
    """Carry the memory of a chain over the physics step that ends at ``time``.

    What must see the new motion follows in ``torque``.
    """
    at = P_HEADER
    while p[at] > 0.0:
        op, m, i = int(p[at]), int(p[at + 2]), at + 3
        if op == 2:
            s[m] = rate_limited(p, i, s, m, time, s[m + 1])
        elif op == 10 and p[i + 4] == 0.0:
            advance_integral(p, i, s, m, time)
        elif op == 30:
            advance_current(p, i, s, m, time)
        elif op == 41 and p[i + 12] > 0.0 and p[i + 13] == 0.0:
            advance_bristle(p, i, s, m, time)
        at += int(p[at + 1])
    s[S_TIME] = time


@compiled()
def torque(p, s, time, goal, q, w, external, first):
    """Torque of a chain on its coordinate, viscous and rigid dry friction excluded [N.m].

    Args:
        p: program of the chain.
        s: its state; its slots are filled with what the stages computed.
        time: of this evaluation [s].
        goal: command as sent [rad].
        q, w: position and speed of the motor side [rad, rad/s].
        external: torque of everything else on the coordinate [N.m].
        first: whether this evaluation opens a physics step, where commands are recorded and samples taken.
    """
    s[S_READING] = encoder_reading(p, q)
    s[S_SPEED] = p[P_SCALE] * w
    s[S_LOAD] = external
    value = goal
    at = P_HEADER
    while p[at] > 0.0:
        op, m, i = int(p[at]), int(p[at + 2]), at + 3
        if op == 10:
            if p[i + 4] > 0.0:
                value = sampled_duty(p, i, s, m, time, value, first)
            else:
                error_goal = value
                value = position_duty(p, i, s, m, error_goal)
                if first:
                    s[m + 1] = error_goal - s[S_READING]
            s[S_DUTY] = value
        elif op == 20:
            value = min(max(value, -p[i]), p[i])
            s[S_DUTY] = value
        elif op == 22:
            s[S_DUTY] = value
            value = supplied_voltage(p, i, value, w)
            s[S_VOLTAGE] = value
        elif op == 30:
            value = motor_torque(p, i, s, m, time, value, w, first)
        elif op == 31:
            s[S_DUTY] = value
            value = regression_torque(p, i, value, w)
        elif op == 11:
            value = ideal_torque(p, i, s, value)
        elif op == 41:
            s[S_ROW_INERTIA] = 0.0
            if p[P_LOAD_FACTOR] != 0.0:
                s[S_LIMIT] = pressed_limit(p, i, q, w, value, external, s[S_PRESSED])
            else:
                s[S_LIMIT] = friction_limit(p, i, q, w, value, external)
            if p[i + 13] > 0.0:
                lugre_row(p, i, s, m, time, w, first)
            elif p[i + 15] > 0.0:
                smooth_row(p, i, s, w)
            elif p[i + 12] > 0.0:
                value -= bristle_torque(p, i, s, m, time, w)
        elif op == 1:
            if first:
                record_delay(s, m, time, value, p[i + 1])
            value = delayed(s, m, time - p[i])
        elif op == 2:
            if first:
                s[m + 1] = value
            value = rate_limited(p, i, s, m, time, value)
        elif op == 3:
            value = dead_banded(p, i, s, value)
        elif op == 4:
            value += p[i]
        elif op == 5:
            value *= p[i]
        elif op == 21:
            value = at_least(value, p[i])
            s[S_DUTY] = value
        elif op == 24:
            value = stepped(p, i, value)
            s[S_DUTY] = value
        elif op == 23:
            value = current_limited_voltage(p, i, value, w)
            s[S_VOLTAGE] = value
        elif op == 32:
            value = min(max(value, -p[i]), p[i])
        elif op == 50:
            s[S_GOAL] = value
            if first:
                sample_net(p, i, s, m, time, value)
            value = s[m + 1]
        at += int(p[at + 1])
    s[S_TORQUE] = value
    if first and p[P_LATENCY] > 0.0:
        record_latency(p, s, time, q)
    return value


@compiled()
def host_reading(p, s, time, q):
    """Position as the host receives it at ``time`` [rad], with the encoder's latency, ticks, offset and scale."""
    if p[P_LATENCY] > 0.0:
        q = late_position(p, s, time, q)
    return encoder_reading(p, q)


__all__ = ["FIRST", "LATER", "REPEAT", "RESTART", "advance", "begin", "host_reading", "runge_kutta_stage", "torque"]
