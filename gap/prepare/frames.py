"""Zeros and directions of a robot's log: a joint that counts the other way round is turned for the diagnosis, and said.

A direction that is wrong shows in gravity, coupling and replay like nothing else. A zero alone does not: a centre of
mass that lies elsewhere looks the same, so it is taken only where the log leaves the model's range otherwise.

A slide is only turned around. One that leaves the range otherwise is asked before the hinges, the others after them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..causes.catalogue import adjustable, catalogue
from ..checks.signal import OTHER_ERROR_RATIO
from ..load.robot import Frame, LoggedRobot, Machine
from ..log.finding import Finding
from ..log.parts import held_out
from ..log.progress import Progress
from ..log.types import MeasuredRun
from ..replay.frames import Compared, Proposed, compare_frames, stays
from ..replay.free import FreeProblem, free_problem
from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter
from ..replay.slide_directions import Directions, compare_slides
from ..replay.tree import axis_of, logged, needed
from ..search.fit import fit, merge
from ..search.forward import NUMERICAL
from ..search.settings import DEFAULT
from ..search.structure import listed
from .columns import commanded
from .pieces import chain_of, cut_joint, nominal_replays

ALIKE_ERROR_RATIO = 1.2  # times an error up to which another is as good: at other joints, in any run
ZERO_ROUNDS = 3  # times that the zeros of taken frames are fitted, each in the light of the others
SETTLED_ZERO = 1e-3  # [rad] by which none moves any more
ZERO, OFFSET = "sensor.offset", "encoder.offset"
GAIN, DELAY, SHIFT = "drive.gain", "drive.delay", "drive.offset"
FRAME_FIT_ITERATIONS = 10  # of a fit that only compares frames
DOUBTED = "robot.frame"
"""Code of the finding that the frames of log and model differ: what is said below it hangs on them."""


def _unchecked(columns: Sequence[str]) -> Finding:
    """That frames are believed, since torques of joints that were not logged would be looked for in them."""
    return Finding(
        "robot.frame_unchecked", "note", None, None,
        f"Zeros and directions of the log were not compared with those of the model: {listed(columns)} "
        f"{'was' if len(columns) == 1 else 'were'} not logged. Log what is missing, or weld it in the model.",
    )  # fmt: skip


def in_likely_frames(
    machine: Machine, progress: Progress, test_group: str | None = None
) -> tuple[Machine, list[Finding]]:
    """The runs of a robot with the frames that its torques and its replay ask for, and what is to be said of frames.

    Frames that the sidecar gives are doubted, and kept.

    Args:
        machine: that was logged.
        progress: is told what goes on.
        test_group: group of runs that no choice may see.

    Raises:
        SealegsError: a chain or the robot's file cannot be read, or there is no such group.
    """
    robot, runs = machine.robot, machine.runs
    if robot is None or robot.file.base == "free":
        return machine, []
    if missing := needed(robot, range(robot.model.njnt), logged(robot, runs)):
        return machine, [_unchecked([f"{robot.column(number)}.position" for number in missing])]
    progress("comparing zeros and directions of log and model")
    hidden = held_out(runs, test_group)
    given = {name for k, run in enumerate(runs) if k not in hidden for name in run.meta.get("frames") or {}}
    framed = machine
    found: list[Found] = []
    try:
        for stage in (_first_slides, _hinges, _other_slides):
            seen = Machine.of(run for k, run in enumerate(framed) if k not in hidden)
            found.append(stage(Stage(seen, seen.robot or robot, given, found, progress)))
            if found[-1].frames:
                framed = framed.in_frames(found[-1].frames)
    except NUMERICAL as error:
        said = (
            f"Zeros and directions could not be compared ({type(error).__name__}: {error}); the model's are believed."
        )
        return machine, [Finding("robot.frame_fault", "warning", None, None, said)]
    doubts = [doubt for stage in found for doubt in stage.doubts]
    for doubt in doubts:
        progress(doubt.sentence)  # whoever sees it may stop and mend it
    zeros = [name for stage in found for name in stage.zeros]
    return framed, [*doubts, *_unknown(zeros, [name for stage in found for name in stage.directions])]


@dataclass(frozen=True)
class Stage:
    """What joints of some kind are judged by.

    Attributes:
        machine: in the frames that were taken so far.
        robot: of it.
        given: joints whose frame the sidecar gives.
        found: by the stages before.
        progress: is told what goes on.
    """

    machine: Machine
    robot: LoggedRobot
    given: Collection[str]
    found: Sequence[Found]
    progress: Progress


@dataclass(frozen=True)
class Found:
    """What one stage found of zeros and directions.

    Attributes:
        frames: that are taken.
        doubted: joints that may have other frames, which are not taken.
        doubts: what is to be said of both.
        zeros, directions: joints whose zero, and slides whose direction, the log does not tell.
    """

    frames: Mapping[str, Frame] = field(default_factory=dict)
    doubted: Collection[str] = ()
    doubts: Sequence[Finding] = ()
    zeros: Sequence[str] = ()
    directions: Sequence[str] = ()


def _hinges(stage: Stage) -> Found:
    machine, robot = stage.machine, stage.robot
    compared = compare_frames(robot, machine, _models(machine, robot))
    if compared is None:
        return Found()
    if not compared.proposed:
        return Found(zeros=compared.silent)
    before = _missed(machine)
    trial = _as_replayed(machine, compared)
    beside, turned = (_beside_numbers(each) for each in (machine, machine.in_frames(trial.proposed.frames)))
    if trial.proposed.frames.keys() <= beside[0].keys() and not _nearer(beside, turned):
        return Found(zeros=compared.silent)
    if not (_tells(robot, machine, trial.proposed.frames, stage.given) and _better(before, trial.missed)):
        doubt = _doubted(compared, trial.proposed.least, trial.proposed.frames, _image(trial.proposed))
        return Found({}, trial.proposed.frames, [doubt], compared.silent)
    stage.progress("fitting the zeros that are taken")
    trial = _refined(machine, robot, trial)
    last = trial.proposed
    doubt = _taken(compared, last.least, last.frames, (before, trial.missed), _image(last))
    return Found(last.frames, (), [doubt], compared.silent)


def _first_slides(stage: Stage) -> Found:
    """Slides that leave the model's range: turned the other way, they may make a hinge seem to be."""
    found = _slides(stage, outside=True)
    return found if found.frames else Found()


def _other_slides(stage: Stage) -> Found:
    return _slides(stage, outside=False)


def _slides(stage: Stage, *, outside: bool) -> Found:
    machine, robot = stage.machine, stage.robot
    compared = compare_slides(robot, machine, _models(machine, robot), outside=outside)
    if compared is None:
        return Found()
    silent = () if outside else compared.silent
    if {name for found in stage.found for name in found.doubted} & set(compared.instead):
        return Found(directions=silent)  # the same doubt, which was said of a hinge
    told = {name: frame for name, frame in compared.told.items() if name not in stage.given}
    doubtful = {**compared.doubtful, **{name: frame for name, frame in compared.told.items() if name in stage.given}}
    doubts = []
    if told:
        before, after = (_missed(some, slides=True) for some in (machine, machine.in_frames(told)))
        alone = all(name in run for run in before for name in told)  # what a force drives is only doubted
        if alone and _nearer(before, after):
            those = tuple([{name: run[name] for name in told} for run in missed] for missed in (before, after))
            more = _alike(set(told) & set(compared.alike)) + _instead(compared)
            doubts.append(_taken(compared, compared.least, told, (those[0], those[1]), more))
        else:
            doubtful, told = {**doubtful, **told}, {}
    if doubtful:
        more = _alike(set(doubtful) & {*compared.alike, *compared.doubtful}) + _instead(compared)
        doubts.append(_doubted(compared, compared.least, doubtful, more))
    return Found(told, doubtful, doubts, directions=silent)


def _models(runs: Sequence[MeasuredRun], robot: LoggedRobot) -> list[dict[str, JointModel]]:
    return [{joint: JointModel(chain_of(run, joint, robot)) for joint in commanded(runs)} for run in runs]


Missed = Sequence[Mapping[str, float]]
"""Mean squared error of each joint of the nominal robot that is replayed alone [rad2 or m2], run by run."""


@dataclass(frozen=True)
class Trial:
    """Frames that are proposed, and what the nominal robot misses of the log with them."""

    proposed: Proposed
    missed: Missed


def _as_replayed(machine: Machine, compared: Compared) -> Trial:
    """The plainest frames that are proposed, unless the nominal replay asks for further ones."""
    first, *others = (Trial(proposed, _missed(machine.in_frames(proposed.frames))) for proposed in compared.proposed)
    chosen = first
    for other in others:
        if ALIKE_ERROR_RATIO * _together(other.missed) <= _together(chosen.missed):  # not where a replay diverged
            chosen = other
    return chosen


def _refined(machine: Machine, robot: LoggedRobot, trial: Trial) -> Trial:
    """The same with zeros that were sought by torques fitted to the replay, which tells them some ten times better; as
    they were where that is clearly worse.
    """
    frames = dict(trial.proposed.frames)
    sought = [name for name, frame in frames.items() if frame.zero != robot.frame(name).zero]
    if not sought:
        return trial
    for _ in range(ZERO_ROUNDS):
        framed = machine.in_frames(frames)
        moved = {name: _offset(framed, name) for name in sought}
        frames |= {name: replace(frames[name], zero=frames[name].zero + moved[name]) for name in sought}
        if max(map(abs, moved.values())) < SETTLED_ZERO:
            break
    fitted = Trial(replace(trial.proposed, frames=frames), _missed(machine.in_frames(frames)))
    return fitted if _together(fitted.missed) < ALIKE_ERROR_RATIO * _together(trial.missed) else trial


def _offset(machine: Machine, joint: str) -> float:
    """How far the zero of a joint is off in the log's frame [rad], beside the model's own numbers up to fivefold."""
    problem = _replay(machine, joint)
    if problem is None:
        return 0.0
    first = problem.models[0]
    zeros = [v[0] for cause in catalogue(first, [ZERO]) for v in cause.variants if v[0].number == OFFSET]
    return fit(problem, [*_numbers(first, GAIN), *zeros]).values.get(OFFSET, 0.0)


def _beside_numbers(machine: Machine) -> Missed:
    """What each hinge misses of the log beside its own numbers up to fivefold, a latency, and a shift of its goals.

    A shift of 33 mrad is more torque than gravity, and looked like a joint that counts the other way round.
    """
    robot = machine.robot
    missed: list[dict[str, float]] = [{} for _ in machine]
    for joint in {} if robot is None else nominal_replays(robot, machine.runs):
        if robot is None or robot.slides(joint) or (problem := _replay(machine, joint)) is None:
            continue
        numbers = _numbers(problem.models[0], GAIN, DELAY, SHIFT)
        error = problem.position_error(fit(problem, numbers, None, FRAME_FIT_ITERATIONS).simulated)
        of_run = np.repeat([unit.run for unit in problem.units], np.diff(problem.starts))[problem.judged]
        for k, each in enumerate(missed):
            each[joint] = float(np.mean(error[of_run == k] ** 2))
    return missed


def _replay(machine: Machine, joint: str) -> FreeProblem | None:
    """The replay of a joint; None where it cannot be replayed alone."""
    pieces = cut_joint(machine, joint, None)
    if pieces.terms is None:
        return None
    scales = {"position": 1.0 / pieces.noise}
    return free_problem(pieces.runs, joint, pieces.models, pieces.units, scales, pieces.terms)


def _numbers(nominal: JointModel, *causes: str) -> list[Parameter]:
    """The model's own numbers up to fivefold, and the first number of some causes: else their errors bend all else."""
    more = [cause.variants[0][:1] for cause in catalogue(nominal, causes)]
    return merge(adjustable(nominal, DEFAULT.refitted_by), *more)


def _tells(
    robot: LoggedRobot, runs: Sequence[MeasuredRun], frames: Mapping[str, Frame], given: Collection[str]
) -> bool:
    """Whether nothing but other frames looks like this: directions, or zeros without which a range is left; of joints
    whose frame nobody gave.
    """
    for name, frame in frames.items():
        if name in given:
            return False
        axis = axis_of(robot, name, runs)
        if frame.sign == robot.frame(name).sign and stays(robot, name, robot.frame(name), axis.low, axis.high):
            return False
    return True


def _better(before: Missed, after: Missed) -> bool:
    """Whether the hinges are missed by less, and as :func:`_nearer`."""
    return _together(after) < _together(before) and _nearer(before, after)


def _nearer(before: Missed, after: Missed) -> bool:
    """Whether a joint is missed by far less, in no run by more, and no other joint by much more."""
    joints = [joint for joint in before[0] if all(joint in run for run in (*before, *after))]

    def whole(missed: Missed, joint: str) -> float:
        return sum(run[joint] for run in missed)

    if any(whole(after, joint) > ALIKE_ERROR_RATIO * whole(before, joint) for joint in joints):
        return False
    return any(
        whole(after, joint) < OTHER_ERROR_RATIO * whole(before, joint)
        and all(now[joint] <= ALIKE_ERROR_RATIO * then[joint] for then, now in zip(before, after, strict=True))
        for joint in joints
    )


def _missed(machine: Machine, *, slides: bool = False) -> Missed:
    """Of hinges, with ``slides`` of all joints."""
    robot = machine.robot
    if robot is None:
        return [{} for _ in machine]
    return [
        {
            joint: float(np.mean(problem.position_error(problem.simulate([{}])[0]) ** 2))
            for joint, problem in nominal_replays(robot, [run]).items()
            if slides or not robot.slides(joint)
        }
        for run in machine
    ]


def _together(missed: Missed) -> float:
    """Of all joints and runs, root of the mean square [rad, of slides alone m]."""
    squares = [square for run in missed for square in run.values()]
    return float(np.sqrt(np.mean(squares))) if squares else np.nan


def _said(frames: Mapping[str, Frame]) -> str:
    return "; ".join(
        f"{name}: {{zero: {frame.zero:.4g}, direction: {frame.sign:.0f}}}" for name, frame in frames.items()
    )


def _image(proposed: Proposed) -> str:
    if not proposed.mirrored:
        return ""
    return (
        f" An arm and its mirror image need the same torques: {' and '.join(proposed.mirrored)} turned around instead "
        "would fit as well."
    )


def _taken(
    compared: Compared | Directions, least: float, frames: Mapping[str, Frame], missed: tuple[Missed, Missed], more: str
) -> Finding:
    """That other frames are taken, with what the nominal robot misses of the log before and after."""
    what, who, unit = "places", listed(list(frames)), "mm"
    if isinstance(compared, Compared):
        what, who, unit = "angles", "the hinges", "mrad"
    before, after = (f"{1e3 * _together(each):.3g} {unit}" for each in missed)
    return Finding(
        DOUBTED, "warning", None, None,
        f"The {what} of log and model do not match: {who} of the nominal robot miss the log by {before} rms as the "
        f"files say, by {after} with {_said(frames)}. These are taken here. Check them, write what is right into the "
        f"sidecar under meta: frames, and diagnose again; no next experiment is proposed before.{more}",
        value=compared.left - least,
    )  # fmt: skip


def _doubted(compared: Compared | Directions, least: float, frames: Mapping[str, Frame], more: str) -> Finding:
    """That other frames would fit better, and are not taken."""
    what, effort, other = "directions", "force", ""
    if isinstance(compared, Compared):
        what, effort, other = (
            "zeros or directions",
            "torque",
            " A centre of mass that lies elsewhere looks like another zero.",
        )
    return Finding(
        DOUBTED, "warning", None, None,
        f"The drives' {effort} fits the model's gravity and coupling badly ({compared.left:.0%} is left over), and "
        f"better with other {what} ({least:.0%}), for instance {_said(frames)}.{other} Check how log and model stand "
        f"to each other there, and write what is right into the sidecar under meta: frames.{more}",
        value=compared.left - least,
    )  # fmt: skip


def _alike(names: Collection[str]) -> str:
    """What looks like the other direction of slides whose load is their weight alone."""
    if not names:
        return ""
    return (
        f" Of {listed(sorted(names))} only the weight tells the direction: a constant force of about twice the weight, "
        "or a goal and a position of different zeros, would look the same."
    )


def _instead(compared: Directions) -> str:
    if not compared.instead:
        return ""
    return f" {' or '.join(compared.instead)} turned around instead would fit as well."


def _unknown(zeros: Sequence[str], directions: Sequence[str]) -> list[Finding]:
    if not (zeros or directions):
        return []
    whose = [f"the zero of {', '.join(zeros)}"] if zeros else []
    whose += [f"the direction of {', '.join(directions)}"] if directions else []
    return [Finding(
        "robot.frame_unknown", "note", None, None,
        f"Neither gravity nor coupling tells {' or '.join(whose)}: the model's zero and direction are believed.",
    )]  # fmt: skip
