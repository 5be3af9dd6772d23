"""The way a log goes, one joint at a time: check, cut, replay, search, measure, decide."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

from ...actuators.chain import Chain
from ...common.bugs import Unforeseen, apart
from ...common.errors import SealegsError
from ..causes.catalogue import checked
from ..checks.imu import IMU
from ..experiment import Experiment, Limits, blind_spots, detection_limits, experiment_for_still, propose
from ..ground.ground import GROUND, GroundSearch, on_ground, search_ground
from ..load.robot import Machine
from ..log.finding import Finding
from ..log.progress import Progress
from ..log.types import OF_CHAINS, MeasuredSet
from ..measure.belief import measured_within_belief
from ..measure.case import Case, Replay
from ..measure.confidence import telling
from ..measure.measured import Measured, measure
from ..measure.named import WITHDRAWN
from ..measure.unseen import unseen_range
from ..prepare.checking import check_log
from ..prepare.columns import chosen, commanded
from ..prepare.frames import DOUBTED, in_likely_frames
from ..prepare.pieces import named_chain, with_neighbours
from ..prepare.request import Request
from ..prepare.resting import without_rests
from ..replay.joint_model import JointModel
from ..robot.encoders import beside_tilt
from ..robot.joints import NOTHING_KNOWN, Known
from ..robot.judged import OfRobot, noted, of_robot
from ..robot.together import (
    FirstLook,
    agreed_latency,
    beside_latency,
    joined,
    look_at,
    seek_latency,
    with_latency,
    with_supply,
)
from ..search.forward import NUMERICAL, Searcher
from ..search.result import Search
from ..search.seek import begun, seek
from ..search.settings import DEFAULT, SearchSettings
from ..verdict.decide import decide, refuse
from ..verdict.verdict import (
    EXPLAINED,
    NOT_IDENTIFIABLE,
    PARTLY,
    JointDiagnosis,
    Refused,
    Replayed,
    Verdict,
    data_errors,
    recording_reasons,
    rivals_of,
)
from .case import NotReplayed, joint_case, judged_by_replay, replay_of_torque, with_believed_loads
from .imu import beside, diagnose_imu
from .parallel import side_by_side

LOGGER = logging.getLogger("sealegs")
BEGUN = "begun"
"""In the place of a verdict, of a joint whose usual causes were sought."""


def diagnose(
    data: MeasuredSet,
    test_group: str | None = None,
    seed: int = 0,
    progress: Progress = lambda text: None,
    limits: Limits | None = None,
    causes: Sequence[str] | None = None,
    settings: SearchSettings = DEFAULT,
    look_on: bool = False,
    done: Callable[[JointDiagnosis], None] = lambda joint: None,
    workers: int | None = 1,
    only: Sequence[str] | None = None,
) -> list[JointDiagnosis]:
    """Diagnose every joint of a data set.

    Args:
        data: measured runs of one machine.
        test_group: group of runs that no fit and no choice may see.
        seed: of all resampling.
        progress: is told what goes on.
        limits: of the next experiment; default: :func:`sealegs.gap.experiment.excitations.default_limits`.
        causes: names of those of a joint to consider; default: all of the catalogue.
        settings: thresholds of the search.
        look_on: whether the search of a joint records rounds that it would skip (:mod:`sealegs.gap.search.record`).
        done: is given each joint as soon as it is diagnosed.
        workers: joints at a time, each in a process of its own; None: as many as there are cores for.
        only: joints to diagnose, and nothing that they share with others; None: all, and what they share.

    Raises:
        SealegsError: the runs have no joint that can be diagnosed, or no such joint, or the catalogue no such cause.
        Unforeseen: of some of it nobody knows why it failed; ``found`` are the other joints.
    """
    errors: dict[str, Exception] = {}
    request = Request(test_group, seed, progress, limits, causes, settings, look_on)
    checked(causes)
    data, findings, stop = check_log(data, progress)
    machine, joints = Machine.of(data.runs), chosen(commanded(data.runs), only, beside(data.runs, only))
    if stop is not None:
        first = [_first_experiment(machine, joint, stop, request) for joint in joints]
        why = Refused("the log", stop.sentence)
        return [refuse(joint, why, findings, plan) for joint, plan in zip(joints, first, strict=True)]
    for what, step in (("zeros and directions", in_likely_frames), ("what the robot rests on", without_rests)):
        with apart(what, errors):  # without it, the model's frames and all samples count
            machine, more = step(machine, progress, test_group)
            findings = [*findings, *more]
    with apart("what drives draw", errors):  # without it, each has a supply of its own
        machine = with_neighbours(machine)
    if only is None:
        with apart("a latency that joints share", errors):  # without it, each joint has one of its own
            seen = partial(_replay_of, machine, findings=findings, request=request)
            looked = seek_latency(joints, seen, request)
            request = replace(request, latency=looked.latency)
            machine = with_neighbours(machine, looked.numbers())
    shared = OfRobot({})
    if only is None and machine.robot is not None and len(joints) > 1:
        with apart("what joints share", errors):  # without it, each joint is diagnosed by itself
            shared = _of_robot(machine, joints, findings, request, workers)
    tasks = {joint: partial(_whatever_happens, shared.known.get(joint, NOTHING_KNOWN)) for joint in joints}
    found = side_by_side(tasks, machine, findings, request, workers, done, errors)
    whole = len(found) == len(joints)  # the ground under them needs all of them
    found = shared.beside(found, request)
    for joint in found:
        if joint.joint in shared.before or joint is shared.robot:
            done(joint)
    if only is None and whole and on_ground(machine):
        with apart("the ground", errors):
            found.append(_kept(GROUND, "the ground", (), request, lambda: _diagnose_ground(machine, found, request)))
            done(found[-1])
    if beside(machine.runs) and (only is None or IMU in only):
        frames = {} if machine.robot is None else dict(machine.robot.frames)
        with apart("the IMU", errors):
            work = partial(diagnose_imu, machine.runs, frames, progress)
            found.append(_kept(IMU, "the IMU", (), request, work))
            done(found[-1])
    named = found if only is not None else _shared_once(found, request)
    for joint in named:
        if all(joint is not other for other in found):
            done(joint)
    if errors:
        raise Unforeseen(errors, named)
    return named


def _shared_once(found: list[JointDiagnosis], request: Request) -> list[JointDiagnosis]:
    """The diagnoses with the latency and the supply told once, where joints share them."""
    late, latency = agreed_latency(found) if request.latency is None else joined(found, request.latency)
    return with_supply(with_latency(late, latency), latency)


def _of_robot(
    machine: Machine, joints: Sequence[str], findings: Sequence[Finding], request: Request, workers: int | None
) -> OfRobot:
    """What joints share, from what is found at each of them first; nothing where its numbers fail."""

    def begin(known: Mapping[str, Known]) -> list[JointDiagnosis]:
        tasks = {joint: partial(_begun, each) for joint, each in known.items()}
        return side_by_side(tasks, machine, findings, request, workers, lambda joint: None)

    first = begin(dict.fromkeys(joints, NOTHING_KNOWN))
    try:
        return of_robot(machine, first, request, begin)
    except NUMERICAL as error:
        LOGGER.exception("the search for what joints share failed")
        why = f"the search for what joints share failed ({type(error).__name__}: {error})"
        request.progress(why)
        said = f"{why}; what was found of each joint stands."
        return OfRobot(noted({}, first, Finding("search.fault", "warning", None, None, said[0].upper() + said[1:])))


def _begun(known: Known, machine: Machine, joint: str, findings: Sequence[Finding], request: Request) -> JointDiagnosis:
    """What is found of a joint first, for what others share with it: its usual causes, and nothing is said of them."""

    def begin() -> JointDiagnosis:
        case = _case(machine, joint, findings, request, known) if _is_commanded(machine, joint) else None
        if not isinstance(case, Case) or case.replay is None or not case.replay.of_robot:
            return refuse(joint, Refused(f"'{joint}'", "it is not replayed beside the others", usable=True))
        search = begun(_searcher(case.replay, request))
        measured, _ = measured_within_belief(case.replay, search, joint, request.seed)
        case = replace(case, replay=replace(case.replay, along=None))  # no function goes to another process
        return JointDiagnosis(case, Verdict(BEGUN, ""), beside_tilt(measured, case.findings), search)

    return _kept(joint, f"'{joint}'", (), request, begin)


def _whatever_happens(
    known: Known, machine: Machine, joint: str, findings: Sequence[Finding], request: Request
) -> JointDiagnosis:
    """The diagnosis of a joint; a refusal where its numbers fail, so that what was found of other joints is kept."""
    mine = [f for f in findings if f.joint in (joint, None)]
    return _kept(joint, f"'{joint}'", mine, request, lambda: diagnose_joint(machine, joint, findings, request, known))


def _kept(
    joint: str, subject: str, findings: Sequence[Finding], request: Request, work: Callable[[], JointDiagnosis]
) -> JointDiagnosis:
    try:
        return work()
    except NUMERICAL as error:
        LOGGER.exception("the diagnosis of %s failed", joint)
        request.progress(f"the diagnosis of {joint} failed: {type(error).__name__}: {error}")
        why = f"its numbers failed ({type(error).__name__}: {error})"
        return refuse(joint, Refused(subject, why, usable=True), findings)


def diagnose_joint(
    machine: Machine,
    joint: str,
    findings: Sequence[Finding],
    request: Request,
    known: Known = NOTHING_KNOWN,
) -> JointDiagnosis:
    """Diagnose one joint of a machine whose faults are mended.

    Args:
        machine: that was logged.
        joint: its name.
        findings: about the log.
        request: what was asked for.
        known: of it from the other joints of its robot.

    Raises:
        LogError: the runs name no actuator for it, or are too short.
    """
    if not _is_commanded(machine, joint):  # only its torque can be judged
        mine = _of_joint(joint, findings, known)
        replay, mine = replay_of_torque(with_believed_loads(machine).runs, joint, mine, request)
        case = replace(judged_by_replay(joint, replay), findings=mine)
        return conclude(case, seek(_searcher(replay, request)), request)
    case = _case(machine, joint, findings, request, known)
    if isinstance(case, NotReplayed):
        return refuse(joint, case.why, case.findings)
    assert case.replay is not None
    search = seek(replace(_searcher(case.replay, request), begun=known.begun))
    request.progress("measuring the gain on runs that nothing has seen")
    return beside_latency(conclude(case, search, request), request.latency)


def _of_joint(joint: str, findings: Sequence[Finding], known: Known) -> tuple[Finding, ...]:
    """The findings about a joint and about all of the log."""
    return tuple(f for f in (*findings, *known.notes) if f.joint in (joint, None, ""))


def _case(
    machine: Machine, joint: str, findings: Sequence[Finding], request: Request, known: Known
) -> Case | NotReplayed:
    """A joint that is commanded, ready to be searched, with the latency that all joints share."""
    case = joint_case(machine, joint, _of_joint(joint, findings, known), request, known)
    if isinstance(case, NotReplayed) or case.replay is None or (shared := request.latency) is None:
        return case
    replay = case.replay
    wide, tuned = (shared.numbers_of(joint, numbers) for numbers in (replay.wide, replay.tuned))
    replay = replace(replay, wide=wide, tuned=tuned, causes=shared.causes_of(joint, replay.causes))
    return replace(case, replay=replay)


def _is_commanded(machine: Machine, joint: str) -> bool:
    commands = (getattr(run.joints[joint], kind) for run in machine for kind in OF_CHAINS)
    return any(command is not None for command in commands)


def _replay_of(
    machine: Machine, joint: str, *, findings: Sequence[Finding], request: Request
) -> Replay | Refused | None:
    """The replay of a joint; None where it has no commands."""
    if not _is_commanded(machine, joint):
        return None
    case = joint_case(machine, joint, tuple(f for f in findings if f.joint in (joint, None, "")), request)
    return case.why if isinstance(case, NotReplayed) else case.replay


def prepared(data: MeasuredSet, joint: str, request: Request) -> Replay:
    """The replay of one joint of a data set, its faults mended, and nothing searched.

    Raises:
        SealegsError: it cannot be replayed; the sentence says why.
    """
    machine, findings = _mended(data, request)
    replay = _replay_of(machine, joint, findings=findings, request=request)
    if replay is None:
        raise SealegsError(f"'{joint}' has no command that could be replayed.")
    if isinstance(replay, Refused):
        raise SealegsError(f"{replay.subject} cannot be replayed: {replay.reason}")
    return replay


def first_look(data: MeasuredSet, request: Request, only: Sequence[str] | None = None) -> FirstLook:
    """What joints of a data set show at first sight, and the latency that they share; nothing is searched.

    Args:
        data: measured runs of one machine.
        request: what is asked for.
        only: names of the joints to look at; None: all.

    Raises:
        SealegsError: the log cannot be used, or no joint of it can be replayed.
    """
    machine, findings = _mended(data, request)
    joints = chosen(commanded(machine), only)
    found = look_at(joints, partial(_replay_of, machine, findings=findings, request=request), request)
    if not found.joints:
        raise SealegsError(
            "No joint can be replayed freely (those of a robot that walks are not), so there is no first look: leave "
            "look=true out, and the diagnosis says why."
        )
    return found


def _mended(data: MeasuredSet, request: Request) -> tuple[Machine, Sequence[Finding]]:
    """The machine with its faults mended, and what was found of the log."""
    data, findings, stop = check_log(data, request.progress)
    if stop is not None:
        raise SealegsError(stop.sentence)
    machine, _ = in_likely_frames(Machine.of(data.runs), request.progress, request.test_group)
    machine, _ = without_rests(machine, request.progress, request.test_group)
    return with_neighbours(machine), findings


def _diagnose_ground(machine: Machine, joints: Sequence[JointDiagnosis], request: Request) -> JointDiagnosis:
    """The ground under a robot, sought with the actuators as their diagnoses left them."""
    chains = {joint.joint: chain for joint in joints if (chain := _found_chain(joint)) is not None}
    sought = search_ground(
        machine,
        chains,
        request.seed,
        progress=request.progress,
        test_group=request.test_group,
        causes=request.causes,
        settings=request.search,
        look_on=request.look_on,
    )
    if not isinstance(sought, GroundSearch):
        return refuse(GROUND, Refused("the ground", sought, usable=True), signal="base.z", unit="m", unexplained=0.0)
    replay = Replay(sought.problem, sought.problem, sought.numbers, sought.numbers)
    request.progress("measuring the gain on pieces that nothing has seen")
    measured = measure(replay, sought.search, GROUND, request.seed)
    findings = tuple(sought.findings(measured.values, complete=len(chains) == len(joints)))
    return _decide(judged_by_replay(GROUND, replay), sought.search, measured, request, findings)


def conclude(case: Case, search: Search, request: Request) -> JointDiagnosis:
    """Measure what a search found, and decide what is said of it."""
    assert case.replay is not None
    measured, search = measured_within_belief(case.replay, search, case.joint, request.seed)
    return _decide(case, search, beside_tilt(measured, case.findings), request)


# --- the steps ---------------------------------------------------------------------------------------------------


def _searcher(replay: Replay, request: Request) -> Searcher:
    return Searcher(
        replay.fitting,
        causes=list(replay.causes),
        tuned=tuple(replay.tuned),
        progress=request.progress,
        seed=request.seed,
        settings=request.search,
        look_on=request.look_on,
        wide=tuple(replay.wide),
    )


def _decide(
    case: Case, search: Search, measured: Measured, request: Request, findings: tuple[Finding, ...] = ()
) -> JointDiagnosis:
    """The verdict, and the next experiment where it leaves something open."""
    replay, joint, errors = case.replay, case.joint, data_errors(case.findings, case.joint)
    assert replay is not None
    problem, free = replay.problem, replay.problem.free_joint
    beyond = unseen_range(problem, measured.simulated["extended"], joint, request.search)
    silent = measured.settled() and not (measured.causes or measured.turned)
    asked = problem.joint if silent and case.held is None else None
    blind, limits = (blind_spots(asked, search, case.hidden), detection_limits(asked, search)) if asked else ((), ())
    unmeasured = () if problem.joint is None else problem.joint.models[0].unknown
    within = [p for p in search.tuned if p.relative and not search.loose and p not in unmeasured]
    factors = {} if measured.causes else telling(problem, measured.values, within)
    verdict = decide(Replayed(case, measured, errors, beyond, blind, limits, factors))
    experiment = None
    # of a gap that is explained, a near miss asks for nothing more: it is of the size of the noise
    withdrawn = [cause.name for cause in measured.open_causes if cause.standing == WITHDRAWN]
    asking = withdrawn if verdict.name == EXPLAINED else measured.open_causes
    unsettled = verdict.name in (NOT_IDENTIFIABLE, PARTLY) or rivals_of(measured.causes) or asking
    framed = all(finding.code != DOUBTED for finding in case.findings)  # goals may mean other angles
    foreseen = free is not None and (replay.along is not None or free.models[0].load.predictable)
    told_places = free is not None and free.models[0].command == "goal"  # what is proposed are positions
    if free is not None and foreseen and told_places and unsettled and framed:
        wide = verdict.because("still", "blind") or bool(withdrawn)
        left = search.less(withdrawn)
        experiment = propose(free, left, request.limits, request.seed, wide, replay.stops, replay.along)
    doubts = recording_reasons(measured.causes, case.findings, request.search)
    every = (*case.findings, *findings, *(() if beyond is None else (beyond,)), *_faults(search, joint))
    return JointDiagnosis(
        replace(case, findings=every, replay=replace(replay, along=None)),  # no function goes to another process
        replace(verdict, reasons=(*verdict.reasons, *doubts)),
        measured,
        search,
        errors,
        experiment,
        limits,
    )


def _faults(search: Search, joint: str) -> tuple[Finding, ...]:
    """That a search ended early, if it did."""
    if not search.fault:
        return ()
    sentence = f"'{joint}': {search.fault}; what was found until then stands, and more may be there."
    return (Finding("search.fault", "warning", joint, None, sentence),)


# --- small things --------------------------------------------------------------------------------------------------


def _found_chain(joint: JointDiagnosis) -> Chain | None:
    """The chain of a joint as its diagnosis left it."""
    return None if joint.problem is None else joint.problem.chain(joint.values)


def _first_experiment(machine: Machine, joint: str, reason: Finding, request: Request) -> Experiment | None:
    """What to run on a joint of a bench that nobody has moved yet."""
    asked = reason.code != "motion.none" or reason.data_error
    first = machine[0]
    if asked or first.robot != "bench" or joint not in first.actuators or first.joints[joint].goal is None:
        return None
    model = JointModel(named_chain(first, joint))
    return experiment_for_still(machine, joint, [model], request.limits, request.seed, request.causes)
