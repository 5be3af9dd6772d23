"""A joint on a bench or of a robot, simulated in a plain compiled loop with the very laws that run in the engine.

It exists for speed: a search replays a log thousands of times, and this costs tens of nanoseconds a step. Dry
friction is resolved
exactly: a moving joint slides until its speed reaches zero inside a step, a resting one holds until the torque
exceeds the limit. What the search finds is confirmed in the engine (:mod:`sealegs.gap.replay.engine`).
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ...actuators.law import (
    HAS_ACT,
    HAS_ADVANCE,
    advance_stages,
    begin,
    host_reading,
    idle_torque,
    stages_of,
    torque_of_stages,
)
from ...actuators.layout import P_LATENCY, P_OFFSET, P_SCALE, P_STATE_SIZE, P_TICKS, S_CURRENT, S_DUTY, S_LIMIT, S_TIME
from ..load.terms import (
    E_BIAS,
    E_COUPLING,
    E_CURVE,
    E_DRAG,
    E_INERTIA,
    E_POSITION,
    E_SIZE,
    E_SLOPE,
    E_SPEED,
    T_DRAWN,
    T_OWN,
    T_PASSIVE,
    T_SIZE,
    T_SPIN,
)
from .constants import K, compiled, pointer

DIVERGED = 1e3  # in each channel from where a replay has left all bounds
ELASTIC_STEP = 1e-3  # [s] largest step with a spring between motor and link, whose frequency bounds it
# [s] with play, whose teeth meet for a few milliseconds, and with firmware that switches: it must when the machine does
EVENT_STEP = 2.5e-4
NEAR = 0.5  # [rad] below which sines are summed up from their series
CHANNELS = ("position", "link_position", "duty", "current")


@compiled(forceinline=True)
def combine(k, row, e):
    """Fill what a joint of a robot works against at one sample (E_SIZE,) from its terms there (T_COLUMNS,)."""
    e[E_POSITION], e[E_SPEED] = row[0], row[1]
    for c in range(T_SIZE):
        e[T_OWN + c] = (
            k[K.mass] * row[T_OWN + c]
            + k[K.payload] * row[T_OWN + T_SIZE + c]
            + k[K.shift] * (row[T_OWN + 2 * T_SIZE + c] + k[K.shift] * row[T_OWN + 3 * T_SIZE + c])
            + k[K.spin] * row[T_OWN + T_SPIN * T_SIZE + c]
            + row[T_OWN + T_PASSIVE * T_SIZE + c]
        )


@compiled(forceinline=True)
def sine_and_rise(x):
    """``sin(x)`` and ``1 - cos(x)``; where the joint is near its measured angle by their series, within 1e-11."""
    if abs(x) > NEAR:
        return math.sin(x), 1.0 - math.cos(x)
    y = x * x
    sine = 1.0 / 120.0 + y * (-1.0 / 5040.0 + y * (1.0 / 362880.0 - y / 39916800.0))
    rise = 1.0 / 720.0 + y * (-1.0 / 40320.0 + y / 3628800.0)
    return x * (1.0 + y * (y * sine - 1.0 / 6.0)), y * (0.5 + y * (y * rise - 1.0 / 24.0))


@compiled(forceinline=True)
def load_torque(k, e, q, w):
    """Torque of all but the actuator and the link's own acceleration on the link [N.m]: gravity and stop; of a joint of
    a robot also what its other joints do to it (``e``, see :func:`combine`).

    Around the measured motion, what changes with the angle of a hinge is taken for one period a turn, which is exact of
    gravity and right to the second order of the rest.
    """
    if k[K.tree] == 0.0:
        value = -k[K.gravity] * math.sin(q)
    else:
        away = q - e[E_POSITION]
        value = -e[E_BIAS] - e[E_DRAG] * (w - e[E_SPEED])
        if k[K.tree] == 1.0:
            sine, rise = sine_and_rise(away)
            value -= e[E_SLOPE] * sine + e[E_CURVE] * rise
        else:
            value -= e[E_SLOPE] * away
    if q > k[K.stop]:
        value -= max(k[K.stop_stiffness] * (q - k[K.stop]) + k[K.stop_damping] * w, 0.0)
    elif q < k[K.lower_stop]:
        value -= min(k[K.stop_stiffness] * (q - k[K.lower_stop]) + k[K.stop_damping] * w, 0.0)
    return value


@compiled(forceinline=True)
def coupling_torque(k, twist, rate):
    """Torque that spring or teeth pass from motor to link [N.m]."""
    play = k[K.half_play]
    if twist > play:
        value = k[K.stiffness] * (twist - play) + k[K.damping] * rate
        return value if play == 0.0 else max(value, 0.0)
    if twist < -play:
        value = k[K.stiffness] * (twist + play) + k[K.damping] * rate
        return value if play == 0.0 else min(value, 0.0)
    return k[K.damping] * rate if play == 0.0 else 0.0


@compiled(forceinline=True)
def drive(acting, p, k, s, time, goal, on, q, w, external, first):
    """Torque on the motor side without dry friction, which is left in ``S_LIMIT`` [N.m].

    ``acting`` are the stages of the chain that act, see :func:`sealegs.actuators.law.stages_of`.
    """
    value = torque_of_stages(acting, p, s, time, goal, q, w, external=external, first=first)
    if not on:  # an open bridge: no current, so no torque and no braking
        value = idle_torque(p, s, q, w, external)
    return value - k[K.viscous] * w


@compiled(forceinline=True)
def slide(acting, p, k, e, s, x, time, span, goal, on, first):
    """Advance motor and link ``x = [q, w, link q, link w]`` by ``span`` seconds.

    Midpoint rule, split where the motor stops. What accelerations of other joints need is no load to the laws, as the
    engine's bias and the published fits have none of it.
    """
    coupled = k[K.coupled] > 0.0
    link_inertia = k[K.inertia] + e[E_INERTIA]
    inertia = k[K.motor_inertia] if coupled else k[K.motor_inertia] + link_inertia
    others = 0.0 if coupled else e[E_COUPLING]
    left = span
    for _ in range(6):
        q, w, lq, lw = x[0], x[1], x[2], x[3]
        external = -coupling_torque(k, q - lq, w - lw) if coupled else load_torque(k, e, q, w)
        total = drive(acting, p, k, s, time, goal, on, q=q, w=w, external=external + others, first=first) + external
        first = False
        limit = s[S_LIMIT]
        la = (load_torque(k, e, lq, lw) - external) / link_inertia if coupled else 0.0
        if w == 0.0 and abs(total) <= limit:
            if not coupled:
                return
            # the motor holds while the link swings on its spring
            mid, mid_w = lq + 0.5 * left * lw, lw + 0.5 * left * la
            la = (load_torque(k, e, mid, mid_w) + coupling_torque(k, q - mid, -mid_w)) / link_inertia
            x[2], x[3] = lq + left * mid_w, lw + left * la
            return
        way = 1.0 if (w > 0.0 or (w == 0.0 and total > 0.0)) else -1.0
        a = (total - way * limit) / inertia
        half = 0.5 * left
        q_mid, w_mid = q + half * w, w + half * a
        if limit > 0.0 and w_mid * way < 0.0:
            w_mid = 0.0
        if coupled:
            lq_mid, lw_mid = lq + half * lw, lw + half * la
            external = -coupling_torque(k, q_mid - lq_mid, w_mid - lw_mid)
            la = (load_torque(k, e, lq_mid, lw_mid) - external) / link_inertia
        else:
            lq_mid, lw_mid = 0.0, 0.0
            external = load_torque(k, e, q_mid, w_mid)
        total = (
            drive(acting, p, k, s, time + half, goal, on, q=q_mid, w=w_mid, external=external + others, first=False)
            + external
        )
        a = (total - way * s[S_LIMIT]) / inertia
        w_new = w + left * a
        share = 1.0
        if limit > 0.0 and w * way > 0.0 and w_new * way < 0.0:
            share = w / (w - w_new)
        part = share * left
        if share < 1.0:
            x[0], x[1] = q + 0.5 * part * w, 0.0
        else:
            if limit > 0.0 and w_new * way < 0.0:
                w_new = 0.0
            x[0], x[1] = q + 0.5 * left * (w + w_new), w_new
        if coupled:
            x[2], x[3] = lq + part * (lw + 0.5 * part * la), lw + part * la
        left -= part
        time += part
        if left <= 1e-9 * span:
            return


@compiled()
def joint_state(p, k, reading, speed):
    """Angle and speed of the joint at what the host reads: :func:`host_reading_smooth` and the host's scale undone."""
    angle = ((reading - k[K.host_offset]) / k[K.host_scale] - p[P_OFFSET]) / p[P_SCALE]
    return angle, speed / (k[K.host_scale] * p[P_SCALE])


@compiled(allocates=True)
def replay(p, k, terms, time, goal, on, temperature, q0, w0, step, out):
    """Replay the commands of one run from the state ``(q0, w0)`` at its first sample.

    Args:
        p: program of the chain (L,).
        k: constants of the joint (K.size,).
        terms: of a joint of a robot, at the samples (n, T_COLUMNS), see :mod:`sealegs.gap.load.terms`; of a bench
            (0, T_COLUMNS).
        time, goal: of the samples (n,) [s], [rad].
        on: whether the drive was on, per sample (n,).
        temperature: of the motor (n,) [degC].
        q0, w0: reading and speed at the first sample [rad, rad/s].
        step: largest step [s].
        out: (n, 4) filled with reading, link position [rad], duty and current [A] at the samples.
    """
    s = np.zeros(int(p[P_STATE_SIZE]))
    x = np.empty(4)
    acting, advancing = stages_of(p, HAS_ACT), stages_of(p, HAS_ADVANCE)
    e, before, after = np.zeros(E_SIZE), np.zeros(E_SIZE), np.zeros(E_SIZE)
    _replay(
        pointer(acting), pointer(advancing), pointer(p), pointer(k), pointer(s), pointer(x), pointer(e),
        before=pointer(before), after=pointer(after), terms=terms, time=time, goal=goal, on=on, temperature=temperature,
        q0=q0, w0=w0, step=step, out=out,
    )  # fmt: skip
    # the memory behind the pointers must live until here
    return acting[0] + advancing[0] + s[0] + x[0] + e[0] + before[0] + after[0]


@compiled()
def _replay(acting, advancing, p, k, s, x, e, before, after, terms, time, goal, on, temperature, q0, w0, step, out):
    """As :func:`replay`, in memory that it made."""
    tree = k[K.tree] > 0.0
    if tree:
        combine(k, terms[0], e)
        combine(k, terms[0], after)
    q0, w0 = joint_state(p, k, q0, w0)
    x[0], x[1], x[2], x[3] = q0, w0, q0, w0
    if k[K.coupled] > 0.0 and k[K.stiffness] > 0.0:  # start with the load held by spring or tooth, not with a jerk
        load = load_torque(k, e, q0, 0.0)
        x[2] = q0 + load / k[K.stiffness] + math.copysign(k[K.half_play], load)
        if load * load_torque(k, e, x[2], 0.0) <= 0.0:  # it hangs between the teeth
            x[2] = q0 if tree else 0.0
    begin(p, s, time[0], goal[0], q0, w0)
    n = len(time)
    arrival = 0
    motor, supply, resistance = int(k[K.motor]), int(k[K.supply]), int(k[K.resistance])
    for j in range(n):
        if motor > 0:
            p[motor] = k[K.constant] * max(1.0 - k[K.loss] * (temperature[j] - k[K.reference]), 0.05)
        if tree:
            if supply > 0:
                # others draw less as they sag: with them, the supply is one of a lower voltage and resistance
                beside = 1.0 + k[K.sag] * terms[j, T_DRAWN + 1]
                p[supply] = k[K.volts] - k[K.sag] * terms[j, T_DRAWN] / beside
                p[resistance] = k[K.sag] / beside
            for c in range(E_SIZE):
                before[c] = e[c] = after[c]
            if j + 1 < n:
                combine(k, terms[j + 1], after)
        if k[K.coupled] > 0.0:
            external = -coupling_torque(k, x[0] - x[2], x[1] - x[3])
        else:
            external = load_torque(k, e, x[0], x[1]) + e[E_COUPLING]
        advance_stages(advancing, p, s, time[j])
        torque_of_stages(acting, p, s, time[j], goal[j], x[0], x[1], external=external, first=True)
        reading = host_reading_smooth(p, s, time[j], x[0])
        out[j, 0] = k[K.host_scale] * reading + k[K.host_offset]
        out[j, 1] = x[2] if k[K.coupled] > 0.0 else x[0]
        out[j, 2] = s[S_DUTY]
        out[j, 3] = s[S_CURRENT]
        if j + 1 == n:
            break
        now = time[j]
        while now < time[j + 1] - 1e-9:
            # up to the next sample, or to where a delayed command arrives
            arrival, end = next_change(time, arrival, k[K.delay], now, time[j + 1])
            count = max(math.ceil((end - now) / step - 1e-9), 1)
            span = (end - now) / count
            for i in range(count):
                at = now + i * span
                if at > time[j]:
                    advance_stages(advancing, p, s, at)
                if tree:  # as in the middle of the step
                    part = (at + 0.5 * span - time[j]) / (time[j + 1] - time[j])
                    for c in range(E_SIZE):
                        e[c] = before[c] + part * (after[c] - before[c])
                slide(acting, p, k, e, s, x, at, span=span, goal=goal[j], on=on[j], first=at > time[j])
            now = end
        if not (abs(x[0]) < 1e4 and abs(x[1]) < 1e6):
            out[j:, :] = DIVERGED
            return
    s[S_TIME] = time[n - 1]


@compiled()
def next_change(time, arrival, delay, now, end):
    """When steps from ``now`` must end: at ``end``, or where a delayed command arrives before it; and which one does.

    Args:
        time: of the commands (n,) [s].
        arrival: index of the first command that may still be on its way.
        delay: of commands [s].
        now, end: between which the steps lie [s].
    """
    while arrival < len(time) and time[arrival] + delay <= now + 1e-9:
        arrival += 1
    if arrival < len(time) and time[arrival] + delay < end - 1e-9:
        end = time[arrival] + delay
    return arrival, end


@compiled()
def host_reading_smooth(p, s, time, q):
    """What the host reads, before rounding to ticks.

    A fit wants the expected reading, the ticks are in the noise floor.
    """
    if p[P_LATENCY] > 0.0:
        ticks = p[P_TICKS]
        p[P_TICKS] = 0.0
        value = host_reading(p, s, time, q)
        p[P_TICKS] = ticks
        return value
    return p[P_SCALE] * q + p[P_OFFSET]


@compiled(parallel=True, allocates=True)
def replay_many(programs, constants, terms, time, goal, on, temperature, starts, states, steps, out):
    """Replay many units with many variants of the model, on all cores.

    Args:
        programs: (v, L), each padded with zeros.
        constants: (v, u, K.size).
        terms: (n, T_COLUMNS) of a joint of a robot, (0, T_COLUMNS) of a bench.
        time, goal, on, temperature: samples of all units one behind the other (n,).
        starts: first sample of each unit, and the end of the last (u + 1,).
        states: start of each unit (u, 2) [rad, rad/s].
        steps: largest step of each variant (v,) [s].
        out: (v, n, 4), filled as in :func:`replay`.
    """
    variants, units = constants.shape[0], constants.shape[1]
    for task in numba.prange(variants * units):
        v, u = task // units, task % units
        a, b = starts[u], starts[u + 1]
        program = programs[v].copy()
        replay(
            program,
            constants[v, u],
            terms[a:b],
            time[a:b],
            goal[a:b],
            on[a:b],
            temperature[a:b],
            q0=states[u, 0],
            w0=states[u, 1],
            step=steps[v],
            out=out[v, a:b],
        )
