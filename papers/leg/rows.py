"""Statements of paper 000 beside ours, each with its mark: the analysis along lines of the foot (2, 4.3 and 4.4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...envs.leg.kinematics import lengthening
from ...envs.leg.robot import JOINTS
from ..published import Otherwise, Row, half_digit
from .choices import MEASURE, ROUTE, SIGN, WORST
from .dynamics import gravity
from .paper import (
    LINES,
    OWN_SPEED,
    RULE,
    Analysis,
    Contributions,
    Draw,
    by_efficiency,
    coriolis_error,
    fastest,
    linear,
    own_shares,
    peak,
    straightness,
    supply_volts,
)

OTHER_SUPPLIES = (0.5, 2.0)  # times the assumed one
FAST_LINES = 30
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
        of_slick: the same without friction (3,).
        own: largest Coriolis torque over the joint's own perturbation: median, 95 % and most of the lines (3, 3).
    """

    speed: float
    worst: float
    usual: float
    friction: tuple[float, ...]
    turned: float
    of_motor: tuple[float, ...]
    of_slick: tuple[float, ...]
    own: tuple[tuple[float, ...], ...]


def swept(speed: float, rows: Sequence[Contributions]) -> Sweep:
    """Figures of one speed."""
    off = np.array([coriolis_error(row) for row in rows])
    friction = np.median([peak(row.friction) / peak(row.inertia) for row in rows], axis=0)
    turned = np.median([peak(row.perturbation)[0] / peak(row.inertia)[0] for row in rows])
    of_motor, of_slick = (
        np.max([peak(row.coriolis) / peak(torque) for row, torque in torques], axis=0)
        for torques in ([(row, row.total) for row in rows], [(row, row.slick) for row in rows])
    )
    own = np.quantile(own_shares(rows), (0.5, 0.95, 1.0), axis=0)
    return Sweep(
        speed=speed,
        worst=float(off.max()),
        usual=float(np.quantile(off, 0.95)),
        friction=tuple(friction.tolist()),
        turned=float(turned),
        of_motor=tuple(of_motor.tolist()),
        of_slick=tuple(of_slick.tolist()),
        own=tuple(tuple(row) for row in own.T.tolist()),
    )


# --- section 4.3.1: the mechanical part ------------------------------------------------------------------------------


def coriolis_rows(
    sweeps: Sequence[Sweep], by_seed: Mapping[float, Sequence[Draw]], slanted: Sequence[Draw]
) -> list[Row]:
    """What leaving out Coriolis costs: beside the whole perturbation, each joint's own, and the motor's torque."""
    at = _own(sweeps)
    level = 0.042
    errors = {speed: _least_to_most([draw.error for draw in found]) for speed, found in by_seed.items()}
    first = next(iter(errors))
    reached = [draw.error for draw in by_seed[first]]
    rows = [
        Row(
            WORST, "4.3.1, 7", f"{level:.1%}", f"{errors[first]} at {first:g} m/s", "fitted",
            agrees=min(reached) <= level <= max(reached), judged="between the draws", rests=(*ROUTE, MEASURE),
            sensitivity=(
                *(Otherwise(f"the foot at {speed:g} m/s at most", text)
                  for speed, text in errors.items() if speed != first),
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
                    for row in sweeps if row.speed != at.speed and j > 0
                ),
                note="both grow with the square of the speed, so that it is the same at any" if j == 0 else "",
            )
        )  # fmt: skip
    for j, name in enumerate(JOINTS):
        rows.append(
            Row(
                f"Coriolis over the motor's torque, {name}", "3, 4.3.1", "under 5 %",
                _held([draw.of_motor[j] for draw in by_seed[OWN_SPEED]]), "predicted",
                agrees=all(draw.of_motor[j] < RULE for draw in by_seed[OWN_SPEED]),
                judged="the paper's 5 %, on every line of every draw", rests=ROUTE,
                sensitivity=(
                    *(Otherwise(f"the first draw, {row.speed:g} m/s", f"most {row.of_motor[j]:.1%}")
                      for row in sweeps if row.speed >= at.speed),
                    Otherwise("lines in any direction", _held([draw.of_motor[j] for draw in slanted])),
                ),
                rival=Otherwise("the same leg without friction", f"most {at.of_slick[j]:.1%}", at.of_slick[j] < RULE),
            )
        )  # fmt: skip
    return rows


def speed_at(sweeps: Sequence[Sweep], level: float, usual: bool) -> float:
    """Highest speed of the foot at which leaving out Coriolis costs ``level`` [m/s]; it grows with the square."""
    values = [sweep.usual if usual else sweep.worst for sweep in sweeps]
    return float(np.exp(np.interp(np.log(level), np.log(values), np.log([sweep.speed for sweep in sweeps]))))


def crossing(sweeps: Sequence[Sweep]) -> float:
    """Highest speed of the foot at which Coriolis reaches the paper's rule of the motor's torque in joint 1 [m/s]."""
    return float(np.interp(RULE, [sweep.of_motor[0] for sweep in sweeps], [sweep.speed for sweep in sweeps]))


def spread(values: Sequence[float] | np.ndarray) -> str:
    """Median, 95 % and most of shares over the lines."""
    median, usual, most = np.quantile(values, (0.5, 0.95, 1.0))
    return f"median {median:.1%}, 95 % under {usual:.1%}, most {most:.1%}"


def gearing_rows(
    by_speed: Mapping[float, Sequence[Contributions]], drawn: Sequence[Draw], slanted: Sequence[Draw]
) -> list[Row]:
    """What the gears do to coupling and friction (2.2, 2.3), and which joints are coupled (4.4)."""
    found = by_speed[OWN_SPEED]
    coupled = {speed: np.max([peak(row.coupled) / peak(row.total) for row in rows], axis=0)
               for speed, rows in by_speed.items()}  # fmt: skip
    bare = np.max([peak(row.coupled) / peak(row.slick - row.rotor) for row in found], axis=0)
    static = np.array([peak(row.friction - row.sliding) / peak(row.friction) for row in found])
    smooth = np.array([peak(by_efficiency(row)) / peak(row.friction) for row in found])
    others = np.array([peak(row.by_others) / peak(row.total) for row in found])
    whole = np.max([peak(row.perturbation) / peak(row.total) for row in found], axis=0)
    level, slant = ([float(draw.coupled.max()) for draw in some] for some in (drawn, slanted))
    rows = [
        Row(
            "high reduction decouples the joints: torque of other joints' motion, over the motor's", "2",
            "can be neglected", f"horizontal: {_held(level)}; in any direction: {_held(slant)}", "predicted",
            agrees=max(*level, *slant) < RULE, judged="the paper's 5 %, on every line of every draw", rests=ROUTE,
            sensitivity=(
                *(Otherwise(f"the first draw, {speed:g} m/s", _of_joints(most))
                  for speed, most in coupled.items() if speed >= OWN_SPEED),
                Otherwise("the first draw without gears: neither rotors nor friction", _of_joints(bare)),
            ),
            note="inertia off the diagonal, and Coriolis; gravity, which couples joints 2 and 3, is not in it",
        ),
        Row(
            "with high reduction the perturbation can be neglected: over the motor's torque", "2.3",
            "could be neglected", _of_joints(whole), "predicted", agrees=bool(whole.max() < RULE),
            judged="the paper's 5 %, on every line", rests=ROUTE,
        ),
        Row(
            "static and meshing friction dominate in high gears: their share of (16)", "2.2", "dominant",
            _of_joints(static.max(axis=0)), "predicted", agrees=bool((static.max(axis=0) > 0.5).any()),
            judged="over half of the friction, on any line", rests=ROUTE,
        ),
        Row(
            "efficiencies (6) are not precise enough: their friction over that of (16)", "2.2", "not precise",
            _of_joints(smooth.max(axis=0)), "predicted", agrees=bool(smooth.max() < 0.5),
            judged="assumed: under half, on every line", rests=ROUTE,
        ),
    ]  # fmt: skip
    for j, name in enumerate(JOINTS):
        most = float(others[:, j].max())
        rows.append(
            Row(
                f"torque of {name} that other joints change, over the motor's", "4.4",
                "coupled" if j else "independent", spread(others[:, j]), "predicted",
                agrees=(most > RULE) if j else (most < RULE), judged="the paper's 5 %, on the worst line", rests=ROUTE,
                note="beside the same joint moving alone, gravity included" if j == 0 else "",
            )
        )  # fmt: skip
    return rows


def _least_to_most(values: Sequence[float]) -> str:
    return f"{min(values):.1%} to {max(values):.1%}"


def _held(most: Sequence[float]) -> str:
    """In how many draws the worst line keeps the paper's rule, and the range of that worst."""
    kept = sum(value < RULE for value in most)
    return f"under {RULE:.0%} in {kept} of {len(most)} draws, most {_least_to_most(most)}"


def _of_joints(most: np.ndarray) -> str:
    return "most " + ", ".join(f"{value:.1%}" for value in most)


def mechanical_rows(found: Sequence[Contributions]) -> list[Row]:
    """What moves the links: inertia in joint 1, and in joints 2 and 3 less of it than of gravity."""
    medians = {part: np.median([peak(getattr(row, part)) for row in found], axis=0) for part in MECHANICAL}
    beside = np.array([peak(row.constant + row.varying)[1:] / peak(row.gravity)[1:] for row in found])
    rows = [
        Row(
            f"inertia over gravity, {name}", "4.3.1", "secondary", spread(share), "predicted",
            agrees=bool(share.max() < 1.0), judged="the smaller one, on every line", rests=ROUTE,
        )
        for name, share in zip(JOINTS[1:], beside.T, strict=True)
    ]  # fmt: skip
    parts = {part: float(values[0]) for part, values in medians.items()}
    told = "inertia" if _most(parts) in ("constant", "varying") else _most(parts)
    first = Row(
        f"largest torque of the links at {JOINTS[0]}", "4.3.1", "inertia", told, "predicted", agrees=told == "inertia",
        judged="exact", rests=ROUTE,
        note=", ".join(f"{part} {value:.3f}" for part, value in parts.items()) + " N.m (medians)",
    )  # fmt: skip
    return [first, *rows]


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
    first = np.array([peak(row.perturbation)[0] / peak(row.total)[0] for row in found])
    varying = np.array([np.ptp(row.perturbation, axis=0) / peak(row.total) for row in found])
    rows = [
        Row(
            "perturbation of joint 1 over its inertia", "4.3.2, 10a", "under 0.005", float(np.median(turned)),
            "predicted", agrees=max(turned) < 0.005, judged="the printed limit, on every line", rests=ROUTE,
            note=f"contradicts tables I and V: median of {LINES} lines, {min(turned):.1%} to {max(turned):.0%}, at any "
            "speed, because both grow with its square; D_11 less h is as large as J_m N^2",
        ),
        Row(
            "perturbation of joint 1 over the motor's torque", "4.3.2, 9", "almost negligible",
            f"median {np.median(first):.1%}, most {first.max():.1%}; under {RULE:.0%} on {np.mean(first < RULE):.0%}",
            "predicted", agrees=bool(first.max() < RULE), judged="the paper's 5 %, on every line", rests=ROUTE,
        ),
    ]  # fmt: skip
    for j in (1, 2):
        rows.append(
            Row(
                f"perturbation of joint {j + 1} is constant: its change over the motor's torque", "4.3.2, 9",
                "constant, on the example line",
                f"under {RULE:.0%} on {np.mean(varying[:, j] < RULE):.0%} of the lines", "predicted", rests=ROUTE,
                note="the example line is not printed" if j == 1 else "",
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
                judged="half a printed digit; the voltage is assumed", rests=(SIGN, "lines of the foot", "supply"),
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
