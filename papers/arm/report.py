"""The comparison with the paper: runs its experiments, writes numbers and pictures."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...common.atomic import write_text
from ...common.errors import SealegsError
from ...envs.arm.parameters import NUMBERS
from ...envs.arm.tables import JOINTS
from . import paper
from .axes import beside_table_one, printed_axes
from .choices import PAPER
from .control import Robust
from .readings import LIKE, gear_ratio, late_rise, reading_lines, statements, summary
from .rows import rows


def compare(out: Path, seconds: float = 5.0, say: Callable[[str], None] = print) -> dict[str, Any]:
    """Run the paper's experiments, write ``arm.json`` and four pictures into ``out``, and tell the results.

    Args:
        out: folder; made if it is not there.
        seconds: must be positive; the paper's motion takes its 5 s whatever is asked for.
        say: prints a line.

    Raises:
        SealegsError: the folder has results already, or the time is none.
    """
    if not seconds > 0.0:
        raise SealegsError(f"seconds is {seconds:g}; it must be positive.")
    if (out / "arm.json").exists():
        raise SealegsError(f"{out} holds a comparison already; give another folder as out=.")
    out.mkdir(parents=True, exist_ok=True)
    results = paper.run(say)
    found = rows(results)
    tables = {
        "readings": reading_lines(results.outcomes),
        "damping": damping_table(results),
        "controllers": controller_table(results),
    }
    document = {
        **PAPER.document(found),
        "tables": {name: "\n".join(lines).rstrip() for name, lines in tables.items()},
        "figures": {
            "ratio": gear_ratio(),
            "counts": gear_ratio() ** 2,
            "lean": beside_table_one(printed_axes())[0],
            "wanted": late_rise(results.outcomes["plain"].motion)[1],
            "ideal": 1e3 * results.ideal,
            "like": 100.0 * LIKE,
            "steps": ", ".join(f"{mm:.3f} mm at {ms} ms" for ms, mm in results.steps.items()),
        },
        "readings": {name: summary(item) for name, item in results.outcomes.items()},
        "statements": statements(results.outcomes),
        "stator_stiffness": {"N.m/rad": paper.STATOR.tolist(), "mm": results.stator.tolist()},
        "link_stiffness": {"N.m/rad": paper.SPRING.tolist(), "mm": results.spring.tolist()},
        "damping": {"N.m.s/rad": paper.DAMPINGS.tolist()}
        | {name: [motion.largest for motion in motions] for name, motions in results.damping.items()},
        "beside_the_highest": {f"{value:g}": m.largest for value, m in results.third[paper.HIGHEST].items()},
        "smoothed_torques": results.smoothed,
        "controllers": results.controlled,
        "robust": asdict(Robust()),
        "numbers": {name: asdict(number) for name, number in NUMBERS.items()},
    }
    write_text(out / "arm.json", json.dumps(document, indent=1) + "\n", replace=True)
    from . import paper_plots  # matplotlib is slow to load

    paper_plots.plot_trajectory(out / "trajectory.png")
    paper_plots.plot_stiffness(results, out / "stiffness.png")
    paper_plots.plot_damping(results, out / "damping.png")
    paper_plots.plot_tool(results, out / "tool.png")
    for line in (*PAPER.lines(found), *(line for lines in tables.values() for line in lines)):
        say(line)
    say(f"Written: {out}/arm.json, trajectory.png, stiffness.png, damping.png, tool.png")
    return document


def damping_table(results: paper.Results) -> list[str]:
    """Largest deviation of the tool by damping of one joint alone."""
    lines = ["largest deviation of the tool [mm], a damper in one joint alone", f"{'c_r [N.m.s/rad]':>16}"]
    lines[1] += "".join(f"{name:>10}" for name in JOINTS)
    for k, value in enumerate(paper.DAMPINGS):
        lines.append(f"{value:16.2g}" + "".join(f"{results.damping[name][k].largest:10.3g}" for name in JOINTS))
    return [*lines, ""]


def controller_table(results: paper.Results) -> list[str]:
    """Largest error of the tool by arm and controller."""
    names = list(next(iter(results.controlled.values())))
    lines = ["largest error of the tool [mm]  " + "".join(f"{name:>18}" for name in names)]
    for arm, errors in results.controlled.items():
        lines.append(f"  {arm:<30}" + "".join(f"{errors[name]:18.3g}" for name in names))
    return [*lines, ""]
