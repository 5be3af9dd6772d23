"""The model that one motion of a public arm gave, on its seven other motions: ``python -m benchmarks.other_motions``.

Five joints of the SO-101 arm are diagnosed on its chirp alone. Each is then replayed along all other motions, which
nothing was fitted to, with the nominal chain and with what was found. Reads ``../shared/data`` (``data=`` another
folder), takes some six minutes on two cores, and writes ``benchmarks/results/other_motions.{json,md}``.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from sealegs.common.markdown import page, table
from sealegs.gap.causes.unknown import with_believed_load
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.load.robot import Machine
from sealegs.gap.log.types import MeasuredRun
from sealegs.gap.prepare.checking import check_log
from sealegs.gap.prepare.pieces import cut_joint
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.problem import converged

from benchmarks.kept import DATA, study, write
from benchmarks.robot_logs import SO101_JOINTS, so101

JOINTS = SO101_JOINTS[:5]
"""Those of the arm; the gripper is logged as a share of its range."""
FITTED = "chirp_sweep"


def replayed(runs: list[MeasuredRun], joint: str) -> FreeProblem:
    """A joint along these runs, as its file and its chain believe it to be."""
    pieces = cut_joint(Machine.of(runs), joint, None)
    found = free_problem(
        pieces.runs, joint, pieces.models, pieces.units, {"position": 1.0 / pieces.noise}, pieces.terms
    )
    return converged(found)


def errors(problem: FreeProblem, values: Mapping[str, float], motions: list[str]) -> dict[str, float]:
    """Rms error of the position in each motion [rad]."""
    error = problem.errors(problem.simulate([values])[0])[:, 0] ** 2
    ends = list(zip(problem.units, problem.starts[:-1], problem.starts[1:], strict=True))
    squares = {
        motion: np.concatenate([error[a:b] for unit, a, b in ends if unit.run == k]) for k, motion in enumerate(motions)
    }
    return {motion: float(np.sqrt(np.nanmean(square))) for motion, square in squares.items()}


def told(rows: list[dict[str, Any]]) -> str:
    """The results as Markdown."""
    motions = list(rows[0]["nominal"])
    cells = (
        (row["joint"], *(f"{1e3 * row['nominal'][m]:.1f} to {1e3 * row['found'][m]:.1f}" for m in motions),
         ", ".join(row["causes"]))
        for row in rows
    )  # fmt: skip
    pairs = [(row["nominal"][m], row["found"][m]) for row in rows for m in motions if m != FITTED]
    better = sum(found < nominal for nominal, found in pairs)
    factor = float(np.median([nominal / max(found, 1e-9) for nominal, found in pairs]))
    of = f"Of {len(pairs)} joints and motions that nothing was fitted to, {better} are better"
    return page(
        "One motion's model on the others (`python -m benchmarks.other_motions`)",
        f"Rms error of the free replay [mrad], nominal to found. What was found is of `{FITTED}` alone; nothing was "
        "fitted to the other motions.",
        table(("joint", *motions, "named"), cells),
        f"{of}; in the median by a factor of {factor:.1f}.",
    )


@study
def main() -> None:
    """Diagnose on one motion, judge on the others, and write the page."""
    asked = dict(word.split("=", 1) for word in sys.argv[1:])
    data = Path(asked.get("data", DATA))
    motions = sorted(path.stem for path in (data / "so101_arm").glob("*.parquet"))
    if FITTED not in motions:
        raise SystemExit(f"{data} does not hold the arm's motions: give the folder of the data as data=<folder>.")
    found = diagnose(so101(data, data, (FITTED,)), workers=None, only=JOINTS, progress=print)
    logs, _, _ = check_log(so101(data, data, motions), lambda text: None)
    runs = [with_believed_load(run) for run in logs.runs]
    rows: list[dict[str, Any]] = []
    for joint in found:
        problem = replayed(runs, joint.joint)
        rows.append({
            "joint": joint.joint,
            "causes": [cause.name for cause in joint.causes],
            "nominal": errors(problem, {}, motions),
            "found": errors(problem, joint.values, motions),
        })  # fmt: skip
    write("other_motions", told(rows), rows)
    print(told(rows))


if __name__ == "__main__":
    sys.exit(main())
