"""A wrong encoder of one joint, in the light of the others: what it misreads changes what they work against.

Gravity at an elbow hangs on where the shoulder stands. Where the shoulder's zero is wrong, the elbow seems to have a
wrong zero as well, and a base that is tilted looks like a wrong zero at every joint with an axis along it. So each
encoder that was named is held against all joints at once: taken as found, how far off do the others stay without
encoders and loads of their own? The one that leaves least is kept, unless the others are further off with it, and those
that it explains are judged with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from ..load.robot import LoggedRobot
from ..load.terms import T_OWN, T_SIZE
from ..log.finding import Finding
from ..log.parts import FIT_A, FIT_B
from ..log.types import Array, JointLog, MeasuredRun
from ..measure.confidence import THRESHOLDS, standing
from ..measure.measured import Measured
from ..prepare.request import Request
from ..replay.parameters import BAR, Parameter, absolute
from ..replay.problem import JointProblem
from ..replay.tree import motion_of, terms_of
from ..search.fit import fit, merge, middle
from ..search.settings import DEFAULT
from ..search.sketch import spread
from ..verdict.verdict import JointDiagnosis
from .directions import rows_of, tilt
from .joints import NOTHING_KNOWN, Again, Joints, Known, joints_of
from .problem import RobotModel, RobotProblem
from .search import LOAD_CAUSES, laid

ENCODERS = ("sensor.offset", "sensor.scale")
TILT_CAUSE = "load.tilt"
MISREAD_CODE = "robot.encoder"
"""Code of the finding that says with which encoder of another joint a joint is judged."""
EITHER_CODE = "robot.encoder_or_tilt"
"""Code of the finding that says that a tilted base does the same as the encoder of a joint."""
INDISTINCT_LOSS_SHARE = 0.05  # of the loss by which two explanations must differ to be told apart: assumed


@dataclass(frozen=True)
class Encoder:
    """How one joint misreads its angle: by an offset [rad or m] after a factor."""

    joint: str
    offset: float
    scale: float

    def link(self, log: JointLog) -> JointLog:
        """The log with the angles that were, instead of those that were read; an encoder at the link is another one."""
        return replace(log, position=(log.position - self.offset) / self.scale)

    def said(self, unit: str) -> str:
        """``a zero that is 0.05 rad off``."""
        parts = [f"a zero that is {self.offset:.3g} {unit} off"] if self.offset else []
        parts += [f"{self.scale:.3g} times the angle"] if self.scale != 1.0 else []
        return " and ".join(parts)


@dataclass(frozen=True, eq=False)
class InLight:
    """Joints in the light of their encoders.

    Attributes:
        found: diagnoses.
        runs: with the angles that were, as far as an encoder was found to misread them.
        moved: by joint, what that adds to its terms, and what is said of it.
        known: the same of joints as far as they were judged with it.
        tilted: whether a tilted base explains more than any encoder.
    """

    found: list[JointDiagnosis]
    runs: Sequence[MeasuredRun]
    moved: Mapping[str, Known] = field(default_factory=dict)
    known: Mapping[str, Known] = field(default_factory=dict)
    tilted: bool = False


def misread(diagnosis: JointDiagnosis) -> Encoder | None:
    """The encoder that a joint's causes say is wrong; None where none is."""
    sure = [c for c in diagnosis.causes if c.name in ENCODERS and c.confidence >= THRESHOLDS.guessed]
    if not sure or diagnosis.problem is None:
        return None
    at = absolute(diagnosis.values, diagnosis.problem.models[0])
    offset = at.get("encoder.offset", 0.0) + at.get("host.offset", 0.0)
    scale = at.get("encoder.scale", 1.0) * at.get("host.scale", 1.0)
    return Encoder(diagnosis.joint, offset, scale)


def corrected(runs: Sequence[MeasuredRun], encoder: Encoder) -> list[MeasuredRun]:
    """Runs with the angles that a joint had."""
    return [replace(run, joints={**run.joints, encoder.joint: encoder.link(run.joints[encoder.joint])}) for run in runs]


def in_light(
    robot: LoggedRobot,
    runs: Sequence[MeasuredRun],
    found: Sequence[JointDiagnosis],
    request: Request,
    again: Again,
) -> InLight:
    """Diagnoses of joints beside the encoders of the others.

    Args:
        robot: that was logged.
        runs: of it.
        found: about each joint alone.
        request: what was asked for.
        again: diagnoses joints again.
    """
    light, kept = InLight(list(found), runs), set[str]()
    for _ in found:
        suspects = {d.joint: e for d in light.found if d.joint not in kept and (e := misread(d)) is not None}
        joints = joints_of(light.found, request.search) if suspects else Joints({}, {})
        if len(joints.problems) < 2 or not set(suspects) & set(joints.problems):
            break
        request.progress(f"holding the encoder of {', '.join(suspects)} against all joints")
        weighed = _Weighed(robot, light.runs, joints, request)
        losses = {joint: weighed.with_encoder(e) for joint, e in suspects.items() if joint in joints.problems}
        joint = min(losses, key=losses.__getitem__)
        level = weighed.with_tilt()
        if level < (1.0 - INDISTINCT_LOSS_SHARE) * losses[joint]:
            return replace(light, tilted=True)
        kept.add(joint)
        either = level < (1.0 + INDISTINCT_LOSS_SHARE) * losses[joint]
        light = _judged(light, weighed, suspects[joint], again, request, either=either)
    return light


@dataclass(frozen=True, eq=False)
class _Others:
    """Joints in the light of one encoder: runs with the angles that were, and by joint its terms and its loss."""

    runs: list[MeasuredRun]
    terms: dict[str, list[Array]]
    losses: dict[str, float]


class _Weighed:
    """Losses of all joints, on what was fitted, without encoders and loads of their own."""

    def __init__(self, robot: LoggedRobot, runs: Sequence[MeasuredRun], joints: Joints, request: Request) -> None:
        self.robot, self.runs, self.searches = robot, runs, joints.searches
        self.motions = [motion_of(robot, run) for run in runs]
        self.terms = {name: terms_of(robot, name, runs, self.motions) for name in joints.problems}
        self.problems: dict[str, JointProblem] = {}
        self._others: dict[Encoder, _Others] = {}
        for name, problem in joints.problems.items():
            seen = spread(problem, request.search.sketched).part(FIT_A, FIT_B)
            self.problems[name] = replace(seen, terms=laid(self.terms[name], seen))

    @cached_property
    def plain(self) -> dict[str, float]:
        """Of each joint, as the robot was read."""
        return {name: self._loss(name, self._numbers(name)) for name in self.problems}

    def with_encoder(self, encoder: Encoder) -> float:
        """Of all joints with the encoder of one."""
        own = [c.variant for c in self.searches[encoder.joint].accepted if c.cause.name in ENCODERS]
        losses = {encoder.joint: self._loss(encoder.joint, merge(self._numbers(encoder.joint), *own))}
        return sum({**self.plain, **self.others(encoder).losses, **losses}.values())

    def speaks_against(self, encoder: Encoder) -> bool:
        """Whether the joints that feel how it moves are further off with it."""
        found = self.others(encoder).losses
        return sum(found.values()) > (1.0 + INDISTINCT_LOSS_SHARE) * sum(self.plain[name] for name in found)

    def others(self, encoder: Encoder) -> _Others:
        """Joints that feel how another one moves."""
        if encoder not in self._others:
            self._others[encoder] = self._moved_by(encoder)
        return self._others[encoder]

    def _moved_by(self, encoder: Encoder) -> _Others:
        runs = corrected(self.runs, encoder)
        motions = [motion_of(self.robot, run) for run in runs]
        found = _Others(runs, {}, {})
        for name, problem in self.problems.items():
            if name != encoder.joint and self.robot.number(encoder.joint) in self.robot.felt_by(name):
                found.terms[name] = terms_of(self.robot, name, runs, motions)
                moved = replace(problem, terms=laid(found.terms[name], problem))
                found.losses[name] = self._loss(name, self._numbers(name), moved)
        return found

    def with_tilt(self) -> float:
        """Of all joints with a base that is tilted."""
        rows: dict[str, dict[str, Array]] = {}
        directions = tilt(self.robot)
        for direction in directions:
            felt = {
                name: laid(found, problem)
                for name, problem in self.problems.items()
                if (found := rows_of(direction, self.robot, name, self.runs, self.motions)) is not None
            }
            rows[direction.number] = felt
        model = RobotModel(self.problems, {d.number: d.neutral for d in directions}, dict.fromkeys(rows, "rad"))
        problem = RobotProblem.of(dict(self.problems), rows, (model,))
        numbers = {name: self._numbers(name) for name in self.problems}
        tuned = [p.of_joint(name) for name, mine in numbers.items() for p in mine]
        start = {f"{name}{BAR}{path}": x for name in numbers for path, x in middle(*self.searches[name].fits).items()}
        found = fit(problem, [*(d.parameter for d in directions), *tuned], start, DEFAULT.sketched_iterations)
        return float(problem.block_errors(found.simulated).sum())

    def _numbers(self, joint: str) -> list[Parameter]:
        search = self.searches[joint]
        kept = [c.variant for c in search.accepted if c.cause.name not in (*ENCODERS, *LOAD_CAUSES)]
        return merge(search.tuned, *kept)

    def _loss(self, joint: str, numbers: Sequence[Parameter], problem: JointProblem | None = None) -> float:
        replayed = problem or self.problems[joint]
        found = fit(replayed, numbers, middle(*self.searches[joint].fits), DEFAULT.sketched_iterations)
        return float(replayed.block_errors(found.simulated).sum())


def _judged(
    light: InLight, weighed: _Weighed, encoder: Encoder, again: Again, request: Request, *, either: bool
) -> InLight:
    """Joints judged with the encoder of one, and that one beside a tilted base where that would do as well."""
    others, said = weighed.others(encoder), encoder.said("m" if weighed.robot.slides(encoder.joint) else "rad")
    if weighed.speaks_against(encoder):
        others = _Others(list(light.runs), {}, {})  # it is a matter of its joint
    asked: dict[str, Known] = {}
    moved = dict(light.moved)
    for name, loss in others.losses.items():
        own = slice(T_OWN, T_OWN + T_SIZE)
        more = [a[:, own] - b[:, own] for a, b in zip(others.terms[name], weighed.terms[name], strict=True)]
        moved[name] = moved.get(name, NOTHING_KNOWN).also(more)
        if loss < (1.0 - INDISTINCT_LOSS_SHARE) * weighed.plain[name]:
            sentence = f"'{name}' is judged with the encoder of '{encoder.joint}' as it was found: {said}."
            moved[name] = moved[name].also(None, Finding(MISREAD_CODE, "note", name, None, sentence))
            asked[name] = moved[name]
    if either:
        sentence = (
            f"A base that is tilted would explain all joints as well as the encoder of '{encoder.joint}' does; stand "
            "the robot level with a spirit level, or log it once more with its base turned."
        )
        note = Finding(EITHER_CODE, "note", encoder.joint, None, sentence)
        moved[encoder.joint] = asked[encoder.joint] = moved.get(encoder.joint, NOTHING_KNOWN).also(None, note)
    if asked:
        request.progress(f"judging {', '.join(asked)} in the light of the encoder of {encoder.joint}")
    now = {d.joint: d for d in (again(asked) if asked else ())}
    return InLight([now.get(d.joint, d) for d in light.found], others.runs, moved, {**light.known, **asked})


def beside_tilt(measured: Measured, findings: Sequence[Finding]) -> Measured:
    """What was measured of a joint, its encoder's causes one of two where a tilted base would do as well."""
    if all(finding.code != EITHER_CODE for finding in findings):
        return measured
    causes = []
    for cause in measured.causes:
        if cause.name in ENCODERS:
            sure, rivals = THRESHOLDS.at_bound * cause.confidence, (*cause.rivals, TILT_CAUSE)
            cause = replace(cause, confidence=sure, rivals=rivals, standing=standing(sure, rivals))
        causes.append(cause)
    return replace(measured, causes=tuple(causes))
