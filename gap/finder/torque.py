"""A joint whose log has no command, ready to be searched: what its torque says of load, friction and the column."""

from __future__ import annotations

from collections.abc import Sequence

from ...actuators import Chain
from ..causes.catalogue import adjustable
from ..causes.unknown import unknown_parameters
from ..causes.visible import shown_by_torque
from ..log.finding import Finding
from ..log.parts import cut
from ..log.torque_side import side_note
from ..log.types import MeasuredRun
from ..measure.case import Replay
from ..prepare.request import Request
from ..replay.joint_model import JointModel
from ..replay.torque import acts, torque_problem


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
