"""The comparison with the paper: runs its experiments, writes numbers and pictures."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ...actuators.errors import SealegsError
from . import balance, paper
from .controller import Gait
from .drive import DRIVES
from .parameters import NUMBERS, SIDES

SEED = 3
SHORTEST = 30.0  # [s] of a run that shows what an assumed number does: 40 hops


def compare(out: Path, seconds: float = SHORTEST, say: Callable[[str], None] = print) -> dict[str, Any]:
    """Run the paper's experiments, write ``biped.json`` and the figures into ``out``, and tell the results.

    Args:
        out: folder; made if it is not there.
        seconds: of each run that shows what an assumed number does [s]; at least 30 are taken. The hopping itself goes
            on for its 92 hops.
        say: prints a line.

    Raises:
        SealegsError: the folder has results already, or the time is none.
    """
    if not seconds > 0.0:
        raise SealegsError(f"seconds is {seconds:g}; it must be positive.")
    if (out / "biped.json").exists():
        raise SealegsError(f"{out} holds a comparison already; give another folder as out=.")
    out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(SEED)
    say(f"hopping {paper.HOPS} hops")
    stretched, rigid = paper.hop()
    if not len(rigid.time):
        raise SealegsError("the biped fell before the hops that are compared; its controller does not fit its numbers.")
    say("identifying the drives")
    identified = {name: paper.identify(name, stretched, rng) for name in DRIVES}
    say("standing on one leg, and balancing")
    springs = {side: paper.spring_test(side, rng) for side in SIDES}
    on_foot, hanging = balance.distances(rng)
    say("changing what was assumed")
    changes = paper.sensitivity(max(seconds, SHORTEST), say)
    result = {
        "printed": {name: asdict(drive) for name, drive in DRIVES.items()},
        "identified": {name: asdict(found) for name, found in identified.items()},
        "springs": {side: asdict(test.spring) for side, test in springs.items()},
        "balance": {"toe": on_foot.tolist(), "hip": hanging.tolist(), "printed": balance.PRINTED},
        "hopping": asdict(paper.measure(stretched)),
        "rigid_cables_from_hop_31": asdict(paper.measure(rigid)) | {"seconds": float(np.ptp(rigid.time))},
        "sensitivity": [asdict(change) for change in changes],
        "controller": asdict(Gait()),
        "numbers": {name: asdict(number) for name, number in NUMBERS.items()},
        "seed": SEED,
    }
    (out / "biped.json").write_text(json.dumps(_plain(result), indent=1, allow_nan=False) + "\n")
    from . import paper_plots  # matplotlib is slow to load

    paper_plots.plot_positions(stretched, rigid, out / "positions.png")
    paper_plots.plot_torques(stretched, rigid, out / "torques.png")
    paper_plots.plot_stretch(stretched, rigid, out / "stretch.png")
    paper_plots.plot_springs(springs, out / "springs.png")
    paper_plots.plot_balance(on_foot, hanging, out / "balance.png")
    for line in (
        *identification_table(identified),
        *experiments_table(springs, on_foot, hanging, stretched, rigid),
        *sensitivity_table(changes),
    ):
        say(line)
    say(f"Written: {out}/biped.json, positions.png, torques.png, stretch.png, springs.png, balance.png")
    return result


def identification_table(identified: Mapping[str, paper.Identified]) -> list[str]:
    """Identified beside printed values; the printed ones are what the virtual machine was built with."""
    rows: list[tuple[str, Callable[[Any], float], Callable[[paper.Identified], float]]] = []
    for step in range(3):
        rows.append((f"III  J_{step + 1} [1e-4 kg.m2]", *_pulley("lumped_inertia", "inertia", step, 1e4)))
        rows.append((f"III  mu_{step + 1} [1e-3 N.m.s]", *_pulley("lumped_friction", "friction", step, 1e3)))
    rows += [
        ("IV   alpha", lambda d: d.inertia_factor, lambda found: found.motor.factor),
        ("IV   K_T", lambda d: d.motor_constant, lambda found: found.motor.constant),
        ("IV   b [1e-3 N.m]", lambda d: 1e3 * d.bias, lambda found: 1e3 * found.pulleys[0].bias),
        ("V    mu [1e-3 N.m.s]", lambda d: 1e3 * d.leg_friction, lambda found: 1e3 * found.leg.friction),
        ("V    b [1e-3 N.m]", lambda d: 1e3 * d.leg_bias, lambda found: 1e3 * found.leg.bias),
        ("VI   K_C [N.m/rad]", lambda d: d.cable_stiffness, lambda found: found.cable.stiffness),
        ("VI   K_dC [N.m.s/rad]", lambda d: d.cable_damping, lambda found: found.cable.damping),
    ]
    lines = ["", f"{'table':<24}" + "".join(f"{name.replace('_', ' '):>26}" for name in identified)]
    lines.append(f"{'':<24}" + "printed  found    off  ".rjust(26) * len(identified))
    for label, printed, found in rows:
        cells = []
        for name, item in identified.items():
            true, ours = printed(DRIVES[name]), found(item)
            cells.append(f"{true:9.3f}{ours:9.3f}{ours / true - 1.0:+7.1%} ")
        lines.append(f"{label:<24}" + "".join(f"{cell:>26}" for cell in cells))
    return lines


def _pulley(printed: str, found: str, step: int, unit: float) -> tuple[Any, Any]:
    return (
        lambda drive: unit * getattr(drive, printed)[step],
        lambda item: unit * getattr(item.pulleys[step], found),
    )


def experiments_table(springs: Mapping[str, Any], on_foot: Any, hanging: Any, stretched: Any, rigid: Any) -> list[str]:
    """Spring, balance and hopping beside what is printed."""
    figures = paper.measure(stretched)
    worst = [1e3 * float(np.abs(values).max()) for values in (on_foot, hanging)]
    lines = ["", f"{'':<42}{'printed':>10}{'ours':>10}"]
    for side, test in springs.items():
        printed = DRIVES[f"{side}_leg_shape"].spring_stiffness
        lines.append(f"{side + ' spring by (24) [N.m/rad]':<42}{printed:>10.1f}{test.spring.stiffness:>10.1f}")
    lines += [
        f"{'centre of mass from the toe, at most [mm]':<42}{'6':>10}{worst[0]:>10.1f}",
        f"{'centre of mass from the hip, at most [mm]':<42}{'6':>10}{worst[1]:>10.1f}",
        f"{'hops without a fall':<42}{paper.HOPS:>10}{figures.hops:>10}",
        f"{'period of a hop [s]':<42}{'':>10}{figures.period:>10.3f}",
        f"{'spread of the period [%]':<42}{'':>10}{100.0 * figures.spread:>10.2f}",
        f"{'share of flight [%]':<42}{'':>10}{100.0 * figures.flight:>10.1f}",
        "",
        "without cable stretch, from the touchdown of hop 31 on: "
        + (f"a fall after {np.ptp(rigid.time):.2f} s" if rigid.fell else "both hops done"),
    ]
    return lines


def sensitivity_table(changes: list[paper.Change]) -> list[str]:
    """What other values of the assumed numbers do."""
    lines = [
        "",
        f"{'assumed number':<30}{'changed to':<26}{'hops':>6}{'fell':>6}{'period':>9}{'flight':>8}{'m/hop':>8}",
    ]
    for change in changes:
        figures = change.figures
        period = "-" if math.isnan(figures.period) else f"{figures.period:.3f}"
        fell = "yes" if figures.fell else ""
        lines.append(
            f"{change.name:<30}{change.value:<26}{figures.hops:>6}{fell:>6}{period:>9}"
            f"{figures.flight:>8.2f}{figures.travel:>8.2f}"
        )
    return [*lines, ""]


def _plain(value: Any) -> Any:
    """``value`` as JSON knows it: no tuples of NumPy, no nan."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
