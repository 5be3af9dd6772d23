"""An independent planar hopper that hides effects in its ground, its springs and its belt.

Own equations of motion in absolute link angles, a Runge-Kutta integrator at 20 kHz, servos whose dry friction holds
and slides by events, ground as a spring and damper with a tangential spring that slips at the friction limit. Shares no
code with sealegs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np

from .recording import Recording

STEP = 5e-5  # [s]
SAMPLE_PERIOD, JITTER = 0.005, 3e-4  # [s]
TICK = 2.0 * math.pi / 4096
ENCODER_NOISE = 3.9e-4  # [rad]
BOOM_STEP, BOOM_NOISE = 1e-4, 1e-4  # [m] boom encoder, seen at the hip
CURRENT_STEP = 0.0065  # [A]
GRAVITY = 9.81
REST = (-0.61, 0.61)  # [rad]
CONTACT_TIME = 0.002  # [s] of the sidecar: as hard as the nominal ground here, about
JOINTS = ("hip", "knee")


class Ground(NamedTuple):
    """The ground: friction, stiffness [N/m] and damping [N.s/m] along its normal and along its surface, slope [rad]
    (positive: rising along x).
    """

    friction: float = 1.0
    stiffness: float = 40_000.0
    damping: float = 70.0
    shear_stiffness: float = 60_000.0
    shear_damping: float = 70.0
    slope: float = 0.0
    drag: float = 0.0  # [N.s2/m2] of the air on the base: a stranger


class Servo(NamedTuple):
    """One servo and its spring, at the output shaft."""

    delay: float = 0.004  # [s]
    gain: float = 30.0  # duty per rad
    duty_limit: float = 0.9
    volts: float = 7.4
    motor_constant: float = 0.664
    resistance: float = 2.723
    armature: float = 0.010
    coulomb: float = 0.03
    viscous: float = 0.35
    stiffness: float = 2.0
    damping: float = 0.0219
    play: float = 0.0  # [rad] of the belt or gears between motor and spring


class Body(NamedTuple):
    """The leg of paper 004 as its sidecar believes it to be."""

    total_mass: float = 0.587
    upper_mass: float = 0.059
    lower_mass: float = 0.038
    upper_length: float = 0.108
    lower_length: float = 0.092
    foot_radius: float = 0.01


class Effect(NamedTuple):
    """A hidden effect: parameter and unit for the truth, how it is applied, sizes for clear, moderate and faint."""

    parameter: str
    unit: str
    apply: Callable[[Ground, Servo, Servo, float], tuple[Ground, Servo, Servo]]
    sizes: tuple[float, float, float]


MAGNITUDES = ("clear", "moderate", "faint")
HOPPER_EFFECTS: dict[str, Effect] = {
    "contact.friction": Effect("friction", "1", lambda g, h, k, v: (g._replace(friction=v), h, k), (0.3, 0.45, 0.7)),
    "contact.stiffness": Effect(
        "stiffness", "N/m", lambda g, h, k, v: (g._replace(stiffness=v, damping=25.0), h, k), (1500.0, 4000.0, 12_000.0)
    ),
    "contact.slope": Effect("slope", "rad", lambda g, h, k, v: (g._replace(slope=v), h, k), (0.07, 0.035, 0.009)),
    "spring.stiffness": Effect(
        "stiffness_factor", "1", lambda g, h, k, v: (g, h, k._replace(stiffness=k.stiffness * v)), (0.7, 0.85, 0.96)
    ),
    "transmission.backlash": Effect("width", "rad", lambda g, h, k, v: (g, h, k._replace(play=v)), (0.12, 0.05, 0.012)),
}
HOPPER_STRANGERS: dict[str, Effect] = {
    "stranger.drag": Effect("drag", "N.s2/m2", lambda g, h, k, v: (g._replace(drag=v), h, k), (4.0, 1.5, 0.4)),
}
UNCERTAIN = ("motor_constant", "resistance", "armature", "coulomb", "viscous", "delay")
"""What the nominal servo may have wrong without anything being hidden."""


@numba.njit(cache=True)
def spring_torque(servo, twist, rate):
    """Torque from motor to link [N.m]; inside the play nothing is passed on, and a slack belt does not pull."""
    half = 0.5 * servo.play
    if half == 0.0:
        return servo.stiffness * twist + servo.damping * rate
    if abs(twist) <= half:
        return 0.0
    side = 1.0 if twist > 0.0 else -1.0
    torque = servo.stiffness * (twist - side * half) + servo.damping * rate
    return torque if torque * side > 0.0 else 0.0


@numba.njit(cache=True)
def ground_force(ground, body, x, z, b, vx, vz, vb, anchor):
    """Normal and tangential force on the foot [N], and where the tangential spring is anchored; NaN off the ground."""
    sin, cos = math.sin(ground.slope), math.cos(ground.slope)
    depth = body.foot_radius - (-sin * x + cos * z)
    if depth <= 0.0:
        return 0.0, 0.0, math.nan
    approach = sin * vx - cos * vz
    normal = max(ground.stiffness * depth + ground.damping * approach, 0.0)
    along = cos * x + sin * z + body.foot_radius * b  # a rolling foot does not slide
    speed = cos * vx + sin * vz + body.foot_radius * vb
    if math.isnan(anchor):
        anchor = along
    tangential = -(ground.shear_stiffness * (along - anchor) + ground.shear_damping * speed)
    limit = ground.friction * normal
    if abs(tangential) > limit:
        tangential = math.copysign(limit, tangential)
        # the anchor is dragged along behind the foot
        anchor = along + (tangential + ground.shear_damping * speed) / (ground.shear_stiffness)
    return normal, tangential, anchor


@numba.njit(cache=True)
def leg_rate(ground, body, hip, knee, motors, s, anchor, rate):
    """Time derivative of the leg's state ``s = [x, z, a, b, and their speeds]``, and the result of `ground_force`."""
    x, z, a, b, vx, vz, va, vb = s
    sa, ca, sb, cb = math.sin(a), math.cos(a), math.sin(b), math.cos(b)
    l1, l2 = body.upper_length, body.lower_length
    m1, m2, mt = body.upper_mass, body.lower_mass, body.total_mass
    first, second, cross = (0.5 * m1 + m2) * l1, 0.5 * m2 * l2, 0.5 * m2 * l1 * l2
    mass = np.zeros((4, 4))
    mass[0, 0] = mass[1, 1] = mt
    mass[0, 2] = mass[2, 0] = first * ca
    mass[0, 3] = mass[3, 0] = second * cb
    mass[1, 2] = mass[2, 1] = first * sa
    mass[1, 3] = mass[3, 1] = second * sb
    mass[2, 2] = m1 * l1 * l1 / 3.0 + m2 * l1 * l1
    mass[3, 3] = m2 * l2 * l2 / 3.0
    mass[2, 3] = mass[3, 2] = cross * math.cos(a - b)
    foot_x, foot_z = x + l1 * sa + l2 * sb, z - l1 * ca - l2 * cb
    foot_vx, foot_vz = vx + l1 * ca * va + l2 * cb * vb, vz + l1 * sa * va + l2 * sb * vb
    normal, tangential, anchor = ground_force(ground, body, foot_x, foot_z, b, foot_vx, foot_vz, vb, anchor)
    sin, cos = math.sin(ground.slope), math.cos(ground.slope)
    fx, fz = -sin * normal + cos * tangential, cos * normal + sin * tangential
    force = np.zeros(4)
    force[0] = fx + first * sa * va * va + second * sb * vb * vb - ground.drag * vx * abs(vx)
    force[1] = fz - mt * GRAVITY - first * ca * va * va - second * cb * vb * vb - ground.drag * vz * abs(vz)
    force[2] = spring_torque(hip, motors[0] - a, motors[1] - va) - GRAVITY * first * sa
    force[2] += l1 * (ca * fx + sa * fz) - cross * math.sin(a - b) * vb * vb
    force[3] = spring_torque(knee, motors[2] - b, motors[3] - vb) - GRAVITY * second * sb
    force[3] += l2 * (cb * fx + sb * fz) + cross * math.sin(a - b) * va * va + body.foot_radius * tangential
    acceleration = np.linalg.solve(mass, force)
    for i in range(4):
        rate[i], rate[4 + i] = s[4 + i], acceleration[i]
    return normal, tangential, anchor


@numba.njit(cache=True)
def servo_step(servo, goal, q, v, load):
    """One step of a servo that a load torque acts on: new angle and speed, duty and current."""
    reading = TICK * math.floor(q / TICK + 0.5)
    duty = min(max(servo.gain * (goal - reading), -servo.duty_limit), servo.duty_limit)
    current = (duty * servo.volts - servo.motor_constant * v) / servo.resistance
    free = servo.motor_constant * current + load
    if v == 0.0 and abs(free) <= servo.coulomb:
        return q, 0.0, duty, current
    way = v if v != 0.0 else free
    # viscous and back-EMF are taken at the end of the step: stable at any size
    push = servo.motor_constant * duty * servo.volts / servo.resistance + load - math.copysign(servo.coulomb, way)
    drag = servo.viscous + servo.motor_constant**2 / servo.resistance
    after = (v + STEP * push / servo.armature) / (1.0 + STEP * drag / servo.armature)
    if after * way < 0.0:
        after = 0.0
    return q + 0.5 * STEP * (v + after), after, duty, current


@numba.njit(cache=True)
def hop(ground, body, hip, knee, sample, shape, noise, start_height):
    """Run the leg under a bang-bang law at the sample times.

    Args:
        sample: times (n,) [s] at which encoders are read and goals set.
        shape: per sample amplitude [rad], the weights of hip and knee, threshold [N.m] and goal shifts (n, 6).
        noise: of the encoders of both motors and both links (n, 4) [rad].
        start_height: of the foot over the ground [m].

    Returns:
        (n, 15): goals, motors, links, duties, currents (two each), hip x and z, forces normal and tangential, slip.
    """
    n = len(sample)
    out = np.zeros((n, 15))
    s = np.zeros(8)
    s[2], s[3] = REST
    s[1] = body.upper_length * math.cos(REST[0]) + body.lower_length * math.cos(REST[1]) + body.foot_radius
    s[1] += start_height
    motor = np.array([REST[0], 0.0, REST[1], 0.0])
    anchor = math.nan
    pending_time = np.full((n + 1,), np.inf)
    goals = np.zeros((n + 1, 2))
    goals[0] = REST
    latest = np.zeros(2, np.int64)  # goal in force at each servo
    duty, current = np.zeros(2), np.zeros(2)
    k1, k2, k3, k4 = np.zeros(8), np.zeros(8), np.zeros(8), np.zeros(8)
    k, normal, tangential, slip = 0, 0.0, 0.0, 0.0
    for step in range(int((sample[n - 1] + 0.002) / STEP)):
        time = step * STEP
        if k < n and sample[k] <= time:
            row = out[k]
            row[2], row[3], row[4], row[5] = motor[0], motor[2], s[2], s[3]
            row[6:8], row[8:10] = duty, current
            row[10], row[11], row[12], row[13], row[14] = s[0], s[1], normal, tangential, slip
            slip = 0.0
            amplitude, w_hip, w_knee, threshold = shape[k, 0], shape[k, 1], shape[k, 2], shape[k, 3]
            along = w_hip * 2.0 * (motor[0] + noise[k, 0] - s[2] - noise[k, 2])
            along += w_knee * 2.0 * (motor[2] + noise[k, 1] - s[3] - noise[k, 3])
            signal = 0.0 if abs(along) <= threshold else math.copysign(amplitude, along)
            row[0] = REST[0] + w_hip * signal + shape[k, 4]
            row[1] = REST[1] + w_knee * signal + shape[k, 5]
            pending_time[k + 1] = sample[k]
            goals[k + 1] = row[0:2]
            k += 1
        for j in range(2):
            servo = hip if j == 0 else knee
            while latest[j] + 1 <= k and pending_time[latest[j] + 1] + servo.delay <= time:
                latest[j] += 1
            load = -spring_torque(servo, motor[2 * j] - s[2 + j], motor[2 * j + 1] - s[6 + j])
            q, v, duty[j], current[j] = servo_step(servo, goals[latest[j], j], motor[2 * j], motor[2 * j + 1], load)
            motor[2 * j], motor[2 * j + 1] = q, v
        normal, tangential, kept = leg_rate(ground, body, hip, knee, motor, s, anchor, k1)
        leg_rate(ground, body, hip, knee, motor, s + 0.5 * STEP * k1, kept, k2)
        leg_rate(ground, body, hip, knee, motor, s + 0.5 * STEP * k2, kept, k3)
        leg_rate(ground, body, hip, knee, motor, s + STEP * k3, kept, k4)
        if not math.isnan(anchor) and not math.isnan(kept):
            slip += abs(kept - anchor)
        anchor = kept
        s = s + STEP / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return out


def nominal_hopper_chain() -> list[dict[str, dict[str, float]]]:
    """The chain that the sidecar believes in, for both joints."""
    servo = Servo()
    motor = {key: getattr(servo, key) for key in ("motor_constant", "resistance", "armature")}
    return [
        {"delay": {"seconds": servo.delay}},
        {"position_p": {"gain": servo.gain}},
        {"duty_limit": {"limit": servo.duty_limit}},
        {"supply": {"volts": servo.volts, "resistance": 0.0}},
        {"dc_motor": motor},
        {"friction": {"coulomb": servo.coulomb, "viscous": servo.viscous}},
        {"spring": {"stiffness": servo.stiffness, "damping": servo.damping}},
        {"encoder": {"ticks": 4096}},
    ]


def record_hopper(
    effects: dict[str, str | float] | None = None,
    seed: int = 0,
    *,
    runs: int = 3,
    duration: float = 20.0,
    nominal_error: float = 0.05,
) -> tuple[list[Recording], dict[str, Any]]:
    """Record runs of a hopper that hides ``effects``.

    Args:
        effects: cause (or stranger) to ``clear``, ``moderate``, ``faint`` or a value; nothing hides nothing.
        seed: of everything random; equal seeds give equal logs.
        runs: number of runs.
        duration: of each run [s].
        nominal_error: largest relative error of the sidecar's servo parameters, drawn for each servo.

    Returns:
        The recordings, and the truth: ``seed``, ``effects``, ``nominal_factors`` by joint (true over nominal),
        ``noise_floor`` [rad], and per run ``forces`` (n, 2) and ``slip`` (n,) of the foot.
    """
    rng = np.random.default_rng(seed)
    ground, servos, factors = Ground(), [], {}
    for joint in JOINTS:
        drawn = {name: 1.0 + nominal_error * rng.uniform(-1.0, 1.0) for name in UNCERTAIN}
        servos.append(Servo()._replace(**{name: getattr(Servo(), name) * factor for name, factor in drawn.items()}))
        factors[joint] = drawn
    hip, knee = servos
    truth: dict[str, Any] = {"seed": seed, "effects": {}, "nominal_factors": factors, "forces": [], "slip": []}
    for name, size in (effects or {}).items():
        effect = (HOPPER_EFFECTS | HOPPER_STRANGERS)[name]
        value = effect.sizes[MAGNITUDES.index(size)] if isinstance(size, str) else float(size)
        ground, hip, knee = effect.apply(ground, hip, knee, value)
        truth["effects"][name] = {
            "parameter": effect.parameter,
            "value": value,
            "unit": effect.unit,
            "magnitude": size if isinstance(size, str) else None,
        }
    truth["noise_floor"] = float(np.hypot(ENCODER_NOISE, TICK / math.sqrt(12.0)))
    recorded = []
    for index in range(runs):
        own = np.random.default_rng([seed, index])
        time, out = _run(ground, hip, knee, duration, own)
        truth["forces"].append(out[:, 12:14])
        truth["slip"].append(out[:, 14])
        recorded.append(_log(f"run{index}", time, out, own))
    return recorded, truth


def _run(ground: Ground, hip: Servo, knee: Servo, duration: float, rng: np.random.Generator):
    count = int(duration / SAMPLE_PERIOD)
    jitter = np.clip(rng.normal(0.0, JITTER, count), -0.3 * SAMPLE_PERIOD, 0.3 * SAMPLE_PERIOD)
    time = SAMPLE_PERIOD * (1.0 + np.arange(count)) + jitter
    # every two seconds the gait changes: how high, how far the hip leans, and forward or backward
    part = (time / 2.0).astype(int)
    pieces = int(part.max()) + 1
    lean = rng.uniform(-0.12, 0.12, pieces)
    shape = np.stack(
        [
            rng.uniform(0.2, 0.32, pieces),
            rng.uniform(-0.65, -0.4, pieces),
            rng.uniform(0.9, 1.1, pieces),
            rng.uniform(0.25, 0.32, pieces),
            lean,
            lean + rng.uniform(-0.06, 0.06, pieces),
        ],
        axis=1,
    )[part]
    noise = rng.normal(0.0, ENCODER_NOISE, (count, 4))
    out = hop(ground, Body(), hip, knee, time, np.ascontiguousarray(shape), noise, rng.uniform(0.01, 0.05))
    return time, out


def _log(name: str, time: np.ndarray, out: np.ndarray, rng: np.random.Generator) -> Recording:
    def encoder(values: np.ndarray) -> np.ndarray:
        return TICK * np.round((values + rng.normal(0.0, ENCODER_NOISE, len(values))) / TICK)

    def boom(values: np.ndarray) -> np.ndarray:
        return BOOM_STEP * np.round((values + rng.normal(0.0, BOOM_NOISE, len(values))) / BOOM_STEP)

    joints = {
        joint: {
            "goal": out[:, k].copy(),
            "position": encoder(out[:, 2 + k]),
            "link_position": encoder(out[:, 4 + k]),
            "duty": np.asarray(np.round(out[:, 6 + k], 3), np.float64),
            "current": CURRENT_STEP
            * np.round((out[:, 8 + k] + rng.normal(0.0, CURRENT_STEP, len(time))) / CURRENT_STEP),
        }
        for k, joint in enumerate(JOINTS)
    }
    body = Body()
    return Recording(
        name=name,
        time=time,
        joints=joints,
        base={"x": boom(out[:, 10]), "z": boom(out[:, 11])},
        robot="hopper",
        robot_params={key: float(getattr(body, key)) for key in Body._fields} | {"contact_time": CONTACT_TIME},
        actuators=dict.fromkeys(JOINTS, nominal_hopper_chain()),
    )
