"""What an import puts a joint to, against the range that the model of its robot has."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from ....envs.described.robot_file import is_robot_file, load_robot_file
from ..types import Array, LogError, MeasuredRun
from .expression import column
from .lines import ASK
from .positions import PERCENT
from .proposal import Proposal
from .recording import Recording

POSITIONS = ("position", "goal", "link_position")
HALF_TURN = math.pi
"""[rad] by which a hinge may lie beyond its range: an unknown zero turns a joint by no more."""
OUTER = 0.01
"""Share of the samples at either end that may be misread."""


def ranges_of(robot: str | None, out: Path) -> dict[str, tuple[float, float, str]]:
    """Lower and upper end [rad or m] and kind of each joint that a robot's file gives a range; none without a file.

    Args:
        robot: path of the file, or another word.
        out: folder of the logs.
    """
    path = _file(robot, out)
    if path is None:
        return {}
    found = load_robot_file(path)
    ranges = {name: (*joint.range, joint.kind) for name, joint in found.model.joints.items() if joint.range}
    own = dict(ranges)
    for joint in found.joints:
        own.pop(joint.name, None)  # of a belt over several joints there is none
        name, factor = joint.terms[0]
        if len(joint.terms) == 1 and name in ranges:
            low, high = sorted(factor * end for end in ranges[name][:2])
            own[joint.name] = (low, high, joint.kind)
    return own


def _file(robot: str | None, out: Path) -> Path | None:
    if robot is None or not is_robot_file(robot):
        return None
    return next((path for path in (Path(robot), out / robot) if os.path.isfile(path)), None)


def check_shares(proposal: Proposal, robot: str | None, out: Path) -> None:
    """Refuse a share of a range that nobody says.

    Raises:
        LogError: no robot's file is given, or it has no range for a joint that is in percent.
    """
    shares = [name.rpartition(".")[0] for name, read in proposal.columns.items() if read.unit == PERCENT]
    if not shares:
        return
    path = _file(robot, out)
    if path is None:
        raise LogError(
            f"unit={PERCENT} is of the range that a joint has in the model of its robot, and no robot's file is given: "
            f"add robot=my_arm.yaml, or write low + <column>/100*(high - low) for {shares[0]} in the mapping."
        )
    known = ranges_of(robot, out)
    model = load_robot_file(path)
    for joint in shares:
        if joint in {*model.model.joints, *(item.name for item in model.joints)} and joint not in known:
            raise LogError(
                f"unit={PERCENT}: {model.model.path.name} gives the joint '{joint}' no range that it could be a share "
                "of; add one there, or write low + <column>/100*(high - low) in the mapping."
            )


def far_in_proposal(
    proposal: Proposal, recordings: Sequence[Recording], robot: str | None, out: Path
) -> tuple[str, ...]:
    """A sentence for each column that a proposal puts far outside its joint's range."""
    ranges = ranges_of(robot, out)
    sure = {name: one for name, one in proposal.columns.items() if one.trust != ASK and one.unit != PERCENT}
    read = {name: one for name, one in sure.items() if _joint(name, ranges)}
    return _far(
        (
            (name, column(one.text, run.known_names(), str(run.source), run.length))
            for run in recordings
            for name, one in read.items()
        ),
        ranges,
        robot,
    )


def far_in_runs(runs: Sequence[MeasuredRun], robot: str | None, out: Path) -> tuple[str, ...]:
    """A sentence for each column that an import put far outside its joint's range."""
    robot = os.path.normpath(out / robot) if robot and is_robot_file(robot) else robot  # out need not exist yet
    ranges = ranges_of(robot, out)
    return _far(
        (
            (name, values)
            for run in runs
            for name, values in run.columns().items()
            if _joint(name, ranges) and (run.meta.get("units") or {}).get(name, "rad") in ("rad", "m")
        ),
        ranges,
        robot,
    )


def _joint(name: str, ranges: Mapping[str, object]) -> str:
    joint, _, signal = name.rpartition(".")
    return joint if signal in POSITIONS and joint in ranges else ""


def _far(
    columns: Iterable[tuple[str, Array]], ranges: Mapping[str, tuple[float, float, str]], robot: str | None
) -> tuple[str, ...]:
    said: dict[str, str] = {}
    for name, values in columns:
        finite = values[np.isfinite(values)]
        if not len(finite) or name in said:
            continue
        low, high, kind = ranges[_joint(name, ranges)]
        least, most = (float(np.quantile(finite, share)) for share in (OUTER, 1.0 - OUTER))
        beyond, unit = (HALF_TURN, "rad") if kind == "hinge" else (high - low, "m")
        if least < low - beyond or most > high + beyond:
            file = Path(robot or "").name
            said[name] = (
                f"{name} goes from {least:.3g} to {most:.3g} {unit}, far outside the range that {file} gives the "
                f"joint, {low:.3g} to {high:.3g} {unit}; correct its unit or its zero in its line"
            )
    return tuple(said.values())
