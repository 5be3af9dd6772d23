"""What the paper (paper 002) does not print and was chosen here, and what of it was not built."""

from __future__ import annotations

from ...envs.arm.parameters import NUMBERS
from ..published import Choice, NotBuilt, Paper, assumed
from .control import PERIOD, Robust
from .paper import BASES, BESIDE, DAMPINGS, SOFTEST
from .readings import PLAIN, readings

INERTIA = ("products", "rotor1_iyz")
OPEN_LOOP = (*INERTIA, "way")
"""What every motion of the arm of table VIII rests on."""
FINAL_MODEL = (*OPEN_LOOP, "reading")
"""What every motion with table X rests on."""
TOOTH = tuple(f"gear {number}: k" for number in (1, 2, 3, 4))


OPPOSITE = "the tool's z goes the opposite way, in some reading"
"""The row of the readings that were sought for it."""


CHOICES = {
    **assumed({name: number for name, number in NUMBERS.items() if name in INERTIA}),
    "way": Choice(
        "septic", "a quintic one has no bound of acceleration at the stretched start",
        ("acceleration of joint 3 is finite at the start",),
    ),
    "reading": Choice(
        readings()[PLAIN].text,
        "the first that was built, though 3.1 calls dampings motor referred and the axes of tables XI and XII lean",
    ),
    "y of link 1": Choice("-0.043 m", "table III prints +0.043 m", ("tables III, V and VI meet, joint 1",)),
    "Z of joint 2 on link 1": Choice("-0.0576 m", "table XII prints 00.0576", ("tables IX, XI and XII meet",)),
    "width of gears 1 and 2": Choice("9 mm", "4 mm are printed", ("gear 1: I", "gear 2: I")),
    "E": Choice("200 GPa", "the text says 207 GPa", TOOTH),
    "third of a cantilever": Choice("k = E I r2 / L3", "the text says a cantilever, of 3 E I / L3", TOOTH),
    "G": Choice("80 GPa", "the text says 84 GPa", ("shaft: k",)),
    "other gears": Choice("those of joint 1", "gears of joints 2 and 3 are not printed"),
    "tool on the axes of tables XI and XII": Choice("(0.58, 0, 0.577) m", "printed for table I only"),
    "range of c_r": Choice(f"{DAMPINGS[0]:g} to {DAMPINGS[-1]:g} N.m.s/rad", "covers all that changes anything"),
    "c_r beside": Choice(
        f"{BASES[0]:g} to {BASES[-1]:g} beside {BESIDE[1]:g} to {BESIDE[-1]:g} N.m.s/rad", "likewise"
    ),
    "feedback": Choice(
        f"lambda {Robust().slope:g} 1/s, gain {Robust().gain:g} 1/s, rho {Robust().bound[0]:g} N.m, at "
        f"{1.0 / PERIOD:g} Hz", "from the bandwidth alone; the paper only asks for a controller",
    ),
    "softest real joint": Choice(f"{SOFTEST:g} of 67 N.m/rad", "below any spring of table X"),
    "readings": Choice(
        "; ".join(reading.text for name, reading in readings().items() if name != PLAIN),
        "sought, with the paper's answer known, to explain that z falls", (OPPOSITE,),
    ),
}  # fmt: skip

NOT_BUILT = (
    NotBuilt("3", "counterbalances reduce the driving torques", "where they sit is not printed, and the paper neglects "
             "body forces: without gravity they only add inertia. Link 2's centre of mass is a row"),
    NotBuilt("table X", "damping by the bearings' formulas", "the bearings are not printed"),
    NotBuilt("table X", "503 and 67 N.m/rad of joints 2 and 3", "their gears and shafts are not printed"),
    NotBuilt("3.1", "lubricant, friction, flux losses and losses of the gears as sources of flexibility", "the paper "
             "leaves them out, and prints no number of them"),
    NotBuilt("2.1", "the joint between bodies held by Lagrange multipliers", "the engine has the joints' angles "
             "instead: the same motion without drift, and no result of the paper is about the multipliers"),
    NotBuilt("4", "Newton-Raphson to 1e-6, integrators of Adams and of Dormand and Prince", "of the paper's program; "
             "what the step of our integrators does is told beside the chosen numbers"),
    NotBuilt("4", "torques smoothed by polynomials", "their degree is not printed; some degrees stand as a "
             "sensitivity"),
    NotBuilt("(12)", "the second model: torques Gamma - c_r q' in place of dampers", "the damper between stator and "
             "rotor is that term, so that both are one model here and no figure could differ"),
    NotBuilt("18 to 25", "curves", "the figures are not at hand: only what the text says of them is a row"),
    NotBuilt("22a", "at a high c_r1 the trajectory is wavy around the others'", "no measure of it is printed"),
    NotBuilt("5.3, 25", "the experiment's deviation is high and fluctuates, by cameras and motors", "no measurement is "
             "printed"),
)  # fmt: skip

PAPER = Paper("paper 002", CHOICES, NOT_BUILT)
