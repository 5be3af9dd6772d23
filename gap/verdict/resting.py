"""Stretches in which a robot rests on what its model lacks are left out of what is judged, and said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..load.resting import Resting, find_resting
from ..load.robot import robot_of
from ..log.finding import Finding
from ..log.progress import Progress
from ..log.types import MeasuredRun
from ..search.structure import listed

RESTS = "robot.rests"
"""Code of the finding that the robot rests on something level."""
MOST = 0.6  # share of a run beyond which leaving contacts out would leave too little of it
LISTED = 4  # contacts that are said with their times


def without_rests(
    runs: Sequence[MeasuredRun], progress: Progress = lambda text: None
) -> tuple[Sequence[MeasuredRun], list[Finding]]:
    """The runs of a robot with its contacts marked at the joints that they push, and what is said of them.

    Args:
        runs: of one machine, in the model's frames.
        progress: is told what is found.
    """
    robot = robot_of(runs[0])
    if robot is None or robot.file.base == "free":
        return runs, []
    resting = find_resting(robot, runs)
    if resting is None:
        return runs, []
    marked = [_marked(run, resting) for run in runs]
    finding = _finding(resting, runs)
    progress(finding.sentence)
    return marked, [finding]


def _marked(run: MeasuredRun, resting: Resting) -> MeasuredRun:
    spans = resting.stretches.get(run.name, ())
    touched = np.any([(run.time >= a) & (run.time <= b) for a, b in spans], axis=0) if spans else np.zeros(1, bool)
    if not touched.any() or touched.mean() > MOST:
        return run
    joints = {
        name: replace(log, touched=touched.astype(float)) if name in resting.joints else log
        for name, log in run.joints.items()
    }
    return replace(run, joints=joints)


def _finding(resting: Resting, runs: Sequence[MeasuredRun]) -> Finding:
    every = [(run.name, a, b) for run in runs for a, b in resting.stretches.get(run.name, ())]
    said = "; ".join(f"{name} {a:.1f} to {b:.1f} s" for name, a, b in every[:LISTED])
    more = f"; and {len(every) - LISTED} more" if len(every) > LISTED else ""
    return Finding(
        RESTS, "warning", None, None,
        f"Something level that the model lacks, such as a table, holds the robot up for {resting.seconds:.3g} s "
        f"({said}{more}): {resting.body} comes no lower than {resting.height:.3f} m in the model's frame, though goals "
        f"go {1e3 * resting.deeper:.0f} mm deeper, and {listed(resting.joints)} are pushed. These stretches are left "
        "out at those joints. Keep goals above that height, or add the surface to the model before you train on it.",
        value=resting.height,
    )  # fmt: skip
