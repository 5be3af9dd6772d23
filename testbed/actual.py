"""What a catalogue would have to find of an effect: a number of the machine that hides it, in the number's own unit."""

from __future__ import annotations

import math

from .physics import Machine

NUMBERS = {
    "friction.coulomb": "coulomb",
    "friction.viscous": "viscous",
    "friction.stribeck": "stribeck",
    "friction.asymmetric": "asymmetry",
    "friction.load_dependent": "load_friction",
    "drive.gain": "gain",
    "drive.delay": "command_delay",
    "drive.rate_limit": "goal_speed",
    "drive.deadband": "error_deadband",
    "drive.saturation": "duty_limit",
    "drive.supply_sag": "supply_resistance",
    "drive.motor_constant": "motor_constant",
    "drive.minimum_duty": "minimum_duty",
    "transmission.backlash": "backlash",
    "transmission.compliance": "joint_stiffness",
    "load.inertia": "extra_inertia",
    "sensor.offset": "encoder_offset",
    "sensor.scale": "encoder_scale",
}
"""Number of the machine that an effect sets, where the machine has it."""


def actual(name: str, machine: Machine, nominal: Machine, filter_time: float, latency: float) -> float:
    """The number that an effect is; NaN for a stranger.

    Args:
        name: of the effect.
        machine: with all effects.
        nominal: as it is believed to be.
        filter_time: time constant of the filter that the host puts on the goal [s].
        latency: of the position's reading [s].
    """
    if name == "load.mass":  # as a factor
        return machine.mass / nominal.mass
    special = {"drive.goal_filter": filter_time, "sensor.delay": latency, "contact.blocked": machine.stop_angle}
    return float(getattr(machine, NUMBERS[name]) if name in NUMBERS else special.get(name, math.nan))
