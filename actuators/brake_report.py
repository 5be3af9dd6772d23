"""What a brake bench characterisation leaves behind: table, fit, chain and picture."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from ..common.atomic import write_text
from ..common.errors import SealegsError
from ..common.extras import needed_for
from .brake_bench import BenchTable
from .chain import GIVING, Chain
from .regression_fit import EQUATION_3, RPM, RegressionFit, misses, usable, write_table
from .stages import Quantity
from .stages.controller import PositionP
from .stages.motor import Regression
from .stages.power import DutyLimit

BEHIND = (*GIVING, "encoder")


def chain_from(fit: RegressionFit, table: BenchTable, measured: Chain | None, gain: float, armature: float) -> Chain:
    """The measured chain with everything between duty and output shaft replaced by the regression.

    Args:
        fit: the regression, in which friction is contained.
        table: what it was fitted to; its largest duty becomes the limit.
        measured: chain that was on the virtual bench; None for a real one, which becomes a position controller.
        gain: of that controller [1/rad].
        armature: rotor inertia at the output of a real servo [kg.m2].
    """
    inertia = armature if measured is None else measured.armature()
    numbers = {key: float(f"{getattr(fit, key):.6g}") for key in ("duty_torque", "speed_torque", "constant")}
    stage = Regression(**numbers, armature=inertia)
    if measured is None:
        limit = DutyLimit(limit=float(np.max(np.abs(table.duty[table.valid]))))
        return Chain((PositionP(gain=gain), limit, stage), "characterised")
    command = [item for item in measured.stages if measured.quantity_before(item) == Quantity.POSITION_GOAL]
    # what else acts on a duty was on the bench, so the map contains it; but a line knows no end
    limit = [item for item in measured.stages if item.name == "duty_limit"]
    behind = [item for item in measured.stages if item.name in BEHIND]
    return Chain((*command, *limit, stage, *behind), "characterised")


def report(out: Path, table: BenchTable, fit: RegressionFit, chain: Chain, label: str) -> None:
    """Write table.csv, fit.json, chain.yaml and fit.png into a new folder, and print the fit beside equation (3).

    Raises:
        SealegsError: the folder exists already, or matplotlib is missing.
    """
    try:
        out.mkdir(parents=True)
    except FileExistsError:
        raise SealegsError(f"{out} exists already and nothing is overwritten; give another folder with out=.") from None
    write_table(table, out / "table.csv")
    kept, off = usable(table), misses(table, fit)
    coefficients = {key: getattr(fit, key) for key in ("duty_torque", "speed_torque", "constant")}
    document = {
        "actuator": label,
        "measurements": len(table),
        "invalid": int(np.sum(~table.valid)),
        "outliers": int(np.sum(table.valid & ~kept)),
        "points": fit.points,
        **coefficients,
        "units": {"duty_torque": "N.m", "speed_torque": "N.m.s/rad", "constant": "N.m", "rms": "N.m"},
        "rms": fit.rms,
        "r2": fit.r2,
        "rms_where": {name: value for name, value in off.items() if np.isfinite(value)},
        "equation_3": {
            key: {"printed": getattr(EQUATION_3, key), "ratio": value / getattr(EQUATION_3, key)}
            for key, value in coefficients.items()
        },
    }
    write_text(out / "fit.json", json.dumps(document, indent=1) + "\n")
    head = f"# Regression of '{label}' from {fit.points} brake bench measurements; friction is contained in it.\n"
    write_text(out / "chain.yaml", head + chain.to_yaml())
    print(f"{label}: {len(table)} measurements, {document['invalid']} stalled, {document['outliers']} outliers dropped")
    print(
        f"fit           torque [N.mm] = {fit.printed()}   (PWM, n [rpm]; rms {1e3 * fit.rms:.1f} N.mm, R2 {fit.r2:.4f})"
    )
    where = ", ".join(f"{name}: {1e3 * value:.1f}" for name, value in off.items() if np.isfinite(value))
    print(f"the line misses by, rms [N.mm]: {where}")
    print(f"equation (3)  torque [N.mm] = {EQUATION_3.printed()}")
    draw(table, fit, out / "fit.png", label)
    print(f"Written: {out}/chain.yaml, table.csv, fit.json, fit.png")
    print(f"Train with it: sealegs train actuator={out}/chain.yaml")


def draw(table: BenchTable, fit: RegressionFit, path: Path, label: str) -> None:
    """Torque over speed coloured by PWM with a line each, and measured over predicted torque, as in Fig. 4.

    Raises:
        SealegsError: matplotlib is missing.
    """
    with needed_for("A picture"):
        from matplotlib.figure import Figure
    kept = usable(table)
    rows, dropped = table.where(kept), table.where(table.valid & ~kept)
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    lines, plane = figure.subplots(1, 2)
    colour = {"c": rows.duty, "cmap": "coolwarm", "vmin": -1.0, "vmax": 1.0, "s": 6, "linewidths": 0}
    points = lines.scatter(rows.speed / RPM, 1e3 * rows.torque, **colour)
    lines.scatter(dropped.speed / RPM, 1e3 * dropped.torque, c="0.6", s=8, marker="x", linewidths=0.7, label="dropped")
    for duty in np.unique(rows.duty):
        mine = rows.where(rows.duty == duty)
        if len(mine) > 3 and np.ptp(mine.speed) > 0.0:
            line = np.polynomial.Polynomial.fit(mine.speed, mine.torque, 1)
            ends = np.array([mine.speed.min(), mine.speed.max()])
            lines.plot(ends / RPM, 1e3 * line(ends), color=points.to_rgba(duty), linewidth=0.8)
    lines.set(xlabel="speed n [rpm]", ylabel="torque [N.mm]", title="A: measurements and a line per PWM")
    lines.legend(loc="best", frameon=False, fontsize=8)
    predicted = fit.torque(rows.duty, rows.speed)
    plane.scatter(1e3 * predicted, 1e3 * rows.torque, **colour)
    reach = 1e3 * np.array([predicted.min(), predicted.max()])
    plane.plot(reach, reach, color="black", linewidth=0.8)
    plane.set(
        xlabel="predicted torque [N.mm]",
        ylabel="measured torque [N.mm]",
        title=f"B: {fit.printed()}  (R2 {fit.r2:.4f})",
    )
    for axes in (lines, plane):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    figure.colorbar(points, ax=[lines, plane], label="PWM", shrink=0.9)
    figure.suptitle(f"Brake bench: {label}")
    figure.savefig(path, dpi=140)
