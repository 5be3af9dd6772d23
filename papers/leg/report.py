"""The comparison with paper 000: its tables, its analysis of relevant dynamics, and its control, beside ours."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...common.atomic import write_text
from ...common.errors import SealegsError
from ...envs.leg.parameters import NUMBERS
from ...envs.leg.robot import chains_of
from .choices import PAPER
from .paper import FIGURE_7, LINES, OWN_SPEED, SEEDS, SPEEDS, Analysis, against_engine, draws
from .rows import (
    actuator_rows,
    coriolis_rows,
    crossing,
    gearing_rows,
    mechanical_rows,
    share_lines,
    shares,
    speed_rows,
    swept,
)
from .table_rows import equation_rows, motor_rows, table_rows
from .tracking import IDEAL, PID, control_rows, controllers, search_lines, search_on, tracking_lines
from .tuning import OTHER_SECONDS, other_paths

DRAWN_AT = (FIGURE_7, OWN_SPEED)  # [m/s] speeds at which the lines are drawn again
EVALUATIONS = 140  # of the search that goes on from the PID's gains


def compare(out: Path, seconds: float = 3.0, say: Callable[[str], None] = print) -> dict[str, Any]:
    """Compare; write ``leg.json`` and pictures into ``out``, and tell the result.

    Args:
        out: folder; made if it is not there.
        seconds: that each path is followed by the controllers [s], 3 at most.
        say: prints a line.

    Raises:
        SealegsError: the folder has results already, or the time is too short.
    """
    if seconds < 1.0:
        raise SealegsError(f"seconds is {seconds:g}; at least 1 is needed for a path to turn round.")
    if (out / "leg.json").exists():
        raise SealegsError(f"{out} holds a comparison already; give another folder as out=.")
    out.mkdir(parents=True, exist_ok=True)
    analysis = Analysis()
    say(f"contributions along {LINES} horizontal lines of the foot at {len(SPEEDS)} speeds")
    lines = analysis.lines(LINES, horizontal=True)
    found = {speed: [analysis.along(line, speed) for line in lines] for speed in SPEEDS}
    sweeps = [swept(speed, rows) for speed, rows in found.items()]
    own = found[OWN_SPEED]
    say(f"{SEEDS} draws of the lines")
    by_seed = {speed: draws(analysis, speed, LINES, SEEDS) for speed in DRAWN_AT}
    slanted = draws(analysis, OWN_SPEED, LINES, SEEDS, horizontal=False)
    say("symbols beside MuJoCo")
    gaps = against_engine()
    followed = min(seconds, OTHER_SECONDS)
    say(f"controllers on {len(other_paths())} paths")
    tracking = controllers(analysis, followed)
    say(f"{EVALUATIONS} more simulations of the search for the PID")
    search = search_on(analysis, EVALUATIONS)
    rows = [
        *table_rows(),
        *motor_rows(),
        *equation_rows(analysis, gaps),
        *speed_rows(analysis),
        *gearing_rows(found, by_seed[OWN_SPEED], slanted),
        *coriolis_rows(sweeps, by_seed, slanted),
        *mechanical_rows(own),
        *actuator_rows(analysis, own, sweeps),
        *control_rows(tracking),
    ]
    tables = {
        "shares": share_lines(own),
        "tracking": tracking_lines(tracking),
        "search": search_lines(search, EVALUATIONS),
    }
    result = {
        **PAPER.document(rows),
        "tables": {name: "\n".join(text).rstrip() for name, text in tables.items()},
        "figures": {
            "crossing": crossing(sweeps),
            "ideal": tracking[IDEAL]["rms"] / tracking[PID]["rms"],
            "beyond": tracking[PID]["beyond"],
            "paths": len(other_paths()),
            "followed": followed,
        },
        "sweep": [asdict(sweep) for sweep in sweeps],
        "worst_by_seed": {f"{speed:g}": [draw.error for draw in drawn] for speed, drawn in by_seed.items()},
        "shares_of_the_motor_torque": {f"{speed:g}": shares(items) for speed, items in found.items()},
        "symbols_beside_mujoco": gaps,
        "tracking_m": tracking,
        "search_m": search,
        "numbers": {name: asdict(number) for name, number in NUMBERS.items()},
        "chains": {name: chain.to_list() for name, chain in chains_of("silo4").items()},
    }
    write_text(out / "leg.json", json.dumps(result, indent=1) + "\n", replace=True)
    from . import paper_plots  # matplotlib is slow to load

    names = paper_plots.draw(analysis, found, sweeps, out)
    for line in [*PAPER.lines(rows), *(line for text in tables.values() for line in text)]:
        say(line)
    say(f"Written: {out}/leg.json, " + ", ".join(f"{out}/{name}" for name in names))
    return result
