"""How the angles of a log stand to those of the robot's model: zeros and directions, from gravity and coupling.

What the drives did along the measured motion is compared with what the model needs for that motion, for other zeros and
directions of the joints. An arm and its mirror image need the same torques, so what fits better is told and left to a
person.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..load.robot import Frame, LoggedRobot
from ..load.tree import Motion
from ..log.finding import Finding
from ..log.types import MeasuredRun
from .driven_simulator import law_along
from .joint_model import JointModel
from .tree import axis_of, motion_of
from .unlogged import torques_of

SAMPLES = 120  # of all runs together, at which torques are compared
ZEROS = np.radians(np.arange(0.0, 360.0, 20.0))  # [rad] tried
NEAR = np.radians(np.arange(-12.0, 12.5, 2.0))  # [rad] from the best of these, of a joint whose zero is doubted
SWEEPS = 2  # over all joints
SLIP = 0.05  # [rad/s] over which dry friction turns around
CHANGE = 0.01  # share of the torque, mean of the joints, that another frame of one joint must explain more
BETTER = 0.1  # and that all together must before the model's frames are doubted
FAR = 0.3  # [rad] less than this is a cause: an encoder's zero
SHOWS = 0.02  # share of the torque of one joint by which a zero must matter for the log to tell it
OUTSIDE = 0.2  # [rad] by which a joint may pass the model's range


@dataclass(frozen=True, eq=False)
class Torques:
    """What drives did at some samples.

    Attributes:
        joints: their names.
        motion: in the log's frame, of all coordinates (m, nv).
        drive: torques of the chains (m, joints).
        low, high: where each joint went.
    """

    joints: tuple[str, ...]
    motion: Motion
    drive: np.ndarray
    low: np.ndarray
    high: np.ndarray


def check_frames(robot: LoggedRobot, runs: Sequence[MeasuredRun], models: Mapping[str, JointModel]) -> list[Finding]:
    """What is to be said of zeros and directions.

    Args:
        robot: with the frames that are believed: those of the sidecar, else of the model.
        runs: of it.
        models: nominal joints by name; their chains say what the drives did.
    """
    judged = [name for name in models if _judged(robot, name)]
    plain = {name: frame for name, frame in robot.frames.items() if name not in judged}
    torques = _torques(replace(robot, frames=plain), runs, {name: models[name] for name in judged})
    if torques is None:
        return []
    names = torques.joints
    believed = {name: robot.frame(name) for name in names}
    here = _left(robot, torques, believed)
    best, least = dict(believed), here
    for _ in range(SWEEPS):
        for name in names:
            for frame in _candidates(robot, torques, name):
                left = _left(robot, torques, {**best, name: frame})
                if left < least - CHANGE:
                    best, least = {**best, name: frame}, left
    findings = []
    other: dict[str, Frame] = {}
    if here - least > BETTER:
        other = {name: frame for name, frame in best.items() if _apart(frame, believed[name])}
        for name, frame in list(other.items()):
            near = [replace(frame, zero=frame.zero + away) for away in NEAR]
            left = [_left(robot, torques, {**best, name: one}) for one in near]
            best[name] = other[name] = near[int(np.argmin(left))]
        findings.append(_doubted(other, here, _left(robot, torques, best)))
    likely = best if other else believed
    reference = _left(robot, torques, likely)
    silent = [n for n in names if n not in other and not _shows(robot, torques, likely, n, reference)]
    if silent:
        findings.append(_unknown(silent))
    return findings


def _apart(one: Frame, other: Frame) -> bool:
    return one.sign != other.sign or abs(np.angle(np.exp(1j * (one.zero - other.zero)))) > FAR


def _judged(robot: LoggedRobot, name: str) -> bool:
    """Whether a joint is a hinge that its drive turns one to one: through a ratio, zeros of drive and joint differ."""
    return not robot.slides(name) and robot.number(name) >= 0 and robot.ratio(name) == 1.0


def _torques(robot: LoggedRobot, runs: Sequence[MeasuredRun], models: Mapping[str, JointModel]) -> Torques | None:
    """The torques of hinges whose chain says what their drive did, at some samples of the runs."""
    names = list(models)
    if not names or not all(robot.turns(joint) for joint in range(robot.model.njnt)):
        return None
    each = max(SAMPLES // len(runs), 20)
    motions, drives = [], []
    for run in runs:
        motion = motion_of(robot, run)
        chosen = np.unique(np.linspace(0.02 * len(run.time), 0.98 * len(run.time) - 1, each).astype(int))
        motions.append([getattr(motion, key)[chosen] for key in ("position", "speed", "acceleration")])
        columns = [_drive(run, name, models[name], motion, robot) for name in names]
        if any(column is None for column in columns):
            return None
        drives.append(np.stack([column[chosen] for column in columns if column is not None], axis=1))
    whole = Motion(*(np.concatenate([motion[k] for motion in motions]) for k in range(3)))
    axes = [axis_of(robot, name, runs) for name in names]
    return Torques(
        tuple(names),
        whole,
        np.concatenate(drives),
        np.array([axis.low for axis in axes]),
        np.array([axis.high for axis in axes]),
    )


def _drive(run: MeasuredRun, name: str, model: JointModel, motion: Motion, robot: LoggedRobot) -> np.ndarray | None:
    """Torque of a joint's chain along its measured motion (n,)."""
    log = run.joints[name]
    command = log.torque_command if model.by_torque else log.goal
    if command is None:
        return None
    dof = int(robot.model.jnt_dofadr[robot.number(name)])
    out = np.empty((len(run.time), 5))
    on = np.ones(len(run.time), bool) if log.enabled is None else log.enabled > 0.5
    zeros = np.zeros(len(run.time))
    program = model.chain.program()
    still = replace(model, load=JointModel(model.chain).load)
    law_along(
        program, still.constants({}, program), zeros + 1.0, run.time - run.time[0], command, on,
        motion.position[:, dof].copy(), motion.speed[:, dof].copy(), zeros, out,
    )  # fmt: skip
    return out[:, 0]


def _left(robot: LoggedRobot, torques: Torques, frames: Mapping[str, Frame]) -> float:
    """Mean share of the joints' torque that the model leaves over with these frames."""
    model = robot.model
    q, w, a = (getattr(torques.motion, key).copy() for key in ("position", "speed", "acceleration"))
    dofs = [int(model.jnt_dofadr[robot.number(name)]) for name in torques.joints]
    for name, dof in zip(torques.joints, dofs, strict=True):
        frame = frames[name]
        q[:, dof] = frame.sign * (q[:, dof] - frame.zero)
        w[:, dof] *= frame.sign
        a[:, dof] *= frame.sign
    need = torques_of(model, Motion(q, w, a))
    shares = []
    for j, (name, dof) in enumerate(zip(torques.joints, dofs, strict=True)):
        speed = torques.motion.speed[:, dof]
        passive = np.stack([np.tanh(speed / SLIP), speed, torques.motion.acceleration[:, dof]], axis=1)
        drive = _beside(passive, torques.drive[:, j])
        load = _beside(passive, frames[name].sign * need[:, dof])
        size = float(load @ load)
        scale = max(float(load @ drive) / size, 0.0) if size > 1e-12 else 0.0  # a mass is positive
        whole = float(drive @ drive)
        shares.append(float(np.sum((drive - scale * load) ** 2)) / whole if whole > 1e-12 else 1.0)
    return float(np.mean(shares))


def _beside(passive: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (m,) less what friction and armature explain of them."""
    return values - passive @ np.linalg.lstsq(passive, values, rcond=None)[0]


def _candidates(robot: LoggedRobot, torques: Torques, name: str) -> list[Frame]:
    """Frames in which a joint stays within the model's range."""
    j, number = torques.joints.index(name), robot.number(name)
    low, high = torques.low[j], torques.high[j]
    found = []
    for sign in (1.0, -1.0):
        for zero in ZEROS:
            frame = Frame(float(np.angle(np.exp(1j * zero))), sign)
            ends = sorted((sign * (low - frame.zero), sign * (high - frame.zero)))
            if robot.model.jnt_limited[number]:
                lower, upper = robot.model.jnt_range[number]
                if ends[0] < lower - OUTSIDE or ends[1] > upper + OUTSIDE:
                    continue
            found.append(frame)
    return found


def _shows(robot: LoggedRobot, torques: Torques, frames: dict[str, Frame], name: str, reference: float) -> bool:
    """Whether another zero of a joint would explain the torques worse."""
    frame = frames[name]
    turned = [replace(frame, zero=frame.zero + turn) for turn in (-0.5, 0.5)]
    worse = max(_left(robot, torques, {**frames, name: other}) for other in turned) - reference
    return worse > SHOWS / len(torques.joints)


def _doubted(frames: Mapping[str, Frame], here: float, least: float) -> Finding:
    said = "; ".join(
        f"{name}: {{zero: {frame.zero:.2f}, direction: {frame.sign:.0f}}}" for name, frame in frames.items()
    )
    return Finding(
        "robot.frame", "warning", None, None,
        f"The drives' torque fits the model's gravity and coupling badly ({here:.0%} is left over), and better with "
        f"other zeros or directions ({least:.0%}), for instance {said}. Check how the angles of log and model stand "
        "to each other, and write what is right into the sidecar under meta: frames.",
        value=here - least,
    )  # fmt: skip


def _unknown(names: Sequence[str]) -> Finding:
    return Finding(
        "robot.frame_unknown", "note", None, None,
        f"Neither gravity nor coupling tells the zero of {', '.join(names)}: the model's is believed.",
    )  # fmt: skip
