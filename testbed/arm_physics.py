"""Equations of motion of a hidden arm: a recursive Newton-Euler algorithm of its own, joints that stick, own servos.

Links are written in frames of their own whose z is the joint's axis. Dry friction of all joints is found together, as
impulses within their limits (projected Gauss-Seidel), at 10 kHz; the joint with play has its motor apart from its link.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

STEP = 1e-4  # [s]
RECORD_EVERY = 5
REFRESH = 5  # steps between two computations of the mass matrix, which changes slowly
SWEEPS = 12  # of the friction impulses


class Links(NamedTuple):
    """A chain of links, the first on the base; arrays by link."""

    turn: np.ndarray  # (n, 3, 3) from the link at zero to the one before it
    place: np.ndarray  # (n, 3) of its joint in the frame of the one before [m]
    mass: np.ndarray  # (n,) [kg]
    centre: np.ndarray  # (n, 3) of its mass [m]
    inertia: np.ndarray  # (n, 3, 3) about that [kg.m2]
    gravity: np.ndarray  # (3,) in the frame of the base [m/s2]
    end: np.ndarray  # (3,) of the arm, in the last link [m]
    table: float  # height of a table below it, in the frame of the base [m]; -inf: none


class Servos(NamedTuple):
    """The servos of the joints; arrays (n,)."""

    gain: np.ndarray  # duty per rad
    duty_limit: np.ndarray
    volts: np.ndarray
    motor_constant: np.ndarray  # at the joint [N.m/A]
    resistance: np.ndarray  # [ohm]
    armature: np.ndarray  # at the joint [kg.m2]
    coulomb: np.ndarray  # [N.m]
    viscous: np.ndarray  # [N.m.s/rad]
    load: np.ndarray  # dry friction per torque through the gearbox
    drift: np.ndarray  # growth of dry friction [N.m/s]
    cable: np.ndarray  # stiffness of a cable that relaxes [N.m/rad]
    ripple: np.ndarray  # amplitude of dry friction over the angle [N.m]
    ripple_count: np.ndarray  # its periods per turn
    ripple_phase: np.ndarray  # [rad]
    upper_stop: np.ndarray  # [rad]
    encoder_scale: np.ndarray
    delay: float  # of all commands [s]
    play: float  # [rad]
    play_joint: int  # that has it; -1: none
    soft: float  # stiffness of a spring in place of the teeth [N.m/rad]; 0: teeth
    by_torque: bool  # goals are torques [N.m]


CABLE_TIME = 2.0  # [s] over which a cable relaxes
STOP_STIFFNESS, STOP_DAMPING = 300.0, 1.5
TOOTH_STIFFNESS, TOOTH_DAMPING = 800.0, 0.6
TABLE_STIFFNESS, TABLE_DAMPING = 5000.0, 30.0  # [N/m, N.s/m]
TABLE_FRICTION, TABLE_SLIP = 0.3, 0.01  # of the end on it, and the speed below which that grows [m/s]
SOFT_DAMPING = 0.02  # [N.m.s/rad] of the spring in place of teeth


@numba.njit(cache=True)
def cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True)
def torques_of(links, turns, w, a, gravity, out):
    """Joint torques (n,) of a motion, by the recursive Newton-Euler algorithm; ``turns`` (n, 3, 3) are of the pose."""
    n = len(w)
    omega, alpha, acc = np.zeros((n + 1, 3)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3))
    force, moment = np.zeros((n, 3)), np.zeros((n, 3))
    t1, t2, t3 = np.zeros(3), np.zeros(3), np.zeros(3)
    for c in range(3):
        acc[0, c] = -gravity[c]
    for i in range(n):
        p = links.place[i]
        # acceleration of the joint in the frame before
        cross(alpha[i], p, t1)
        cross(omega[i], p, t2)
        cross(omega[i], t2, t3)
        for c in range(3):
            t1[c] += acc[i, c] + t3[c]
        for r in range(3):
            omega[i + 1, r] = 0.0
            alpha[i + 1, r] = 0.0
            acc[i + 1, r] = 0.0
            for c in range(3):
                omega[i + 1, r] += turns[i, c, r] * omega[i, c]
                alpha[i + 1, r] += turns[i, c, r] * alpha[i, c]
                acc[i + 1, r] += turns[i, c, r] * t1[c]
        alpha[i + 1, 0] += omega[i + 1, 1] * w[i]
        alpha[i + 1, 1] -= omega[i + 1, 0] * w[i]
        alpha[i + 1, 2] += a[i]
        omega[i + 1, 2] += w[i]
        centre = links.centre[i]
        cross(alpha[i + 1], centre, t1)
        cross(omega[i + 1], centre, t2)
        cross(omega[i + 1], t2, t3)
        for c in range(3):
            force[i, c] = links.mass[i] * (acc[i + 1, c] + t1[c] + t3[c])
        for r in range(3):
            t1[r] = 0.0
            t2[r] = 0.0
            for c in range(3):
                t1[r] += links.inertia[i, r, c] * omega[i + 1, c]
                t2[r] += links.inertia[i, r, c] * alpha[i + 1, c]
        cross(omega[i + 1], t1, t3)
        cross(centre, force[i], t1)
        for c in range(3):
            moment[i, c] = t2[c] + t3[c] + t1[c]
    for i in range(n - 1, -1, -1):
        out[i] = moment[i, 2]
        if i == 0:
            break
        for r in range(3):
            t1[r] = 0.0
            t2[r] = 0.0
            for c in range(3):
                t1[r] += turns[i, r, c] * force[i, c]
                t2[r] += turns[i, r, c] * moment[i, c]
        cross(links.place[i], t1, t3)
        for c in range(3):
            force[i - 1, c] += t1[c]
            moment[i - 1, c] += t2[c] + t3[c]


@numba.njit(cache=True)
def pose(links, q, turns):
    """Fill ``turns`` (n, 3, 3), from each link to the one before, at joint angles (n,)."""
    for i in range(len(q)):
        cos, sin = math.cos(q[i]), math.sin(q[i])
        for r in range(3):
            turns[i, r, 0] = links.turn[i, r, 0] * cos + links.turn[i, r, 1] * sin
            turns[i, r, 1] = -links.turn[i, r, 0] * sin + links.turn[i, r, 1] * cos
            turns[i, r, 2] = links.turn[i, r, 2]


@numba.njit(cache=True)
def mass_matrix(links, turns, out):
    """Fill the mass matrix (n, n) of the links."""
    n = len(out)
    still, unit, column = np.zeros(n), np.zeros(n), np.zeros(n)
    none = np.zeros(3)
    for k in range(n):
        unit[k] = 1.0
        torques_of(links, turns, still, unit, none, column)
        unit[k] = 0.0
        for i in range(n):
            out[i, k] = column[i]


@numba.njit(cache=True)
def push_of(links, turns, w, out):
    """Fill the torques (n,) with which a table pushes the joints at speeds (n,)."""
    n = len(w)
    turned, place, at = np.eye(3), np.zeros(3), np.zeros(3)
    axes, places, levers = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    for i in range(n):
        place = place + turned @ links.place[i]
        turned = turned @ turns[i]
        axes[i], places[i] = turned[:, 2], place
    end = place + turned @ links.end
    speed = np.zeros(3)
    for i in range(n):
        at[:] = end - places[i]
        cross(axes[i], at, levers[i])
        speed += levers[i] * w[i]
    force = 0.0
    if end[2] < links.table:
        force = max(TABLE_STIFFNESS * (links.table - end[2]) - TABLE_DAMPING * speed[2], 0.0)
    slip = max(math.hypot(speed[0], speed[1]), TABLE_SLIP)
    for i in range(n):
        along = (levers[i, 0] * speed[0] + levers[i, 1] * speed[1]) / slip
        out[i] = force * (levers[i, 2] - TABLE_FRICTION * along)


@numba.njit(cache=True)
def simulate(links, servos, goal_time, goal, duration):
    """Integrate one run from rest at the first goals (n,), or hanging at zero where goals are torques.

    Args:
        links, servos: the arm.
        goal_time: when goals (k, n) are sent (k,) [s].
        goal: [rad], or torques [N.m].
        duration: [s].

    Returns:
        Records every ``RECORD_EVERY`` steps: time (m,), motor angles (m, n), speeds (m, n), duties (m, n), currents
        (m, n) and link angles (m, n).
    """
    n = goal.shape[1]
    steps = int(duration / STEP)
    count = steps // RECORD_EVERY + 1
    times, angles, speeds = np.empty(count), np.empty((count, n)), np.empty((count, n))
    duties, currents, linked = np.empty((count, n)), np.empty((count, n)), np.empty((count, n))
    q, w, still = np.zeros(n), np.zeros(n), np.zeros(n)
    if not servos.by_torque:
        q[:] = goal[0]
    relaxed = q.copy()
    turns, matrix = np.empty((n, 3, 3)), np.empty((n, n))
    bias, drive, duty, current, dry, impulse, push = (
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
    )
    b = servos.play_joint
    motor, motor_w = (q[b], 0.0) if b >= 0 else (0.0, 0.0)
    inverse = np.eye(n)
    command = 0
    for step in range(steps + 1):
        now = step * STEP
        while command + 1 < len(goal_time) and goal_time[command + 1] + servos.delay <= now:
            command += 1
        pose(links, q, turns)
        if step % REFRESH == 0:
            mass_matrix(links, turns, matrix)
            for i in range(n):
                if i != b:
                    matrix[i, i] += servos.armature[i]
            inverse = np.linalg.inv(matrix)
        torques_of(links, turns, w, still, links.gravity, bias)
        if links.table > -np.inf:
            push_of(links, turns, w, push)
        motor_torque = 0.0
        for i in range(n):
            angle, rate = (motor, motor_w) if i == b else (q[i], w[i])
            if servos.by_torque:
                duty[i], current[i] = 0.0, goal[command, i]
                value = servos.motor_constant[i] * goal[command, i]
            else:
                ticks = 2.0 * math.pi / 4096
                reading = ticks * math.floor(servos.encoder_scale[i] * angle / ticks + 0.5)
                duty[i] = min(
                    max(servos.gain[i] * (goal[command, i] - reading), -servos.duty_limit[i]), servos.duty_limit[i]
                )
                current[i] = (duty[i] * servos.volts[i] - servos.motor_constant[i] * rate) / servos.resistance[i]
                value = servos.motor_constant[i] * current[i]
            limit = servos.coulomb[i] + servos.drift[i] * now + servos.load[i] * abs(value + bias[i])
            if servos.ripple[i] > 0.0:
                limit += servos.ripple[i] * math.cos(servos.ripple_count[i] * angle + servos.ripple_phase[i])
            dry[i] = max(limit, 0.0) * STEP
            relaxed[i] += STEP / CABLE_TIME * (q[i] - relaxed[i])
            outside = servos.cable[i] * (relaxed[i] - q[i]) + push[i]
            if q[i] > servos.upper_stop[i]:
                outside -= max(STOP_STIFFNESS * (q[i] - servos.upper_stop[i]) + STOP_DAMPING * w[i], 0.0)
            if i == b:
                motor_torque = value - servos.viscous[i] * rate
                twist, apart = motor - q[i], 0.5 * servos.play
                tooth = 0.0
                if servos.soft > 0.0:
                    tooth = servos.soft * twist + SOFT_DAMPING * (motor_w - w[i])
                elif twist > apart:
                    tooth = max(TOOTH_STIFFNESS * (twist - apart) + TOOTH_DAMPING * (motor_w - w[i]), 0.0)
                elif twist < -apart:
                    tooth = min(TOOTH_STIFFNESS * (twist + apart) + TOOTH_DAMPING * (motor_w - w[i]), 0.0)
                motor_torque -= tooth
                drive[i] = outside + tooth - bias[i]
            else:
                drive[i] = value - servos.viscous[i] * rate + outside - bias[i]
        if step % RECORD_EVERY == 0:
            row = step // RECORD_EVERY
            times[row] = now
            for i in range(n):
                angles[row, i], speeds[row, i] = (motor, motor_w) if i == b else (q[i], w[i])
                duties[row, i], currents[row, i], linked[row, i] = duty[i], current[i], q[i]
        # free speeds, then the impulses of dry friction that bring them to rest within their limits
        for i in range(n):
            change = 0.0
            for k in range(n):
                change += inverse[i, k] * drive[k]
            w[i] += STEP * change
            impulse[i] = 0.0
        for _ in range(SWEEPS):
            largest = 0.0
            for i in range(n):
                if i == b:
                    continue
                wanted = impulse[i] - w[i] / inverse[i, i]
                wanted = min(max(wanted, -dry[i]), dry[i])
                change = wanted - impulse[i]
                impulse[i] = wanted
                for k in range(n):
                    w[k] += inverse[k, i] * change
                largest = max(largest, abs(change))
            if largest < 1e-12:
                break
        if b >= 0:
            free = motor_w + STEP * motor_torque / servos.armature[b]
            most = dry[b] / servos.armature[b]
            motor_w = 0.0 if abs(free) <= most else free - math.copysign(most, free)
            motor += STEP * motor_w
        for i in range(n):
            q[i] += STEP * w[i]
    return times, angles, speeds, duties, currents, linked
