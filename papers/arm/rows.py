"""Printed numbers and statements of the arm's paper (paper 002) beside ours, each with its mark."""

from __future__ import annotations

import numpy as np

from ...envs.arm.kinematics import PRINTED, chain
from ...envs.arm.tables import (
    FINAL,
    GEARS,
    JOINTS,
    SHAFT,
    TABLE_MODULI,
    TEXT_MODULI,
    TOOL,
    in_series,
    second_moment,
    shaft_stiffness,
    tooth_stiffness,
)
from ...envs.arm.trajectory import Line
from ..published import Otherwise, Row
from .dynamics import inverse
from .paper import BESIDE, DAMPINGS, HIGHEST, MARKS, SPRING, STATOR, Results, crossings, late_rise, mark

EXACT = 1e-3  # relative: tables I and IV
INPUTS = "follows from the inputs"


def kinematic_rows() -> list[Row]:
    """Table I: where the tool is at both ends, by the product of its three steps."""
    found = []
    for label, angles, printed in zip(("first", "last"), ((0.0, 0.0, 0.0), FINAL), TOOL, strict=True):
        place = chain(np.deg2rad(angles), PRINTED)[:3, 3]
        for axis, value, ours in zip("xyz", printed, place, strict=True):
            agrees = abs(ours - value) < 1e-12 if value == 0.0 else None
            bound = None if value == 0.0 else max(EXACT, 0.6e-4 / abs(value))  # four digits are printed
            found.append(
                Row(
                    f"{label} position of the tool, {axis}",
                    where="table I",
                    printed=value,
                    ours=float(ours),
                    mark=INPUTS,
                    unit="m",
                    within=bound,
                    agrees=agrees,
                )
            )
    return found


def stiffness_rows() -> list[Row]:
    """Table IV, and the series that table X's first stiffness is."""
    young, shear = TABLE_MODULI
    found, ours = [], []
    for number, gear in enumerate(GEARS, 1):
        moment = second_moment(gear.true_width, gear.thickness)
        note = f"with b = 9 mm; the printed {gear.width:g} mm give {second_moment(gear.width, gear.thickness):.3g} mm4"
        found.append(
            Row(
                f"gear {number}: I", "table IV", gear.moment, moment, INPUTS, "mm4", EXACT,
                note=note if gear.width != gear.true_width else "",
            )
        )  # fmt: skip
        ours.append(tooth_stiffness(gear.moment, gear.diameter, gear.length, young))
        found.append(
            Row(f"gear {number}: k = E I r2 / L3", "table IV", gear.stiffness, ours[-1], INPUTS, "N.m/rad", EXACT)
        )
    diameter, length, polar, stiffness = SHAFT
    found.append(Row("shaft: J", "table IV", polar, np.pi * diameter**4 / 32.0, INPUTS, "mm4", EXACT))
    ours.append(shaft_stiffness(polar, length, shear))
    found.append(Row("shaft: k = G J / L", "table IV", stiffness, ours[-1], INPUTS, "N.m/rad", EXACT))
    printed = (*(gear.stiffness for gear in GEARS), stiffness)
    as_text = tooth_stiffness(GEARS[0].moment, GEARS[0].diameter, GEARS[0].length, TEXT_MODULI[0])
    found.append(
        Row(
            "joint 1: all five in series", "table X", 488.0, in_series(printed), INPUTS, "N.m/rad", EXACT,
            note=f"of the printed five; of ours {in_series(tuple(ours)):.1f}. E = 200 GPa and G = 80 GPa; the text's "
            f"207 GPa would give gear 1 {as_text:.0f} N.m/rad, and the cantilever of its text three times all. "
            "Gears of joints 2 and 3 are not printed",
        )
    )  # fmt: skip
    return found


def start_rows() -> list[Row]:
    """What the stretched start does to the trajectory: printed only as a spline that starts and ends at rest."""
    early = np.array([1e-2, 1e-4])
    quintic, septic = (np.abs(Line(way=way).joints(early)[2][:, 2]) for way in ("quintic", "septic"))
    times = np.linspace(1e-6, 5.0, 2001)
    largest = np.abs(Line().joints(times)[2][:, 2]).max()
    torque = np.abs(inverse(Line(), np.linspace(1e-3, 4.999, 200))).max(axis=0)
    return [
        Row(
            "acceleration of joint 3 is finite at the start", "Fig. 12", "finite",
            f"septic: {largest:.2f} rad/s2; quintic: {quintic[0]:.0f} at 10 ms, {quintic[1]:.0f} at 0.1 ms",
            INPUTS, agrees=bool(septic[1] < 1.5),
            note="the arm starts stretched. Largest torques on the septic way: "
            + f"{', '.join(f'{t:.3g}' for t in torque)} N.m",
        )
    ]  # fmt: skip


def open_loop_rows(results: Results) -> list[Row]:
    """Section 5: stiffness between stator and rotor, dampers, and the final model."""
    r = results
    low, high = (mark(STATOR, r.stator, level) for level in MARKS)
    springs = [mark(SPRING, r.spring, level) for level in MARKS]
    final, damped, sprung = r.final.largest, r.parts["dampers"].largest, r.parts["springs"].largest
    by_joint = [r.damping[name] for name in JOINTS]
    ordered = (by_joint[0] > by_joint[2]) & (by_joint[2] > by_joint[1])
    span = f"{DAMPINGS[ordered].min():.2g} to {DAMPINGS[ordered].max():.2g} N.m.s/rad" if ordered.any() else "nowhere"
    alone = r.beside[0.0].largest
    lower = {value: motion.largest for value, motion in r.beside.items() if 0.0 < value <= HIGHEST}
    best = min(lower, key=lambda value: lower[value])
    crossed = crossings({value: r.crossing[value] for value in BESIDE if value >= 1e-2})
    ratio = f"{damped:.2f} mm of dampers, {sprung:.4f} mm of springs"
    return [
        Row(
            "stator to rotor: stiffness at the 1 mm mark", "Fig. 18", "not printed", low, "predicted", "N.m/rad",
            note="the paper's figure is not at hand: these are for reading it",
        ),
        Row(
            "stator to rotor: 30 mm are passed at a very small stiffness", "5.1", "very small", f"{high:.2g} N.m/rad",
            "predicted", agrees=high < 0.01 * 67.0,
        ),
        Row("rotor to link: stiffness at the 1 mm mark", "5.1", "not printed", springs[0], "predicted", "N.m/rad"),
        Row("rotor to link: stiffness at the 30 mm mark", "5.1", "not printed", springs[1], "predicted", "N.m/rad"),
        Row(
            "dampers are a major source of error", "6", "stated", ratio, "predicted", agrees=damped > 10.0 * sprung,
            sensitivity=tuple(
                Otherwise(name, f"{b:.2f} mm of dampers, {c:.4f} mm of springs") for name, (_, b, c) in r.varied.items()
            ),
        ),
        Row(
            "table X: largest deviation of the tool", "Fig. 25", "not printed", final, "predicted", "mm",
            sensitivity=tuple(Otherwise(name, a) for name, (a, _, _) in r.varied.items())
            + tuple(Otherwise(f"torques smoothed by polynomials of degree {n}, perfect joints", v)
                    for n, v in r.smoothed.items()),
        ),
        Row(
            "effect of c_r1 over c_r3 over c_r2", "5.2", "stated", f"from {span}", "predicted",
            agrees=bool(ordered.any()),
            note="below, c_r3 counts most: " + ", ".join(
                f"{value:.3g} mm of {name}" for name, value in
                zip(JOINTS, (float(row[list(DAMPINGS).index(DAMPINGS[4])]) for row in by_joint), strict=True)
            ) + f" at {DAMPINGS[4]:.2g} N.m.s/rad",
        ),
        Row(
            f"at the highest c_r1 ({HIGHEST:g}) c_r3 lowers the error", "5.2", "stated",
            f"{alone:.0f} to {lower[best]:.0f} mm at {best:g}", "predicted", agrees=lower[best] < alone,
        ),
        Row("curves cross at high c_r3", "5.2", "stated", f"{crossed} pairs", "predicted", agrees=crossed > 0),
    ]  # fmt: skip


def mixed_rows(results: Results) -> list[Row]:
    """Section 5.3: the vertical motion that goes the wrong way."""
    main = results.mixed[""]
    found, wanted = late_rise(main)
    others = [Otherwise(name, f"{late_rise(motion)[0]:+.0f} mm") for name, motion in results.mixed.items() if name]
    own = late_rise(results.final)[0]
    return [
        Row(
            "the tool's z goes against the wanted direction", "5.3", "stated",
            f"{found:+.0f} mm in the last quarter, wanted {wanted:+.0f}", "predicted", agrees=found * wanted < 0.0,
            sensitivity=(*others, Otherwise("torques of the same table VIII, joints of table X", f"{own:+.0f} mm")),
            note="torques of the links of table II on the arm of table VIII. Both tables differ by up to a tenth in "
            "inertia, and nothing corrects it; the paper blames several solutions of its inverse model",
        )
    ]  # fmt: skip


def rows(results: Results) -> list[Row]:
    """All rows, in the order of the paper."""
    return [*kinematic_rows(), *stiffness_rows(), *start_rows(), *open_loop_rows(results), *mixed_rows(results)]
