"""One joint of a log, cut into parts: its chain, its model, and what it works against."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from hashlib import blake2b

import numpy as np

from ...actuators.chain import Chain, load_chain
from ...common.errors import SealegsError
from ..causes.unknown import unknown_parameters
from ..checks.data_set import noise_floor
from ..experiment import Along
from ..load.pendulum import hung
from ..load.robot import LoggedRobot, Machine
from ..load.terms import T_OWN, T_SIZE
from ..load.tree import Motion
from ..log.finding import Finding
from ..log.parts import TEST, Unit, between_gaps, cut
from ..log.types import Array, LogError, MeasuredRun
from ..replay.flattened import flattened
from ..replay.free import FreeProblem, free_problem
from ..replay.joint_model import JointModel
from ..replay.scene import untouched
from ..replay.tree import held_still, held_terms, joint_of_tree, motion_of, not_free, owned, terms_of, told_range
from ..search.structure import fine
from .columns import commanded

MODEL_PRECISION = 1e-4  # of a joint's motion, to which no rigid model of a robot is right: assumed


@dataclass(frozen=True, eq=False)
class Cut:
    """One joint of a log, cut into parts.

    Attributes:
        runs, models: the runs and the nominal joint of each.
        units: pieces of runs, each in one part.
        noise: of a position sample [rad].
        terms: what a joint of a robot works against in each run (samples, T_COLUMNS).
        findings: about the robot.
        along: as of :class:`Replay`.
    """

    joint: str
    runs: Sequence[MeasuredRun]
    models: Sequence[JointModel]
    units: Sequence[Unit]
    noise: float
    terms: Sequence[np.ndarray] | None = None
    findings: tuple[Finding, ...] = ()
    along: Along | None = None


def cut_joint(machine: Machine, joint: str, test_group: str | None, more: Sequence[Array] | None = None) -> Cut:
    """One joint of a machine, cut into parts.

    Args:
        machine: that was logged.
        joint: its name.
        test_group: group of runs that is kept for the test.
        more: of a joint of a robot, what is added to the load that its file gives, in each run (samples, T_SIZE).

    Raises:
        SealegsError: a chain cannot be had, or the runs are too short.
    """
    robot, runs = machine.robot, machine.runs
    missing = [run.name for run in runs if joint not in run.actuators]
    if missing and robot is None:
        raise LogError(f"{missing[0]}: the sidecar names no actuator for joint '{joint}'; add it under 'actuators'.")
    chains = [chain_of(run, joint, robot) for run in runs]
    terms, findings = None, []
    if robot is not None:
        armature = chains[0].armature()
        why = not_free(robot, joint, runs, armature)
        if why is not None:
            runs = tuple(untouched(runs, joint))
        else:
            terms = terms_of(robot, joint, runs, _motions(robot, _Logged(_digest(runs), tuple(runs))))
            for table, added in zip(terms, more or (), strict=False):
                table[:, T_OWN : T_OWN + T_SIZE] += added
        notes = (owned(robot, joint, chains[0]), held_still(robot, joint, runs, armature) if why is None else why)
        notes = (*notes, told_range(robot, joint, runs) if why is None else None)
        findings += [said for said in notes if said is not None]
        if missing and (assumed := robot.joint(joint).notes):
            findings.append(_assumed(joint, missing[0], assumed))
        models = [joint_of_tree(robot, joint, chain, runs, terms) for chain in chains]
        models = [
            replace(model, unknown=unknown_parameters(run, model.chain, robot.joint(joint).unknown, model.load))
            for run, model in zip(runs, models, strict=True)
        ]
    else:
        load = hung([run.robot_params for run in runs if run.robot == "bench"])
        models = [
            JointModel(chain, load, unknown=unknown_parameters(run, chain))
            for run, chain in zip(runs, chains, strict=True)
        ]
    logged = float(np.median([noise_floor(run, joint) for run in runs]))
    noise = max(logged, MODEL_PRECISION * models[0].axis.span)
    if noise > logged:
        findings.append(_finer(joint, noise, models[0].axis.unit("rad")))
    along = None
    if robot is not None and terms is not None and not (robot.slides(joint) or models[0].by_torque):
        along = held_terms(robot, joint, runs)
    units = cut(runs, joint, test_group)
    if models[0].by_torque:
        units = between_gaps(runs, joint, units)
    return Cut(
        joint, runs=runs, models=models, units=units, noise=noise, terms=terms, findings=tuple(findings), along=along
    )


def fit_runs(pieces: Cut) -> list[MeasuredRun]:
    """The runs with what no fit may see marked as touched: nothing of it is to be read off."""
    found = []
    for number, run in enumerate(pieces.runs):
        log = run.joints[pieces.joint]
        marks = np.ones(len(run.time))
        for unit in pieces.units:
            if unit.run == number and unit.part != TEST:
                marks[unit.start : unit.stop] = 0.0 if log.touched is None else log.touched[unit.start : unit.stop]
        found.append(replace(run, joints={**run.joints, pieces.joint: replace(log, touched=marks)}))
    return found


@dataclass(frozen=True)
class _Logged:
    """Runs that are the same where their contents are, whichever objects hold them."""

    digest: str
    runs: tuple[MeasuredRun, ...] = field(compare=False)


def _digest(runs: Sequence[MeasuredRun]) -> str:
    """Of all that a nominal replay reads."""
    found = blake2b()
    for run in runs:
        found.update(repr((run.robot, run.robot_params, run.actuators, run.meta, list(run.joints), run.seen)).encode())
        found.update(np.ascontiguousarray(run.time).tobytes())
        for log in run.joints.values():
            for signal, values in log.signals().items():
                found.update(signal.encode() + np.ascontiguousarray(values).tobytes())
    return found.hexdigest()


@lru_cache(maxsize=1)
def _motions(robot: LoggedRobot, logged: _Logged) -> list[Motion]:
    """How the robot moved in each run; what smoothing takes from its joints is put back from their replays, with the
    numbers of a first look where there was one.

    The same for every joint of a log, and kept from one to the next.
    """
    runs = logged.runs
    taken = flattened(runs, nominal_replays(robot, runs), runs[0].seen)
    return [motion_of(robot, run, each) for run, each in zip(runs, taken, strict=True)]


def nominal_replays(robot: LoggedRobot, runs: Sequence[MeasuredRun]) -> dict[str, FreeProblem]:
    """Each joint of a robot's runs that can be replayed alone and follows goals, ready to be replayed as believed."""
    problems = {}
    for joint in commanded(runs):
        if not all(joint in run.joints and run.joints[joint].goal is not None for run in runs):
            continue  # what is wrong with one joint is told where that one is judged
        chain = chain_of(runs[0], joint, robot)
        if chain.find("torque_command") is not None or not_free(robot, joint, runs, chain.armature()) is not None:
            continue  # without a controller that holds it near the log, a nominal replay is of another motion
        terms = terms_of(robot, joint, runs, changes=False)
        models = [joint_of_tree(robot, joint, chain_of(run, joint, robot), runs, terms) for run in runs]
        problems[joint] = free_problem(runs, joint, models, cut(runs, joint), {"position": 1.0}, terms)
    return problems


def chain_of(run: MeasuredRun, joint: str, robot: LoggedRobot | None) -> Chain:
    """The chain that the sidecar names, or else the robot's file, whose angle is that of its model."""
    if robot is None:
        return named_chain(run, joint)
    item = robot.joint(joint)
    if joint in run.actuators:
        return item.carried(named_chain(run, joint))
    return item.carried(robot.frame(joint).chain_to_log(item.chain))


def named_chain(run: MeasuredRun, joint: str) -> Chain:
    """The chain that a sidecar names.

    Raises:
        LogError: it cannot be had; the message names the run.
    """
    try:
        return load_chain(run.actuators[joint])
    except SealegsError as error:
        raise LogError(f"{run.name}: actuator of joint '{joint}': {error}") from None


def _assumed(joint: str, run: str, notes: Sequence[str]) -> Finding:
    """That nobody said what drives a joint."""
    return Finding(
        "robot.assumed_drive", "warning", joint, None,
        f"The sidecar of {run} names no actuator for joint '{joint}', and the robot's file has no chain for it: "
        f"{'; '.join(notes)}. Its numbers are nobody's measurement; name the actuator.",
    )  # fmt: skip


def _finer(joint: str, noise: float, unit: str) -> Finding:
    return Finding(
        "noise.finer", "note", joint, f"{joint}.position",
        f"{joint}.position is finer than models of machines are: errors below {fine(noise, unit, 3)} "
        f"({MODEL_PRECISION:g} of the motion, assumed) count as noise.",
    )  # fmt: skip
