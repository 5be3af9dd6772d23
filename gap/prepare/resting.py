"""Stretches in which a robot rests on what its model lacks, or touches the scene that its model has, are left out of
what is judged, and said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..load.resting import Resting, find_resting
from ..load.robot import Machine
from ..log.finding import MAX_TOLD, Finding
from ..log.parts import cut
from ..log.progress import Progress
from ..log.types import MeasuredRun
from ..replay.scene import Touch, touches_of
from ..search.forward import NUMERICAL
from ..search.structure import listed

TOUCHES = "robot.touches"
"""Code of the finding that the robot touches the scene of its own file."""
RESTS = "robot.rests"
"""Code of the finding that the robot rests on something level."""
MIN_JUDGED_SHARE = 0.4  # of what is judged of a joint, that must be left without the contacts


def without_rests(
    machine: Machine, progress: Progress = lambda text: None, test_group: str | None = None
) -> tuple[Machine, list[Finding]]:
    """The runs of a robot with its contacts marked at the joints that carry what touches, and what is said of them.

    Args:
        machine: in the model's frames.
        progress: is told what is found.
        test_group: group of runs that is kept for the test.

    Raises:
        LogError: there is no such group.
    """
    robot, runs = machine.robot, machine.runs
    if robot is None or robot.file.base == "free":
        return machine, []
    if (touches := [touches_of(robot, run) for run in runs]) and any(touches):
        marked, told = _off_scene(runs, touches, progress, test_group)
        return Machine.of(marked), told
    try:
        resting = find_resting(robot, runs)
    except NUMERICAL as error:
        said = f"Whether the robot rests on something could not be told ({type(error).__name__}: {error})."
        return machine, [Finding("robot.rests_fault", "warning", None, None, said)]
    if resting is None:
        return machine, []
    marked = [_marked(run, resting) for run in runs]
    enough = all(_enough(runs, marked, joint, test_group) for joint in resting.joints)
    finding = _finding(resting, runs, left_out=enough)
    progress(finding.sentence)
    return Machine.of(marked) if enough else machine, [finding]


def _off_scene(
    runs: Sequence[MeasuredRun], touches: Sequence[Touch | None], progress: Progress, test_group: str | None
) -> tuple[Sequence[MeasuredRun], list[Finding]]:
    """The runs without their contacts with the robot's own scene; joints of which too little is left are held."""
    joints = dict.fromkeys(name for touch in touches if touch for name, own in touch.joints.items() if own.any())
    marked = [run if touch is None else _with(run, touch.joints) for run, touch in zip(runs, touches, strict=True)]
    left = [joint for joint in joints if _enough(runs, marked, joint, test_group)]
    for joint in joints:
        if joint not in left:  # marked throughout: its link is moved as measured
            marked = [_with(run, {joint: np.ones(len(run.time))}) for run in marked]
    seconds = sum(
        run.period * float(np.max(list(touch.joints.values()), axis=0).sum())
        for run, touch in zip(runs, touches, strict=True) if touch
    )  # fmt: skip
    part = next(touch.part for touch in touches if touch)
    done = [f"These stretches are left out at {listed(left)}."] if left else []
    if held := [joint for joint in joints if joint not in left]:
        done.append(f"Too little is left of {listed(held)}, whose links are moved as measured.")
    sentence = (
        f"The robot touches what stands still in its own model, such as a floor or the end of a tendon, for "
        f"{seconds:.3g} s ('{part}' most), and joints are replayed without contacts. {' '.join(done)} Record in the "
        "air, or remove what is not there."
    )
    progress(sentence)
    return marked, [Finding(TOUCHES, "warning", None, None, sentence, value=seconds)]


def _with(run: MeasuredRun, touched: Mapping[str, np.ndarray]) -> MeasuredRun:
    marks = {name: replace(run.joints[name], touched=own) for name, own in touched.items() if name in run.joints}
    return replace(run, joints={**run.joints, **marks})


def _marked(run: MeasuredRun, resting: Resting) -> MeasuredRun:
    spans = resting.stretches.get(run.name, ())
    touched = np.zeros(len(run.time))
    for a, b in spans:
        touched[(run.time >= a) & (run.time <= b)] = 1.0
    if not touched.any():
        return run
    return _with(run, dict.fromkeys(resting.joints, touched))


def _enough(runs: Sequence[MeasuredRun], marked: Sequence[MeasuredRun], joint: str, test_group: str | None) -> bool:
    """Whether what is left of a joint without the contacts is enough in each part of the data."""
    if any(joint not in run.joints for run in runs):
        return True  # it is not diagnosed
    before, after = (_judged(each, joint, test_group) for each in (runs, marked))
    return all(after.get(part, 0.0) >= MIN_JUDGED_SHARE * seconds for part, seconds in before.items())


def _judged(runs: Sequence[MeasuredRun], joint: str, test_group: str | None) -> dict[int, float]:
    """How much is judged of a joint in each part [s]."""
    lengths: dict[int, float] = {}
    for unit in cut(runs, joint, test_group):
        time = runs[unit.run].time
        length = float(time[unit.stop - 1] - time[min(unit.start + unit.judged, unit.stop - 1)])
        lengths[unit.part] = lengths.get(unit.part, 0.0) + length
    return lengths


def _finding(resting: Resting, runs: Sequence[MeasuredRun], *, left_out: bool) -> Finding:
    every = [(run.name, a, b) for run in runs for a, b in resting.stretches.get(run.name, ())]
    said = "; ".join(f"{name} {a:.1f} to {b:.1f} s" for name, a, b in every[:MAX_TOLD])
    more = f"; and {len(every) - MAX_TOLD} more" if len(every) > MAX_TOLD else ""
    done = f"These stretches are left out at {listed(resting.joints)}."
    if not left_out:
        done = (
            "Without these stretches too little would be left, so they are judged: what is found of "
            f"{listed(resting.joints)} may be the surface. Record with goals above it."
        )
    return Finding(
        RESTS, "warning", None, None,
        f"Something level that the model lacks, such as a table, holds the robot up for {resting.seconds:.3g} s "
        f"({said}{more}): {resting.body} rests at {resting.height:.3f} m in the model's frame, though goals go "
        f"{1e3 * resting.deeper:.0f} mm deeper, and joints that carry it are pushed. {done} Keep goals above that "
        "height, or add the surface to the model before you train on it.",
        value=resting.height,
    )  # fmt: skip
