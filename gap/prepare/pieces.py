"""One joint of a log, cut into parts: its chain, its model, and what it works against."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from hashlib import blake2b
from types import MappingProxyType

import numpy as np

from ...actuators.chain import Chain, load_chain
from ...actuators.stages.power import motor_behind
from ...common.errors import SealegsError
from ..causes.unknown import unknown_parameters
from ..checks.data_set import noise_floor
from ..checks.signal import derivatives
from ..experiment import Along
from ..load.load import hung
from ..load.robot import LoggedRobot, Machine
from ..load.terms import T_OWN, T_SIZE
from ..load.tree import Motion
from ..log.finding import Finding
from ..log.parts import TEST, Unit, between_gaps, cut
from ..log.types import Array, LogError, MeasuredRun
from ..replay.driven_simulator import law_along
from ..replay.flattened import flattened
from ..replay.free import FreeProblem, free_problem
from ..replay.joint_model import JointModel
from ..replay.parameters import Target, address
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


# --- what the joints of a robot do to each other: how each moves, and what its drive draws from the supply of all ----
#
# Both follow from a replay of each joint. A first look at all of them knows their numbers better than what is
# believed: a joint whose rotor is heavier than believed moves less sharply, and shakes its neighbours less.
#
# Few logs have currents. A drive's duty follows from its goals and its measured motion, and duty and speed give the
# current: a bridge draws its duty times the motor's current, and returns nothing. Between two slow rows a jump of the
# goal draws its most and decays, and no row sees that. So what was logged counts as far as a row foresees the next one,
# and what goals and motion say for the rest.

MOMENTS = 8
"""Of a row, at which a duty is worked out: goals take effect between two rows."""
NOTHING_FOUND: Mapping[str, Mapping[str, float]] = MappingProxyType({})


def with_neighbours(machine: Machine, found: Mapping[str, Mapping[str, float]] = NOTHING_FOUND) -> Machine:
    """The machine with what is known of the neighbours of each joint; as it is where there is no robot's file.

    Args:
        machine: that was logged.
        found: numbers of joints that are better known than what is believed, by joint and path.
    """
    robot = machine.robot
    if robot is None:
        return machine
    runs, driven = [], {item.name for item in robot.file.joints if robot.number(item.name) >= 0}
    for run in machine:
        names = [name for name in run.joints if name in driven]
        draws = {name: drawn_by(run, name, robot, found.get(name, {})) for name in names} if len(names) > 1 else {}
        runs.append(
            replace(run, draws={name: rows for name, rows in draws.items() if rows is not None}, seen=dict(found))
        )
    return Machine.of(runs)


def drawn_by(run: MeasuredRun, joint: str, robot: LoggedRobot, found: Mapping[str, float]) -> Array | None:
    """What one drive draws at full voltage, and less of it per volt of sag (n, 2); None where nothing tells.

    Args:
        run, joint: that were logged.
        robot: of the run.
        found: numbers of the drive by path, beside what is believed.
    """
    log = run.joints[joint]
    own = {path: value for path, value in found.items() if address(path).target is Target.STAGE}
    model = JointModel(chain_of(run, joint, robot)).with_fitted(own)
    supply, command = model.chain.find("supply"), getattr(log, model.command)
    if supply is None or not model.chain.shares_supply():
        return None
    on = np.ones(len(run.time)) if log.enabled is None else log.enabled
    motor, read = motor_behind(model.chain, supply), None
    good = np.isfinite(log.position)
    if good.any():
        smooth, rate, _ = derivatives(run.time, np.interp(run.time, run.time[good], log.position[good]))
    if log.duty is not None and log.current is not None:
        read = np.stack([np.maximum(np.nan_to_num(log.duty * log.current), 0.0), np.zeros(len(run.time))], axis=1)
    elif log.duty is not None and good.any():
        read = _drawn(np.nan_to_num(log.duty), rate, supply.volts, motor)
    if command is None or not np.isfinite(command).any() or not good.any():
        return None if read is None else on[:, None] * read
    count = len(run.time)
    at = np.interp(np.arange(MOMENTS * count) / MOMENTS, np.arange(count), run.time)
    speed = np.interp(at, run.time, rate)
    duty = _duty(model, at - at[0], _held(run.time, command, at), np.interp(at, run.time, smooth), speed)
    within = _drawn(np.nan_to_num(duty), speed, supply.volts, motor)
    drawn = within.reshape(-1, MOMENTS, 2).mean(axis=1)
    if read is not None:
        seen = seen_share(read[:, 0])
        drawn = seen * read + (1.0 - seen) * drawn
    return on[:, None] * drawn


def seen_share(values: Array) -> float:
    """Share of a column (n,) that its neighbouring rows foresee: what runs on between rows was seen by them."""
    if len(values) < 3:
        return 1.0
    foreseen = 0.5 * (values[2:] + values[:-2])
    power = 1.5 * float(np.var(values))  # of an error of foresight where rows have nothing in common
    return 1.0 - min(float(np.mean((values[1:-1] - foreseen) ** 2)) / power, 1.0) if power > 0.0 else 1.0


def _drawn(duty: Array, speed: Array, volts: float, motor: Mapping[str, float]) -> Array:
    """What a drive draws at a duty and a speed (n,), and less of it per volt of sag (n, 2)."""
    drawn = duty * (duty * volts - motor["back_emf"] * speed) / motor["motor_resistance"]
    less = np.where(drawn > 0.0, duty**2 / motor["motor_resistance"], 0.0)
    return np.stack([np.maximum(drawn, 0.0), less], axis=1)


def _held(time: Array, command: Array, at: Array) -> Array:
    """The command in force (m,) at other times ``at`` (m,), from rows (n,) of which some may be empty."""
    known = np.isfinite(command)
    return command[known][np.maximum(np.searchsorted(time[known], at, "right") - 1, 0)]


def _duty(model: JointModel, time: Array, goal: Array, position: Array, speed: Array) -> Array:
    """Duty of a drive along a motion of its joint (n,)."""
    zeros, out = np.zeros(len(time)), np.empty((len(time), 5))
    program = model.chain.program()
    constants = model.constants({}, program)
    law_along(program, constants, zeros + 1.0, time, goal, zeros == 0.0, position, w=speed, external=zeros, out=out)
    return out[:, 2]
