"""A joint ready to be searched: its replay, freely or along its measured motion, and what is said of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ...actuators import Chain
from ..causes.catalogue import adjustable, catalogue
from ..causes.load import with_stops
from ..causes.unknown import unknown_parameters, with_believed_load
from ..causes.visible import limits as limits_of_driven
from ..causes.visible import shown, shown_by_torque
from ..checks.data_set import shows_little
from ..checks.stops import stops_of, told_stops
from ..load.robot import Machine
from ..log.finding import Finding
from ..log.parts import cut
from ..log.torque_side import side_note
from ..log.types import LogError, MeasuredRun
from ..measure.case import Case, Replay
from ..prepare.pieces import cut_joint, fit_runs
from ..prepare.request import Request
from ..replay.driven import as_read, driven_problem
from ..replay.free import free_problem
from ..replay.joint_model import JointModel
from ..replay.problem import converged
from ..replay.torque import acts, torque_problem
from ..replay.tree import HELD
from ..robot.joints import NOTHING_KNOWN, Known
from ..search.channels import weigh_channels
from ..search.delays import with_started_delays
from ..search.windows import in_windows
from ..verdict.decide import refuse_divergence
from ..verdict.verdict import Refused


@dataclass(frozen=True)
class NotReplayed:
    """A joint that cannot be replayed: why, and what is to be said of it nevertheless."""

    why: Refused
    findings: tuple[Finding, ...]


def joint_case(
    machine: Machine,
    joint: str,
    findings: tuple[Finding, ...],
    request: Request,
    known: Known = NOTHING_KNOWN,
) -> Case | NotReplayed:
    """A joint ready to be searched: replayed freely on a bench or in a tree, driven where what holds its link is not
    known.

    Args:
        machine, joint: that were logged.
        findings: about the log of the joint.
        request: what was asked for.
        known: of it from the other joints of its robot.

    Raises:
        LogError: the runs name no actuator for it, or are too short.
    """
    machine = with_believed_loads(machine)
    pieces = cut_joint(machine, joint, request.test_group, known.more)
    first = pieces.models[0]
    causes = catalogue(first, request.causes)
    layout = (pieces.runs, joint, pieces.models, pieces.units)
    stops = stops_of(pieces.runs, joint, first.axis.reach)
    findings = (*findings, *pieces.findings)
    seen = told_stops(stops, joint, first.axis.unit("rad"))
    wide, tuned = adjustable(first, request.search.refitted_by), adjustable(first)
    hidden: Sequence[str] = ()
    if pieces.terms is not None or all(run.robot == "bench" for run in pieces.runs):
        free = converged(free_problem(*layout, {"position": 1.0 / pieces.noise}, pieces.terms))
        if (lost := refuse_divergence(free, joint)) is not None:
            return NotReplayed(lost, findings)
        fitted = stops_of(fit_runs(pieces), joint, first.axis.reach)
        problem, causes = weigh_channels(free, request.search), with_stops(causes, fitted, first)
        fitting = in_windows(problem, wide, request.search)
    else:
        told = any(finding.code == "columns.before_goal" for finding in findings)
        try:
            driven = as_read(driven_problem(*layout, pieces.noise), told=told)
        except LogError as error:
            held = next((f"{finding.sentence} " for finding in pieces.findings if finding.code == HELD), "")
            why = f"{held}{'Along that motion: ' if held else ''}{error}"
            return NotReplayed(Refused(f"'{joint}'", why, usable=True), findings)
        causes, hidden = shown(driven, first, causes)
        request.progress(f"judging the actuator of {joint} along its measured motion")
        problem = fitting = weigh_channels(converged(driven), request.search)
        seen = (*seen, *limits_of_driven(driven, joint, hidden))
    replay = Replay(
        problem, fitting, wide, tuned, with_started_delays(fitting, causes, request.search), stops, pieces.along
    )
    return replace(
        judged_by_replay(joint, replay),
        findings=(*findings, *seen),
        still=shows_little(machine.runs, joint),
        frames=machine[0].meta.get("frames"),
        hidden=tuple(hidden),
    )


def with_believed_loads(machine: Machine) -> Machine:
    """Its runs with the load that is believed where a sidecar leaves it open."""
    return Machine.of(with_believed_load(run) for run in machine)


def judged_by_replay(joint: str, replay: Replay) -> Case:
    """A joint, or the ground, by the signal that its replay is judged by."""
    signal, unit = replay.problem.signal
    return Case(joint, signal=signal if "." in signal else f"{joint}.{signal}", unit=unit, replay=replay)


def replay_of_torque(
    runs: Sequence[MeasuredRun], joint: str, findings: Sequence[Finding], request: Request
) -> tuple[Replay, tuple[Finding, ...]]:
    """The torque of a joint of a bench along its measured motion, and what is said of it.

    A finding that the torque column is shifted is left out: it is judged by the same balance.

    Raises:
        LogError: it has no torque, or too little of it, or it is not of a bench.
    """

    def model_of(run: MeasuredRun, chain: Chain) -> JointModel:
        return JointModel(chain, unknown=unknown_parameters(run, chain))

    settings, group = request.search, request.test_group
    problem = torque_problem(runs, joint, cut(runs, joint, group), model_of, settings.column_calibration, group)
    nominal = problem.models[0].joint
    wide, tuned = (
        [p for p in adjustable(nominal, *width) if acts(p.number)] for width in ((settings.refitted_by,), ())
    )
    request.progress(f"judging the torque of {joint} along its measured motion")
    causes = shown_by_torque(problem, nominal, request.causes)
    side = (side_note(joint, problem.side, problem.side_reason),) if problem.sides_differ else ()
    told = (f for f in findings if not (f.cause == "sensor.delay" and f.column == f"{joint}.torque"))
    return Replay(problem, problem, wide, tuned, causes), (*told, *side)
