"""Printed numbers and statements of the arm's paper (paper 002) beside ours, each with its mark."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...envs.arm.kinematics import chain
from ...envs.arm.tables import (
    FINAL,
    FLEXIBLE,
    GEARS,
    SHAFT,
    SIMPLE,
    STIFFNESS,
    TABLE_MODULI,
    TEXT_MODULI,
    TOOL,
    in_series,
    second_moment,
    shaft_stiffness,
    tooth_stiffness,
)
from ...envs.arm.trajectory import PRINTED, Line
from ..published import Otherwise, Row, half_digit
from .axes import (
    HINGES,
    SIMPLE_HINGES,
    SIMPLE_TORQUES,
    TABLE_I,
    TORQUES,
    beside_table_one,
    distance,
    ends,
    gap,
    printed_axes,
    tilt,
)
from .choices import FINAL_MODEL, OPEN_LOOP, OPPOSITE
from .dynamics import Motion, inverse
from .paper import BASES, BESIDE, DAMPINGS, HIGHEST, MARKS, SOFTEST, SPRING, STATOR, Results, crossing_pairs, mark
from .readings import FALL, LIKE, ORDER, PLAIN, fall

EXACT = 1e-3  # relative: table IV
TABLE_IV = "assumed: under the inputs' digits"
CLOSED = 5e-5  # [m] half a digit of tables IX, XI and XII
INPUTS = "follows from the inputs"
MAJOR = 10.0  # times the other's effect: a major source
BY_SPRINGS = "assumed: 1 mm, the paper's mark for springs"
NEGLIGIBLE = 0.05  # relative change of the deviation, as of a damper a hundredth of the others


def kinematic_rows() -> list[Row]:
    """Table I and (13): where the tool is at both ends, and how it is turned."""
    found = []
    decimals = ((2, 0, 3), (4, 4, 4))
    for label, angles, printed, digits in zip(("first", "last"), ((0.0, 0.0, 0.0), FINAL), TOOL, decimals, strict=True):
        place = chain(np.deg2rad(angles), PRINTED)[:3, 3]
        for axis, value, ours, count in zip("xyz", printed, place, digits, strict=True):
            none = value == 0.0
            found.append(
                Row(
                    f"{label} position of the tool, {axis}", "table I", value, float(ours), INPUTS, "m",
                    within=None if none else half_digit(value, count),
                    agrees=abs(ours) < 1e-12 if none else None, judged="half a printed digit", rests=(),
                )
            )  # fmt: skip
    rng = np.random.default_rng(0)
    off = max(
        float(np.abs(chain(q, PRINTED)[:3, :3] - turned(q[0] - np.pi / 2, q[1], q[2] + np.pi / 2)).max())
        for q in rng.uniform(-np.pi, np.pi, (100, 3))
    )
    found.append(
        Row(
            "orientation of the last link by Z-X-Z angles of the joints", "(13)", "q1 - 90 deg, q2, q3 + 90 deg",
            f"within {off:.0e}", INPUTS, agrees=off < 1e-12, judged="exact", rests=(),
        )
    )  # fmt: skip
    return found


def turned(first: float, second: float, third: float) -> np.ndarray:
    """Rotation by Euler angles Z-X-Z [rad], (3, 3)."""
    c, s = np.cos(second), np.sin(second)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    around = []
    for angle in (first, third):
        c, s = np.cos(angle), np.sin(angle)
        around.append(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
    return around[0] @ about_x @ around[1]


def axes_rows(results: Results) -> list[Row]:
    """Tables II to IX and XI to XIII: whether their bodies, axes and torques fit together."""
    mirrored = SIMPLE["link1"]
    as_printed = {**SIMPLE, "link1": type(mirrored)(mirrored.mass, mirrored.inertia, (-0.0185, 0.043, 0.376), True)}
    gaps = [gap(hinge, SIMPLE) for hinge in SIMPLE_HINGES]
    cut = HINGES[1]
    start, end = ends(cut, FLEXIBLE, "first")
    lost = ends(type(cut)(cut.first, cut.second, cut.on_first, (cut.on_second[0], (-3.44e-3, -0.3584, 0.0576))),
                FLEXIBLE, "second")[1]  # fmt: skip
    aside = np.linalg.norm(np.cross(lost - start, end - start)) / np.linalg.norm(end - start)
    whole = max(gap(hinge, FLEXIBLE) for hinge in HINGES)
    lean, beside = beside_table_one(printed_axes())
    leans = [
        tilt(np.subtract(b, a), np.subtract(hinge.on_first[1], hinge.on_first[0]))
        for (a, b), hinge in zip(SIMPLE_TORQUES, SIMPLE_HINGES, strict=True)
    ]
    same = all(points == hinge.on_first for points, hinge in zip(TORQUES, HINGES, strict=True))
    joint = TABLE_I.joints[1]
    aside_2 = [1e3 * distance(np.array(joint.point), np.array(joint.direction), np.array(table["link2"].centre))
               for table in (SIMPLE, FLEXIBLE)]  # fmt: skip
    masses = [sum(body.mass for body in table.values()) for table in (SIMPLE, FLEXIBLE)]
    closed = "half a digit of the tables, 0.05 mm"

    def meets(name: str, where: str, metres: float, rests: tuple[str, ...] = (), note: str = "") -> Row:
        return Row(
            name, where, "meet", f"{1e3 * metres:.2f} mm apart", "fitted" if rests else INPUTS,
            agrees=bool(metres < CLOSED), judged=closed, rests=rests, note=note,
        )  # fmt: skip

    return [
        meets("tables III, V and VI meet, joint 1, as printed", "III, V, VI", gap(SIMPLE_HINGES[0], as_printed)),
        meets("tables III, V and VI meet, joint 1", "III, V, VI", gaps[0], ("y of link 1",)),
        meets("tables III, V and VI meet, joint 2", "III, V, VI", gaps[1]),
        meets("tables III, V and VI meet, joint 3", "III, V, VI", gaps[2],
              note="the model without rotors has no axes of its own that meet; readings `simple` take either side"),
        meets("tables IX, XI and XII meet, as printed", "IX, XI, XII", float(aside),
              note="Z of joint 2 on link 1 is printed 00.0576 in table XII"),
        meets("tables IX, XI and XII meet", "IX, XI, XII", whole, ("Z of joint 2 on link 1",)),
        Row("axes of tables XI and XII are those of table I", "I, XI, XII", "the same robot",
            f"{lean:.2f} deg, {beside:.1f} mm off", INPUTS, agrees=lean < 0.05, judged="0.05 deg, digits of XI and XII",
            rests=(), note="the drawn robot leans, and the one that the torques are computed for does not"),
        Row("torques of table VII act on the axes of tables V and VI", "V, VI, VII", "the same",
            f"{max(leans):.2f} deg off at TSDA {1 + int(np.argmax(leans))}", INPUTS, agrees=max(leans) < 1e-3,
            judged="exact", rests=(),
            note=f"0.207 for 0.2007, and without effect: the ideal arm misses by {results.tilted_torque:.3f} mm"),
        Row("torques of table XIII act on the axes of tables XI and XII", "XI, XII, XIII", "the same",
            "the same" if same else "not", INPUTS, agrees=same, judged="exact", rests=()),
        Row("mass of tables VIII's bodies, of table II's links", "II, VIII", masses[0], masses[1], INPUTS, "kg",
            within=half_digit(masses[0], 3), judged="half a digit of table II", rests=(),
            note="table II's is verified by weighing"),
        Row("counterbalances bring link 2's centre of mass to its joint", "3, III, IX", "closer to the joint",
            "{:.1f} and {:.1f} mm from its axis, by tables III and IX".format(*aside_2), INPUTS,
            agrees=max(aside_2) < 0.1 * 1e3 * PRINTED.upper, judged="assumed: a tenth of the link's length", rests=()),
    ]  # fmt: skip


def stiffness_rows() -> list[Row]:
    """Table IV, and the series that table X's first stiffness is."""
    young, shear = TABLE_MODULI
    found, ours = [], []
    for number, gear in enumerate(GEARS, 1):
        chosen = gear.width != gear.true_width
        moment = second_moment(gear.true_width, gear.thickness)
        if chosen:
            as_printed = second_moment(gear.width, gear.thickness)
            found.append(_iv(f"gear {number}: I with the printed width", gear.moment, as_printed, "mm4"))
        rests = ("width of gears 1 and 2",) if chosen else ()
        found.append(_iv(f"gear {number}: I", gear.moment, moment, "mm4", rests))
        ours.append(tooth_stiffness(gear.moment, gear.diameter, gear.length, young))
        text = 3.0 * tooth_stiffness(gear.moment, gear.diameter, gear.length, TEXT_MODULI[0])
        found.append(_iv(f"gear {number}: k of the text's cantilever", gear.stiffness, text))
        found.append(_iv(f"gear {number}: k", gear.stiffness, ours[-1], rests=("E", "third of a cantilever")))
    diameter, length, polar, stiffness = SHAFT
    found.append(_iv("shaft: J", polar, np.pi * diameter**4 / 32.0, "mm4"))
    found.append(_iv("shaft: k with the text's G", stiffness, shaft_stiffness(polar, length, TEXT_MODULI[1])))
    ours.append(shaft_stiffness(polar, length, shear))
    found.append(_iv("shaft: k", stiffness, ours[-1], rests=("G",)))
    printed = (*(gear.stiffness for gear in GEARS), stiffness)
    found.append(
        Row(
            "joint 1: all five in series", "table X", 488.0, in_series(printed), INPUTS, "N.m/rad",
            within=half_digit(488.0, 0), judged="half a printed digit", rests=(),
        )
    )  # fmt: skip
    return found


def _iv(name: str, printed: float, ours: float, unit: str = "N.m/rad", rests: tuple[str, ...] = ()) -> Row:
    return Row(
        name, "table IV", printed, ours, "fitted" if rests else INPUTS, unit, EXACT, judged=TABLE_IV, rests=rests
    )


def start_rows() -> list[Row]:
    """What the stretched start does to the trajectory: printed only as a spline that starts and ends at rest."""
    early = np.array([1e-2, 1e-4])
    quintic, septic = (np.abs(Line(way=way).joints(early)[2][:, 2]) for way in ("quintic", "septic"))
    times = np.linspace(1e-6, 5.0, 2001)
    largest = np.abs(Line().joints(times)[2][:, 2]).max()
    first = Line().joints(np.array([1e-6]))[2][0]
    torque = np.abs(inverse(Line(), np.linspace(1e-3, 4.999, 200))).max(axis=0)
    return [
        Row(
            "acceleration of joint 3 is finite at the start", "Fig. 12", "finite",
            f"septic: {largest:.2f} rad/s2; quintic: {quintic[0]:.0f} at 10 ms, {quintic[1]:.0f} at 0.1 ms",
            "fitted", agrees=bool(septic[1] < 1.5), judged="a bound", rests=("way",),
            note="the arm starts stretched. Largest torques on the septic way: "
            + f"{', '.join(f'{t:.3g}' for t in torque)} N.m",
        ),
        Row(
            "all velocities and accelerations start and end at rest", "4", "at rest",
            "tool at rest; joints start with " + ", ".join(f"{value:.2f}" for value in first) + " rad/s2", "predicted",
            agrees=bool(np.abs(first).max() < EXACT), judged="exact", rests=("way",),
            note="with a way of a higher power, all joints would start at rest, too",
        ),
    ]  # fmt: skip


def stiffness_study_rows(results: Results) -> list[Row]:
    """Section 5.1: springs between stator and rotor, and between rotor and link."""
    r = results
    low, high = (mark(STATOR, r.stator, level) for level in MARKS)
    springs = [mark(SPRING, r.spring, level) for level in MARKS]
    figure = "the paper's figure is not at hand: these are for reading it"
    limit, held = SOFTEST * min(STIFFNESS), r.parts["springs at the stator"].largest
    stiff, damped = float(r.spring[-1]), r.damping["joint1"][-1]
    turns = [float(np.degrees(np.ptp(angles))) for angles in (damped.links[:, 0], Line().joints(damped.time)[0][:, 0])]
    return [
        Row("a stiff spring makes rotor and link one", "2.1.3", "rigid", f"{stiff:.4f} mm at {SPRING[-1]:g} N.m/rad",
            "predicted", agrees=stiff < MARKS[0], judged="the paper's own mark of 1 mm", rests=OPEN_LOOP),
        Row("a high c_r holds its joint", "2.1.3", "no motion",
            f"{turns[0]:.2f} of {turns[1]:.0f} deg at {DAMPINGS[-1]:g} N.m.s/rad", "predicted",
            agrees=turns[0] < 0.01 * turns[1], judged="assumed: a hundredth", rests=(*OPEN_LOOP, "range of c_r")),
        Row("stator to rotor: stiffness at the 1 mm mark", "Fig. 18", "not printed", low, "predicted", "N.m/rad",
            rests=OPEN_LOOP, note=figure),
        Row("stator to rotor: 30 mm are passed at a very small stiffness", "5.1", "very small",
            f"{high:.2g} N.m/rad", "predicted", agrees=high < limit, judged="assumed: under a hundredth of 67 N.m/rad",
            rests=(*OPEN_LOOP, "softest real joint")),
        Row("springs as stiff as table X's are between rotor and link", "5.1", "only there",
            f"{r.parts['springs'].largest:.4f} mm", "predicted", agrees=r.parts["springs"].largest < MARKS[0],
            judged="the paper's own mark of 1 mm", rests=OPEN_LOOP,
            sensitivity=(Otherwise("the same between stator and rotor, holding the arm", f"{held:.0f} mm"),)),
        Row("rotor to link: stiffness at the 1 mm mark", "5.1", "not printed", springs[0], "predicted", "N.m/rad",
            rests=OPEN_LOOP),
        Row("rotor to link: stiffness at the 30 mm mark", "5.1", "not printed", springs[1], "predicted", "N.m/rad",
            rests=OPEN_LOOP),
    ]  # fmt: skip


def damping_study_rows(results: Results) -> list[Row]:
    """Section 5.2: what dampers do to the tool. The paper's values are not printed: rows say where they hold."""
    r = results
    rests = (*OPEN_LOOP, "range of c_r")
    largest = {name: np.array([motion.largest for motion in motions]) for name, motions in r.damping.items()}
    first, second, third = largest.values()
    ordered = (first > third) & (third > second)
    way = 1e3 * float(np.linalg.norm(np.subtract(TOOL[1], TOOL[0])))
    pairs = crossing_pairs(r.crossing)
    lowers = {base: [item.largest < row[0.0].largest for value, item in row.items() if value > 0.0]
              for base, row in r.third.items() if base == HIGHEST}  # fmt: skip
    by_joint = np.max(list(largest.values()), axis=0) > MAJOR * np.min(list(largest.values()), axis=0)
    by_value = sum(bool(values.max() > MAJOR * values.min()) for values in largest.values())
    best = min(r.third[HIGHEST].items(), key=lambda item: item[1].largest)
    alone = r.third[HIGHEST][0.0].largest
    found = [
        Row("effect of c_r1 over c_r3 over c_r2, of equal dampers", "5.2", ORDER,
            f"{extent(ordered, DAMPINGS)} N.m.s/rad", "predicted", rests=rests,
            note=f"there c_r1 makes the tool miss by {first[ordered].min():.0f} to {first[ordered].max():.0f} mm, on a "
            f"way of {way:.0f} mm. Below, c_r3 counts most"),
        Row("effect of a damper depends on its value and its joint", "5.2", "on both",
            f"over values, ten times in {by_value} of {len(largest)} joints; between joints, ten times at "
            f"{extent(by_joint, DAMPINGS)} N.m.s/rad", "predicted",
            agrees=True if by_value == len(largest) and by_joint.all() else None,
            judged="assumed: ten times, at every value", rests=rests),
        _ranged("c_r1 alone: the deviation grows all the way", "Fig. 19", "accumulatively",
                [bool(np.diff(motion.deviation).min() > -1e-6) for motion in r.damping["joint1"]], DAMPINGS, rests),
        _counted("c_r3 lowers the largest deviation beside the highest c_r1", "5.2", "lowers", lowers,
                 (*rests, "c_r beside"),
                 f"at most from {alone:.0f} to {best[1].largest:.0f} mm, by {best[0]:g}"),
        Row("curves cross at high c_r3", "Fig. 22c, 23", "stated",
            "; ".join(f"{low:g} and {high:g}" for low, high in pairs) or "none", "predicted",
            rests=(*OPEN_LOOP, "c_r beside"), agrees=None if pairs else False, judged="0.1 mm to both sides",
            note=f"of {', '.join(f'{value:g}' for value in BESIDE if value)} N.m.s/rad in joint 3 alone"),
        Row("one coordinate deviates much and another little, by c_r3", "Fig. 23", "stated",
            "; ".join(f"{value:g}: " + ", ".join(f"{mm:.0f}" for mm in by_axis(motion))
                      for value, motion in r.crossing.items() if value >= BASES[0]), "predicted", "mm",
            rests=(*OPEN_LOOP, "c_r beside"), note="largest deviation in x, y and z"),
    ]  # fmt: skip
    beside = (*OPEN_LOOP, "c_r beside")
    for name, by_base in r.changed.items():
        small = "relatively small" if name == "joint3" else "negligible"
        found.append(
            _ranged(f"{name}: a low c_r is {small} beside the others", "22a to c", small,
                    [_negligible(by_base[base], base) for base in BASES], BASES, beside,
                    f"a hundredth of the others changes the deviation by under {NEGLIGIBLE:.0%}, assumed")
        )  # fmt: skip
        if name != "joint3":
            closer = {base: _closer(by_base[base], base) for base in BASES}
            found.append(
                _counted(
                    f"{name}: a higher c_r brings the tool closer to its target", "22a, b", "closer", closer, beside
                )
            )
    everywhere = {base: _everywhere(r.changed["joint2"][base], base) for base in BASES}
    found.append(
        _counted(
            "a higher c_r2 lowers the deviation at all points of the line", "22b", "all points", everywhere, beside
        )
    )
    found.append(
        _ranged("the higher c_r3, the closer the tool follows", "22c", "the higher, the closer",
                [_monotone(r.changed["joint3"][base], base) for base in BASES], BASES, beside,
                "; ".join(f"beside {base:g} best at {_best(r.changed['joint3'][base]):g}" for base in BASES))
    )  # fmt: skip
    return found


def by_axis(motion: Motion) -> list[float]:
    """Largest deviation of the tool in x, y and z [mm]."""
    return [1e3 * float(value) for value in np.abs(motion.tool - motion.wanted).max(axis=0)]


def _negligible(motions: dict[float, Motion], base: float) -> bool:
    """Whether a damper of a hundredth of the others changes the deviation by less than :data:`NEGLIGIBLE`."""
    low = motions[min(motions, key=lambda value: abs(value - 0.01 * base))].largest
    return abs(low / motions[0.0].largest - 1.0) < NEGLIGIBLE


def _closer(motions: dict[float, Motion], base: float) -> list[bool]:
    """Whether each damper at least as high as the others brings the tool closer to where it should end."""
    return [bool(m.deviation[-1] < motions[0.0].deviation[-1]) for value, m in motions.items() if value >= base]


def _everywhere(motions: dict[float, Motion], base: float) -> list[bool]:
    """Whether each such damper lowers the deviation at all times at which it is over a tenth of a millimetre."""
    seen = motions[0.0].deviation > 1e-4
    return [bool((m.deviation <= motions[0.0].deviation)[seen].all()) for value, m in motions.items() if value >= base]


def _monotone(motions: dict[float, Motion], base: float) -> bool:
    """Whether the mean deviation falls with every higher damper, from the others' on."""
    means = [m.deviation.mean() for value, m in motions.items() if value >= base]
    return bool(np.all(np.diff(means) < 0.0))


def _best(motions: dict[float, Motion]) -> float:
    return min(motions, key=lambda value: motions[value].deviation.mean())


def extent(holds: Sequence[bool] | np.ndarray, values: Sequence[float] | np.ndarray) -> str:
    """Where a statement holds on a grid: in runs of neighbours, or everywhere, or nowhere."""
    holds = np.asarray(holds, dtype=bool)
    if holds.all() or not holds.any():
        return f"{'everywhere' if holds.all() else 'nowhere'} from {values[0]:.2g} to {values[-1]:.2g}"
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    runs = [(values[a], values[b - 1]) for a, b in edges.reshape(-1, 2)]
    return (
        ", ".join(f"{a:.2g}" if a == b else f"{a:.2g} to {b:.2g}" for a, b in runs)
        + f" ({holds.sum()} of {len(holds)})"
    )


def _ranged(
    name: str, where: str, printed: str, holds: Sequence[bool], values: Sequence[float] | np.ndarray,
    rests: tuple[str, ...], note: str = "",
) -> Row:  # fmt: skip
    """A statement without its values: it agrees if it holds for all of them."""
    return Row(name, where, printed, f"{extent(holds, values)} N.m.s/rad", "predicted", agrees=all(holds),
               judged="assumed: all of the range", rests=rests, note=note)  # fmt: skip


def _counted(
    name: str, where: str, printed: str, held: Mapping[float, Sequence[bool]], rests: tuple[str, ...], note: str = ""
) -> Row:
    """A statement whose values are not printed: it agrees if all values do, and is missed if none does."""
    counts = "; ".join(f"beside {base:g} with {sum(holds)} of {len(holds)}" for base, holds in held.items())
    every = [value for holds in held.values() for value in holds]
    return Row(name, where, printed, f"{counts} values", "predicted", agrees=all(every) if all(every) or not any(every)
               else None, judged="assumed: with every value", rests=rests, note=note)  # fmt: skip


def final_rows(results: Results) -> list[Row]:
    """Sections 5.3 and 6: the final model, by what the text leaves open."""
    r = results
    plain, motor = r.outcomes[PLAIN], r.outcomes["motor"]
    others = [o for o in r.outcomes.values() if o is not plain]
    off, sprung = r.final.largest, r.parts["springs"].largest
    _, linear, robust = r.controlled["table X"].values()
    (usual, quick), (slow, slowly) = r.spinning.items()
    falling = [name for name, o in r.outcomes.items() if o is not plain and o.opposite]
    return [
        Row(
            "the final model moves entirely unlike the ideal arm", "5.3", "entirely different", off, "predicted", "mm",
            agrees=off > LIKE * plain.way, judged=f"assumed: over {LIKE:.0%} of the way of {plain.way:.0f} mm",
            rests=FINAL_MODEL,
            note="5.3 and 6 also say that experiments are like the ideal arm, and agree with the final model: both "
            "cannot be. By that the miss is right, and a rigid arm would miss as well",
            sensitivity=(
                *(Otherwise(o.reading.text, o.motion.largest) for o in others),
                *(Otherwise(name, a) for name, (a, _, _) in r.varied.items()),
                *(Otherwise(f"torques smoothed by polynomials of degree {n}, perfect joints", v)
                  for n, v in r.smoothed.items()),
            ),
        ),
        Row(
            "dampers are a major source of error without a controller", "abstract, 6", "stated", off, "predicted", "mm",
            agrees=off > MARKS[0], judged=BY_SPRINGS, rests=FINAL_MODEL,
            sensitivity=(
                Otherwise("table X's springs alone", sprung),
                *(Otherwise(name, f"{b:.2f} mm of dampers, {c:.4f} mm of springs")
                  for name, (_, b, c) in r.varied.items()),
            ),
        ),
        Row(
            "dampers are a major source of error, beside the axes of tables XI and XII", "6", "stated",
            f"{plain.by_dampers:.2f} mm of dampers, {r.outcomes['axes'].perfect.largest:.0f} mm of axes", "predicted",
            agrees=plain.by_dampers > r.outcomes["axes"].perfect.largest, judged="the larger effect",
            rests=(*FINAL_MODEL, "tool on the axes of tables XI and XII"),
            sensitivity=(Otherwise("all c_r motor referred", f"{motor.by_dampers:.0f} mm of dampers"),),
        ),
        Row(
            "rotors that only spin [1, 2] limit a model to slow motions", "1", "to slow motions",
            f"{quick:.2f} mm in {usual:g} s, {slowly:.2f} mm in {slow:g} s", "predicted",
            agrees=quick > MARKS[0] > slowly, judged=BY_SPRINGS, rests=OPEN_LOOP,
            note="gyroscopic terms matter about as much as table X's dampers, at any speed: without gravity, torques "
            "grow with its square",
        ),
        Row(
            "the inverse model has several solutions", "5.3", "several",
            f"one: least eigenvalue of the mass matrix {r.least_inertia:.4f} kg.m2", "predicted",
            agrees=r.least_inertia <= 0.0, judged="one if it is positive", rests=OPEN_LOOP,
            note="but the angles Z-X-Z of (13) and table IX have theta = 0 at the start, where phi and psi are not "
            "unique. Whether that led the paper's program astray cannot be seen from its text",
        ),
        Row(
            "a feedback controller takes away the error that dampers cause", "abstract", "stated", robust, "predicted",
            "mm", agrees=robust < MARKS[0], judged=BY_SPRINGS, rests=(*FINAL_MODEL, "feedback"),
            sensitivity=(
                Otherwise("none", off), Otherwise("computed torque in place of a sliding mode", linear),
            ),
        ),
        Row(
            "order of table X's dampers by their effect", "5.2", ORDER, plain.order, "predicted",
            agrees=plain.order == ORDER, judged="exact", rests=FINAL_MODEL,
            sensitivity=tuple(Otherwise(o.reading.text, o.order) for o in others if any(o.reading.damping)),
        ),
        Row(
            "the tool's z goes the opposite way", "5.3", "opposite", _falls(plain.motion), "predicted",
            agrees=plain.opposite, judged=BY_SPRINGS, rests=FINAL_MODEL,
            sensitivity=tuple(Otherwise(o.reading.text, _falls(o.motion)) for o in others),
        ),
        Row(
            OPPOSITE, "5.3", "opposite", f"in {len(falling)} of {len(others)} readings: {'; '.join(falling)}", "fitted",
            agrees=bool(falling), judged=f"{BY_SPRINGS}, in any of them",
            rests=(*OPEN_LOOP, "readings", "other gears", "tool on the axes of tables XI and XII"),
            note="known beforehand: all of these readings were sought because the paper says so",
        ),
    ]  # fmt: skip


def _falls(motion: Motion) -> str:
    depth, since = fall(motion)
    return f"falls by {depth:.0f} mm from {since:.1f} s on" if depth > FALL else "rises"


def rows(results: Results) -> list[Row]:
    """All rows, in the order of the paper."""
    return [
        *kinematic_rows(),
        *axes_rows(results),
        *stiffness_rows(),
        *start_rows(),
        *stiffness_study_rows(results),
        *damping_study_rows(results),
        *final_rows(results),
    ]
