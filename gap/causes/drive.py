"""Firmware, power stage and motor."""

from __future__ import annotations

from dataclasses import replace

from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter, factor
from .cause import (
    Cause,
    Ceiling,
    Limit,
    Needs,
    alone,
    both,
    entry,
    follows_goals,
    follows_positions,
    has,
    has_any,
    impedance,
    lacks,
    stall_torque,
)

PER_COMMAND = Parameter("scale.factor", "1", 0.3, 3.0, 1.0, 0.1, logarithmic=True)
LOOPS = ("position_p", "position_pd", "position_pi")


def _loop_gain(nominal: JointModel) -> str | None:
    """Path of the gain of the position loop; None where there is no such loop."""
    return next((f"{name}.gain" for name in LOOPS if nominal.chain.find(name)), None)


def _stiffer_loop(nominal: JointModel) -> list[tuple[Parameter, ...]]:
    """The gain beside a cause that shapes the goal: a loop that seemed slow because of it is stiffer than it seemed."""
    loop = _loop_gain(nominal)
    return [(replace(factor(loop, 0.1, 10.0), start=2.0),)] if loop else []


def _speed_gain(nominal: JointModel) -> Cause:
    """Of a speed loop: its two gains, which a register each sets."""
    paths = [path for path in ("velocity_pi.integral", "velocity_pi.gain") if nominal.value(path) > 0.0]
    return Cause(
        sentence="The speed loop is weaker or stronger than its setting says.",
        picture="response",
        against="control error",
        variants=(*((factor(path, 0.1, 10.0),) for path in paths), tuple(factor(path, 0.1, 10.0) for path in paths)),
        error=True,
    )


@entry("drive.gain", both(has_any(*LOOPS, "velocity_pi", "ideal"), lambda nominal: not impedance(nominal)))
def gain(nominal: JointModel) -> Cause:
    if nominal.chain.find("velocity_pi"):
        return _speed_gain(nominal)
    return Cause(
        sentence="The position loop is weaker or stronger than its setting says.",
        picture="response",
        against="control error",
        variants=((factor(_loop_gain(nominal) or "ideal.stiffness", 0.1, 10.0),),),
        error=True,
    )


@entry("drive.derivative", has_any(*LOOPS))
def derivative(nominal: JointModel) -> Cause:
    """Servos have a D term from the factory that models of them leave out; what it brakes was taken for friction."""
    loop = _loop_gain(nominal)
    size = 1.0 if loop is None else nominal.value(loop)
    believed = nominal.value("derivative.gain") if nominal.chain.find("derivative") else 0.0
    term = Parameter("derivative.gain", "s/rad", 0.0, 0.5 * size, believed + 0.01 * size, 0.005 * size)
    # with a long one only the speed is left of the error's: then it is friction
    smoothed = Parameter("derivative.filter", "s", 4e-4, 0.05, 1e-3, 0.3, logarithmic=True, shape=True)
    beside = [(term, smoothed, factor(loop, 0.1, 10.0))] if loop else []
    return Cause(
        sentence="The firmware also acts on how fast the error grows (D term).",
        signature="lag",
        picture="response",
        variants=((term, smoothed), *beside),
        error=has("derivative")(nominal),
        degenerates_to=Limit("friction.viscous", "the goal only jumps"),
    )


@entry("drive.delay")
def delay(nominal: JointModel) -> Cause:
    believed = nominal.value("delay.seconds")
    # the response has steps of its own, a sample each, so that a fit from afar may end between them
    late = Parameter("delay.seconds", "s", 0.0, 0.2, believed, 0.004)
    return Cause(
        sentence="Commands take effect at another time than the model believes.",
        signature="lag",
        picture="response",
        variants=alone(late, believed + 0.008, believed + 0.002),
        error=has("delay")(nominal),
    )


@entry("drive.rate_limit", follows_positions)
def rate_limit(nominal: JointModel) -> Cause:
    del nominal
    speed = Parameter("rate_limit.speed", "rad/s", 0.05, 500.0, 1.5, 0.2, logarithmic=True)
    return Cause(
        sentence="The firmware moves its goal no faster than a limit.",
        signature="lag",
        picture="response",
        variants=alone(speed, 1.5, 5.0, 15.0, 45.0),
        degenerates_to=Limit("drive.delay", "all steps of the goal are alike"),
    )


@entry("drive.acceleration_limit", follows_positions)
def acceleration_limit(nominal: JointModel) -> Cause:
    """Of a goal profile; the register of Feetech's servos reaches from 0.15 to 39 rad/s2."""
    limits = alone(
        Parameter("rate_limit.acceleration", "rad/s2", 0.15, 5e4, 5.0, 0.2, logarithmic=True), 5.0, 30.0, 300.0
    )
    together = [(*limit, *gain) for gain in _stiffer_loop(nominal) for limit in limits[1:]]  # they only pay together
    return Cause(
        sentence="The firmware speeds its goal up no faster than a limit.",
        signature="lag",
        picture="response",
        variants=(*limits, *together),
        degenerates_to=Limit("drive.rate_limit", "the goal only jumps, and always as far"),
    )


@entry("drive.goal_filter", follows_goals)
def goal_filter(nominal: JointModel) -> Cause:
    """In the firmware or by the host, whose steps make the goal come earlier by half of its period."""
    # the steps of a slower one show in the log; with longer ones this stood in for half of a public arm's motor
    period = Parameter("goal_filter.period", "s", 0.0, 0.04, 0.005, 0.004)
    filters = alone(Parameter("goal_filter.time_constant", "s", 0.0, 1.0, 0.05, 0.004), 0.05, 0.008)
    together = [(*filters[0], period, *gain) for gain in _stiffer_loop(nominal)]
    return Cause(
        sentence="Firmware or host smooths the goal before the controller sees it.",
        signature="lag",
        picture="response",
        variants=(*((*constant, period) for constant in filters), *together),
        degenerates_to=Limit("drive.delay", "the goal never jumps and moves slowly"),
    )


@entry("drive.deadband", follows_goals)
def deadband(nominal: JointModel) -> Cause:
    unit = "rad/s" if nominal.command == "goal_velocity" else "rad"
    return Cause(
        sentence="The controller ignores errors below a width.",
        picture="duty_against_error",
        variants=alone(Parameter("dead_band.width", unit, 0.0, 0.3, 0.006, 0.003), 0.006, 0.03),
    )


@entry("drive.saturation", has_any("supply", "regression"))
def saturation(nominal: JointModel) -> Cause:
    top = nominal.value("duty_limit.limit")
    limit = Parameter("duty_limit.limit", "1", 0.02, 1.0, top, 0.1, logarithmic=True)
    return Cause(
        sentence="The duty saturates earlier than the model believes.",
        picture="duty_against_error",
        variants=alone(limit, *(share * top for share in (0.95, 0.8, 0.5, 0.25))),
        refuted_by=Ceiling("duty", "duty_limit.limit"),
    )


@entry("drive.offset")
def offset(nominal: JointModel) -> Cause:
    unit = "rad/s" if nominal.command == "goal_velocity" else "rad"
    shift = Parameter("offset.value", unit, -0.5, 0.5, 0.0, 0.005)
    if nominal.by_torque:
        top = stall_torque(nominal)
        shift = Parameter("offset.value", "N.m", -0.5 * top, 0.5 * top, 0.0, 0.02 * top)
    return Cause(
        sentence="Commands arrive shifted by a constant.",
        picture="response",
        against="control error",
        variants=((shift,),),
    )


@entry("drive.minimum_duty", has("supply"))
def minimum_duty(nominal: JointModel) -> Cause:
    del nominal
    return Cause(
        sentence="The firmware raises small duties to a minimum start-up force.",
        picture="duty_against_error",
        variants=alone(Parameter("minimum_duty.value", "1", 0.0, 0.6, 0.04, 0.02), 0.04, 0.12),
        degenerates_to=Limit("friction.coulomb", "the joint moves all the time"),
    )


@entry("drive.supply_sag", has("supply", "dc_motor"))
def supply_sag(nominal: JointModel) -> Cause:
    motor = nominal.value("dc_motor.resistance")
    source = Parameter("supply.resistance", "ohm", 0.0, 5.0 * motor, 0.2 * motor, 0.1 * motor)
    return Cause(
        sentence="The supply voltage drops under current.",
        picture="voltage_against_current",
        variants=((source,),),
    )


@entry("drive.overload", lambda nominal: stall_torque(nominal) > 0.0)
def overload(nominal: JointModel) -> Cause:
    """A limit that is believed, as the ``effort`` of a URDF, may be wrong either way."""
    top = stall_torque(nominal) / nominal.chain.gear_ratio()  # the limit goes before a gear
    believed = nominal.value("torque_limit.limit") if nominal.chain.find("torque_limit") else top
    most = 1.2 * max(top, believed)
    starts = [share * believed for share in (0.8, 0.5, 0.25, 1.6) if share * believed < most]
    limit = Parameter("torque_limit.limit", "N.m", 0.02 * believed, most, believed, 0.1, logarithmic=True)
    return Cause(
        sentence="The firmware limits the torque.",
        picture="response",
        against="motor torque",
        variants=alone(limit, *starts),
        error=has("torque_limit")(nominal),
        degenerates_to=Limit("drive.saturation", "the torque is largest at one speed"),
    )


@entry("drive.integer_gain", both(has("supply"), lacks("duty_step")))
def integer_gain(nominal: JointModel) -> Cause:
    del nominal
    step = Parameter("duty_step.size", "1", 0.0, 0.4, 0.005, 0.02)
    down = alone(step, 0.005, 0.0085, 0.0145, 0.025, 0.042, 0.07)
    mode = Parameter("duty_step.towards_zero", "1", 0.9, 1.0, 1.0, 1.0, shape=True)
    return Cause(
        sentence="The firmware computes the duty in coarse steps.",
        picture="duty_against_error",
        variants=(*down, *((*size, mode) for size in down)),
    )


@entry("drive.thermal", both(has("dc_motor"), lacks("thermal")))
def thermal(nominal: JointModel) -> Cause:
    del nominal
    loss = Parameter("thermal.loss", "1/K", -0.05, 0.05, 0.002, 0.002)
    return Cause(
        sentence="The motor grows weaker as it warms up.",
        picture="residual_against_temperature",
        variants=((loss,),),
        needs=Needs(temperature_range=True),
        degenerates_to=Limit("drive.motor_constant", "the temperature hardly changes"),
    )


@entry("drive.motor_constant", has_any("dc_motor", "torque_command", "ideal"))
def motor_constant(nominal: JointModel) -> Cause:
    motor, strength = nominal.chain.find("dc_motor") is not None, PER_COMMAND
    if motor:
        strength = factor("dc_motor.motor_constant", 0.3, 3.0)
    elif nominal.chain.find("ideal") is not None:
        strength = factor("ideal.strength", 0.3, 3.0)
    return Cause(
        sentence="Torque per current and back-EMF differ from the data sheet."
        if motor
        else "The drive gives more or less torque than it is commanded.",
        picture="response",
        against="motor torque",
        variants=((strength,),),
        error=True,
    )


@entry("drive.resistance", has("dc_motor"))
def resistance(nominal: JointModel) -> Cause:
    del nominal
    return Cause(
        sentence="The winding has another resistance: torque per volt and back-EMF per speed go with its inverse.",
        picture="response",
        against="motor torque",
        variants=((factor("dc_motor.resistance", 0.3, 3.0),),),
        error=True,
        degenerates_to=Limit("drive.motor_constant", "the joint turns slowly"),
    )
