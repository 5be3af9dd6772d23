"""A bench and a servo whose encoder has no ticks, so that replays of two simulators can be compared closely."""

from __future__ import annotations

PARAMS = {"mass": 0.5, "arm_mass": 0.03, "length": 0.12}
CHAIN = [
    {"delay": {"seconds": 0.005}},
    {"position_p": {"gain": 5.3}},
    {"duty_limit": {"limit": 0.97}},
    {"supply": {"volts": 7.4, "resistance": 0.0}},
    {"dc_motor": {"motor_constant": 1.2, "resistance": 2.7, "armature": 0.026}},
    {"friction": {"coulomb": 0.052, "viscous": 0.059}},
    {"encoder": {"ticks": 0}},
]
