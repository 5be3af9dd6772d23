"""Tables and appendices of paper 000 beside ours: what follows from printed numbers, or from how they are read."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...envs.leg.inertia import printed, rotors
from ...envs.leg.kinematics import foot, jacobian
from ...envs.leg.parameters import LINKS, MOMENTS
from ...envs.leg.robot import JOINTS, LEG, chains_of
from ..published import Mark, Otherwise, Row, half_digit
from .dynamics import TABLE_VII, constants, coriolis, gravity, mass_matrix, printed_coriolis, printed_gravity
from .paper import Analysis, peak

B_M = {"joint_1": 1.77e-4, "joint_2": 9.14e-4, "joint_3": 3.0e-4}  # [N.m.s/rad] table V
FREQUENCIES = {"joint_1": (3.5e-3,), "joint_2": (3.5e-3, 0.071, 1.0), "joint_3": (3.5e-3, 0.071, 1.0)}
"""omega of tables II to IV, per radian of the motor."""
PERIODS = ("of the joint", "of the planetary gear", "of the motor")
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
