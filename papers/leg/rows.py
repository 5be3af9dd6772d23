"""Printed numbers and statements of paper 000 beside ours, each with its mark: tables, and the analysis (4.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...envs.leg.inertia import printed
from ...envs.leg.kinematics import foot, jacobian, lengthening
from ...envs.leg.parameters import LINKS, MOMENTS
from ...envs.leg.robot import JOINTS, LEG, chains_of
from ..published import Mark, Otherwise, Row, half_digit
from .choices import ROUTE
from .dynamics import TABLE_VII, constants, coriolis, gravity, mass_matrix, printed_coriolis, printed_gravity
from .paper import (
    LINES,
    OWN_SPEED,
    RULE,
    Analysis,
    Contributions,
    by_efficiency,
    coriolis_error,
    fastest,
    linear,
    own_shares,
    peak,
    straightness,
    supply_volts,
)

B_M = {"joint_1": 1.77e-4, "joint_2": 9.14e-4, "joint_3": 3.0e-4}  # [N.m.s/rad] table V
FREQUENCIES = {"joint_1": (3.5e-3,), "joint_2": (3.5e-3, 0.071, 1.0), "joint_3": (3.5e-3, 0.071, 1.0)}
"""omega of tables II to IV, per radian of the motor."""
PERIODS = ("of the joint", "of the planetary gear", "of the motor")
OTHER_SUPPLIES = (0.5, 2.0)  # times the assumed one
FAST_LINES = 30
EXACT = 1e-9
INPUTS: Mark = "follows from the inputs"
DECIMALS_I = {
    "mass": (2, 2, 2),
    "length": (4, 4, 4),
    "centre": (4, 4, 4),
    "xx": (4, 4, 4),
    "xy": (4, 4, 5),
    "xz": (6, 5, 5),
    "yy": (4, 4, 4),
    "yz": (5, 5, 4),
    "zz": (4, 4, 4),
}
"""Decimals in SI units to which table I prints, by link."""
DECIMALS_VII = {key: 5 if key in ("b", "e", "r", "s") else 3 if key in ("u", "v", "w") else 4 for key in TABLE_VII}
PARTS = ("constant", "rotor", "varying", "coriolis", "gravity", "friction")
MECHANICAL = ("constant", "varying", "coriolis", "gravity")


@dataclass(frozen=True)
class Sweep:
    """The analysis at one highest speed of the foot.

    Attributes:
        speed: [m/s].
        worst, usual: largest error of leaving out Coriolis on any line, and that of 95 % of them.
        friction: largest friction over the largest torque of the equivalent inertia, median over lines (3,).
        turned: largest perturbation of joint 1 over its equivalent inertia's torque, median over lines.
        of_motor: largest Coriolis torque over the motor's, on any line (3,).
        own: largest Coriolis torque over the joint's own perturbation: median, 95 % and most of the lines (3, 3).
    """

    speed: float
    worst: float
    usual: float
    friction: tuple[float, ...]
    turned: float
    of_motor: tuple[float, ...]
    own: tuple[tuple[float, ...], ...]


def swept(speed: float, rows: Sequence[Contributions]) -> Sweep:
    """Figures of one speed."""
    off = np.array([coriolis_error(row) for row in rows])
    friction = np.median([peak(row.friction) / peak(row.inertia) for row in rows], axis=0)
    turned = np.median([peak(row.perturbation)[0] / peak(row.inertia)[0] for row in rows])
    of_motor = np.max([peak(row.coriolis) / peak(row.total) for row in rows], axis=0)
    own = np.quantile(own_shares(rows), (0.5, 0.95, 1.0), axis=0)
    return Sweep(
        speed, float(off.max()), float(np.quantile(off, 0.95)), tuple(friction.tolist()), float(turned),
        tuple(of_motor.tolist()), tuple(tuple(row) for row in own.T.tolist()),
    )  # fmt: skip


# --- tables ----------------------------------------------------------------------------------------------------------


def open_digits() -> dict[str, float]:
    """What half a digit of every number of table I, and of table VII itself, leaves open: relative, by constant."""
    values = LEG.parameters()
    base = constants(values).table()
    left = {key: half_digit(printed, DECIMALS_VII[key]) * abs(printed) for key, printed in TABLE_VII.items()}
    keys = ["mass", "length", *(f"centre_{axis}" for axis in "xyz"), *(f"inertia_{moment}" for moment in MOMENTS)]
    for link in LINKS:
        for key in keys:
            decimals = DECIMALS_I["centre" if key.startswith("centre") else key.removeprefix("inertia_")][link - 1]
            name = f"link{link}_{key}"
            moved = constants({**values, name: values[name] + 0.5 * 10.0**-decimals}).table()
            for constant in left:
                left[constant] += abs(moved[constant] - base[constant])
    return {key: value / abs(TABLE_VII[key]) for key, value in left.items()}


def table_rows() -> list[Row]:
    """Table VII, from table I."""
    ours = constants(LEG.parameters()).table()
    tensors = constants(LEG.parameters({"product_sign": -1.0})).table()
    left = open_digits()
    rows = []
    for key, value in TABLE_VII.items():
        by_sign = key in ("e", "r")
        rows.append(
            Row(
                key, "VII", value, ours[key], "fitted" if by_sign else INPUTS, within=left[key],
                judged="half a digit of tables I and VII", rests=("sign of products",) if by_sign else (),
                sensitivity=(Otherwise("table I's products as tensor elements", tensors[key]),) if by_sign else (),
            )
        )  # fmt: skip
    exist = {
        sign: [link for link in LINKS if printed(LEG.parameters({"product_sign": sign}), link).possible()]
        for sign in (1.0, -1.0)
    }
    rows.append(
        Row(
            "links of table I that can exist", "I", "1, 2, 3", ", ".join(map(str, exist[1.0])), "predicted",
            agrees=exist[1.0] == list(LINKS), judged="positive second moments", rests=("sign of products",),
            sensitivity=(Otherwise("products as tensor elements", ", ".join(map(str, exist[-1.0]))),),
            note="the paper read the products of a tensor as integrals of x y: masses cannot be laid out so",
        )
    )  # fmt: skip
    return rows


def motor_rows() -> list[Row]:
    """What table V's damping is, and what the frequencies of meshing are."""
    rows = []
    for name, chain in chains_of("silo4").items():
        motor = chain.find("dc_motor")
        damping = motor.motor_constant * motor.back_emf / motor.resistance
        last = name == JOINTS[-1]
        rows.append(
            Row(
                f"B_m of {name} as K_M K_E / R", "V", B_M[name], damping, INPUTS, "N.m.s/rad", within=0.03,
                judged="assumed: 3 %", rests=(),
                note="all three are the damping by back-EMF: beside a voltage, they would count twice" if last else "",
            )
        )  # fmt: skip
    values = LEG.parameters()
    for j, (name, frequencies) in enumerate(FREQUENCIES.items(), 1):
        planetary, skew = values[f"planetary{j}_gear"], values[f"skew{j}_gear"]
        turns = (1.0 / (planetary * skew), 1.0 / planetary, 1.0)
        for k, (value, ours) in enumerate(zip(frequencies, turns, strict=False)):
            rows.append(
                Row(
                    f"omega_{k + 1} of {name} as one period a turn {PERIODS[k]}", "II to V", value, ours, INPUTS,
                    within=half_digit(value, (4, 3, 0)[k]) if k < 2 else EXACT,
                    judged="half a printed digit" if k < 2 else "exact", rests=(),
                    note="without effect: its amplitude is printed 0" if name == "joint_1" else "",
                )
            )  # fmt: skip
    return rows


def equation_rows(analysis: Analysis, gaps: Mapping[str, float]) -> list[Row]:
    """Appendices A and B beside the engine, and to the letter."""
    worst = max(gaps, key=lambda name: gaps[name])
    whole, q = constants(LEG.parameters()), analysis.workspace(500)
    omitted = {key: abs(float(value)) for key, value in vars(whole).items() if key.startswith(("sine", "side"))}
    largest = max(omitted, key=lambda key: omitted[key])
    speed = np.random.default_rng(0).uniform(-1.0, 1.0, q.shape)
    turning = coriolis(analysis.constants, q, speed)
    weight = gravity(analysis.constants, q)
    step = 1e-6 * np.eye(3)
    numeric = np.stack([(foot(analysis.values, q + d) - foot(analysis.values, q - d)) / 2e-6 for d in step], axis=-1)
    off = float(np.abs(numeric - jacobian(analysis.values, q)).max())
    least = float(np.linalg.eigvalsh(mass_matrix(analysis.constants, q)).min())

    def letter(name: str, where: str, ours: np.ndarray, theirs: np.ndarray, columns: slice, note: str) -> Row:
        gap = float((peak(ours - theirs)[columns] / peak(ours)[columns]).max())
        limit = float(max(open_digits().values()))
        return Row(
            name, where, "alike", f"{gap:.2%} of the maximum", INPUTS, agrees=gap <= limit,
            judged=f"{limit:.1%}, what the digits of tables I and VII leave open", rests=(), note=note,
        )  # fmt: skip

    return [
        Row("equations of motion in symbols and in MuJoCo", "B", "alike", f"{gaps[worst]:.1e} of the maximum ({worst})",
            INPUTS, agrees=gaps[worst] < 1e-9, judged="rounding", rests=(),
            note="with the terms that (36) leaves out"),
        Row("terms left out of (36)", "B.1", "under 1e-4", f"up to {omitted[largest]:.1e} kg.m2 ({largest})", INPUTS,
            agrees=omitted[largest] < 1e-4, judged="the printed limit", rests=(),
            note=f"{sum(value >= 1e-4 for value in omitted.values())} of {len(omitted)} are larger"),
        letter("(40) to the letter, and the Christoffel symbols of (36)", "(40)", turning,
               printed_coriolis(TABLE_VII, q, speed), slice(0, 3),
               "h112 lacks b cos(q2) and has g where -2 e belongs; h211 lacks b/2 cos(q2): all of them small"),
        letter("(42) to the letter, and the slope of the potential", "(42)", weight, printed_gravity(TABLE_VII, q),
               slice(1, 3), "g_2 lacks x sin(q2 + q3)"),
        Row("the mass matrix is positive definite, over the workspace", "2.1", "stated",
            f"least eigenvalue {least:.4f} kg.m2", "predicted", agrees=least > 0.0, judged="positive or not",
            rests=("sign of products",)),
        Row("Jacobian (34), and differences of the foot", "(34)", "alike", f"within {off:.0e} m", INPUTS,
            agrees=off < 1e-8, judged="rounding", rests=()),
    ]  # fmt: skip


# --- section 4.3.1: the mechanical part ------------------------------------------------------------------------------


def coriolis_rows(sweeps: Sequence[Sweep], by_seed: Mapping[float, Sequence[float]]) -> list[Row]:
    """What leaving out Coriolis costs: beside the whole perturbation, each joint's own, and the motor's torque."""
    at = _own(sweeps)
    level = 0.042
    spread = {speed: f"{min(worst):.1%} to {max(worst):.1%}" for speed, worst in by_seed.items()}
    first = next(iter(spread))
    rows = [
        Row(
            "error of leaving out Coriolis, worst line, by draw of the lines", "4.3.1, 7", f"{level:.1%}",
            f"{spread[first]} at {first:g} m/s", "predicted", rests=ROUTE,
            sensitivity=(
                *(Otherwise(f"the foot at {speed:g} m/s at most", text)
                  for speed, text in spread.items() if speed != first),
                *(Otherwise(f"the first draw, {row.speed:g} m/s", f"{row.worst:.1%}") for row in sweeps),
            ),
            note=f"the foot's speed is not printed. {level:.1%} fall at {speed_at(sweeps, level, False):.2f} m/s on "
            f"the worst of the first {LINES} lines, at {speed_at(sweeps, level, True):.2f} m/s on 95 % of them; "
            f"{len(by_seed[first])} draws of {LINES} lines",
        )
    ]  # fmt: skip
    for j, name in enumerate(JOINTS):
        median, usual, most = at.own[j]
        rows.append(
            Row(
                f"Coriolis over the perturbation of {name} itself", "4.3.1", "can be neglected",
                f"median {median:.0%}, 95 % of lines under {usual:.0%}, most {most:.0%}", "predicted",
                agrees=most < RULE, judged="the paper's 5 %, on every line", rests=ROUTE,
                sensitivity=tuple(
                    Otherwise(f"the foot at {row.speed:g} m/s at most",
                              "median {:.0%}, 95 % under {:.0%}, most {:.0%}".format(*row.own[j]))
                    for row in sweeps if row.speed != at.speed
                ),
                note="both grow with the square of the speed, so that it is the same at any" if j == 0 else "",
            )
        )  # fmt: skip
    for j, name in enumerate(JOINTS):
        rows.append(
            Row(
                f"Coriolis over the motor's torque, {name}", "3, 4.3.1", "under 5 %", f"most {at.of_motor[j]:.1%}",
                "predicted", agrees=at.of_motor[j] < RULE, judged="the paper's 5 %, on every line", rests=ROUTE,
                sensitivity=tuple(
                    Otherwise(f"the foot at {row.speed:g} m/s at most", f"most {row.of_motor[j]:.1%}")
                    for row in sweeps if row.speed > at.speed
                ),
            )
        )  # fmt: skip
    return rows


def speed_at(sweeps: Sequence[Sweep], level: float, usual: bool) -> float:
    """Highest speed of the foot at which leaving out Coriolis costs ``level`` [m/s]; it grows with the square."""
    values = [sweep.usual if usual else sweep.worst for sweep in sweeps]
    return float(np.exp(np.interp(np.log(level), np.log(values), np.log([sweep.speed for sweep in sweeps]))))


def mechanical_rows(found: Sequence[Contributions]) -> list[Row]:
    """What moves the links, by joint: inertia in joint 1, gravity in joints 2 and 3."""
    medians = {part: np.median([peak(getattr(row, part)) for row in found], axis=0) for part in MECHANICAL}
    rows = []
    for j, (name, says) in enumerate(zip(JOINTS, ("inertia", "gravity", "gravity"), strict=True)):
        parts = {part: float(values[j]) for part, values in medians.items()}
        most = max(parts, key=lambda part: parts[part])
        told = "inertia" if most in ("constant", "varying") else most
        rows.append(
            Row(
                f"largest torque of the links at {name}", "4.3.1", says, told, "predicted", agrees=told == says,
                judged="exact", rests=ROUTE,
                note=", ".join(f"{part} {value:.3f}" for part, value in parts.items()) + " N.m (medians)",
            )
        )  # fmt: skip
    return rows


# --- section 4.3.2: the actuators ------------------------------------------------------------------------------------


def shares(rows: Sequence[Contributions], efficiency: bool = False) -> dict[str, dict[str, float]]:
    """Largest torque of each part over the largest motor torque, the most of 95 % of the lines, by joint.

    Args:
        rows: lines.
        efficiency: whether friction is that of the gears' efficiencies in place of (16).
    """
    found = {part: list[np.ndarray]() for part in PARTS}
    for row in rows:
        friction = by_efficiency(row) if efficiency else row.friction
        total = peak(row.inertia + row.perturbation + friction)
        for part in PARTS:
            found[part].append(peak(friction if part == "friction" else getattr(row, part)) / total)
    most = {part: np.quantile(values, 0.95, axis=0) for part, values in found.items()}
    return {name: {part: float(most[part][j]) for part in PARTS} for j, name in enumerate(JOINTS)}


def share_lines(rows: Sequence[Contributions]) -> list[str]:
    """The 5 % rule as lines of text."""
    lines = [f"share of the motor torque at {OWN_SPEED:g} m/s (95 % of {len(rows)} lines); * under 5 %: left out"]
    lines.append(f"{'':10s}" + "".join(f"{part:>12s}" for part in PARTS))
    for name, row in shares(rows).items():
        cells = "".join(f"{row[part]:11.1%}{'*' if row[part] < RULE else ' '}" for part in PARTS)
        lines.append(f"{name:10s}{cells}".rstrip())
    return [*lines, ""]


def actuator_rows(analysis: Analysis, found: Sequence[Contributions], sweeps: Sequence[Sweep]) -> list[Row]:
    """Friction, inertia and perturbation of the actuators."""
    at = _own(sweeps)
    turned = [peak(row.perturbation)[0] / peak(row.inertia)[0] for row in found]
    shared, smooth = shares(found), shares(found, efficiency=True)
    driven = list(JOINTS[1:])
    least = np.min([peak(row.friction) / peak(row.total) for row in found], axis=0)
    varying = np.quantile([np.ptp(row.perturbation, axis=0) / peak(row.total) for row in found], (0.5, 1.0), axis=0)
    rows = [
        Row(
            "perturbation of joint 1 over its inertia", "4.3.2, 10a", "under 0.005", float(np.median(turned)),
            "predicted", agrees=max(turned) < 0.005, judged="the printed limit, on every line", rests=ROUTE,
            note=f"contradicts tables I and V: median of {LINES} lines, {min(turned):.1%} to {max(turned):.0%}, at any "
            "speed, because both grow with its square; D_11 less h is as large as J_m N^2",
        ),
        Row(
            "perturbation of joint 1 over the motor's torque", "4.3.2, 9", "almost negligible",
            f"median {varying[0][0]:.1%}, most {varying[1][0]:.0%}", "predicted", agrees=varying[1][0] < RULE,
            judged="the paper's 5 %, on every line", rests=ROUTE,
        ),
    ]  # fmt: skip
    for j in (1, 2):
        rows.append(
            Row(
                f"perturbation of joint {j + 1} is constant: its change over the motor's torque", "4.3.2, 9",
                "constant, on the example line", f"median {varying[0][j]:.1%}, most {varying[1][j]:.0%}", "predicted",
                agrees=bool(varying[1][j] < RULE), judged="the paper's 5 %, on every line", rests=ROUTE,
            )
        )  # fmt: skip
    for j, says in ((0, "under 1"), (1, 2.0), (2, 2.0)):
        rows.append(
            Row(
                f"friction over inertia, joint {j + 1}", "4.3.2, 8", says, at.friction[j], "predicted",
                within=None if j == 0 else 0.25, agrees=at.friction[j] < 1.0 if j == 0 else None,
                judged="the printed limit" if j == 0 else "half a digit of 2, assumed", rests=ROUTE,
                sensitivity=tuple(
                    Otherwise(f"the foot at {row.speed:g} m/s at most", row.friction[j]) for row in sweeps
                ),
                note="" if j else "tables II to IV and V make friction larger than inertia in all three joints, unless "
                "accelerations are several times those of a bang-bang line",
            )
        )  # fmt: skip
    rows += [
        Row(
            "friction is never negligible", "4.3.2", "in any joint",
            "least " + ", ".join(f"{value:.0%}" for value in least), "predicted", agrees=bool(least.min() > RULE),
            judged="the paper's 5 % of the motor's torque, on every line", rests=ROUTE,
        ),
        Row(
            "what dominates actuators 2 and 3", "4.3.2", "friction", _dominant(shared), "predicted",
            agrees=all(_most(shared[name]) == "friction" for name in driven), judged="exact", rests=ROUTE,
            rival=Otherwise(
                "gears with table V's efficiencies (6) in place of (16)", _dominant(smooth),
                all(_most(smooth[name]) == "friction" for name in driven),
            ),
        ),
        Row(
            "what makes the perturbation of joint 1 vary", "4.3.2", "varying inertia",
            _largest(shared[JOINTS[0]]) + " inertia", "predicted", agrees=_largest(shared[JOINTS[0]]) == "varying",
            judged="exact", rests=ROUTE,
        ),
        Row(
            "largest part of the perturbation of joints 2 and 3", "4.3.2", "gravity",
            ", ".join(_largest(shared[name]) for name in driven), "predicted",
            agrees=all(_largest(shared[name]) == "gravity" for name in driven), judged="exact", rests=ROUTE,
        ),
    ]  # fmt: skip
    return rows + linearity_rows(analysis, found)


def linearity_rows(analysis: Analysis, found: Sequence[Contributions]) -> list[Row]:
    """(29) and (30): gravity over the horizontal lengthening."""
    along = np.array([[straightness(row.lengthening, row.gravity[:, j]) for j in (1, 2)] for row in found])
    q = analysis.workspace(5000)
    reach, weight = lengthening(analysis.values, q), gravity(analysis.constants, q)
    over = [straightness(reach, weight[:, j]) for j in (1, 2)]
    grows = [np.mean([linear(row.lengthening, np.abs(row.gravity[:, j]))[0] > 0.0 for row in found]) for j in (1, 2)]
    stretched = [
        Row(
            f"gravity of joint {j + 2} grows as the leg stretches", "4.3.2, 10", "increases",
            f"on {grows[j]:.0%} of the lines", "predicted", agrees=bool(grows[j] == 1.0), judged="on every line",
            rests=ROUTE,
        )
        for j in (0, 1)
    ]  # fmt: skip
    return stretched + [
        Row(
            f"gravity of joint {j + 2} linear in R_h along a line, R2", "4.3.2, 10", "linear",
            f"{along[:, j].min():.2f} to {along[:, j].max():.2f}", "predicted",
            agrees=bool(np.quantile(along[:, j], 0.05) > 0.97), judged="assumed: over 0.97 on 95 % of the lines",
            rests=ROUTE, sensitivity=(Otherwise("over the whole workspace", f"{over[j]:.2f}"),),
        )
        for j in (0, 1)
    ]  # fmt: skip


def speed_rows(analysis: Analysis) -> list[Row]:
    """Section 4: mean speeds of the foot, as the fastest that the motors allow."""
    lines, supply = analysis.lines(FAST_LINES, horizontal=True), supply_volts()
    voltages = (supply, *(factor * supply for factor in OTHER_SUPPLIES))
    rows = []
    for name, printed_speed, straight in (
        ("mean speed of the foot on a straight line", 0.2, False),
        ("mean speed of the foot, each joint straight to its angle", 0.4, True),
    ):
        speeds = {volts: [fastest(analysis, line, volts, straight) for line in lines] for volts in voltages}
        medians = {volts: float(np.median(values)) for volts, values in speeds.items()}
        rows.append(
            Row(
                name, "4", printed_speed, medians[supply], "predicted", "m/s", within=half_digit(printed_speed, 1),
                judged="half a printed digit; the voltage is assumed", rests=("lines of the foot", "supply"),
                sensitivity=tuple(Otherwise(f"{volts:g} V", medians[volts]) for volts in voltages[1:]),
                note=f"the fastest bang-bang motion at {supply:g} V (assumed), median of {FAST_LINES} lines "
                f"({min(speeds[supply]):.2f} to {max(speeds[supply]):.2f})",
            )
        )  # fmt: skip
    return rows


def _own(sweeps: Sequence[Sweep]) -> Sweep:
    return next(sweep for sweep in sweeps if sweep.speed == OWN_SPEED)


def _most(shared: Mapping[str, float]) -> str:
    return max(shared, key=lambda name: shared[name])


def _dominant(shared: Mapping[str, Mapping[str, float]]) -> str:
    return ", ".join(_most(shared[name]) for name in JOINTS[1:])


def _largest(shared: Mapping[str, float]) -> str:
    return max(("varying", "coriolis", "gravity"), key=lambda name: shared[name])
