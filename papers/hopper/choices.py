"""What the hopper's paper does not print and we chose, what for, and what of the paper is not repeated."""

from __future__ import annotations

import math
from itertools import product

from ...actuators.brake_bench import Noise
from ...actuators.gravity import GRAVITY
from ...actuators.regression_fit import HIGH, SLOW
from ...envs.hopper.parameters import NUMBERS
from ..published import Choice, NotBuilt, Paper, assumed
from .paper import LEG_DISTANCE, PEAK, PRINTED, SETTLING

HOPS = "regular hopping in both simulations and with the hardware's K_P, without a D part"
FITTED = tuple(f"{what} {case}" for case in ("with actuator", "without actuator") for what in ("frequency", "height"))
BLIND_FITTED = tuple(f"{what} without actuator, lengths from it" for what in ("frequency", "height"))
UNSUITED = "without actuator, control parameters do not suit the leg"
POINTS = "points that are left of the protocol"
LINE = ("torque per PWM of a motor's bench", "torque per rpm of a motor's bench")

LENGTHS = ("upper_length", "lower_length")
BLIND = ("blind_upper_length", "blind_lower_length")
MODEL = (
    "upper_centre",
    "lower_centre",
    "foot_radius",
    "contact_time",
    "signal",
    "gain_unit",
    "settling",
)
"""Names of chosen numbers that all hopping rests on, beside the lengths of the links."""
BLIND_LENGTHS = (0.100, 0.084)  # [m] upper and lower link: of the search, best on the figures without actuator

AMPLITUDES, THRESHOLDS = (0.15, 0.23, 0.3, 0.4), (0.15, 0.3, 0.45, 0.6, 0.75)  # [rad], [N.m]
SIGNALS = tuple(product(AMPLITUDES, THRESHOLDS))
"""Control parameters that are tried without actuator, the printed ones among them."""

_AIR = 2.0 * math.sqrt(2.0 * PRINTED["hardware"].height / GRAVITY)  # [s] up by the printed height and down again
_PERIOD = 1.0 / PRINTED["hardware"].frequency  # [s]
_CURVE = "its figure is not at hand"
_SEARCH = "search in benchmarks/results/hopper_open_parameters.md"
PAPER = Paper(
    "paper 004",
    {
        **assumed(NUMBERS, upper_length=FITTED, lower_length=FITTED),
        **{
            name: Choice(f"{value:g} m", f"{_SEARCH}, on the leg without actuator alone", BLIND_FITTED)
            for name, value in zip(BLIND, BLIND_LENGTHS, strict=True)
        },
        "signal": Choice("three states, sign of the springs' torque", "a signal of two states does not hop", (HOPS,)),
        "gain_unit": Choice("K_P = 75 as duty per radian", "as percent per radian the leg sags to the floor", (HOPS,)),
        "height_of_a_jump": Choice(
            "way of the hip from its lowest to its highest point",
            f"from standing, the hardware's 10 cm would take {_AIR:.2f} s of flight, "
            f"and its whole period is {_PERIOD:.2f} s",
        ),
        "other_signals": Choice(
            f"the nearest to the hardware of {len(SIGNALS)}: amplitude of {', '.join(map(str, AMPLITUDES))} rad, "
            f"threshold of {', '.join(map(str, THRESHOLDS))} N.m",
            "plausible", (UNSUITED,),
        ),
        "settling": Choice(f"{SETTLING:g} s", "the start that no figure looks at"),
        "peak": Choice(f"{PEAK:g} rad/s", "by which a peak of a motor's speed stands out; plausible"),
        "leg_distance": Choice(f"{LEG_DISTANCE:g} m", "between the legs of the model with four, which do not touch"),
        "bench_motor": Choice(
            "the motor in configs/actuator/sv1270tg_motor.yaml", "near the first two coefficients of (3)", LINE
        ),
        "bench_noise": Choice(
            f"normal, {1e3 * Noise.torque:g} N.mm and {Noise.speed:g} rad/s", "0.1 % of the transducer's range"
        ),
        "spurious": Choice(
            f"no measurement of (3)'s bench is wrong altogether; {Noise.spurious:.0%} of the motor's bench, by "
            f"{Noise.spurious_torque:g} N.m", "not printed; with some wrong too many points remain", (POINTS,),
        ),
        "constant_on_the_bench": Choice(
            "the constant of (3) as friction, against the motion in both directions",
            "of two readings, the one that leaves about as many points as the paper has", (POINTS,),
        ),
        "parts_of_the_bench": Choice(f"high is from PWM {HIGH:g} on, low up to {SLOW:g} rad/s", "plausible"),
    },
    (
        NotBuilt("II", "temperature, couplings and friction change (2)", "the motor of our bench has them built in, so "
                 "that nothing could come out otherwise"),
        NotBuilt("II", "speed falls with the torque at every PWM, until it stalls", "our bench's motor is built so"),
        NotBuilt("III-B, Fig. 4", "speed over torque at each PWM and temperature", _CURVE),
        NotBuilt("III-D", "stages as disks give their inertias", "the masses of the stages are not printed"),
        NotBuilt("IV-B", "worn gears rub less", "the wear is not printed; K_P = 55 stands at the rows of the hardware"),
        NotBuilt("IV-E, Fig. 6 and 7", "curves of hardware and simulation match, with the same largest link angles and "
                 "free swings", _CURVE),
        NotBuilt("IV-E, V-A", "the hardware's motor has steps in flight, likely of backlash", f"{_CURVE}, and the play "
                 "is not printed; two plays stand at the row of the peaks"),
        NotBuilt("IV-E", "without actuator the motor's speed has spikes", "the motor is its goal, which steps, so that "
                 "nothing could come out otherwise"),
        NotBuilt("IV-E", "without actuator the leg does not swing realistically in flight", _CURVE),
        NotBuilt("V-B", "better fits of the bench improve the simulation of the leg further", _CURVE),
    ),
)  # fmt: skip
