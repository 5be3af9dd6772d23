"""The comparison with the paper: runs both cases, writes numbers and pictures."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...common.atomic import write_text
from ...common.errors import SealegsError
from ...envs.hopper.parameters import NUMBERS
from . import rows as printed_rows
from .choices import PAPER
from .paper import CHAINS, PRINTED, Legs, measure


def compare(out: Path, seconds: float = 10.0, say: Callable[[str], None] = print) -> dict[str, Any]:
    """Run the paper's experiment, write ``hopper.json``, ``time.png`` and ``periods.png`` into ``out``, and tell the
    result.

    Args:
        out: folder; made if it is not there.
        seconds: length of the run [s]; the paper's is 10.
        say: prints a line.

    Raises:
        SealegsError: the folder has results already, or the run is too short to measure hops.
    """
    if seconds < 4.0:
        raise SealegsError(f"seconds is {seconds:g}; at least 4 are needed, because the first two are left out.")
    if (out / "hopper.json").exists():
        raise SealegsError(f"{out} holds a comparison already; give another folder as out=.")
    out.mkdir(parents=True, exist_ok=True)
    found = printed_rows.run(seconds, say)
    rows = printed_rows.rows(found)
    result = {
        **PAPER.document(rows),
        "printed": {name: asdict(printed) for name, printed in PRINTED.items()},
        "simulated": {name: asdict(measure(hops)) for name, hops in found.cases.items()},
        "real_time_factor": found.speed,
        "chains": {name: Legs(chain).chain.to_list() for name, chain in CHAINS.items()},
        "controller": asdict(Legs("ideal").controller),
        "numbers": {name: asdict(number) for name, number in NUMBERS.items()},
        "seconds": seconds,
    }
    write_text(out / "hopper.json", json.dumps(result, indent=1) + "\n", replace=True)
    from .paper_plots import plot_periods, plot_time  # matplotlib is slow to load

    plot_time(found.cases, out / "time.png")
    plot_periods(found.cases, out / "periods.png")
    for line in PAPER.lines(rows):
        say(line)
    say(f"Written: {out}/hopper.json, {out}/time.png, {out}/periods.png")
    return result
