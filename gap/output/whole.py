"""The extended model as a whole robot: all joints together in the engine along the log, beside the nominal one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...actuators import Chain, load_chain
from ...common.errors import SealegsError
from ...envs.described.as_robot import as_robot
from ...envs.extended import Extended
from ..load.robot import LoggedRobot, Machine
from ..log.progress import Progress
from ..log.types import MeasuredRun, MeasuredSet
from ..measure.case import ROBOT
from ..prepare.checking import check_log
from ..prepare.resting import without_rests
from ..replay.engine import Whole, replay_whole, whole, why_not_whole
from ..verdict.verdict import JointDiagnosis
from .extension import Taken, as_taken, believed_still

MODELS = ("nominal", "extended")


def confirm_whole(
    diagnoses: Sequence[JointDiagnosis],
    data: MeasuredSet,
    extended: Extended,
    progress: Progress = lambda text: None,
    taken: Taken = "all",
    models: Sequence[str] = MODELS,
) -> dict[str, Any] | None:
    """Error of each joint when the whole robot is simulated along the log.

    Args:
        diagnoses, data: of the robot.
        extended: its model.
        progress: is told what goes on.
        taken: what ``extended`` takes of the diagnoses.
        models: that are simulated.

    Returns:
        By joint the root mean square of the error of each model, in the unit of the joint; a ``reason`` where the robot
        cannot be simulated so; None where the log is of no robot with a file.
    """
    if Machine.of(data.runs).robot is None:
        return None
    data, *_ = check_log(data, lambda text: None)  # in the model's units, and mended as where it was judged
    machine, _ = without_rests(Machine.of(as_taken(data, diagnoses).runs))
    data, robot = replace(data, runs=machine.runs), machine.robot
    if robot is None:
        return None
    if (why := why_not_whole(robot, data.runs)) is not None:
        return {"reason": f"The robot was not simulated as a whole: {why}."}
    progress("simulating the whole robot along the log")
    found = {diagnosis.joint: diagnosis for diagnosis in diagnoses if diagnosis.joint != ROBOT}
    still = [name for name, diagnosis in found.items() if believed_still(diagnosis, taken)]
    squares: dict[str, dict[str, list[np.ndarray]]] = {name: {model: [] for model in models} for name in found}
    machines: dict[str, Whole] = {}
    try:
        numbers = {"nominal": dict(extended.params or {}), "extended": extended.params_on(as_robot(robot.file))}
        for index, run in enumerate(data.runs):
            for model in models:
                as_found = {name: d for name, d in found.items() if model == "extended" and name not in still}
                chains = {name: _chain(robot, run, name, found.get(name), index, name in as_found) for name in found}
                key = model + "".join(chain.to_yaml() for chain in chains.values())
                if key not in machines:
                    machines[key] = whole(robot, chains, numbers[model])
                for name, error in _errors(machines[key], run, index, list(found), as_found).items():
                    squares[name][model].append(error**2)
    except SealegsError as error:
        return {"reason": f"The robot was not simulated as a whole: {error}"}
    joints = {
        name: {model: float(np.sqrt(np.mean(np.concatenate(parts)))) for model, parts in of.items()}
        | {"unit": robot.joint(name).unit}
        for name, of in squares.items()
    }
    return {"runs": [run.name for run in data.runs], "joints": joints}


def _chain(
    robot: LoggedRobot, run: MeasuredRun, name: str, found: JointDiagnosis | None, index: int, as_found: bool
) -> Chain:
    """The chain of a joint in a run, in the frame of the robot's model."""
    if found is not None and found.problem is not None and found.problem.joint is not None:
        joint = found.problem.joint.models[index]
        chain = joint.with_fitted(found.values).chain if as_found else joint.chain
    elif name in run.actuators:
        chain = robot.joint(name).carried(load_chain(run.actuators[name]))
    else:
        return robot.joint(name).chain  # in that frame already
    return robot.frame(name).chain_to_model(chain)


def _errors(
    machine: Whole, run: MeasuredRun, index: int, names: Sequence[str], as_found: Mapping[str, JointDiagnosis]
) -> dict[str, np.ndarray]:
    """Errors of joints (n,), each reading as the host's log has it."""
    hosts = dict.fromkeys(names, (1.0, 0.0))
    for name, diagnosis in as_found.items():
        if diagnosis.problem is not None and diagnosis.problem.joint is not None:
            joint = diagnosis.problem.joint.models[index].with_fitted(diagnosis.values)
            hosts[name] = joint.host_scale, joint.host_offset
    joints = dict(run.joints)
    for name, (scale, offset) in hosts.items():
        joints[name] = replace(joints[name], position=(joints[name].position - offset) / scale)
    readings = replay_whole(machine, replace(run, joints=joints))
    errors = {}
    for name, (scale, offset) in hosts.items():
        error = scale * readings[name] + offset - run.joints[name].position
        log = run.joints[name]
        free = True if log.touched is None or log.always_touched else log.touched < 0.5
        errors[name] = error[np.isfinite(error) & free]
    return errors
