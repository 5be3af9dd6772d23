"""The comparison with the paper: runs its experiments, writes numbers and pictures."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ...common.atomic import write_text
from ...common.errors import SealegsError
from ...envs.biped.drive import DRIVES
from ...envs.biped.parameters import NUMBERS, SIDES
from ..published import Mark, Otherwise, Row, documents, row_lines
from . import balance, paper, validation
from .controller import Gait

SEED = 3
PLANTED: Mark = "planted and recovered"
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
    further, validated = validation.validate(stretched, rng, say)
    say("changing what was assumed")
    changes = paper.sensitivity(max(seconds, SHORTEST), say)
    worst = [1e3 * float(np.abs(values).max()) for values in (on_foot, hanging)]
    printed = [*rows(identified, springs, worst, stretched, changes), *further]
    result = {
        "rows": documents(printed),
        "printed": {name: asdict(drive) for name, drive in DRIVES.items()},
        "identified": {name: asdict(found) for name, found in identified.items()},
        "springs": {side: asdict(test.spring) for side, test in springs.items()},
        "balance": {"toe": on_foot.tolist(), "hip": hanging.tolist(), "printed": balance.PRINTED},
        "validation": validated,
        "hopping": asdict(paper.measure(stretched)),
        "rigid_cables_from_hop_31": asdict(paper.measure(rigid)) | {"seconds": float(np.ptp(rigid.time))},
        "sensitivity": [asdict(change) for change in changes],
        "controller": asdict(Gait()),
        "numbers": {name: asdict(number) for name, number in NUMBERS.items()},
        "seed": SEED,
    }
    write_text(out / "biped.json", json.dumps(_plain(result), indent=1, allow_nan=False) + "\n", replace=True)
    from . import paper_plots  # matplotlib is slow to load

    paper_plots.plot_positions(stretched, rigid, out / "positions.png")
    paper_plots.plot_torques(stretched, rigid, out / "torques.png")
    paper_plots.plot_stretch(stretched, rigid, out / "stretch.png")
    paper_plots.plot_springs(springs, out / "springs.png")
    paper_plots.plot_balance(on_foot, hanging, out / "balance.png")
    for line in (
        *row_lines("paper 003", printed),
        *hopping_lines(stretched, rigid),
        *sensitivity_table(changes),
    ):
        say(line)
    say(f"Written: {out}/biped.json, positions.png, torques.png, stretch.png, springs.png, balance.png")
    return result


Quantity = tuple[str, str, Callable[[Any], float], Callable[[paper.Identified], float]]


def identified_quantities() -> list[Quantity]:
    """Table, name with unit, and how to read the printed and the found value of each identified quantity."""
    found: list[Quantity] = []
    for step in range(3):
        found.append(("III", f"J_{step + 1} [1e-4 kg.m2]", *_pulley("lumped_inertia", "inertia", step, 1e4)))
        found.append(("III", f"mu_{step + 1} [1e-3 N.m.s]", *_pulley("lumped_friction", "friction", step, 1e3)))
    return [
        *found,
        ("IV", "alpha", lambda d: d.inertia_factor, lambda found: found.motor.factor),
        ("IV", "K_T", lambda d: d.motor_constant, lambda found: found.motor.constant),
        ("IV", "b [1e-3 N.m]", lambda d: 1e3 * d.bias, lambda found: 1e3 * found.pulleys[0].bias),
        ("V", "mu [1e-3 N.m.s]", lambda d: 1e3 * d.leg_friction, lambda found: 1e3 * found.leg.friction),
        ("V", "b [1e-3 N.m]", lambda d: 1e3 * d.leg_bias, lambda found: 1e3 * found.leg.bias),
        ("VI", "K_C [N.m/rad]", lambda d: d.cable_stiffness, lambda found: found.cable.stiffness),
        ("VI", "K_dC [N.m.s/rad]", lambda d: d.cable_damping, lambda found: found.cable.damping),
    ]


def _pulley(printed: str, found: str, step: int, unit: float) -> tuple[Any, Any]:
    return (
        lambda drive: unit * getattr(drive, printed)[step],
        lambda item: unit * getattr(item.pulleys[step], found),
    )


def rows(
    identified: Mapping[str, paper.Identified],
    springs: Mapping[str, paper.SpringTest],
    worst: Sequence[float],
    stretched: Any,
    changes: Sequence[paper.Change],
) -> list[Row]:
    """What the paper prints beside ours, the identification of each drive first.

    Args:
        identified: by drive.
        springs: by side.
        worst: largest distance of the centre of mass from toe and hip [mm].
        stretched: recording of the hops.
        changes: what other values of assumed numbers do.
    """
    found = [
        Row(f"{name.replace('_', ' ')}: {label}", f"table {table}", printed(DRIVES[name]), ours(item), PLANTED)
        for table, label, printed, ours in identified_quantities()
        for name, item in identified.items()
    ]
    for side, test in springs.items():
        printed = DRIVES[f"{side}_leg_shape"].spring_stiffness
        found.append(Row(f"{side} spring by (24)", "Fig. 19", printed, test.spring.stiffness, PLANTED, "N.m/rad", 0.05))
    for place, value in zip(("toe", "hip"), worst, strict=True):
        found.append(
            Row(
                f"centre of mass from the {place}, at most", "Fig. 17", 6.0, value, "fitted", "mm", agrees=value <= 6.0,
                note="fingertips of at most 3 N.m, assumed, cannot leave more than 5.3 mm" if place == "toe" else "",
            )
        )  # fmt: skip
    figures = paper.measure(stretched)
    found.append(
        Row(
            "hops without a fall", "VIII-D", float(paper.HOPS), float(figures.hops), "fitted", within=0.0,
            note="gains and lean are not printed; they were searched for hopping that lasts",
        )
    )  # fmt: skip
    if still := [change for change in changes if change.name.startswith("K_Tor")]:
        hops = still[0].figures
        found.append(
            Row(
                "without the update of the lean", "VII", "unstable",
                f"falls after {hops.hops} hops" if hops.fell else f"{hops.hops} hops", "predicted", agrees=hops.fell,
                sensitivity=tuple(
                    Otherwise(change.value, f"{change.figures.hops} hops{', fell' if change.figures.fell else ''}")
                    for change in changes
                    if change.name == paper.WITHOUT_UPDATE
                ),
            )
        )  # fmt: skip
    if rigid := [change.figures for change in changes if change.name == "cables"]:
        hops = rigid[0]
        found.append(
            Row(
                "a controller tuned on rigid cables, on cables that stretch", "VIII-D", "five hops",
                f"tuned on stretching cables, on rigid ones: {hops.hops} hops{', then a fall' if hops.fell else ''}",
                "predicted", note="the other way round: no controller here was tuned on rigid cables",
            )
        )  # fmt: skip
    return found


def hopping_lines(stretched: Any, rigid: Any) -> list[str]:
    """What the paper prints no figure of: how it hops here."""
    figures = paper.measure(stretched)
    return [
        f"{'period of a hop [s]':<42}{figures.period:>10.3f}",
        f"{'spread of the period [%]':<42}{100.0 * figures.spread:>10.2f}",
        f"{'flight and retraction, by the controller [%]':<46}{100.0 * figures.flight:>6.1f}",
        f"{'both soles off the floor [%]':<42}{100.0 * validation.soles_off(stretched):>10.1f}",
        "",
        "the same controller on rigid cables, from the touchdown of hop 31 on: "
        + (f"a fall after {np.ptp(rigid.time):.2f} s" if rigid.fell else "both hops done"),
    ]


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
