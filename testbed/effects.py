"""What the hidden bench can hide: cause names, what each changes, and how much is clear, moderate or faint.

A magnitude moves the measured position by about 11, 4.5 and 1.6 times the noise floor (rms over the default runs with
the medium load); ``python -m testbed.calibrate`` prints them. Five whose size depends on the seed, or which a
servo cannot show that strongly, are set by hand: ``friction.presliding``, ``transmission.backlash`` (clear),
``drive.overload``, ``contact.blocked``, and ``drive.acceleration_limit``, which moves it by 140, 40 and 12: what servos
are set to shows far more than others do. For scale: nominal parameters wrong by up to 5 % alone move it by 4 to 5.5
noise floors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .physics import Machine

MAGNITUDES = ("clear", "moderate", "faint")
GAP_IN_NOISE_FLOORS = {"clear": 11.0, "moderate": 4.5, "faint": 1.6}


@dataclass(frozen=True)
class Effect:
    """One hidden effect.

    Attributes:
        parameter: its name in the truth.
        unit: its unit.
        apply: machine and value to the machine with the effect.
        sizes: value per magnitude.
        span: value without effect, largest plausible value; the calibration searches between them.
    """

    parameter: str
    unit: str
    apply: Callable[[Machine, float], Machine]
    sizes: tuple[float, float, float]
    span: tuple[float, float]


def _add(field: str) -> Callable[[Machine, float], Machine]:
    return lambda machine, value: machine._replace(**{field: getattr(machine, field) + value})


def _set(field: str) -> Callable[[Machine, float], Machine]:
    return lambda machine, value: machine._replace(**{field: value})


def _times(field: str) -> Callable[[Machine, float], Machine]:
    return lambda machine, value: machine._replace(**{field: getattr(machine, field) * value})


def _gear_ratio(machine: Machine, factor: float) -> Machine:
    return machine._replace(motor_constant=machine.motor_constant * factor, armature=machine.armature * factor * factor)


def _jams(machine: Machine, torque: float) -> Machine:
    return machine._replace(jam_torque=torque)


EFFECTS: dict[str, Effect] = {
    "friction.coulomb": Effect("coulomb_extra", "N.m", _add("coulomb"), (0.092, 0.035, 0.0087), (0.0, 0.4)),
    "friction.viscous": Effect("viscous_extra", "N.m.s/rad", _add("viscous"), (0.0348, 0.014, 0.00428), (0.0, 1.0)),
    "friction.stribeck": Effect("stribeck", "N.m", _set("stribeck"), (0.276, 0.113, 0.0384), (0.0, 0.6)),
    "friction.asymmetric": Effect("asymmetry", "N.m", _set("asymmetry"), (0.108, 0.0346, 0.0087), (0.0, 0.4)),
    "friction.load_dependent": Effect("load", "1", _set("load_friction"), (0.133, 0.0519, 0.0151), (0.0, 0.4)),
    "friction.position_dependent": Effect("ripple", "N.m", _set("ripple"), (0.222, 0.0581, 0.0146), (0.0, 0.5)),
    "friction.presliding": Effect(
        "bristle_stiffness", "N.m/rad", _set("bristle_stiffness"), (0.8, 4.0, 28.0), (400.0, 0.5)
    ),
    "drive.gain": Effect("gain_factor", "1", _times("gain"), (0.893, 0.954, 0.987), (1.0, 0.4)),
    "drive.delay": Effect("delay_extra", "s", _add("command_delay"), (0.00408, 0.00163, 0.000495), (0.0, 0.06)),
    "drive.rate_limit": Effect("speed", "rad/s", _set("goal_speed"), (16.7, 41.4, 119.0), (400.0, 1.0)),
    "drive.acceleration_limit": Effect(
        "acceleration", "rad/s2", _set("goal_acceleration"), (40.0, 400.0, 4500.0), (1e6, 5.0)
    ),
    "drive.goal_filter": Effect("time_constant", "s", _set("goal_smoothing"), (0.00527, 0.00212, 0.000626), (0.0, 0.1)),
    "drive.deadband": Effect("deadband", "rad", _set("error_deadband"), (0.0216, 0.0127, 0.00689), (0.0, 0.06)),
    "drive.saturation": Effect("duty_limit", "1", _set("duty_limit"), (0.924, 0.95, 0.963), (0.97, 0.35)),
    "drive.offset": Effect("goal_offset", "rad", _set("goal_offset"), (0.00671, 0.00263, 0.000588), (0.0, 0.05)),
    "drive.supply_sag": Effect(
        "supply_resistance", "ohm", _set("supply_resistance"), (0.414, 0.165, 0.0551), (0.0, 8.0)
    ),
    "drive.thermal": Effect(
        "torque_loss", "1/K", _set("torque_loss_per_kelvin"), (0.0103, 0.00426, 0.00134), (0.0, 0.06)
    ),
    "drive.motor_constant": Effect(
        "motor_constant_factor", "1", _times("motor_constant"), (0.913, 0.965, 0.99), (1.0, 0.5)
    ),
    "drive.minimum_duty": Effect("minimum_duty", "1", _set("minimum_duty"), (0.113, 0.0663, 0.0332), (0.0, 0.4)),
    "drive.overload": Effect("torque_limit", "N.m", _set("overload_torque"), (1.9, 2.4, 2.8), (3.5, 0.7)),
    "drive.integer_gain": Effect("duty_step", "1", _set("duty_step"), (0.0695, 0.0284, 0.00652), (0.0, 0.3)),
    "transmission.backlash": Effect("width", "rad", _set("backlash"), (0.25, 0.106, 0.0222), (0.0, 0.25)),
    "transmission.compliance": Effect(
        "stiffness", "N.m/rad", _set("joint_stiffness"), (5.96, 13.7, 53.4), (400.0, 1.5)
    ),
    "transmission.gear_ratio": Effect("ratio_factor", "1", _gear_ratio, (0.944, 0.978, 0.993), (1.0, 0.5)),
    "load.mass": Effect("mass_factor", "1", _times("mass"), (1.46, 1.18, 1.05), (1.0, 3.0)),
    "load.inertia": Effect("inertia_extra", "kg.m2", _set("extra_inertia"), (0.00393, 0.00154, 0.000481), (0.0, 0.1)),
    "load.centre_of_mass": Effect("shift", "m", _set("centre_shift"), (0.0365, 0.0156, 0.00444), (0.0, 0.12)),
    "sensor.offset": Effect("offset", "rad", _set("encoder_offset"), (0.112, 0.0452, 0.0114), (0.0, 0.6)),
    "sensor.scale": Effect("scale", "1", _set("encoder_scale"), (0.956, 0.982, 0.994), (1.0, 0.5)),
    "sensor.delay": Effect("latency", "s", lambda machine, value: machine, (0.00408, 0.00163, 0.000495), (0.0, 0.06)),
    "spring.stiffness": Effect("stiffness_factor", "1", _times("joint_stiffness"), (0.369, 0.709, 0.904), (1.0, 0.1)),
    "contact.blocked": Effect("stop_angle", "rad", _set("stop_angle"), (1.0, 1.07, 1.12), (1.7, 0.1)),
    "drive.derivative": Effect(
        "derivative_gain", "s/rad", _set("derivative_gain"), (0.0438, 0.0189, 0.00546), (0.0, 0.5)
    ),
    "friction.drag": Effect("drag", "N.m.s2/rad2", _set("air_drag"), (0.00837, 0.00328, 0.00106), (0.0, 0.3)),
    "drive.resistance": Effect("resistance_factor", "1", _times("resistance"), (1.14, 1.055, 1.018), (1.0, 3.0)),
}

STRANGERS: dict[str, Effect] = {
    "stranger.cable": Effect("stiffness", "N.m/rad", _set("cable_stiffness"), (0.4, 0.158, 0.0455), (0.0, 2.0)),
    "stranger.friction_drift": Effect(
        "drift", "N.m/s", _set("friction_drift"), (0.00724, 0.00252, 0.000687), (0.0, 0.03)
    ),
    "stranger.jams": Effect("jam_torque", "N.m", _jams, (0.374, 0.146, 0.0482), (0.0, 2.0)),
}
"""Effects that no catalogue of causes holds; nothing may be named for them with confidence."""

BOTH_SIGNS = {
    "friction.asymmetric", "drive.gain", "drive.offset", "drive.motor_constant", "drive.resistance",
    "transmission.gear_ratio", "load.mass", "load.centre_of_mass", "sensor.offset", "sensor.scale", "spring.stiffness",
}  # fmt: skip
"""Effects that may as well be of the other sign."""
SPREAD = 1.4
"""A drawn effect is up to this factor larger or smaller than the size that its magnitude stands for."""
BY_HAND = {"drive.overload", "contact.blocked"}
"""Limits that the motion only just reaches; theirs are drawn from a tenth of that spread."""


def drawn_constants(rng: np.random.Generator) -> dict[str, float]:
    """What an effect has beside its size, drawn as well: by name of the machine's number."""
    plain = Machine()
    names = ("stribeck_velocity", "tooth_stiffness", "tooth_damping", "stop_stiffness", "stop_damping")
    numbers = {name: getattr(plain, name) * SPREAD ** rng.uniform(-1.0, 1.0) for name in names}
    turns = {"ripple_count": float(rng.integers(5, 15)), "ripple_phase": rng.uniform(-np.pi, np.pi)}
    return {**numbers, **turns}


def drawn(name: str, magnitude: str, rng: np.random.Generator) -> float:
    """A value of ``magnitude`` of an effect, of random size and sign.

    So that nothing which was set while looking at the sizes in the table, such as where a fit starts, fits by chance.
    """
    effect = (EFFECTS | STRANGERS)[name]
    value, none = effect.sizes[MAGNITUDES.index(magnitude)], effect.span[0]
    power = rng.uniform(-1.0, 1.0) * (0.1 if name in BY_HAND else 1.0)
    sign = rng.choice((-1.0, 1.0)) if name in BOTH_SIGNS else 1.0
    if none >= 400.0 or name in BY_HAND:  # the larger the value the smaller the effect, without a size for none
        return value * SPREAD**-power
    return none + (value - none) * sign * SPREAD**power
