"""What the hexapod's paper does not print and we chose, what for, and what of the paper is not repeated.

Of its tables only table 10 is at hand.
"""

from __future__ import annotations

from ...actuators import Chain
from ...envs.hexapod.gait import Tripod
from ...envs.hexapod.parameters import NUMBERS
from ...envs.hexapod.robot import HORIZONTAL, ROTATION, VERTICAL, chains_of, coordinate
from ..published import Choice, NotBuilt, Paper, assumed
from .friction_bench import SPEEDS, SPREAD
from .measures import AT_REST, SETTLED
from .paper import BAND, BREAKAWAY_AT_REST, BREAKAWAY_WALKING, WALKING

ALTITUDE, DRY_SINKS = "motors at 0 V: altitude constant with LuGre", "not with dry/viscous"
BALANCE = "LuGre balances gravity after a small transient"
NO_CURRENT, REGULATION = "no vertical current in support with LuGre", "but with dry/viscous, for regulation"
BREAKS_LOOSE = "slight current as the load on leg 0 grows"
HORIZONTAL_CURRENT = "load dependence raises the horizontal current in support"
BETTER = "better without load dependence"
STILL = "vertical joints stand still in support"
OVERCOME = "10 kg overcome joints 1 and 3, which have the breakaway force under 5 kg"
SLIP = "slip of the feet is negligible"
HUNTING = "anti-windup prevents hunting"

REWARD_ALONE = "winding_loss"  # no row rests on it: papers take the losses from the motors' currents
ROBOT = tuple(name for name, number in NUMBERS.items() if number.assumed and name != REWARD_ALONE)
MOTORS = ("motor", "controllers", "vertical_coulomb", "vertical_viscous", "horizontal_coulomb", "rotation_friction")
STANDS = (*ROBOT, *MOTORS, "breakaway_at_rest")
WALKS = (*ROBOT, *MOTORS, "breakaway_walking", "horizontal_load", "gait")
DRAWS = (*WALKS, "settled")
BENCH = (*ROBOT, *MOTORS[:2], "vertical_coulomb", "vertical_viscous", "breakaway_walking", "bench", "spread_by_leg")
"""Names of the chosen numbers that each experiment rests on."""


def _value(kind: str, path: str, chains: dict[str, Chain]) -> str:
    return f"{chains[coordinate(0, kind)].value(path):g}"


def _choices() -> dict[str, Choice]:
    lugre, load = chains_of("amru5_lugre"), chains_of("amru5_load")
    gait, missing = Tripod(), "plausible; tables 1 to 9 are missing"
    motor = [_value(VERTICAL, f"dc_motor.{key}", lugre) for key in ("motor_constant", "resistance", "inductance")]
    loop = [_value(VERTICAL, f"position_pi.{key}", lugre) for key in ("gain", "integral", "band")]
    load_terms = [_value(HORIZONTAL, f"friction.{key}", load) for key in ("load", "load_quadratic")]
    rotation = [_value(ROTATION, f"friction.{key}", lugre) for key in ("coulomb", "viscous")]
    return {
        **assumed(NUMBERS, slip_speed=(SLIP,)),
        "motor": Choice(
            f"{motor[0]} N.m/A, {motor[1]} ohm, {motor[2]} H, 24 V",
            "data sheet of the RE35 as remembered, with 0.2 ohm of driver",
        ),
        "controllers": Choice(
            f"screws: {loop[0]} /m, {loop[1]} /(m.s), the integral runs out within {loop[2]} m, of vertical ones "
            f"within {WALKING[BAND]:g} m",
            f"{missing}; how the anti-windup works is not said", (HUNTING, NO_CURRENT, BREAKS_LOOSE),
        ),
        "vertical_coulomb": Choice(
            f"{_value(VERTICAL, 'friction.coulomb', lugre)} N", "low enough for dry friction to give way",
            (DRY_SINKS, REGULATION),
        ),
        "vertical_viscous": Choice(f"{_value(VERTICAL, 'friction.viscous', lugre)} N.s/m", missing),
        "horizontal_coulomb": Choice(f"{_value(HORIZONTAL, 'friction.coulomb', lugre)} N", missing),
        "rotation_friction": Choice(f"{rotation[0]} N.m, {rotation[1]} N.m.s/rad", missing),
        "breakaway_at_rest": Choice(
            f"{BREAKAWAY_AT_REST:g} N over Coulomb", "holds the robot on six legs: 5 kg a foot, not 10",
            (ALTITUDE, BALANCE, OVERCOME),
        ),
        "breakaway_walking": Choice(
            f"{WALKING[BREAKAWAY_WALKING]:g} N over Coulomb",
            "holds it on three, but for a moment", (NO_CURRENT, BREAKS_LOOSE, STILL),
        ),
        "horizontal_load": Choice(
            f"{load_terms[0]} N/N, {load_terms[1]} N/N2", "for the printed 35 %", (BETTER, HORIZONTAL_CURRENT)
        ),
        "gait": Choice(
            f"lift {gait.lift:g} m, double stance twice {gait.double_stance:.3g} of a cycle, lifting {gait.lifting:g}",
            "plausible; the gait is left to a reference",
        ),
        "bench": Choice(
            f"{', '.join(f'{1e3 * v:g}' for v in SPEEDS)} mm/s", "plausible"
        ),
        "settled": Choice(
            f"a support is looked at from {SETTLED:g} s on; less than {1e3 * AT_REST:g} mA count as no current",
            "the integral of a joint that has stopped runs out first",
        ),
        "spread_by_leg": Choice(
            f"{100 * SPREAD:g} % by leg and direction, drawn", "plausible; tables 4 to 9 are missing"
        ),
    }  # fmt: skip


CURVES = "the measured curves are not at hand"
PAPER = Paper(
    "paper 001",
    _choices(),
    (
        NotBuilt("2.1", "outer diameter of 1.4 m", "the joints' ranges are not printed"),
        NotBuilt(
            "1, 3.3, 8",
            "smoothed laws are ill-conditioned, and Newmark integrates all of it in one",
            "another integrator, of which no figure is printed",
        ),
        NotBuilt(
            "4.1.2", "two dependent parameters halve the time of a simulation", "the engine closes the loops itself"
        ),
        NotBuilt("4.2.1, table 2", "damping of the ground is stable", "the table is missing"),
        NotBuilt("5.3, tables 4 to 6", "friction of 18 joints, mean and deviation", "the tables are missing"),
        NotBuilt("5.3", "the horizontal joint has no viscous friction", "taken over, so it cannot be checked"),
        NotBuilt(
            "5.3, table 7",
            "(31) is quadratic, because the horizontal screw bends under loads on the foot",
            "the table is missing, and screws are rigid here",
        ),
        NotBuilt(
            "5.4, tables 8 and 9",
            "breakaway forces of six legs, which the load influences strongly",
            "the tables are missing; a value under 5 kg and one under 10 kg are assumed",
        ),
        NotBuilt("7.1", "the model is valid for other gaits", "nothing measured of other gaits is printed"),
        NotBuilt("7.2.1, Fig. 11", "the horizontal current in support is too low without load dependence", CURVES),
        NotBuilt("7.2.1, Fig. 11", "currents of the swing are as measured", CURVES),
        NotBuilt("7.2.1", "the measured current oscillates with the sprocket chain", "the chain is not modelled"),
        NotBuilt("7.2.2", "voltages are under-estimated, above all low ones", CURVES),
        NotBuilt("7.3, Fig. 12", "specific resistances, and the experiment's, which differ at low velocity", CURVES),
    ),
)
