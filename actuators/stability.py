"""Whether a chain can be simulated at a model's time step; where it cannot, it would oscillate ever wilder, silently.

The engine takes native damping implicitly, but a law's fall of torque over speed (back-EMF, a controller's damping)
explicitly: the speed is multiplied by ``1 - h d / J`` per step, with time step ``h``, that fall ``d`` [N.m.s/rad] and
the inertia ``J`` that it moves, or by the Runge-Kutta polynomial of ``-h d / J``. A stiffness ``k``, of a spring on a
rotor or of a position controller, is stable below ``h sqrt(k / J) = 2``, or sqrt(8) in Runge-Kutta. The discrete
integrator takes springs implicitly: they are stable at any step, and add ``h^2 k`` to the inertia that a law moves.

Both together: one stage needs ``2 h d + h^2 k < 4 J + 2 h c`` with the native damping ``c`` [N.m.s/rad]. Runge-Kutta is
stable where both roots lie within 2.6 of zero, which they do where ``h d / J`` and ``h sqrt(k / J)`` do.
"""

from __future__ import annotations

import math

import mujoco

from .chain import Chain
from .stages import ChainError

# of h d / J and h sqrt(k / J); the bounds of stability are 2 and 2, and 2.79 and 2.83, less what a wild motion needs
ONE_STAGE = (1.5, 1.9)
RUNGE_KUTTA = (2.5, 2.7)


def velocity_slope(chain: Chain, step: float) -> float:
    """Torque that the law of a chain loses per speed [N.m.s/rad], unsaturated, as felt within a ``step`` [s]."""
    motor, regression, ideal = chain.find("dc_motor"), chain.find("regression"), chain.find("ideal")
    controller, encoder = chain.find("position_pd") or chain.find("position_pi"), chain.find("encoder")
    scale = encoder.scale if encoder is not None else 1.0
    damping = controller.damping * scale if controller is not None else 0.0  # duty per speed
    if (speed_drive := chain.find("ideal_velocity")) is not None:
        return speed_drive.damping * scale
    if (speed_controller := chain.find("velocity_pi")) is not None:
        damping = speed_controller.gain * scale
    if ideal is not None:
        return ideal.strength * ideal.damping * scale
    if regression is not None:
        ratio = chain.gear_ratio()
        return damping * regression.duty_torque * ratio - regression.speed_torque * ratio**2
    if motor is None:
        return 0.0
    constant = motor.motor_constant * chain.gear_ratio() * chain.magnetisation()
    supply = chain.find("supply")
    back_emf = constant * motor.emf_ratio
    slope = (back_emf + damping * (supply.volts if supply is not None else 0.0)) * constant / motor.resistance
    lag = motor.inductance / motor.resistance
    return slope if lag == 0.0 else -slope * math.expm1(-step / lag)  # the share of the current that follows in a step


def position_slope(chain: Chain, step: float) -> float:
    """Torque that the law of a chain loses per position [N.m/rad], unsaturated, as felt within a ``step`` [s]."""
    motor, regression, ideal = chain.find("dc_motor"), chain.find("regression"), chain.find("ideal")
    controller = chain.find("position_p") or chain.find("position_pd") or chain.find("position_pi")
    speed_controller = chain.find("velocity_pi")
    encoder = chain.find("encoder")
    scale = encoder.scale if encoder is not None else 1.0
    if ideal is not None:
        return ideal.strength * ideal.stiffness * scale
    # a digital controller oscillates by its own period, on the machine too: a shorter step mends nothing
    if controller is not None and controller.parameters().get("period"):
        return 0.0
    if speed_controller is not None:
        gain = speed_controller.integral * scale  # its integral holds a position
    elif controller is not None:
        gain = controller.gain * scale  # duty per position
    else:
        return 0.0
    if regression is not None:
        return gain * regression.duty_torque * chain.gear_ratio()
    supply = chain.find("supply")
    if motor is None or supply is None:
        return 0.0
    constant = motor.motor_constant * chain.gear_ratio() * chain.magnetisation()
    slope = gain * supply.volts * constant / motor.resistance
    lag = motor.inductance / motor.resistance
    return slope if lag == 0.0 else -slope * math.expm1(-step / lag)  # as the fall over speed


def unstable_beyond(
    chain: Chain, inertia: float, coupled: bool, step: float, integrator: int
) -> tuple[float, str] | None:
    """Longest stable step [s], and what bounds it, of a chain that a step makes unstable; None where none does.

    Args:
        chain: on a coordinate.
        inertia: that the motor moves, with its armature [kg.m2].
        coupled: whether a spring or play lies between motor and link.
        step: of the simulation [s].
        integrator: of the engine, a ``mujoco.mjtIntegrator``.
    """
    kutta = integrator == mujoco.mjtIntegrator.mjINT_RK4
    most_damping, most_frequency = RUNGE_KUTTA if kutta else ONE_STAGE
    slope, held = velocity_slope(chain, step), max(position_slope(chain, step), 0.0)
    friction = chain.find("friction")
    native = friction.viscous if friction is not None else 0.0
    if kutta:
        slope, native = slope + native, 0.0  # implicit in the other integrators
    springs = [stage for stage in (chain.find("spring"), chain.find("compliance")) if stage is not None]
    stiffness = sum(stage.stiffness for stage in springs) if coupled else 0.0
    pulley = min((stage.inertia for stage in springs if stage.parameters().get("inertia")), default=inertia)
    square = stiffness / min(pulley, inertia)  # of the frequency
    if integrator == mujoco.mjtIntegrator.mjINT_DISCRETE:  # takes springs implicitly, which hold the rotor
        inertia, square = inertia + step**2 * stiffness, 0.0
    if step * slope > most_damping * inertia:
        return most_damping * inertia / slope, f"its torque falls by {slope:.3g} N.m per rad/s"
    if step * math.sqrt(square) > most_frequency:
        return most_frequency / math.sqrt(square), f"its spring of {stiffness:g} N.m/rad pulls"
    if held == 0.0:
        return None
    # quadratic h^2 + linear h is 1 at the longest step h
    quadratic = square / most_frequency**2 + held / inertia / (most_damping if kutta else most_frequency) ** 2
    linear = 0.0 if kutta else (max(slope, 0.0) / most_damping - native / 2.0) / inertia
    if step * (quadratic * step + linear) > 1.0:
        longest = 2.0 / (linear + math.sqrt(linear**2 + 4.0 * quadratic))
        return longest, f"its controller holds with {held:.3g} N.m/rad"
    return None


def check_step(name: str, chain: Chain, inertia: float, coupled: bool, option: mujoco.MjOption) -> None:
    """Refuse a chain that its model's step makes unstable.

    Args:
        name: of the coordinate.
        chain: on it.
        inertia: that the motor moves, with its armature [kg.m2].
        coupled: whether a spring or play lies between motor and link.
        option: the model's time step and integrator.

    Raises:
        ChainError: the step is too long.
    """
    found = unstable_beyond(chain, inertia, coupled, option.timestep, option.integrator)
    if found is None:
        return
    longest, reason = found
    raise ChainError(
        f"{chain.label}: the chain on '{name}' is unstable at a step of {option.timestep:g} s, because {reason} on an "
        f"inertia of {inertia:.3g} kg.m2; make the step shorter than {longest:.2g} s, or correct the armature."
    )
