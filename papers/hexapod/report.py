"""The comparison with the paper: runs its experiments, writes numbers and pictures beside the printed statements."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ...common.atomic import write_text
from ...common.errors import SealegsError
from ...envs.hexapod.gait import SPEED, Tripod
from ...envs.hexapod.parameters import NUMBERS
from ...envs.hexapod.robot import FRICTIONS, HORIZONTAL, KINDS, VERTICAL
from . import experiments, rows
from .choices import PAPER
from .measures import motors
from .paper import BREAKAWAY_AT_REST, WALKING, Walk, chains_with, friction_at_rest, limit_by_speed


def compare(out: Path, seconds: float = 10.0, say: Callable[[str], None] = print) -> dict[str, Any]:
    """Run the paper's experiments; write ``hexapod.json`` and six pictures into ``out``, and tell the result.

    Args:
        out: folder; made if it is not there.
        seconds: that the robot stands with its motors at 0 V [s]; the gait takes the cycles that it needs.
        say: prints a line.

    Raises:
        SealegsError: the folder has results already, or the time is too short to sink in.
    """
    if seconds < 1.0:
        raise SealegsError(f"seconds is {seconds:g}; at least 1 is needed for a robot to sink visibly.")
    if (out / "hexapod.json").exists():
        raise SealegsError(f"{out} holds a comparison already; give another folder as out=.")
    out.mkdir(parents=True, exist_ok=True)
    found = experiments.run(seconds, say)
    standing, walks, resistance = found.standing, found.walks, found.resistance
    printed = rows.rows(found)
    result = {
        **PAPER.document(printed),
        "page_tables": experiments.page_tables(found),
        "identified_friction": {name: np.asarray(value).tolist() for name, value in asdict(found.identified).items()},
        "sinking_m": {name: row.sinking for name, row in standing.items()},
        "penetration_m": found.depth,
        "motors_of_leg_0": {name: motors(walk) for name, walk in walks.items()},
        "specific_resistance": {
            name: {f"{v:g}": value for v, value in row.items()} for name, row in resistance.items()
        },
        "shares_in_transfer_and_support": {name: walk.shares() for name, walk in walks.items()},
        "gait": asdict(Tripod()),
        "chains": {
            name: {
                joint: chain.to_list()
                for joint, chain in chains_with(name, WALKING).items()
                if joint.startswith("leg0")
            }
            for name in FRICTIONS
        },
        "breakaway_at_rest_N": BREAKAWAY_AT_REST,
        "numbers": {name: asdict(number) for name, number in NUMBERS.items()},
        "seconds": seconds,
    }
    write_text(out / "hexapod.json", json.dumps(result, indent=1) + "\n", replace=True)
    from . import paper_plots  # matplotlib is slow to load

    paper_plots.plot_standing(standing, out / "height.png")
    paper_plots.plot_friction(standing["LuGre"], out / "friction.png")
    limit = limit_by_speed(friction_at_rest(), standing["LuGre"].speed)
    paper_plots.plot_limit(standing["LuGre"], limit, out / "limit.png")
    paper_plots.plot_motors(walks, VERTICAL, out / "vertical.png")
    paper_plots.plot_motors(walks, HORIZONTAL, out / "horizontal.png")
    paper_plots.plot_resistance(resistance, out / "resistance.png")
    for line in (*PAPER.lines(printed), *table(walks, resistance)):
        say(line)
    pictures = ("height", "friction", "limit", "vertical", "horizontal", "resistance")
    names = ("hexapod.json", *(f"{name}.png" for name in pictures))
    say("Written: " + ", ".join(f"{out}/{name}" for name in names))
    return result


def table(walks: Mapping[str, Walk], resistance: Mapping[str, Mapping[float, float]]) -> list[str]:
    """Currents, voltages and specific resistances as lines of text."""
    lines = ["motors of leg 0, root mean square    " + "".join(f"{name:>15s}" for name in walks)]
    measured = {name: motors(walk) for name, walk in walks.items()}
    for quantity in next(iter(measured.values())):
        unit = "A" if quantity.endswith("current") else "V"
        for part in ("transfer", "support"):
            values = "".join(f"{row[quantity][part]:15.2f}" for row in measured.values())
            lines.append(f"{quantity + ', ' + part:33s} [{unit}] {values}")
    lines.append("specific resistance")
    for speed in next(iter(resistance.values())):
        lines.append(
            f"  at {100 * speed:4.2f} cm/s{'':23s}" + "".join(f"{row[speed]:15.2f}" for row in resistance.values())
        )
    lines.append(f"of that, at {100 * SPEED:g} cm/s")
    shares = [walk.shares() for walk in walks.values()]
    for kind in KINDS:
        for k, part in enumerate(("transfer", "support")):
            lines.append(f"  {f'{kind}, {part}':35s}" + "".join(f"{row[kind][k]:15.2f}" for row in shares))
    return [*lines, ""]
