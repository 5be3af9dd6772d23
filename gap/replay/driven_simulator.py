"""A joint whose link follows its measured motion, so that only the actuator is judged: no load and no contact needed.

The same laws and the same sliding and sticking as in :mod:`.simulator`. A motor behind a spring, compliance or play
moves on its own against the measured link; one that is rigid with the link moves as the link does, and shows what it
asks of its drive and gives to its load.

Nothing of a given motion pulls a wrong integral of a position controller back. So it is read from the column that is
judged, in the rows that are replayed but not judged: its mean error there, in each variant of the model.
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
    idle_torque,
    stages_of,
    torque_of_stages,
)
from ...actuators.layout import P_LATENCY, P_STATE_SIZE, S_CURRENT, S_DUTY, S_LIMIT, S_TIME, S_VOLTAGE
from ...actuators.stages.friction import REST_SPEED
from ..load.terms import E_SIZE
from .constants import K, compiled, pointer
from .simulator import DIVERGED, coupling_torque, drive, host_reading_smooth, joint_state, next_change, slide

CHANNELS = ("position", "torque", "duty", "current")


@compiled()
def ahead(time, link, latency, out):
    """Motion of a link (n, 3) as it was, from one that was read ``latency`` seconds later [s]: ``out`` (n, 3)."""
    n, at = len(time), 0
    for j in range(n):
        then = time[j] + latency
        while at + 2 < n and time[at + 1] <= then:
            at += 1
        part = (then - time[at]) / (time[at + 1] - time[at])
        beyond = max(then - time[n - 1], 0.0)  # no reading tells of the last moments: as fast as it was
        part = min(part, 1.0)
        for c in range(3):
            out[j, c] = link[at, c] + part * (link[at + 1, c] - link[at, c])
        out[j, 0] += beyond * out[j, 1]


@compiled(allocates=True)
def replay_driven(p, k, time, goal, on, temperature, link, told, q0, w0, step, out):
    """Replay the commands of one run while its link moves as measured.

    Args:
        p: program of the chain (L,).
        k: constants of the joint (K.size,), of a link that no torque moves.
        time, goal: of the samples (n,) [s], [rad].
        on: whether the drive was on, per sample (n,).
        temperature: of the motor (n,) [degC].
        link: its position, speed and acceleration at the samples (n, 3) [rad, rad/s, rad/s2].
        told: what the log says of the channel that is judged, where it is not judged, else NaN (n,).
        q0, w0: reading and speed of a motor that is not rigid with the link at the first sample [rad, rad/s].
        step: largest step [s].
        out: (n, 4) filled with reading [rad], torque [N.m], duty and current [A] at the samples; the torque is that on
            the link, or the motor's before its armature and friction took theirs.
    """
    s = np.zeros(int(p[P_STATE_SIZE]))
    x = np.empty(4)
    acting, advancing = stages_of(p, HAS_ACT), stages_of(p, HAS_ADVANCE)
    nothing = np.zeros(E_SIZE)  # that the link, which moves as measured, works against
    if k[K.coupled] == 0.0 and p[P_LATENCY] > 0.0:  # what moves the motor is the joint, which was read late
        moved = np.empty(link.shape)
        ahead(time, link, p[P_LATENCY], moved)
        link = moved
    _replay_driven(
        pointer(acting), pointer(advancing), pointer(p), pointer(k), pointer(s), pointer(x), pointer(nothing),
        time=time, goal=goal, on=on, temperature=temperature, link=link, told=told, q0=q0, w0=w0, step=step, out=out,
    )  # fmt: skip
    # the memory behind the pointers must live until here
    return acting[0] + advancing[0] + s[0] + x[0] + nothing[0]


@compiled(forceinline=True)
def teach(k, s, missing):
    """Add to the integral of a controller what makes up for so much duty that its replay lacks."""
    m = int(k[K.integral])
    s[m] += missing
    if k[K.sampled] > 0.0:  # what it holds of its latest sample, see the law of the controller
        s[m + 2] += missing
        s[m + 4] += missing


@compiled(forceinline=True)
def less_friction(torque, limit, speed):
    """A torque [N.m] less dry friction of a limit [N.m] at a speed [rad/s]; at rest friction takes what it can hold."""
    if abs(speed) > REST_SPEED:
        return torque - math.copysign(limit, speed)
    return torque - math.copysign(min(limit, abs(torque)), torque)


@compiled()
def _replay_driven(acting, advancing, p, k, s, x, nothing, time, goal, on, temperature, link, told, q0, w0, step, out):
    """As :func:`replay_driven`, in memory that it made."""
    coupled = k[K.coupled] > 0.0
    q0, w0 = joint_state(p, k, q0, w0)
    x[0], x[1], x[2], x[3] = q0, w0, link[0, 0], link[0, 1]
    if not coupled:
        x[0], x[1] = x[2], x[3]
    begin(p, s, time[0], goal[0], x[0], x[1])
    n = len(time)
    arrival = 0
    motor = int(k[K.motor])
    taught = 0
    passed = 0.0  # to the link, which pushes back as much
    for j in range(n):
        if motor > 0:
            p[motor] = k[K.constant] * max(1.0 - k[K.loss] * (temperature[j] - k[K.reference]), 0.05)
        x[2], x[3] = link[j, 0], link[j, 1]
        advance_stages(advancing, p, s, time[j])
        if coupled:
            passed = coupling_torque(k, x[0] - x[2], x[1] - x[3])
            given = drive(acting, p, k, s, time[j], goal[j], on[j], q=x[0], w=x[1], external=-passed, first=True)
        else:
            x[0], x[1] = x[2], x[3]
            given = drive(acting, p, k, s, time[j], goal[j], on[j], q=x[0], w=x[1], external=-passed, first=True)
            free = given - k[K.motor_inertia] * link[j, 2]
            passed = less_friction(free, s[S_LIMIT], x[1])
            drive(
                acting, p, k, s, time[j], goal[j], on[j], q=x[0], w=x[1], external=-passed, first=False
            )  # friction by this very load
            passed = less_friction(free, s[S_LIMIT], x[1])
        out[j, 0] = k[K.host_scale] * host_reading_smooth(p, s, time[j], x[0]) + k[K.host_offset]
        out[j, 1] = passed if k[K.at_drive] == 0.0 else given + k[K.viscous] * x[1]
        out[j, 2] = s[S_DUTY]
        out[j, 3] = s[S_CURRENT]
        if k[K.integral] > 0.0 and k[K.per_duty] > 0.0:
            if math.isnan(told[j]) or not on[j]:
                taught = 0
            else:
                taught += 1  # each row has its share of their mean
                teach(k, s, (told[j] - out[j, int(k[K.judged])]) / (k[K.per_duty] * taught))
        if j + 1 == n:
            break
        between = time[j + 1] - time[j]
        speed = (link[j + 1, 0] - link[j, 0]) / between
        now = time[j]
        while now < time[j + 1] - 1e-9:
            # up to the next sample, or to where a delayed command arrives
            arrival, end = next_change(time, arrival, k[K.delay], now, time[j + 1])
            count = max(math.ceil((end - now) / step - 1e-9), 1)
            span = (end - now) / count
            for i in range(count):
                at = now + i * span
                x[2], x[3] = link[j, 0] + speed * (at - time[j]), speed
                if not coupled:
                    x[0], x[1] = x[2], x[3]
                if at > time[j]:
                    advance_stages(advancing, p, s, at)
                if coupled:
                    slide(acting, p, k, nothing, s, x, at, span=span, goal=goal[j], on=on[j], first=at > time[j])
                elif at > time[j]:
                    drive(acting, p, k, s, at, goal[j], on[j], q=x[0], w=x[1], external=-passed, first=True)
            now = end
        if not (abs(x[0]) < 1e4 and abs(x[1]) < 1e6):
            out[j:, :] = DIVERGED
            return
    s[S_TIME] = time[n - 1]


@compiled(parallel=True, allocates=True)
def replay_driven_many(programs, constants, time, goal, on, temperature, link, told, starts, states, steps, out):
    """Replay many units with many variants of the model, on all cores; as :func:`gap.replay.simulator.replay_many`."""
    variants, units = constants.shape[0], constants.shape[1]
    for task in numba.prange(variants * units):
        v, u = task // units, task % units
        a, b = starts[u], starts[u + 1]
        replay_driven(
            programs[v].copy(),
            constants[v, u],
            time[a:b],
            goal[a:b],
            on[a:b],
            temperature[a:b],
            link[a:b],
            told=told[a:b],
            q0=states[u, 0],
            w0=states[u, 1],
            step=steps[v],
            out=out[v, a:b],
        )


@compiled(allocates=True)
def law_along(p, k, warm, time, goal, on, q, w, external, out):
    """Run a chain's law along a given motion of its motor side.

    Args:
        p: program of the chain (L,).
        k: constants of the joint (c,).
        warm: motor constant over that of the program (n,).
        time, goal, on: of the samples (n,) [s], [rad], -.
        q, w: position and speed of the motor side (n,) [rad], [rad/s].
        external: torque of everything else on it (n,) [N.m].
        out: (n, 5) filled with torque [N.m], dry friction's limit [N.m], duty, current [A] and voltage [V].
    """
    s = np.zeros(int(p[P_STATE_SIZE]))
    acting, advancing = stages_of(p, HAS_ACT), stages_of(p, HAS_ADVANCE)
    motor = int(k[K.motor])
    constant = p[motor]
    begin(p, s, time[0], goal[0], q[0], w[0])
    for j in range(len(time)):
        if motor > 0:
            p[motor] = constant * warm[j]
        advance_stages(advancing, p, s, time[j])
        value = torque_of_stages(acting, p, s, time[j], goal[j], q[j], w[j], external=external[j], first=True)
        if not on[j]:
            value = idle_torque(p, s, q[j], w[j], external[j])
        out[j, 0], out[j, 1], out[j, 2], out[j, 3], out[j, 4] = value, s[S_LIMIT], s[S_DUTY], s[S_CURRENT], s[S_VOLTAGE]
