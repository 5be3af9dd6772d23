"""Zeros and directions of a robot's log: what fits far better than the model's is taken for the diagnosis, and said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..load.robot import Frame, LoggedRobot, robot_of
from ..log.finding import Finding
from ..log.progress import Progress
from ..log.types import MeasuredRun
from ..replay.frames import Proposed, proposed_frames
from ..replay.joint_model import JointModel
from ..replay.unlogged import logged, needed
from ..search.forward import NUMERICAL
from .columns import commanded
from .pieces import chain_of, nominal_replays

HALVED = 0.5  # of the mean squared error of one joint's nominal replay, to which frames must bring it to be taken
ASKED = 0.8  # of the error with plainer frames, to which others must bring it to be preferred


def in_likely_frames(runs: Sequence[MeasuredRun], progress: Progress) -> tuple[Sequence[MeasuredRun], list[Finding]]:
    """The runs of a robot with the frames that its torques and its replay ask for, and what is to be said of frames.

    Frames that the sidecar gives are doubted, and kept.
    """
    robot = robot_of(runs[0])
    if robot is None or robot.file.base == "free":
        return runs, []
    if needed(robot, range(robot.model.njnt), logged(robot, runs)):  # their torque would be looked for in the frames
        return runs, []
    progress("comparing zeros and directions of log and model")
    models = {joint: JointModel(chain_of(runs[0], joint, robot)) for joint in commanded(runs)}
    try:
        proposed = proposed_frames(robot, runs, models)
        if proposed is None:
            return runs, []
        silent = [_unknown(proposed.silent)] if proposed.silent else []
        if not proposed.frames:
            return runs, silent
        before = _missed(runs)
        proposed, turned, after = _as_replayed(runs, robot, proposed)
    except (*NUMERICAL, ValueError, LookupError) as error:
        said = (
            f"Zeros and directions could not be compared ({type(error).__name__}: {error}); the model's are believed."
        )
        return runs, [Finding("robot.frame_fault", "warning", None, None, said)]
    better = any(after[joint] ** 2 < HALVED * before[joint] ** 2 for joint in before if joint in after)
    taken = better and _together(after) < _together(before) and not any(run.meta.get("frames") for run in runs)
    doubt = _taken(proposed, _together(before), _together(after)) if taken else _doubted(proposed)
    progress(doubt.sentence)  # whoever sees it may stop and mend it
    return (turned if taken else runs), [doubt, *silent]


def _as_replayed(
    runs: Sequence[MeasuredRun], robot: LoggedRobot, proposed: Proposed
) -> tuple[Proposed, Sequence[MeasuredRun], dict[str, float]]:
    """The plainer frames, unless the nominal replay asks for the others; the runs with them, and what is missed."""
    plain = _in_frames(runs, robot, proposed.plainer)
    missed = _missed(plain)
    if proposed.plainer != proposed.frames:
        other = _in_frames(runs, robot, proposed.frames)
        less = _missed(other)
        if not _together(less) > ASKED * _together(missed):
            return proposed, other, less
    return replace(proposed, frames=proposed.plainer), plain, missed


def _in_frames(runs: Sequence[MeasuredRun], robot: LoggedRobot, frames: Mapping[str, Frame]) -> tuple[MeasuredRun, ...]:
    every = {**robot.frames, **frames}
    said = {name: {"zero": frame.zero, "direction": int(frame.sign)} for name, frame in every.items()}
    return tuple(replace(run, meta={**run.meta, "frames": said}) for run in runs)


def _missed(runs: Sequence[MeasuredRun]) -> dict[str, float]:
    """Error of each hinge of the nominal robot that is replayed alone, root of the mean square [rad]."""
    robot = robot_of(runs[0])
    if robot is None:
        return {}
    return {
        joint: float(np.sqrt(np.mean(problem.position_error(problem.simulate([{}])[0]) ** 2)))
        for joint, problem in nominal_replays(robot, runs).items()
        if not robot.slides(joint)
    }


def _together(errors: Mapping[str, float]) -> float:
    """Of all joints, root of the mean square [rad]."""
    return float(np.sqrt(np.mean(np.square(list(errors.values()))))) if errors else np.nan


def _said(frames: Mapping[str, Frame]) -> str:
    return "; ".join(
        f"{name}: {{zero: {frame.zero:.3g}, direction: {frame.sign:.0f}}}" for name, frame in frames.items()
    )


def _image(proposed: Proposed) -> str:
    if not proposed.mirrored:
        return ""
    return (
        f" An arm and its mirror image need the same torques: {' and '.join(proposed.mirrored)} turned around instead "
        "would fit as well."
    )


def _taken(proposed: Proposed, before: float, after: float) -> Finding:
    return Finding(
        "robot.frame", "warning", None, None,
        f"The angles of log and model do not match: the nominal robot misses the log by {1e3 * before:.3g} mrad rms, "
        f"and by {1e3 * after:.3g} with {_said(proposed.frames)}. These zeros and directions are taken here; check "
        f"them, and write what is right into the sidecar under meta: frames.{_image(proposed)}",
        value=proposed.left - proposed.least,
    )  # fmt: skip


def _doubted(proposed: Proposed) -> Finding:
    return Finding(
        "robot.frame", "warning", None, None,
        f"The drives' torque fits the model's gravity and coupling badly ({proposed.left:.0%} is left over), and "
        f"better with other zeros or directions ({proposed.least:.0%}), for instance {_said(proposed.frames)}. Check "
        "how the angles of log and model stand to each other, and write what is right into the sidecar under meta: "
        f"frames.{_image(proposed)}",
        value=proposed.left - proposed.least,
    )  # fmt: skip


def _unknown(names: Sequence[str]) -> Finding:
    return Finding(
        "robot.frame_unknown", "note", None, None,
        f"Neither gravity nor coupling tells the zero of {', '.join(names)}: the model's is believed.",
    )  # fmt: skip
