"""Limits of safety that a robot's file does not state, from the ideal servos that its model file gives the joints.

An ideal servo has the force that a model file gives it, and no no-load speed; limits for a small servo would stop it in
the first excitation. So the excitations are tried on its inertias beforehand, without gravity and other poses, which
:data:`SPARE` is for. Of any other chain the limits of ``configs/robot/bench.yaml`` hold.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import numpy as np

from ...actuators.stages.controller import UNLIMITED
from ...common.errors import WARNING
from ...envs.described.model_file import UNITS
from ...envs.described.robot_described import HINGES, SLIDES, FileJoint, RobotFile
from ...envs.described.robot_within import TURN
from ...envs.described.urdf_text import urdf_speeds
from ...envs.new_robot.robot_yaml import AssumedLimits
from .limits import LEAST, usual_reach

ASSUMED = ("range_margin", "speed", "following_error")
"""Limits that are assumed."""
SPARE = 1.5  # times what the trial shows: gravity, other poses and loads; assumed
TRIAL = 1e-3  # [s] step of the trial
LASTS = 0.3  # [s] ``following_time`` of configs/robot/bench.yaml
CYCLE = 0.01  # [s] of deployment, where nothing else is said
STEP = 2.0 * np.pi / 4096  # [rad] of an encoder; of a slide without a gear as many metres
NOISE = 3.0  # steps that a position may jump by from cycle to cycle without having moved; assumed
SEEMING = NOISE * STEP / CYCLE  # [rad/s or m/s] measured by them at rest
ROUNDS = 5  # trials with smaller reaches, at most
SIDES = 4  # sets of servos at their largest pull that a step of the trial tries, at most
KEPT = 500  # of such sets whose answer is kept: they come again step by step


def assumed_limits(robot: RobotFile, *, advised: bool = True) -> AssumedLimits:
    """Limits of safety of a robot's joints, from the servos that its file gives them.

    A speed that the file states stays the limit.

    Args:
        robot: as read.
        advised: whether to look for a reach at which excitations keep to such speeds; this takes some seconds.
    """
    stated = urdf_speeds(robot.model.path)
    ideal = [joint for joint in robot.joints if joint.chain.find("ideal") is not None]
    usual_reaches = {joint.name: _usual_reach(joint) for joint in ideal}
    fastest, behind = _trial(robot, ideal, usual_reaches) if ideal else (np.zeros(0), np.zeros(0))
    needed = {joint.name: SPARE * v + SEEMING for joint, v in zip(ideal, fastest, strict=True)}
    margin: dict[str, float] = {}
    speed: dict[str, float] = {}
    said: list[str] = []
    too_slow: dict[str, float] = {}
    for joint in robot.joints:
        usual, span = HINGES["speed"], joint.range[1] - joint.range[0]
        if joint.kind == "slide":
            margin[joint.name] = max(SLIDES["range_margin"] * span, NOISE * STEP)
            usual = SLIDES["speed"] * span
        need = needed.get(joint.name, 0.0)
        if max(usual, need) > usual or joint.kind == "slide":
            speed[joint.name] = max(usual, need)
        if (own := _stated_speed(joint, stated)) is None:
            continue
        if joint.name in needed and own >= need:
            speed[joint.name] = own
            continue
        speed[joint.name] = own if own >= SPARE * SEEMING else own + SEEMING
        said.append(_slower(robot, joint, own, speed[joint.name], needed.get(joint.name)))
        if joint.name in needed:
            too_slow[joint.name] = speed[joint.name]
    following: dict[str, float] = {}
    for joint, lag in zip(ideal, SPARE * np.maximum(behind, 0.0), strict=True):
        most = most_behind(joint.kind, joint.range)
        if lag <= most:
            following[joint.name] = min(max(_full_error(joint) + lag, _least(joint.kind)), most)
        else:
            said.append(_too_far(joint, lag))
    reach: dict[str, float] = {}
    if too_slow and advised:
        reach = _kept_reach(robot, ideal, usual_reaches, needed, too_slow)
        said.append(
            f"excitations keep to the velocity limits of {robot.model.path.name} with reach='{json.dumps(reach)}'."
            if reach
            else f"no reach was found at which excitations keep to all velocity limits of {robot.model.path.name}."
        )
    found = dict(zip(ASSUMED, (margin, speed, following), strict=True))
    return AssumedLimits(
        {key: {name: float(f"{value:.3g}") for name, value in values.items()} for key, values in found.items()},
        tuple(said),
        reach,
    )


def _least(kind: str) -> float:
    return LEAST if kind == "hinge" else NOISE * STEP


def most_behind(kind: str, ends: tuple[float, float]) -> float:
    """Largest ``following_error`` that means something [rad or m]: no goal is farther from a joint than its range, and
    no joint that follows is a turn behind.

    Args:
        kind: of the joint, hinge or slide.
        ends: of its range [rad or m].
    """
    width = ends[1] - ends[0]
    return max(min(width, TURN) if kind == "hinge" else width, _least(kind))


def _too_far(joint: FileJoint, behind: float) -> str:
    """That a servo is too weak for any limit of how far it stays behind."""
    unit, span = UNITS[joint.kind][0], joint.range[1] - joint.range[0]
    most = "a turn" if joint.kind == "hinge" and span > TURN else f"its range of {span:.3g} {unit}"
    return (
        f"{WARNING}joint {joint.name}: with the usual reach its servo may stay {behind:.3g} {unit} behind in "
        f"excitations, more than {most}; no following_error is written for it: give it a stronger servo, "
        "or a limit of your own under deploy: safety."
    )


def _slower(robot: RobotFile, joint: FileJoint, own: float, written: float, need: float | None) -> str:
    """That excitations may need more than a velocity limit that is written, or that nobody knows whether they do."""
    unit = UNITS[joint.kind][0]
    more = "" if written == own else f", with {written - own:.2g} {unit}/s for the steps of an encoder,"
    why = (
        "nobody tried whether its chain keeps to it in excitations"
        if need is None
        else f"excitations of the usual reach may need {need:.3g} {unit}/s"
    )
    return (
        f"joint {joint.name}: its velocity limit of {own:g} {unit}/s in {robot.model.path.name}{more} is written as "
        f"deploy: safety: speed, but {why}; give sealegs deploy a smaller reach= where it stops them."
    )


def _kept_reach(
    robot: RobotFile,
    joints: Sequence[FileJoint],
    usual: Mapping[str, float],
    needed: Mapping[str, float],
    limits: Mapping[str, float],
) -> dict[str, float]:
    """Smaller reaches [rad or m] at which excitations keep to limits of speed [rad/s or m/s]; none: not found."""
    reaches, needs = dict(usual), dict(needed)
    for _ in range(ROUNDS):
        for name, limit in limits.items():
            if needs[name] > limit:
                reaches[name] *= 0.9 * (limit - SEEMING) / (needs[name] - SEEMING)
                reaches[name] = float(f"{reaches[name]:.2g}")
        fastest, _ = _trial(robot, joints, reaches)
        needs = {joint.name: SPARE * v + SEEMING for joint, v in zip(joints, fastest, strict=True)}
        if all(needs[name] <= limit for name, limit in limits.items()):
            return {name: reaches[name] for name in limits}
    return {}


def _usual_reach(joint: FileJoint) -> float:
    return usual_reach(0.5 * (joint.range[1] - joint.range[0]), UNITS[joint.kind][0])


def _stated_speed(joint: FileJoint, stated: Mapping[str, float]) -> float | None:
    """Largest speed that a URDF states for a joint [rad/s or m/s]; None: none, or of the parts of a belt only."""
    if len(joint.terms) != 1 or (speed := stated.get(joint.joint)) is None:
        return None
    (_, ratio), *_ = joint.terms
    return speed * abs(ratio)


def _full_error(joint: FileJoint) -> float:
    """Error at which an ideal servo gives its largest force: so far gravity may hold it behind [rad or m]."""
    limit, stiffness = joint.chain.value("ideal.torque_limit"), joint.chain.value("ideal.stiffness")
    most = joint.range[1] - joint.range[0]  # no goal is farther away
    return 0.0 if limit >= UNLIMITED else min(limit / max(stiffness, 1e-9), most)


def _trial(
    robot: RobotFile, joints: Sequence[FileJoint], reaches: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Largest speed (n,) [rad/s or m/s], and largest error that lasts (n,) [rad or m], of ideal servos.

    All excitations of the library run at once, and goals that jump from one end of the reach to the other. Joints act
    on each other by the inertias of the file's pose.
    """
    goals = np.repeat(_goals(joints, reaches), round(CYCLE / TRIAL), axis=0)
    stiffness, damping, force = (_column(joints, f"ideal.{key}") for key in ("stiffness", "damping", "torque_limit"))
    viscous = np.array([[j.chain.value("friction.viscous") if j.chain.find("friction") else 0.0] for j in joints])
    mobility = _mobility(robot, joints)
    more = np.diag([max(j.chain.armature() - j.model_values["armature"], 0.0) for j in joints])
    mobility = np.linalg.solve(np.eye(len(joints)) + mobility @ more, mobility)
    servos = _Servos(TRIAL * mobility, TRIAL * stiffness + damping, viscous, force)
    position, velocity = goals[0], np.zeros_like(goals[0])
    errors, fastest = np.empty_like(goals), np.zeros(len(joints))
    for row, goal in enumerate(goals):
        error = goal - position
        velocity = servos.after(velocity, stiffness * error)
        position = position + TRIAL * velocity
        errors[row] = error
        fastest = np.maximum(fastest, np.abs(velocity).max(axis=1))
    # what Following asks: the least error of each stretch of LASTS, every cycle
    distances = np.abs(errors[:: round(CYCLE / TRIAL)])
    lasting = np.lib.stride_tricks.sliding_window_view(distances, round(LASTS / CYCLE), axis=0).min(axis=-1)
    return fastest, lasting.max(axis=(0, 2))


class _Servos:
    """Steps of the trial: implicit, so that no stiffness, damping or friction makes them unstable at any inertia."""

    def __init__(self, gain: np.ndarray, slope: np.ndarray, viscous: np.ndarray, force: np.ndarray) -> None:
        """Prepare.

        Args:
            gain: speed that each joint gains in a step by a force on each (n, n) [1/(N.m.s) or 1/(N.s)].
            slope: by which the pull of each servo falls per speed (n, 1) [N.m.s/rad or N.s/m].
            viscous: the same of friction.
            force: largest pull (n, 1) [N.m or N].
        """
        self._gain, self._slope, self._viscous, self._force = gain, slope, viscous, force
        self._answers: dict[bytes, np.ndarray] = {}
        self._free = self._answer(np.ones(len(gain), dtype=bool))

    def after(self, speed: np.ndarray, pull: np.ndarray) -> np.ndarray:
        """Speeds a step later (n, words) [rad/s or m/s], from those now and the pulls of servos at rest there."""
        found = self._free @ (speed + self._gain @ pull)
        side = self._side(found, pull)
        held = np.zeros_like(side)
        for _ in range(SIDES):
            # another set of servos is at its largest pull than was reckoned with; each set gives a stable step
            wrong = np.flatnonzero((side != held).any(axis=0))
            if not len(wrong):
                break
            held[:, wrong] = side[:, wrong]
            for k in wrong:
                free = held[:, k] == 0.0
                constant = np.where(free, pull[:, k], held[:, k] * self._force[:, 0])
                found[:, k] = self._answer(free) @ (speed[:, k] + self._gain @ constant)
            side = self._side(found, pull)
        return found

    def _answer(self, free: np.ndarray) -> np.ndarray:
        """Speeds by those without damping (n, n), where the servos ``free`` (n,) are not at their largest pull."""
        key = free.tobytes()
        if key not in self._answers:
            if len(self._answers) >= KEPT:
                self._answers.clear()
            slope = (self._viscous + self._slope * free[:, None])[:, 0]
            self._answers[key] = np.linalg.inv(np.eye(len(free)) + self._gain * slope)
        return self._answers[key]

    def _side(self, speed: np.ndarray, pull: np.ndarray) -> np.ndarray:
        """1 or -1 where a servo would pull more than it can, else 0."""
        wanted = pull - self._slope * speed
        return np.sign(wanted) * (np.abs(wanted) > self._force)


def _goals(joints: Sequence[FileJoint], reaches: Mapping[str, float]) -> np.ndarray:
    """Goals about the middle of the ranges (time, n, words) [rad or m], every :data:`CYCLE`."""
    from ...gap.experiment import library

    columns = []
    for k, joint in enumerate(joints):
        reach = reaches[joint.name]
        shapes = list(library(0.0, reach, [0, k]).values())  # as library_excitation with seed 0
        count = np.arange(len(shapes[0]))
        jumps = [reach * (1.0 - 2.0 * (count // half % 2)) for half in (40 + 7 * k, 100)]  # joints apart, and together
        columns.append(np.stack([*shapes, *jumps], axis=1))
    return np.stack(columns, axis=1)


def _column(joints: Sequence[FileJoint], key: str) -> np.ndarray:
    return np.array([[joint.chain.value(key)] for joint in joints])


def _mobility(robot: RobotFile, joints: Sequence[FileJoint]) -> np.ndarray:
    """How fast each coordinate gains speed by a force on each (n, n) [1/(kg.m2) or 1/kg]; all other joints give way."""
    mobility = robot.model.mobility
    return np.array(
        [[sum(c * d * mobility[a, b] for a, c in one.terms for b, d in two.terms) for two in joints] for one in joints]
    )
