"""Tables and appendices of paper 000 beside ours: what follows from printed numbers, or from how they are read."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...envs.leg.inertia import printed, rotors
from ...envs.leg.kinematics import foot, jacobian
from ...envs.leg.parameters import LINKS, MOMENTS
from ...envs.leg.robot import JOINTS, LEG, chains_of
from ..published import Mark, Otherwise, Row, half_digit
from .choices import SIGN
from .dynamics import TABLE_VII, constants, coriolis, gravity, mass_matrix, printed_coriolis, printed_gravity
from .paper import Analysis, peak

B_M = {"joint_1": 1.77e-4, "joint_2": 9.14e-4, "joint_3": 3.0e-4}  # [N.m.s/rad] table V
FREQUENCIES = {"joint_1": (3.5e-3,), "joint_2": (3.5e-3, 0.071), "joint_3": (3.5e-3, 0.071)}
"""omega_1 and omega_2 of tables II to IV, per radian of the motor."""
PERIODS = ("of the joint", "of the planetary gear")
GAP = 1e-9  # over the largest size: rounding
TENSOR = "table I's products as tensor elements"
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
                judged="half a digit of tables I and VII", rests=(SIGN,) if by_sign else (),
                sensitivity=(Otherwise(TENSOR, tensors[key]),) if by_sign else (),
            )
        )  # fmt: skip
    lengths = [1e3 * LEG.parameters()[f"link{link}_length"] for link in LINKS]
    rows.append(
        Row(
            "length of each link", "4, I", "about 0.240 m", ", ".join(f"{mm:g}" for mm in lengths) + " mm", INPUTS,
            agrees=all(abs(mm - 240.0) < 5.0 for mm in lengths), judged="5 mm, half a digit of 0.24", rests=(),
        )
    )  # fmt: skip
    exist = {
        sign: [link for link in LINKS if printed(LEG.parameters({"product_sign": sign}), link).possible()]
        for sign in (1.0, -1.0)
    }
    rows.append(
        Row(
            "links of table I that can exist", "I", "1, 2, 3", ", ".join(map(str, exist[1.0])), "predicted",
            agrees=exist[1.0] == list(LINKS), judged="positive second moments", rests=(SIGN,),
            sensitivity=(Otherwise(TENSOR, ", ".join(map(str, exist[-1.0]))),),
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
    k, turning = constants(values), rotors(values)
    beside = [turning[j] / links for j, links in enumerate((k.h, k.l, k.m))]
    rows.append(
        Row(
            "low-inertia motors: their inertia at the joint over the links' constant one", "4.2, (17) to (19)", "low",
            ", ".join(f"{value:.1f}" for value in beside) + " times", INPUTS, agrees=max(beside) < 1.0,
            judged="the smaller one, in every joint", rests=(),
        )
    )  # fmt: skip
    for j, (name, frequencies) in enumerate(FREQUENCIES.items(), 1):
        planetary, skew = values[f"planetary{j}_gear"], values[f"skew{j}_gear"]
        turns = (1.0 / (planetary * skew), 1.0 / planetary)
        for k, (value, ours) in enumerate(zip(frequencies, turns, strict=False)):
            rows.append(
                Row(
                    f"omega_{k + 1} of {name} as one period a turn {PERIODS[k]}", "II to V", value, ours, INPUTS,
                    within=half_digit(value, (4, 3)[k]), judged="half a printed digit", rests=(),
                    note="without effect: its amplitude is printed 0" if name == "joint_1" else "",
                )
            )  # fmt: skip
    return rows


def equation_rows(analysis: Analysis, gaps: Mapping[str, float]) -> list[Row]:
    """Appendices A and B beside the engine, and to the letter."""
    q = analysis.workspace(500)
    other = Analysis({"product_sign": -analysis.values["product_sign"]})
    speed = np.random.default_rng(0).uniform(-1.0, 1.0, q.shape)
    step = 1e-6 * np.eye(3)
    numeric = np.stack([(foot(analysis.values, q + d) - foot(analysis.values, q - d)) / 2e-6 for d in step], axis=-1)
    off = float(np.abs(numeric - jacobian(analysis.values, q)).max())
    least = float(np.linalg.eigvalsh(mass_matrix(analysis.constants, q)).min())
    omitted, signed = left_out(analysis), left_out(other)
    largest, largest_signed = (max(terms, key=lambda key, terms=terms: terms[key]) for terms in (omitted, signed))
    left = open_digits()
    loosest = max(left, key=lambda key: left[key])
    limit = f"{left[loosest]:.1%}, what the digits of tables I and VII leave open in {loosest}, the loosest constant"

    def turning(of: Analysis) -> float:
        return _gap(coriolis(of.constants, q, speed), printed_coriolis(TABLE_VII, q, speed))

    weight = _gap(gravity(analysis.constants, q)[:, 1:], printed_gravity(TABLE_VII, q)[:, 1:])
    return [
        Row("equations of motion in symbols and in MuJoCo", "B", "alike", f"within {GAP:g} of the maximum"
            if max(gaps.values()) < GAP else f"{max(gaps.values()):.1e} of the maximum", INPUTS,
            agrees=max(gaps.values()) < GAP, judged="rounding", rests=(), note="with the terms that (36) leaves out"),
        Row("terms left out of (36)", "B.1", "under 1e-4", f"up to {omitted[largest]:.1e} kg.m2 ({largest})",
            "predicted", agrees=omitted[largest] < 1e-4, judged="the printed limit", rests=(SIGN,),
            sensitivity=(Otherwise(TENSOR, f"up to {signed[largest_signed]:.1e} kg.m2 ({largest_signed})"),),
            note=f"{sum(value >= 1e-4 for value in omitted.values())} of {len(omitted)} are larger"),
        Row("(40) to the letter, and the Christoffel symbols of (36)", "(40)", "alike",
            f"{turning(analysis):.2%} of the maximum", "predicted", agrees=turning(analysis) <= left[loosest],
            judged=limit, rests=(SIGN,), sensitivity=(Otherwise(TENSOR, f"{turning(other):.2%} of the maximum"),),
            note="h112 lacks b cos(q2) and has g where -2 e belongs; h211 lacks b/2 cos(q2): all of them small"),
        Row("(42) to the letter, and the slope of the potential", "(42)", "alike", f"{weight:.2%} of the maximum",
            INPUTS, agrees=weight <= left[loosest], judged=limit, rests=(), note="g_2 lacks x sin(q2 + q3)"),
        Row("the mass matrix is positive definite, over the workspace", "2.1", "stated",
            f"least eigenvalue {least:.4f} kg.m2", "predicted", agrees=least > 0.0, judged="positive or not",
            rests=(SIGN,)),
        Row("Jacobian (34), and differences of the foot", "(34)", "alike", f"within {off:.0e} m", INPUTS,
            agrees=off < 1e-8, judged="rounding", rests=()),
    ]  # fmt: skip


def left_out(analysis: Analysis) -> dict[str, float]:
    """Size of each term that (36) leaves out [kg.m2]."""
    whole = vars(constants(analysis.values))
    return {key: abs(float(value)) for key, value in whole.items() if key.startswith(("sine", "side"))}


def _gap(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest difference of two torques over the largest size of each column."""
    return float((peak(ours - theirs) / peak(ours)).max())
