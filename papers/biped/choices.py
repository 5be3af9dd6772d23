"""What the biped's paper does not print and we chose, what for, and what of the paper is not repeated."""

from __future__ import annotations

import math

from ...envs.biped.drive import ENCODER, SPRING_DAMPING
from ...envs.biped.parameters import NUMBERS
from ..published import Choice, NotBuilt, Paper, assumed
from .controller import Gait
from .hopping import DROP, JOINT_TICKS, SETTLED, SPEED_WINDOW, STEADY
from .return_map import FINE, SETTLING
from .return_map import HOPS as HEALING_HOPS
from .rig import FINGERTIP, NOISE

HOPS, RIGID_HOPS = "hops without a fall", "controllers tuned on rigid cables hop on them"
SOLES = "both soles off the floor, share of the time"
HEALS = "1 mrad of pitch heals with the update (44)"
OVER = {place: f"centre of mass from the {place}, at most" for place in ("toe", "hip")}
LANDING = "ground of table VI while the biped lands"
ALIKE = "motor constants right over left, of leg angles and leg shapes"

TUNED_ON_RIGID = tuple(
    Gait(torso=lean, torso_gain=0.0, gains=gains, dampings=dampings)
    for lean, gains, dampings in (
        (0.00202, (69.4, 19.4), (7.53, 0.123)),
        (0.185, (43.7, 21.5), (4.89, 0.134)),
        (0.192, (25.4, 16.4), (3.35, 0.0469)),
        (0.195, (50.0, 18.8), (8.68, 0.0321)),
        (-0.0033, (17.7, 23.4), (5.67, 0.0825)),
        (0.236, (28.1, 16.0), (1.16, 0.0494)),
    )
)
"""All that :mod:`sealegs.papers.biped.tune_on_rigid` finds."""
DRAWN_FROM, DRAWS = 1, 74  # seed and number of the controllers that it tries

_MACHINE = {name: number for name, number in NUMBERS.items() if name != "leg_angle"}  # where learning starts
ROBOT = tuple(name for name, number in _MACHINE.items() if number.assumed)
PULLEYS_ALONE = ("order_of_table_IV", "encoders", "excitation")
RIG = (*PULLEYS_ALONE, "mean_pulleys")
DRIVES_OF_HOPPING = ("order_of_table_IV", "mean_pulleys", "right_cable", "spring_damping", "encoders")
HOPPING = (*ROBOT, *DRIVES_OF_HOPPING, "gains", "lean", "travel", "limits", "start")
IDENTIFIED_HOPPING = tuple(dict.fromkeys((*HOPPING, *RIG)))
ON_RIGID = (*ROBOT, *DRIVES_OF_HOPPING, "gains_on_rigid", "steady", "limits", "start")
"""Names of the chosen numbers that each experiment rests on."""

_GROUND, _GAIT = (LANDING,), Gait()
_LASTS = (HOPS, SOLES, HEALS)
_CURVE = "its figure is not at hand"


def _pair(values: tuple[float, float]) -> str:
    return " and ".join(f"{value:.3g}" for value in values)


PAPER = Paper(
    "paper 003",
    {
        **assumed(
            _MACHINE, contact_time=_GROUND, contact_damping=_GROUND, contact_low=_GROUND, contact_high=_GROUND,
            contact_width=_GROUND,
        ),
        "gains": Choice(
            f"K_p {_pair(_GAIT.gains)} N.m/rad, K_d {_pair(_GAIT.dampings)} N.m.s/rad",
            "random search for hopping that lasts", _LASTS,
        ),
        "lean": Choice(f"{math.degrees(_GAIT.torso):.1f} deg", "likewise", _LASTS),
        "travel": Choice(
            f"delta_phi_d = {math.degrees(_GAIT.travel):.2f} deg",
            "(46) reads -69 degrees, whose point is lost; -6.9 would be ten times as far",
        ),
        "gains_on_rigid": Choice(
            f"{len(TUNED_ON_RIGID)} controllers",
            f"all of {DRAWS} drawn from seed {DRAWN_FROM} that hop on rigid cables (papers/biped/tune_on_rigid.py)",
            (RIGID_HOPS,),
        ),
        "steady": Choice(f"{STEADY} hops in 30 s", "plausible"),
        "limits": Choice(f"{_pair(_GAIT.limits)} N.m", "plausible: walking needs 2 and 8 (IV-C)"),
        "start": Choice(f"a fall of {DROP:g} m, legs spread as in flight", "plausible"),
        "encoders": Choice(
            f"{ENCODER} steps a turn of motors and springs, 2^{math.log2(JOINT_TICKS):.0f} of joints and boom, "
            f"noise of {NOISE:g} steps; speeds over {SPEED_WINDOW} ms", "plausible",
        ),
        "order_of_table_IV": Choice(
            "second and third motor constant exchanged", "the text: those of the leg angles are nearly identical",
            (ALIKE,),
        ),
        "mean_pulleys": Choice(
            "inertia of pulleys, mean of both sides, in legs and hopping", "(10) solved for it; the sides' are the same"
        ),
        "right_cable": Choice("K_C and K_dC of mLA right as of mLA left", "table VI has lost them"),
        "spring_damping": Choice(
            f"K_dB = {SPRING_DAMPING:g} N.m.s/rad at the pulley", "table VI reads 15; its point is taken as lost"
        ),
        "excitation": Choice("magnitudes, bands and postures of the experiments", "plausible"),
        "settled": Choice(f"{SETTLED} hops", "the start that the period does not count"),
        "return_map": Choice(
            f"{SETTLING} hops before the pitch is put off, {HEALING_HOPS} after; encoders of "
            f"2^{math.log2(FINE):.0f} steps",
            "plausible",
        ),
        "fingertip": Choice(f"{FINGERTIP:g} N.m at most", "so that what is left is under 6 mm", tuple(OVER.values())),
    },
    (
        NotBuilt("I", "accelerations by differentiation are inaccurate with quantised encoders",
                 "the encoders' steps are assumed, and would decide it"),
        NotBuilt("II", "springs make running more efficient and let actuators be weaker",
                 "it is of running, and cited from other papers"),
        NotBuilt("II-A", "on its long boom the robot moves much like a planar one", "the model is planar"),
        NotBuilt("II-B, VIII-A", "springs give in one way only",
                 "the model is built so, and nothing could come out otherwise"),
        NotBuilt("II-B, (1) to (6)", "differentials add the motions of motor and spring",
                 "the model is built so, and nothing could come out otherwise"),
        NotBuilt("IV-C", "torques of walking exceed 2 and 8 N.m", "the walk is of another paper"),
        NotBuilt("V-B", "legs are decoupled with the torso held, but for a stand that is not rigid",
                 "its stiffness is not printed; on a rigid one they are decoupled as built"),
        NotBuilt("V-D", "wiring, stick-slip and drifting biases differ a little", "their sizes are not printed"),
        NotBuilt("VII-A", "torques eight times those of the dynamic experiments",
                 "those of V are not printed, and assumed here"),
        NotBuilt("VIII-A, (30)", "the hard stop's damping", "the springs' stop is the engine's limit"),
        NotBuilt("VIII-A, table VI", "bristles of the ground", "the engine's floor has Coulomb friction"),
        NotBuilt("VIII-C", "cable stretch and ground, found from the machine's hopping", "its log is not at hand"),
        NotBuilt("VIII-C, table VI", "the spring's damping, found likewise",
                 f"likewise; {SPRING_DAMPING:g} is planted where 15 is printed"),
        NotBuilt("VIII-D", "a hop of the machine lasts 30 ms longer than simulated", "its log is not at hand"),
        NotBuilt("VIII-D, Fig. 21 to 23", "positions, torques and stretch of the 31st and 32nd hop", _CURVE),
    ),
)  # fmt: skip
