"""Equations of motion of the hidden bench: a servo, a gear train that may give way or have play, and a pendulum.

Dry friction is integrated exactly, by events: a moving joint slides until its speed reaches zero within a step, then it
is held until the torque on it exceeds the breakaway torque. Nothing here is shared with the simulator under test.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

STEP = 5e-5
"""Integration step [s]: 20 kHz."""
RECORD_EVERY = 5
"""Steps between two recorded states."""
GRAVITY = 9.81
TOOTH_STIFFNESS = 1500.0
TOOTH_DAMPING = 1.0
STOP_STIFFNESS = 500.0
STOP_DAMPING = 1.0
THERMAL_CAPACITY = 4.0
THERMAL_RESISTANCE = 12.0
"""Lumped heat capacity [J/K] and resistance to the surroundings [K/W] of the motor; small, so that a run shows it."""
FIRMWARE_STEPS = 20  # of the integration, between two differences of the error: 1 ms
INTEGRAL_DUTY = 0.3  # to which the firmware limits the integral term
AMBIENT = 25.0


class Machine(NamedTuple):
    """One hidden machine. Servo values at the output shaft, SI units.

    ``inf`` and 0 switch an effect off where a comment says so.
    """

    # firmware
    command_delay: float = 0.005
    goal_offset: float = 0.0
    goal_speed: float = math.inf  # inf: no speed profile
    goal_acceleration: float = math.inf  # inf: none
    goal_smoothing: float = 0.0  # time constant of a low-pass filter on the goal [s]
    gain: float = 5.3
    integral_gain: float = 0.0  # [1/(rad s)]
    derivative_gain: float = 0.0  # [s/rad]
    error_deadband: float = 0.0
    duty_limit: float = 0.97
    minimum_duty: float = 0.0
    duty_step: float = 0.0  # 0: continuous
    overload_torque: float = math.inf
    # power stage and motor
    volts: float = 7.4
    supply_resistance: float = 0.0
    motor_constant: float = 1.2
    resistance: float = 2.7
    armature: float = 0.026
    torque_loss_per_kelvin: float = 0.0
    cogging: float = 0.0  # largest torque with which the magnets pull to some angles [N.m]
    cogging_count: float = 7.0  # of those angles in a turn of the shaft
    cogging_phase: float = 0.4
    # friction at the gearbox
    coulomb: float = 0.052
    viscous: float = 0.059
    stribeck: float = 0.0
    stribeck_velocity: float = 0.2
    asymmetry: float = 0.0
    load_friction: float = 0.0
    ripple: float = 0.0
    ripple_count: float = 9.0
    ripple_phase: float = 0.7
    bristle_stiffness: float = math.inf  # inf: rigid sticking
    # transmission
    joint_stiffness: float = math.inf  # inf: rigid
    joint_damping: float = 0.0
    backlash: float = 0.0
    tooth_stiffness: float = TOOTH_STIFFNESS
    tooth_damping: float = TOOTH_DAMPING
    # load
    mass: float = 0.5
    length: float = 0.12
    arm_mass: float = 0.0
    extra_inertia: float = 0.0
    centre_shift: float = 0.0
    stop_angle: float = math.inf
    stop_stiffness: float = STOP_STIFFNESS
    stop_damping: float = STOP_DAMPING
    # encoder, as firmware and host read it
    encoder_ticks: float = 4096.0
    encoder_offset: float = 0.0
    encoder_scale: float = 1.0
    # strangers
    air_drag: float = 0.0
    cable_stiffness: float = 0.0  # N.m/rad of a cable in rubber: a spring and a damper in series (Maxwell)
    cable_time: float = 0.3  # s in which its torque relaxes
    friction_drift: float = 0.0  # N.m per second
    jam_torque: float = 0.0

    @property
    def link_inertia(self) -> float:
        """Inertia of the pendulum about the shaft [kg.m2]: point mass on a uniform rod."""
        return inertia_of(self)

    @property
    def elastic(self) -> bool:
        """Whether motor and link move apart."""
        return self.backlash > 0.0 or math.isfinite(self.joint_stiffness)


@numba.njit(cache=True)
def inertia_of(m):
    """Inertia of the pendulum about the shaft [kg.m2]."""
    reach = m.length + m.centre_shift
    return m.mass * reach * reach + m.arm_mass * m.length * m.length / 3.0 + m.extra_inertia


@numba.njit(cache=True)
def load_torque(m, q, v):
    """Torque of gravity, air and end stop on the link [N.m]; the pendulum hangs at zero."""
    moment = m.mass * (m.length + m.centre_shift) + 0.5 * m.arm_mass * m.length
    torque = -GRAVITY * moment * math.sin(q) - m.air_drag * v * abs(v)
    if abs(q) > m.stop_angle:
        side = 1.0 if q > 0.0 else -1.0
        torque -= side * max(m.stop_stiffness * (side * q - m.stop_angle) + m.stop_damping * side * v, 0.0)
    return torque


@numba.njit(cache=True)
def transmitted(m, twist, rate):
    """Torque that the gear train passes from motor to link [N.m]."""
    play = 0.5 * m.backlash
    stiffness, damping = m.joint_stiffness, m.joint_damping
    if not math.isfinite(stiffness):
        stiffness, damping = m.tooth_stiffness, m.tooth_damping
    if abs(twist) <= play:
        return 0.0
    side = 1.0 if twist > 0.0 else -1.0
    torque = stiffness * (twist - side * play) + damping * rate
    if m.backlash > 0.0 and torque * side < 0.0:
        return 0.0  # teeth push, they do not pull
    return torque


@numba.njit(cache=True)
def breakaway(m, q, v, direction, motor, external, time, jammed):
    """Dry friction torque [N.m] at speed ``v`` for sliding in ``direction``."""
    load = abs(motor - external)
    limit = m.coulomb + m.asymmetry * direction + m.load_friction * load + m.friction_drift * time
    limit += m.stribeck * math.exp(-abs(v) / m.stribeck_velocity)
    limit += m.ripple * math.cos(m.ripple_count * q + m.ripple_phase)
    if jammed:
        limit += m.jam_torque
    return max(limit, 0.0)


@numba.njit(cache=True)
def firmware_duty(m, goal, q, summed, growth):
    """Duty that the firmware sets for a goal, the shaft angle ``q`` [rad], the error summed up so far [rad.s], and how
    fast it grows [rad/s].
    """
    reading = m.encoder_scale * q + m.encoder_offset
    if m.encoder_ticks > 0.0:
        tick = 2.0 * math.pi / m.encoder_ticks
        reading = tick * math.floor(reading / tick + 0.5)
    error = goal - reading
    duty = 0.0 if abs(error) < m.error_deadband else m.gain * error
    duty += m.integral_gain * summed + m.derivative_gain * growth
    if m.duty_step > 0.0:
        duty = m.duty_step * math.floor(duty / m.duty_step)
    if m.minimum_duty > 0.0 and 1e-9 < abs(duty) < m.minimum_duty:
        duty = math.copysign(m.minimum_duty, duty)
    return min(max(duty, -m.duty_limit), m.duty_limit)


@numba.njit(cache=True)
def winding_current(m, constant, duty, v):
    """Motor current [A] with back-EMF and a supply that sags by what the bridge draws."""
    current = (duty * m.volts - constant * v) / m.resistance
    if m.supply_resistance > 0.0 and duty * current > 0.0:
        current = (duty * m.volts - constant * v) / (m.resistance + duty * duty * m.supply_resistance)
    return current


@numba.njit(cache=True)
def magnets(m, q):
    """Torque of the magnets on the rotor [N.m], whatever current flows."""
    return m.cogging * math.sin(m.cogging_count * q + m.cogging_phase) if m.cogging != 0.0 else 0.0


@numba.njit(cache=True)
def ramped(m, at, speed, wanted):
    """The goal of the firmware a step later, and its speed: full push until only full braking is left."""
    push, left = m.goal_acceleration * STEP, wanted - at
    if abs(left) <= push * STEP and abs(speed) <= push:
        return wanted, 0.0
    stops_at = at + 0.5 * speed * abs(speed) / m.goal_acceleration
    speed += push if stops_at < wanted else -push
    speed = min(max(speed, -m.goal_speed), m.goal_speed)
    return at + speed * STEP, speed


@numba.njit(cache=True)
def slide(torque, dry, inertia, v, direction):
    """Acceleration [rad/s2] of a joint that slides in ``direction``."""
    return (torque - direction * dry) / inertia


@numba.njit(cache=True)
def simulate(m, goal_time, goal, jam_start, jam_end, duration, start_temperature):
    """Integrate one run from rest at ``goal[0]``, or hanging where the servo cannot hold it.

    Returns:
        (k, 8) record every ``RECORD_EVERY`` steps: time, motor angle and speed, link angle, duty, current, supply
        voltage, temperature.
    """
    steps = int(duration / STEP)
    record = np.empty((steps // RECORD_EVERY + 1, 8))
    inertia = inertia_of(m)
    elastic = m.backlash > 0.0 or math.isfinite(m.joint_stiffness)
    shaft_inertia = m.armature if elastic else m.armature + inertia
    bristles = math.isfinite(m.bristle_stiffness)
    q, v, bristle = goal[0] + m.goal_offset, 0.0, 0.0
    link, link_v = q, 0.0
    temperature = start_temperature
    profile, profile_v, smooth, summed = q, 0.0, q, 0.0
    relaxed = q  # where the cable pulls to
    error, growth = 0.0, 0.0
    command, jam = 0, 0
    for step in range(steps + 1):
        time = step * STEP
        while command + 1 < len(goal_time) and goal_time[command + 1] + m.command_delay <= time:
            command += 1
        wanted = goal[command] + m.goal_offset
        if m.goal_smoothing > 0.0:
            smooth += STEP * (wanted - smooth) / (m.goal_smoothing + STEP)
            wanted = smooth
        reach = m.goal_speed * STEP
        if math.isfinite(m.goal_acceleration):
            profile, profile_v = ramped(m, profile, profile_v, wanted)
        else:
            profile = wanted if abs(wanted - profile) <= reach else profile + math.copysign(reach, wanted - profile)
        if m.integral_gain > 0.0:
            most = INTEGRAL_DUTY / m.integral_gain
            summed = min(max(summed + STEP * (profile - m.encoder_scale * q - m.encoder_offset), -most), most)
        if m.derivative_gain > 0.0 and step % FIRMWARE_STEPS == 0:
            now = profile - m.encoder_scale * q - m.encoder_offset
            error, growth = now, (now - error) / (FIRMWARE_STEPS * STEP) if step > 0 else 0.0
        duty = firmware_duty(m, profile, q, summed, growth)
        constant = m.motor_constant * (1.0 - m.torque_loss_per_kelvin * (temperature - AMBIENT))
        current = winding_current(m, constant, duty, v)
        if step % RECORD_EVERY == 0:
            row = record[step // RECORD_EVERY]
            row[0], row[1], row[2], row[3] = time, q, v, link if elastic else q
            row[4], row[5], row[7] = duty, current, temperature
            row[6] = m.volts - m.supply_resistance * max(duty * current, 0.0)
        heat = current * current * m.resistance - (temperature - AMBIENT) / THERMAL_RESISTANCE
        temperature += STEP * heat / THERMAL_CAPACITY
        while jam < len(jam_end) and jam_end[jam] < time:
            jam += 1
        jammed = jam < len(jam_start) and jam_start[jam] <= time

        cable = m.cable_stiffness * (relaxed - (link if elastic else q))  # hardly changes over a step
        relaxed -= STEP / m.cable_time * (relaxed - (link if elastic else q))

        # First half step: torque and acceleration at its start.
        motor = min(max(constant * current, -m.overload_torque), m.overload_torque) + magnets(m, q)
        external = -transmitted(m, q - link, v - link_v) if elastic else load_torque(m, q, v) + cable
        if elastic:
            link_a = (load_torque(m, link, link_v) + cable - external) / inertia
            link_mid, link_v_mid = link + 0.5 * STEP * link_v, link_v + 0.5 * STEP * link_a
        else:
            link_mid, link_v_mid = 0.0, 0.0
        torque = motor + external - m.viscous * v
        direction = 1.0 if v > 0.0 or (v == 0.0 and torque > 0.0) else -1.0
        dry = breakaway(m, q, v, direction, motor, external, time, jammed)
        if bristles:
            # Elastic sticking: a spring of bristles that slips at the breakaway torque.
            bristle = min(max(bristle, -dry / m.bristle_stiffness), dry / m.bristle_stiffness)
            dry = direction * m.bristle_stiffness * bristle
        held = v == 0.0 and abs(torque) <= dry and not bristles
        if held:
            q_mid, v_mid = q, 0.0
        else:
            a = slide(torque, dry, shaft_inertia, v, direction)
            q_mid, v_mid = q + 0.5 * STEP * v, v + 0.5 * STEP * a
            if v_mid * direction < 0.0 and not bristles:
                v_mid = 0.0

        # Whole step with the midpoint's acceleration.
        current = winding_current(m, constant, duty, v_mid)
        motor = min(max(constant * current, -m.overload_torque), m.overload_torque) + magnets(m, q_mid)
        external = (
            -transmitted(m, q_mid - link_mid, v_mid - link_v_mid) if elastic else load_torque(m, q_mid, v_mid) + cable
        )
        if elastic:
            link_a = (load_torque(m, link_mid, link_v_mid) + cable - external) / inertia
            link += STEP * link_v_mid
            link_v += STEP * link_a
        if held:
            continue
        torque = motor + external - m.viscous * v_mid
        if bristles:
            v_new = v + STEP * (torque - m.bristle_stiffness * (bristle + 0.5 * STEP * v)) / shaft_inertia
            bristle += 0.5 * STEP * (v + v_new)
            q += 0.5 * STEP * (v + v_new)
            v = v_new
            continue
        dry = breakaway(m, q_mid, v_mid, direction, motor, external, time + 0.5 * STEP, jammed)
        a = slide(torque, dry, shaft_inertia, v_mid, direction)
        v_new = v + STEP * a
        if v_new * direction <= 0.0:  # comes to rest within the step, at the instant -v / a
            q += 0.5 * v * (v / -a) if v != 0.0 and a * direction < 0.0 else 0.0
            v = 0.0
        else:
            q += 0.5 * STEP * (v + v_new)
            v = v_new
    return record
