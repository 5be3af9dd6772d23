"""What to type after a diagnosis: run the proposed experiment, train on the machine as found, or what is missing."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ...common import plugins
from ...common.errors import SealegsError
from ...envs.described.robot_file import is_robot_file
from ...envs.extended import read_extended
from ...envs.robots import ROBOTS, get_robot
from ..checks.drive import EFFORTS, predicted
from ..experiment.proposal import EXPERIMENT_REPEATS, VISIBLE_DIFFERENCE
from ..log.sidecar import read_sidecar
from ..replay.tree import HELD
from ..search.structure import listed
from ..verdict.verdict import NOT_IDENTIFIABLE, JointDiagnosis
from .document import overall, to_document

BENCH = "bench"
RUN = (
    f"Run the proposed experiment {EXPERIMENT_REPEATS} times, with hw= and port= of these servos, and diagnose its "
    "logs together with the old ones:"
)
SETTLED = "No further experiment would tell more."
REFITTED = (
    "Numbers were refitted beyond their tolerance, and no experiment is proposed that would tell which of them is "
    "wrong: measure them apart where you can."
)
TRAIN = "{settled} Train on the machine as found:"
TORQUES = (
    "{settled} The machine as found is in {file}. What torques drive is trained with your own code: tasks give "
    "position goals."
)
MISSING = (
    "Nothing to train on yet: what was found is not identifiable, and no experiment is proposed that would tell. "
    "Needed is a log that shows more: {needed}."
)
DESCRIBE = " The load is not known either: describe it in the file of a robot, so that the motion itself is judged."


def next_step(
    diagnoses: Sequence[JointDiagnosis], written: Mapping[str, Path], logs: Path | None = None
) -> tuple[str, Sequence[str]]:
    """A sentence and the commands that it leads to; no sentence where there is nothing to train on.

    Args:
        diagnoses: one per joint.
        written: files by what they hold.
        logs: folder of the logs, where those of the experiment belong.
    """
    several = len(diagnoses) > 1
    keys = [f"{item.joint} experiment" if several else "experiment" for item in diagnoses if tells(item)]
    commands = [experiment_command(written[key], logs) for key in keys if key in written]
    if commands:
        return RUN, commands
    found = any(item.causes or item.model == "refitted" for item in diagnoses)
    if keys or not found or "extended" not in written:
        return "", ()
    if overall([to_document(item) for item in diagnoses])["verdict"] == NOT_IDENTIFIABLE:
        driven = any(item.problem is not None and item.problem.free_joint is None for item in diagnoses)
        held = next((f.sentence for item in diagnoses for f in item.findings if f.code == HELD), "")
        return MISSING.format(needed=_needed(diagnoses)) + (f" {held}" if held else DESCRIBE if driven else ""), ()
    settled = REFITTED if any(item.refitted for item in diagnoses) else SETTLED
    if any(map(_by_torque, diagnoses)):
        return TORQUES.format(settled=settled, file=written["extended"]), ()
    return TRAIN.format(settled=settled), [train_command(written["extended"].parent)]


def _needed(diagnoses: Sequence[JointDiagnosis]) -> str:
    """What a log would have to show more of: motion, load, and columns that a chain predicts and that it lacks."""
    lacking = [name for name in EFFORTS if any(name in _lacking(item) for item in diagnoses)]
    ways = ["a wider and faster motion (limits=)", "another load"]
    if lacking:
        ways.append(f"the column{'s' if len(lacking) > 1 else ''} {listed(lacking)}")
    return f"{', '.join(ways[:-1])}{',' if len(ways) > 2 else ''} or {ways[-1]}"


def _lacking(diagnosis: JointDiagnosis) -> Sequence[str]:
    """Columns of effort that would tell more of a joint."""
    joint = None if diagnosis.problem is None else diagnosis.problem.joint
    if joint is None:
        return ("current", "duty")
    logged = {name for c, name in enumerate(joint.channels) if np.isfinite(joint.measured[:, c]).any()}
    driven = joint.free_joint is None
    wanted = [name for name in predicted(joint.models[0].chain) if driven or name != "torque"]
    return [name for name in wanted if name not in logged]


def _by_torque(diagnosis: JointDiagnosis) -> bool:
    """Whether a joint was commanded by a torque."""
    joint = None if diagnosis.problem is None else diagnosis.problem.joint
    return joint is not None and any(model.by_torque for model in joint.models)


def tells(diagnosis: JointDiagnosis) -> bool:
    """Whether the proposed experiment tells its rivals apart at all."""
    experiment = diagnosis.experiment
    return experiment is not None and experiment.separation >= VISIBLE_DIFFERENCE


def experiment_command(goals: Path, logs: Path | None = None) -> str:
    """The command that runs a proposed experiment on its robot, with the load that it asks for.

    Args:
        goals: its CSV, with the sidecar beside it.
        logs: folder of the old logs; None: where ``deploy`` puts its own. Of logs with zeros and directions of their
            own, the new ones go beside that folder: they are in those of the model.
    """
    said = read_sidecar(goals)
    words = ["sealegs", "deploy", f"excitation={goals}", f"robot={said.robot}"]
    if said.robot == BENCH:
        words += [f"actuator={chain}" for chain in said.actuators.values() if isinstance(chain, str)]
    try:
        usual = get_robot(said.robot).parameters({})
    except SealegsError:  # said by the command
        usual = {}
    for name, value in said.robot_params.items():
        if value != 0.0 and not math.isclose(value, usual.get(name, math.nan)):
            words.append(f"robot.params.{name}={value:g}")
    if logs is not None:
        words.append(f"out={logs}-model-frame" if said.meta.get("frames") else f"out={logs}")
    return shlex.join([*words, *plugins.arguments()])


def train_command(folder: Path) -> str:
    """The command that trains on the extended model of a folder."""
    robot = read_extended(folder).robot
    task = ["env=track", f"robot={robot}"] if is_robot_file(robot) else [f"env={robot}"] if robot in ROBOTS else []
    return shlex.join(["sealegs", "train", *task, f"extended={folder}", *plugins.arguments()])
