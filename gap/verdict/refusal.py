"""The diagnosis of what cannot be judged."""

from __future__ import annotations

from collections.abc import Sequence

from ..experiment import Experiment
from ..log.finding import Finding
from ..measure.case import Case
from ..measure.measured import Measured
from ..replay.problem import JointProblem, diverged
from .decide import decide
from .evidence import Refused
from .verdict import JointDiagnosis


def refuse(
    joint: str,
    why: Refused,
    findings: Sequence[Finding] = (),
    experiment: Experiment | None = None,
    signal: str = "",
    unit: str = "rad",
    unexplained: float = 1.0,
) -> JointDiagnosis:
    """The diagnosis of what cannot be judged."""
    verdict = decide(why)
    case = Case(joint, tuple(findings), signal or f"{joint}.position", unit)
    return JointDiagnosis(case, verdict, Measured(unexplained=unexplained), experiment=experiment)


def refuse_divergence(problem: JointProblem, joint: str) -> Refused | None:
    """Why a joint cannot be judged whose replay with the nominal model leaves all bounds; None where it does not."""
    if not diverged(problem.simulate([{}])[0]):
        return None
    why = (
        f"its nominal model leaves all bounds even in steps of {1e3 * problem.step:g} ms: it is driven away from its "
        "goal, or damping and stiffness are too large for its inertia; check direction, gains, damping and armature in "
        "the robot's file and the chain"
    )
    return Refused(f"'{joint}'", why, usable=True)
