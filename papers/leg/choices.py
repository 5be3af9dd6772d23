"""What paper 000 does not print and was chosen here, and what of it was not built."""

from __future__ import annotations

from ...envs.leg.parameters import NUMBERS
from ..published import Choice, NotBuilt, Paper, assumed
from .paper import LINES, OWN_SPEED, REACH_HIGH, REACH_LOW, SHORTEST, supply_volts
from .tuning import other_paths

ROUTE = ("lines of the foot", "speed of the foot")
"""What every figure along lines rests on."""
CONTROL = ("paths of the foot", "supply", "gains", "period")
"""What every figure of a controller rests on."""

CHOICES = {
    **assumed(NUMBERS),
    "sign of products": Choice("integrals of x y", "so that table VII's e and r follow from table I", ("e", "r")),
    "lines of the foot": Choice(
        f"{LINES} horizontal ones of {SHORTEST:g} m at least, from {REACH_LOW.tolist()} to {REACH_HIGH.tolist()} m",
        "the paper's trajectories are not printed; ranges of the joints are assumed as well",
    ),
    "speed of the foot": Choice(
        f"{OWN_SPEED:g} m/s at most", "twice the printed mean of 0.2 m/s, bang-bang; that of figures 5 to 10 is not "
        "printed",
    ),
    "supply": Choice(f"{supply_volts():g} V", "plausible for the motors"),
    "paths of the foot": Choice(
        f"{len(other_paths())} random lines to and fro, means of 5 to 15 cm/s", "as the environment draws them"
    ),
    "gains": Choice("configs/actuator/silo4.yaml and silo4_pd.yaml", "a search for the PID, by hand for the PD"),
    "period": Choice("2 ms", "plausible for firmware"),
}  # fmt: skip

NOT_BUILT = (
    NotBuilt("4", "a foot of three passive joints, with force sensor and potentiometers", "sizes and masses of its "
             "parts are not printed; table I has them in link 3, and the analysis is of the leg in the air"),
    NotBuilt("2.1, (2)", "ground-contact forces of the support phase", "the paper analyses the transfer phase; "
             "papers/leg/machine.py stands on four legs, with forces that the paper does not print"),
    NotBuilt("4.4, 12", "gain scheduling: controllers R_i(s) tuned for each trajectory", "neither the controllers nor "
             "the rule is printed. Perturbation (28) to (30), friction and inertia are compensated as in figure 12"),
    NotBuilt("2.2", "elasticity and backlash of the gears", "the paper names them and prints no number"),
    NotBuilt("5 to 10", "curves", "the figures are not at hand: only what the text says of them is a row"),
    NotBuilt("2.1", "Lagrange-Euler is fast enough for real time", "about computers of its time"),
    NotBuilt("3", "experiments on the prototype", "no measurement is printed; rows are of the model with its tables"),
)  # fmt: skip

PAPER = Paper("paper 000", CHOICES, NOT_BUILT)
