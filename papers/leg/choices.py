"""What paper 000 does not print and was chosen here, and what of it was not built."""

from __future__ import annotations

from ...envs.leg.parameters import NUMBERS
from ..published import Choice, NotBuilt, Paper, assumed
from .paper import FIGURE_7, LINES, OWN_SPEED, REACH_HIGH, REACH_LOW, SHORTEST, supply_volts
from .tuning import other_paths

SIGN = "sign of products"
MEASURE = "measure of figure 7"
WORST = "error of leaving out Coriolis, worst line, by draw of the lines"
"""The row that the measure of figure 7 was chosen to reach."""
ROUTE = (SIGN, "lines of the foot", "speed of the foot")
"""What every figure along lines rests on."""
CONTROL = (SIGN, "paths of the foot", "supply", "gains", "period")
"""What every figure of a controller rests on."""

CHOICES = {
    **assumed(NUMBERS),
    SIGN: Choice("integrals of x y", "so that table VII's e and r follow from table I", ("e", "r")),
    "lines of the foot": Choice(
        f"{LINES} horizontal ones of {SHORTEST:g} m at least, from {REACH_LOW.tolist()} to {REACH_HIGH.tolist()} m",
        "the paper's trajectories are not printed; ranges of the joints are assumed as well",
    ),
    "speed of the foot": Choice(
        f"{OWN_SPEED:g} m/s at most", "twice the printed mean of 0.2 m/s, bang-bang; that of figures 5 to 10 is not "
        "printed",
    ),
    MEASURE: Choice(
        f"largest Coriolis torque of any joint over the largest perturbation of any, at {FIGURE_7:g} m/s",
        "the figure is not at hand; each joint's own perturbation cannot give 4.2 %", (WORST,),
    ),
    "supply": Choice(f"{supply_volts():g} V", "plausible for the motors"),
    "paths of the foot": Choice(
        f"{len(other_paths())} random lines to and fro, means of 5 to 15 cm/s", "as the environment draws them"
    ),
    "gains": Choice("configs/actuator/silo4.yaml and silo4_pd.yaml", "a search for the PID, by hand for the PD"),
    "period": Choice("2 ms", "plausible for firmware"),
}  # fmt: skip

NOT_BUILT = (
    NotBuilt("2, 2.1, (2)", "forces and coupling between legs through body and ground", "the analysis is of a leg in "
             "the air. papers/leg/machine.py stands on four legs, but the paper prints no force to set beside it"),
    NotBuilt("2.2, 5", "backlash and elasticity, which grow with the reduction", "no number of them is printed"),
    NotBuilt("2.3, 5", "friction grows with the reduction", "friction is printed for these gears alone"),
    NotBuilt("3, step 4", "contributions over the trajectory's acceleration", "no result is stated. On a bang-bang "
             "line it goes with the square of the speed, so that other speeds above are other accelerations"),
    NotBuilt("3", "dynamics in a trajectory generator of highest speed [6]", "the generator is not printed; the "
             "fastest bang-bang motion is a row"),
    NotBuilt("4", "a foot of three passive joints, with force sensor and potentiometers", "sizes and masses of its "
             "parts are not printed; table I has them in link 3"),
    NotBuilt("4.1, 4.3", "masses weighed, and torques measured on the prototype", "no measurement is printed; rows are "
             "of the model with its tables"),
    NotBuilt("4.2", "friction identified by least squares", "what it was identified from is not printed"),
    NotBuilt("4.3.2", "R_h, in words, is the distance to the origin of the leg's frame", "(27) leaves out the 60 mm "
             "of link 1, and is taken to the letter"),
    NotBuilt("4.4, 12", "controllers R_i(s), tuned for each trajectory", "neither they nor their tuning are printed. "
             "(28) to (30), scheduled by position, friction and inertia are compensated as in figure 12, over a PD"),
    NotBuilt("5 to 10", "curves", "the figures are not at hand: only what the text says of them is a row"),
    NotBuilt("2.1", "Lagrange-Euler is fast enough for real time", "about computers of its time"),
)  # fmt: skip

PAPER = Paper("paper 000", CHOICES, NOT_BUILT)
