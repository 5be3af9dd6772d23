"""The catalogue: every physical cause that a gap can be named for. A new cause is one entry here and one test."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ...actuators.mounting import coupling_element
from ..replay.joint_model import JointModel
from ..replay.parameters import TIGHT, Parameter, factor


@dataclass(frozen=True)
class Cause:
    """One entry of the catalogue.

    Attributes:
        name: as in ``diagnosis.json``.
        sentence: for people.
        picture: which picture shows it (:mod:`sealegs.gap.output.pictures`).
        variants: ways in which it may act, each the parameters that it turns; the one that explains more is taken.
        error: whether it is a wrong number of the nominal model, not an effect that the model lacks.
    """

    name: str
    sentence: str
    picture: str
    variants: tuple[tuple[Parameter, ...], ...]
    error: bool = False


Entry = Callable[[JointModel], Cause | None]
ENTRIES: list[Entry] = []


def entry(function: Entry) -> Entry:
    """Add an entry: a function from the nominal joint to the cause, or None where the joint cannot have it."""
    ENTRIES.append(function)
    return function


def catalogue(nominal: JointModel) -> list[Cause]:
    """The causes that a joint can have; what nobody measured (:mod:`sealegs.gap.load.unknown`) cannot be wrong."""
    unknown = {parameter.path.rstrip("*") for parameter in nominal.unknown}
    causes = [cause for make in ENTRIES if (cause := make(nominal)) is not None]
    return [
        cause
        for cause in causes
        if not (cause.error and any(variant[0].path.rstrip("*") in unknown for variant in cause.variants))
        and not (cause.name.startswith("load.") and any(path.startswith("load.") for path in unknown))
    ]


def retunable(nominal: JointModel, width: float = TIGHT) -> list[Parameter]:
    """Numbers that the nominal model has and that nobody knows exactly, as factors within ``1 +- width``, and those
    that nobody measured, within their own bounds.
    """
    low, high = 1.0 / (1.0 + width), 1.0 + width
    unknown = {parameter.path.rstrip("*") for parameter in nominal.unknown}
    found = []
    for stage, keys in RETUNABLE.items():
        if nominal.chain.find(stage) is not None:
            found += [
                factor(f"{stage}.{key}", low, high, 0.05, DIFFERENCES.get(f"{stage}.{key}", 0.4))
                for key in keys
                if nominal.value(f"{stage}.{key}") > 0.0 and f"{stage}.{key}" not in unknown
            ]
    return [*found, *nominal.unknown]


RETUNABLE: dict[str, tuple[str, ...]] = {
    "delay": ("seconds",),
    "dc_motor": ("motor_constant", "resistance", "armature"),
    "regression": ("armature",),
    "ideal": ("stiffness", "damping", "armature"),
    "friction": ("coulomb", "viscous", "stribeck", "load"),
    "spring": ("damping",),
}
"""Numbers that data sheets and older fits give only roughly; gains, ticks and limits are set by people and known."""


DIFFERENCES = {"delay.seconds": 1.5}
"""Finite-difference steps in parts of the scale, where the response has steps of its own (a command is early or
late by a whole sample).
"""


def _number(
    nominal: JointModel, path: str, unit: str, low: float, high: float, start: float, scale: float
) -> Parameter:
    """A parameter as a factor where the nominal model has it, else as a value."""
    has = nominal.chain.find(path.split(".")[0]) is not None and nominal.value(path) > 0.0
    value = nominal.value(path) if has else 0.0
    if has and low < value < high:
        return factor(path, max(low / value, 0.02), min(high / value, 50.0), 0.15)
    return Parameter(path, unit, low, high, start, scale)


# --- friction ----------------------------------------------------------------------------------------------------


@entry
def coulomb(nominal: JointModel) -> Cause:
    number = _number(
        nominal,
        "friction.coulomb",
        "N.m",
        1e-4 * _torque(nominal),
        _torque(nominal),
        0.05 * _torque(nominal),
        0.02 * _torque(nominal),
    )
    sentence = "Dry friction differs from what the model has."
    return Cause("friction.coulomb", sentence, "friction_against_speed", ((number,),), error=True)


@entry
def viscous(nominal: JointModel) -> Cause:
    top = _torque(nominal)
    number = _number(nominal, "friction.viscous", "N.m.s/rad", 1e-5 * top, top, 0.02 * top, 0.02 * top)
    sentence = "Friction that grows with speed differs from what the model has."
    return Cause("friction.viscous", sentence, "friction_against_speed", ((number,),), error=True)


@entry
def stribeck(nominal: JointModel) -> Cause:
    top = _torque(nominal)
    extra = Parameter("friction.stribeck", "N.m", 0.0, top, 0.05 * top, 0.03 * top)
    speed = Parameter("friction.stribeck_velocity", "rad/s", 0.02, 3.0, 0.2, 0.5, logarithmic=True)
    sentence = "Friction is larger at rest and at low speed than while moving."
    return Cause("friction.stribeck", sentence, "friction_against_speed", ((extra, speed),))


@entry
def asymmetric(nominal: JointModel) -> Cause:
    top = _torque(nominal)
    number = Parameter("friction.asymmetry", "N.m", -0.5 * top, 0.5 * top, 0.0, 0.02 * top)
    return Cause(
        "friction.asymmetric",
        "Dry friction differs between the two directions.",
        "friction_against_speed",
        ((number,),),
    )


@entry
def load_dependent(nominal: JointModel) -> Cause:
    number = Parameter("friction.load", "1", 0.0, 1.5, 0.08, 0.05)
    at_rest = Parameter("friction.load_stribeck", "1", 0.0, 1.5, 0.08, 0.05)
    speed = Parameter("friction.stribeck_velocity", "rad/s", 0.02, 5.0, 0.3, 0.5, logarithmic=True)
    sentence = "Dry friction grows with the torque that passes through the gearbox."
    quadratic = Parameter(
        "friction.load_quadratic",
        "1/(N.m)",
        0.0,
        3.0 / _torque(nominal),
        0.1 / _torque(nominal),
        0.1 / _torque(nominal),
    )
    variants = ((number,), (quadratic, number), (number, at_rest, speed), (quadratic, at_rest, speed))
    return Cause("friction.load_dependent", sentence, "residual_against_load", variants)


@entry
def presliding(nominal: JointModel) -> Cause:
    top = _torque(nominal)
    numbers = [
        Parameter("friction.bristle_stiffness", "N.m/rad", 0.05 * top, 50.0 * top, start * top, 0.3, logarithmic=True)
        for start in (0.4, 2.0, 8.0)
    ]
    return Cause(
        "friction.presliding",
        "A joint that sticks gives way like a spring before it slips.",
        "hysteresis",
        tuple((n,) for n in numbers),
    )


@entry
def position_dependent(nominal: JointModel) -> Cause:
    top = _torque(nominal)
    amplitude = Parameter("friction.ripple", "N.m", 0.0, 0.5 * top, 0.02 * top, 0.02 * top)
    phase = Parameter("friction.ripple_phase", "rad", -9.0, 9.0, 0.0, 0.5)
    # The period is found by trying whole numbers of teeth; a descent would stick in the nearest of many minima.
    counts = [Parameter("friction.ripple_count", "1/turn", n - 0.5, n + 0.5, float(n), 0.3) for n in RIPPLE_COUNTS]
    variants = tuple((amplitude, count, phase) for count in counts)
    return Cause(
        "friction.position_dependent",
        "Friction changes with the angle, as teeth mesh.",
        "residual_against_position",
        variants,
    )


RIPPLE_COUNTS = (2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 14, 16, 18, 20, 24)


# --- drive -------------------------------------------------------------------------------------------------------


@entry
def gain(nominal: JointModel) -> Cause | None:
    stage = next((name for name in ("position_p", "position_pd", "position_pi") if nominal.chain.find(name)), None)
    path = f"{stage}.gain" if stage else "ideal.stiffness"
    if stage is None and nominal.chain.find("ideal") is None:
        return None
    sentence = "The position loop is weaker or stronger than its setting says."
    return Cause("drive.gain", sentence, "response", ((factor(path, 0.1, 10.0),),), error=True)


@entry
def delay(nominal: JointModel) -> Cause:
    believed = nominal.value("delay.seconds")
    # the response has steps of its own, a sample each, so that a fit from afar may end between them
    numbers = [Parameter("delay.seconds", "s", 0.0, 0.2, believed + more, 0.004) for more in (0.008, 0.002)]
    return Cause(
        "drive.delay",
        "Commands take effect later than the model believes.",
        "response",
        tuple((n,) for n in numbers),
        error=nominal.chain.find("delay") is not None,
    )


@entry
def rate_limit(nominal: JointModel) -> Cause:
    sentence = "The firmware moves its goal no faster than a limit."
    numbers = [
        Parameter("rate_limit.speed", "rad/s", 0.05, 500.0, start, 0.2, logarithmic=True)
        for start in (1.5, 5.0, 15.0, 45.0)
    ]
    return Cause("drive.rate_limit", sentence, "response", tuple((number,) for number in numbers))


@entry
def deadband(nominal: JointModel) -> Cause:
    numbers = [Parameter("dead_band.width", "rad", 0.0, 0.3, start, 0.003) for start in (0.006, 0.03)]
    return Cause(
        "drive.deadband",
        "The controller ignores errors below a width.",
        "duty_against_error",
        tuple((n,) for n in numbers),
    )


@entry
def saturation(nominal: JointModel) -> Cause | None:
    if nominal.chain.find("supply") is None and nominal.chain.find("regression") is None:
        return None
    top = nominal.value("duty_limit.limit")
    numbers = [
        Parameter("duty_limit.limit", "1", 0.02, 1.0, start * top, 0.1, logarithmic=True)
        for start in (0.95, 0.8, 0.5, 0.25)
    ]
    return Cause(
        "drive.saturation",
        "The duty saturates earlier than the model believes.",
        "duty_against_error",
        tuple((n,) for n in numbers),
    )


@entry
def offset(nominal: JointModel) -> Cause:
    number = Parameter("offset.value", "rad", -0.5, 0.5, 0.0, 0.005)
    return Cause("drive.offset", "Goals arrive shifted by a constant.", "response", ((number,),))


@entry
def minimum_duty(nominal: JointModel) -> Cause | None:
    if nominal.chain.find("supply") is None:
        return None
    numbers = [Parameter("minimum_duty.value", "1", 0.0, 0.6, start, 0.02) for start in (0.04, 0.12)]
    return Cause(
        "drive.minimum_duty",
        "The firmware raises small duties to a minimum start-up force.",
        "duty_against_error",
        tuple((n,) for n in numbers),
    )


@entry
def supply_sag(nominal: JointModel) -> Cause | None:
    if nominal.chain.find("supply") is None or nominal.chain.find("dc_motor") is None:
        return None
    motor = nominal.value("dc_motor.resistance")
    number = Parameter("supply.resistance", "ohm", 0.0, 5.0 * motor, 0.2 * motor, 0.1 * motor)
    return Cause("drive.supply_sag", "The supply voltage drops under current.", "voltage_against_current", ((number,),))


@entry
def overload(nominal: JointModel) -> Cause | None:
    if nominal.chain.find("torque_limit") is not None or (top := _torque(nominal)) <= 0.0:
        return None
    top /= nominal.chain.gear_ratio()  # the limit goes before a gear
    numbers = [
        Parameter("torque_limit.limit", "N.m", 0.02 * top, 1.2 * top, start * top, 0.1, logarithmic=True)
        for start in (0.8, 0.5, 0.25)
    ]
    return Cause("drive.overload", "The firmware limits the torque.", "response", tuple((n,) for n in numbers))


@entry
def integer_gain(nominal: JointModel) -> Cause | None:
    if nominal.chain.find("duty_step") is not None or nominal.chain.find("supply") is None:
        return None
    down = [
        Parameter("duty_step.size", "1", 0.0, 0.4, start, 0.02) for start in (0.005, 0.0085, 0.0145, 0.025, 0.042, 0.07)
    ]
    mode = Parameter("duty_step.towards_zero", "1", 0.9, 1.0, 1.0, 1.0)
    variants = (*((number,) for number in down), *((number, mode) for number in down))
    return Cause(
        "drive.integer_gain", "The firmware computes the duty in coarse steps.", "duty_against_error", variants
    )


@entry
def thermal(nominal: JointModel) -> Cause | None:
    if nominal.chain.find("dc_motor") is None or nominal.chain.find("thermal") is not None:
        return None
    number = Parameter("thermal.loss", "1/K", -0.05, 0.05, 0.002, 0.002)
    return Cause(
        "drive.thermal", "The motor grows weaker as it warms up.", "residual_against_temperature", ((number,),)
    )


@entry
def motor_constant(nominal: JointModel) -> Cause | None:
    if nominal.chain.find("dc_motor") is None:
        return None
    sentence = "Torque per current and back-EMF differ from the data sheet."
    return Cause(
        "drive.motor_constant", sentence, "response", ((factor("dc_motor.motor_constant", 0.3, 3.0),),), error=True
    )


# --- transmission ------------------------------------------------------------------------------------------------


@entry
def backlash(nominal: JointModel) -> Cause:
    small, large = (Parameter("backlash.width", "rad", 0.0, 0.5, start, 0.01) for start in (0.02, 0.08))
    variants: list[tuple[Parameter, ...]] = [(small,), (large,)]
    if (top := _torque(nominal)) > 0.0 and coupling_element(nominal.chain) is None:
        # how teeth bounce shows in a play that is wide enough for them to leave each other
        stiffness = Parameter(
            "backlash.tooth_stiffness", "N.m/rad", 30.0 * top, 3e3 * top, 300.0 * top, 0.3, logarithmic=True
        )
        damping = Parameter(
            "backlash.tooth_damping", "N.m.s/rad", 0.01 * top, 3.0 * top, 0.3 * top, 0.3, logarithmic=True
        )
        variants.append((large, stiffness, damping))
    return Cause("transmission.backlash", "There is play between motor and link.", "hysteresis", tuple(variants))


@entry
def compliance(nominal: JointModel) -> Cause | None:
    if nominal.chain.find("spring") is not None:
        return None
    top = _torque(nominal)
    damping = Parameter("compliance.damping", "N.m.s/rad", 0.0, 0.5 * top, 0.005 * top, 0.01 * top)
    variants = []
    for start in (6.0, 25.0):
        number = Parameter(
            "compliance.stiffness", "N.m/rad", 0.3 * top, 400.0 * top, start * top, 0.3, logarithmic=True
        )
        variants.append((number, damping))
    return Cause("transmission.compliance", "Gears or shaft give way under load.", "hysteresis", tuple(variants))


@entry
def gear_ratio(nominal: JointModel) -> Cause | None:
    if nominal.chain.find("dc_motor") is None:
        return None
    number = Parameter("gear_ratio.factor", "1", 0.2, 5.0, 1.0, 0.1, logarithmic=True)
    return Cause(
        "transmission.gear_ratio",
        "The reduction differs: torque scales with it, reflected inertia with its square.",
        "response",
        ((number,),),
        error=True,
    )


@entry
def spring_stiffness(nominal: JointModel) -> Cause | None:
    if nominal.chain.find("spring") is None:
        return None
    return Cause(
        "spring.stiffness",
        "The series spring is softer or stiffer than believed.",
        "hysteresis",
        ((factor("spring.stiffness", 0.05, 20.0),),),
        error=True,
    )


# --- load --------------------------------------------------------------------------------------------------------


@entry
def load_mass(nominal: JointModel) -> Cause:
    number = Parameter("load.mass_factor", "1", 0.2, 6.0, 1.0, 0.1, logarithmic=True)
    return Cause(
        "load.mass",
        "The load is lighter or heavier than believed.",
        "residual_against_position",
        ((number,),),
        error=True,
    )


@entry
def load_inertia(nominal: JointModel) -> Cause:
    number = Parameter("load.extra_inertia", "kg.m2", 0.0, 0.5, 0.002, 0.002)
    return Cause(
        "load.inertia", "The load has more inertia than its mass and length give.", "response", ((number,),), error=True
    )


@entry
def centre_of_mass(nominal: JointModel) -> Cause:
    number = Parameter("load.centre_shift", "m", -0.08, 0.3, 0.0, 0.005)
    return Cause(
        "load.centre_of_mass",
        "The load's centre of mass sits at another distance.",
        "residual_against_position",
        ((number,),),
        error=True,
    )


@entry
def blocked(nominal: JointModel) -> Cause:
    variants = []
    for start in (0.9, 0.5, 0.25):
        upper = Parameter("load.stop_angle", "rad", -0.5, 2.0, start, 0.03)
        lower = Parameter("load.lower_stop", "rad", -2.0, 0.5, -start, 0.03)
        variants += [(upper,), (lower,), (upper, lower)]
    return Cause("contact.blocked", "Something stops the link at an angle.", "response", tuple(variants))


# --- sensor ------------------------------------------------------------------------------------------------------


@entry
def sensor_offset(nominal: JointModel) -> Cause:
    in_loop = Parameter("encoder.offset", "rad", -0.8, 0.8, 0.0, 0.02)
    in_log = Parameter("host.offset", "rad", -0.8, 0.8, 0.0, 0.005)
    return Cause(
        "sensor.offset",
        "The encoder's zero is not where the model has it.",
        "residual_against_position",
        ((in_loop,), (in_log,)),
        error=True,
    )


@entry
def sensor_scale(nominal: JointModel) -> Cause:
    in_loop = Parameter("encoder.scale", "1", 0.4, 2.5, 1.0, 0.05, logarithmic=True)
    in_log = Parameter("host.scale", "1", 0.01, 100.0, 1.0, 0.02, logarithmic=True)
    return Cause(
        "sensor.scale",
        "The encoder reads more or less than the angle.",
        "residual_against_position",
        ((in_loop,), (in_log,)),
        error=True,
    )


@entry
def sensor_delay(nominal: JointModel) -> Cause:
    number = Parameter("encoder.latency", "s", 0.0, 0.2, 0.006, 0.003)
    return Cause("sensor.delay", "Readings reach the host late.", "response", ((number,),))


def _torque(nominal: JointModel) -> float:
    """Stall torque of the joint [N.m], the yardstick for starts and bounds."""
    chain = nominal.chain
    motor, supply = chain.find("dc_motor"), chain.find("supply")
    if motor is not None and supply is not None:
        return chain.gear_ratio() * motor.motor_constant * supply.volts / motor.resistance
    if (regression := chain.find("regression")) is not None:
        return abs(regression.duty_torque) * chain.gear_ratio()
    if (ideal := chain.find("ideal")) is not None:
        return min(ideal.torque_limit, ideal.stiffness * math.pi / 4)
    return 1.0
