"""What a chain says of its servo at the joint: how fast it turns without load, and what it holds when stalled."""

from __future__ import annotations

import math

from .chain import Chain

BOUNDLESS = 1e3  # torque limits from here on are none [N.m]


def largest_duty(chain: Chain) -> float:
    """Largest duty that the drive gives."""
    return chain.value("duty_limit.limit") if chain.find("duty_limit") is not None else 1.0


def no_load_speed(chain: Chain) -> float:
    """Speed of the joint at the largest duty without load or friction [rad/s]; infinite where the chain tells none."""
    if chain.find("supply") is not None and (motor := chain.find("dc_motor")) is not None:
        back_emf = motor.back_emf * chain.gear_ratio()
        return largest_duty(chain) * chain.value("supply.volts") / max(back_emf, 1e-6)
    if chain.find("regression") is not None and chain.value("regression.speed_torque") < 0.0:
        speed = largest_duty(chain) * chain.value("regression.duty_torque") / chain.value("regression.speed_torque")
        return abs(speed) / chain.gear_ratio()
    return math.inf


def stall_torque(chain: Chain) -> float:
    """Torque on the joint at the largest duty, at rest and without friction [N.m]; infinite where the chain tells
    none."""
    if chain.find("supply") is not None and (motor := chain.find("dc_motor")) is not None:
        current = largest_duty(chain) * chain.value("supply.volts") / motor.resistance
        return current * motor.motor_constant * chain.gear_ratio()
    if chain.find("regression") is not None and chain.value("regression.speed_torque") < 0.0:
        return abs(largest_duty(chain) * chain.value("regression.duty_torque")) * chain.gear_ratio()
    if chain.find("ideal") is not None and chain.value("ideal.torque_limit") < BOUNDLESS:
        return chain.value("ideal.torque_limit")
    if chain.find("ideal_velocity") is not None and chain.value("ideal_velocity.torque_limit") < BOUNDLESS:
        return chain.value("ideal_velocity.torque_limit")
    return math.inf
