"""Rigid bodies and servos of the everyday machines: Kane's equations in the frame of the world, at 10 kHz.

Each joint may have play behind its gearbox. Friction acts in the gearbox, on the motor's side of the play. All servos
draw from one supply, whose voltage falls with the sum of their currents, and get their goals over one bus.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from ..arm_physics import cross

STEP = 1e-4  # [s]
RECORD_EVERY = 10
REFRESH = 5  # steps between two mass matrices
SWEEPS = 10  # of the friction impulses
AMBIENT = 25.0  # [degC]
HEAT_CAPACITY, HEAT_RESISTANCE = 4.0, 8.0  # of a winding [J/K, K/W]
TOOTH_STIFFNESS, TOOTH_DAMPING = 600.0, 0.5  # [N.m/rad, N.m.s/rad], of a tooth on the heaviest link
TOOTH_TIME = 1.5e-3  # [s] of the swing of a light link on its teeth, which makes them softer there
STOP_STIFFNESS, STOP_DAMPING = 200.0, 1.0
CABLE_TIME = 1.5  # [s] over which a cable relaxes
TICK = 2.0 * math.pi / 4096


class Links(NamedTuple):
    """Links one behind the other, the first on the base; arrays by link, places and axes in the link before."""

    place: np.ndarray  # (n, 3) of the joint [m]
    axis: np.ndarray  # (n, 3) of the joint
    mass: np.ndarray  # (n,) with what is fixed to it [kg]
    centre: np.ndarray  # (n, 3) [m]
    inertia: np.ndarray  # (n, 3, 3) about it [kg.m2]


class Servos(NamedTuple):
    """Servos of the joints; arrays (n,), and what they share."""

    gain: np.ndarray  # duty per rad
    duty_limit: np.ndarray
    motor_constant: np.ndarray  # at the joint [N.m/A]
    resistance: np.ndarray  # [ohm]
    armature: np.ndarray  # at the joint [kg.m2]
    coulomb: np.ndarray  # [N.m]
    viscous: np.ndarray  # [N.m.s/rad]
    stribeck: np.ndarray  # [N.m]
    stribeck_velocity: np.ndarray  # [rad/s]
    load: np.ndarray  # dry friction per torque through the gearbox
    play: np.ndarray  # [rad]
    loss: np.ndarray  # of the magnets [1/K]
    goal_offset: np.ndarray  # [rad]
    stop: np.ndarray  # upper [rad]
    output_side: np.ndarray  # 1: the loop is closed behind the play
    cable: np.ndarray  # [N.m/rad]
    trip: np.ndarray  # torque above which an overload is counted [N.m]
    volts: float
    latency: float  # of goals on the bus [s]
    source: float  # resistance of the supply [ohm]


TRIP_TIME, TRIP_LEFT = 0.6, 0.4  # [s] above the threshold until the torque is cut, and what is left of it


@numba.njit(cache=True)
def _turned(matrix, vector, out):
    for i in range(3):
        out[i] = matrix[i, 0] * vector[0] + matrix[i, 1] * vector[1] + matrix[i, 2] * vector[2]


@numba.njit(cache=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True)
def _times(a, b, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@numba.njit(cache=True)
def _pose(links, q, origin, axis, turn, centre, spatial, own, part):
    """Origins, axes, turns, centres of mass and inertias in the world."""
    n = len(q)
    for k in range(n):
        c, s = math.cos(q[k]), math.sin(q[k])
        a = links.axis[k]
        for i in range(3):
            for j in range(3):
                own[i, j] = (1.0 - c) * a[i] * a[j] + (c if i == j else 0.0)
        own[0, 1] -= s * a[2]
        own[0, 2] += s * a[1]
        own[1, 0] += s * a[2]
        own[1, 2] -= s * a[0]
        own[2, 0] -= s * a[1]
        own[2, 1] += s * a[0]
        if k == 0:
            origin[0] = links.place[0]
            axis[0] = a
            turn[0] = own
        else:
            _turned(turn[k - 1], links.place[k], origin[k])
            for i in range(3):
                origin[k, i] += origin[k - 1, i]
            _turned(turn[k - 1], a, axis[k])
            _times(turn[k - 1], own, turn[k])
        _turned(turn[k], links.centre[k], centre[k])
        for i in range(3):
            centre[k, i] += origin[k, i]
        _times(turn[k], links.inertia[k], part)
        for i in range(3):
            for j in range(3):
                spatial[k, i, j] = part[i, 0] * turn[k, j, 0] + part[i, 1] * turn[k, j, 1] + part[i, 2] * turn[k, j, 2]


@numba.njit(cache=True)
def _mass_matrix(links, origin, axis, centre, spatial, out, lever, away, moment):
    """The mass matrix (n, n) by partial velocities."""
    n = len(links.mass)
    out[:] = 0.0
    for k in range(n):
        for i in range(k + 1):
            for c in range(3):
                away[c] = centre[k, c] - origin[i, c]
            cross(axis[i], away, lever[i])
        for i in range(k + 1):
            _turned(spatial[k], axis[i], moment)
            for j in range(i + 1):
                value = links.mass[k] * _dot(lever[i], lever[j]) + _dot(moment, axis[j])
                out[i, j] += value
                if i != j:
                    out[j, i] += value


@numba.njit(cache=True)
def _bias(links, origin, axis, centre, spatial, w, out, v):
    """Torques (n,) that hold against gravity and the effects of speed; ``v`` (8, 3) is scratch."""
    n = len(w)
    omega, alpha, acc, a, b, c, force, moment = v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7]
    out[:] = 0.0
    omega[:] = 0.0
    alpha[:] = 0.0
    acc[0], acc[1], acc[2] = 0.0, 0.0, 9.81
    for k in range(n):
        for i in range(3):
            a[i] = origin[k, i] - (origin[k - 1, i] if k > 0 else 0.0)
        cross(omega, a, b)
        cross(omega, b, c)
        cross(alpha, a, b)
        for i in range(3):
            acc[i] += b[i] + c[i]
            a[i] = axis[k, i] * w[k]
        cross(omega, a, b)
        for i in range(3):
            alpha[i] += b[i]
            omega[i] += a[i]
            a[i] = centre[k, i] - origin[k, i]
        cross(omega, a, b)
        cross(omega, b, c)
        cross(alpha, a, b)
        for i in range(3):
            force[i] = links.mass[k] * (acc[i] + b[i] + c[i])
        _turned(spatial[k], omega, a)
        cross(omega, a, b)
        _turned(spatial[k], alpha, moment)
        for i in range(3):
            moment[i] += b[i]
        for j in range(k + 1):
            for i in range(3):
                a[i] = centre[k, i] - origin[j, i]
            cross(axis[j], a, b)
            out[j] += _dot(b, force) + _dot(axis[j], moment)


@numba.njit(cache=True)
def _invert(matrix, out, work):
    """The inverse (n, n) of a positive definite matrix, by Gauss and Jordan."""
    n = len(matrix)
    for i in range(n):
        for j in range(n):
            work[i, j] = matrix[i, j]
            out[i, j] = 1.0 if i == j else 0.0
    for k in range(n):
        pivot = 1.0 / work[k, k]
        for j in range(n):
            work[k, j] *= pivot
            out[k, j] *= pivot
        for i in range(n):
            if i != k:
                by = work[i, k]
                for j in range(n):
                    work[i, j] -= by * work[k, j]
                    out[i, j] -= by * out[k, j]


class State(NamedTuple):
    """What a machine remembers; arrays (n,)."""

    q: np.ndarray  # of the links [rad]
    w: np.ndarray
    motor: np.ndarray  # of joints with play [rad]
    motor_w: np.ndarray
    heat: np.ndarray  # [degC]
    relaxed: np.ndarray  # where the cable is slack [rad]
    over: np.ndarray  # for how long the torque is above the trip's threshold [s]
    tripped: np.ndarray
    duty: np.ndarray
    current: np.ndarray  # [A]
    torque: np.ndarray  # [N.m]
    volts: np.ndarray  # (1,)


class Scratch(NamedTuple):
    """Room to compute in; ``matrix``, ``inverse``, ``stiff`` and ``damp`` hold for :data:`REFRESH` steps."""

    origin: np.ndarray
    axis: np.ndarray
    centre: np.ndarray
    turn: np.ndarray
    spatial: np.ndarray
    own: np.ndarray
    part: np.ndarray
    lever: np.ndarray
    away: np.ndarray
    moment: np.ndarray
    scratch: np.ndarray
    work: np.ndarray
    matrix: np.ndarray
    bias: np.ndarray
    impulse: np.ndarray
    dry: np.ndarray
    drive: np.ndarray
    through: np.ndarray
    stiff: np.ndarray
    damp: np.ndarray
    inverse: np.ndarray


@numba.njit(cache=True)
def at_rest(angles, volts):
    """The state of a machine at rest at these angles (n,)."""
    n = len(angles)
    return State(
        angles.copy(), np.zeros(n), angles.copy(), np.zeros(n), np.full(n, AMBIENT), angles.copy(), np.zeros(n),
        np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.full(1, volts),
    )  # fmt: skip


@numba.njit(cache=True)
def room(n):
    """Room to compute a machine of n joints in."""
    return Scratch(
        np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3, 3)),
        np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((n, 3)), np.zeros(3), np.zeros(3), np.zeros((8, 3)),
        np.zeros((n, n)), np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n),
        np.zeros(n), np.zeros(n), np.eye(n),
    )  # fmt: skip


@numba.njit(cache=True)
def drive_step(links, servos, s, k, goal, refresh):
    """What the servos do now: duties, currents and torques, for goals (n,) that they have [rad]."""
    n = len(goal)
    _pose(links, s.q, k.origin, k.axis, k.turn, k.centre, k.spatial, k.own, k.part)
    if refresh:
        _mass_matrix(links, k.origin, k.axis, k.centre, k.spatial, k.matrix, k.lever, k.away, k.moment)
        for i in range(n):
            k.stiff[i] = min(TOOTH_STIFFNESS, k.matrix[i, i] * (2.0 * math.pi / TOOTH_TIME) ** 2)
            k.damp[i] = TOOTH_DAMPING * k.stiff[i] / TOOTH_STIFFNESS
            if not servos.play[i] > 0.0:
                k.matrix[i, i] += servos.armature[i]
        _invert(k.matrix, k.inverse, k.work)
    _bias(links, k.origin, k.axis, k.centre, k.spatial, s.w, k.bias, k.scratch)
    drawn = 0.0
    volts = s.volts[0]
    for i in range(n):
        split = servos.play[i] > 0.0
        at, rate = (s.motor[i], s.motor_w[i]) if split else (s.q[i], s.w[i])
        read = s.q[i] if servos.output_side[i] > 0.0 else at
        reading = TICK * math.floor(read / TICK + 0.5)
        error = goal[i] + servos.goal_offset[i] - reading
        s.duty[i] = min(max(servos.gain[i] * error, -servos.duty_limit[i]), servos.duty_limit[i])
        constant = servos.motor_constant[i] * (1.0 - servos.loss[i] * (s.heat[i] - AMBIENT))
        s.current[i] = (s.duty[i] * volts - constant * rate) / servos.resistance[i]
        s.torque[i] = constant * s.current[i]
        s.over[i] = s.over[i] + STEP if abs(s.torque[i]) > servos.trip[i] else 0.0
        if s.over[i] > TRIP_TIME:
            s.tripped[i] = 1.0
        if abs(error) < 0.02:
            s.tripped[i] = 0.0
        if s.tripped[i] > 0.0:
            s.torque[i] *= TRIP_LEFT
            s.current[i] *= TRIP_LEFT
        drawn += max(s.duty[i] * s.current[i], 0.0)
        s.heat[i] += (
            STEP / HEAT_CAPACITY * (s.current[i] ** 2 * servos.resistance[i] - (s.heat[i] - AMBIENT) / HEAT_RESISTANCE)
        )
    s.volts[0] += 0.05 * (servos.volts - servos.source * drawn - volts)  # what capacitors smooth: 2 ms


@numba.njit(cache=True)
def move_step(servos, s, k):
    """Move on by :data:`STEP` under the torques of now."""
    n = len(s.q)
    for i in range(n):
        split = servos.play[i] > 0.0
        rate = s.motor_w[i] if split else s.w[i]
        s.relaxed[i] += STEP / CABLE_TIME * (s.q[i] - s.relaxed[i])
        outside = servos.cable[i] * (s.relaxed[i] - s.q[i])
        if s.q[i] > servos.stop[i]:
            outside -= max(STOP_STIFFNESS * (s.q[i] - servos.stop[i]) + STOP_DAMPING * s.w[i], 0.0)
        external = outside - k.bias[i]
        if split:
            twist, apart, tooth = s.motor[i] - s.q[i], 0.5 * servos.play[i], 0.0
            if twist > apart:
                tooth = max(k.stiff[i] * (twist - apart) + k.damp[i] * (s.motor_w[i] - s.w[i]), 0.0)
            elif twist < -apart:
                tooth = min(k.stiff[i] * (twist + apart) + k.damp[i] * (s.motor_w[i] - s.w[i]), 0.0)
            k.drive[i] = outside + tooth - k.bias[i]
            k.through[i] = s.torque[i] - servos.viscous[i] * rate - tooth
            external = -tooth
        else:
            k.drive[i] = s.torque[i] - servos.viscous[i] * rate + outside - k.bias[i]
        limit = servos.coulomb[i] + servos.load[i] * abs(s.torque[i] - external)
        limit += servos.stribeck[i] * math.exp(-abs(rate) / servos.stribeck_velocity[i])
        k.dry[i] = limit * STEP
    for i in range(n):
        for j in range(n):
            s.w[i] += STEP * k.inverse[i, j] * k.drive[j]
        k.impulse[i] = 0.0
    for _ in range(SWEEPS):
        largest = 0.0
        for i in range(n):
            if servos.play[i] > 0.0:
                continue
            wanted = min(max(k.impulse[i] - s.w[i] / k.inverse[i, i], -k.dry[i]), k.dry[i])
            change = wanted - k.impulse[i]
            k.impulse[i] = wanted
            for j in range(n):
                s.w[j] += k.inverse[j, i] * change
            largest = max(largest, abs(change))
        if largest < 1e-12:
            break
    for i in range(n):
        if servos.play[i] > 0.0:
            free = s.motor_w[i] + STEP * k.through[i] / servos.armature[i]
            most = k.dry[i] / servos.armature[i]
            s.motor_w[i] = 0.0 if abs(free) <= most else free - math.copysign(most, free)
            s.motor[i] += STEP * s.motor_w[i]
        s.q[i] += STEP * s.w[i]


@numba.njit(cache=True)
def simulate(links, servos, goal_time, goal, duration):
    """Integrate from rest at the first goals.

    Args:
        links, servos: the machine.
        goal_time, goal: when goals are sent (k,) [s], and what they are (k, n) [rad].
        duration: [s].

    Returns:
        Times (m,), and (m, n): motor angles, link angles, duties, currents, temperatures; voltages (m,).
    """
    n = goal.shape[1]
    steps = int(duration / STEP)
    count = steps // RECORD_EVERY + 1
    times, volts_out = np.empty(count), np.empty(count)
    motors, angles, duties = np.empty((count, n)), np.empty((count, n)), np.empty((count, n))
    currents, heats = np.empty((count, n)), np.empty((count, n))
    s, k, command = at_rest(goal[0], servos.volts), room(n), 0
    for step in range(steps + 1):
        now = step * STEP
        while command + 1 < len(goal_time) and goal_time[command + 1] + servos.latency <= now:
            command += 1
        drive_step(links, servos, s, k, goal[command], step % REFRESH == 0)
        if step % RECORD_EVERY == 0:
            row = step // RECORD_EVERY
            times[row], volts_out[row] = now, s.volts[0]
            for i in range(n):
                motors[row, i] = s.motor[i] if servos.play[i] > 0.0 else s.q[i]
                angles[row, i], duties[row, i] = s.q[i], s.duty[i]
                currents[row, i], heats[row, i] = s.current[i], s.heat[i]
        move_step(servos, s, k)
    return times, motors, angles, duties, currents, heats, volts_out


@numba.njit(cache=True)
def advance(links, servos, s, k, sent, since, steps):
    """Let a machine go on while goals that were sent over the bus arrive.

    Args:
        links, servos, s, k: the machine, its state and room.
        sent: goals (h, n) [rad], the newest first.
        since: how long ago each was sent (h,) [s], the newest first.
        steps: of :data:`STEP`.
    """
    for step in range(steps):
        now, which = step * STEP, len(since) - 1
        for h in range(len(since)):
            if since[h] + now >= servos.latency:
                which = h
                break
        drive_step(links, servos, s, k, sent[which], step % REFRESH == 0)
        move_step(servos, s, k)
