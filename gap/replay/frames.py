"""How the angles of a log stand to those of the robot's model: zeros and directions, from gravity and coupling.

What the drives did along the measured motion is compared with what the model needs for that motion, for other zeros and
directions of the joints. An arm and its mirror image need the same torques: of such frames, those are proposed that
differ at the fewest joints. Directions of slides are asked in :mod:`sealegs.gap.replay.slide_directions`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from ..load.resting import REVERSAL_SPEED
from ..load.robot import Frame, LoggedRobot, Turned
from ..load.tree import Motion
from ..log.types import MeasuredRun
from .driven_simulator import law_along
from .joint_model import JointModel
from .tree import MARGIN, axis_of, motion_of, torques_of

SAMPLES = 300  # of all runs together, at which torques are compared
FINE = 3000  # the same where zeros are sought between the points of the grid
ZEROS = np.radians(np.arange(0.0, 360.0, 20.0))  # [rad] tried
NEAR = np.radians(12.0)  # [rad] from the best of these to where the zero of a doubted joint is then sought
TURNS = 2  # of each joint, at most
CHANGE = 0.02  # share of the torque, mean of the joints, that another frame of one joint must explain more
BETTER = 0.1  # and that all together must before the model's frames are doubted
FAR = 0.3  # [rad] less than this is a cause: an encoder's zero
PLAIN = 0.4  # share of what other frames explain that may be given up for plainer ones
UNSURE = 0.5  # [rad] up to which a zero may be one that a wrong mass pretends
SHOWS = 0.02  # share of the torque of one joint by which a zero must matter for the log to tell it
OUTSIDE = 0.2  # [rad] by which a joint may pass the model's range
SLIPS = 0.005  # [m/s] over which dry friction of a slide turns around


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


@dataclass(frozen=True)
class Proposed:
    """Zeros and directions that the drives' torques speak for.

    Attributes:
        frames: of the joints whose frame is doubted, by name.
        least: mean share of the joints' torque that the model leaves over with them.
        mirrored: joints that are turned in the mirror image of these frames, which fits as well; () where none does.
    """

    frames: Mapping[str, Frame]
    least: float
    mirrored: tuple[str, ...] = ()


@dataclass(frozen=True)
class Compared:
    """Log and model, by zeros and directions.

    Attributes:
        left: mean share of the joints' torque that the model leaves over as believed.
        proposed: what fits better, where anything does: first frames that differ little from what is believed and
            explain most of what the last ones do.
        silent: joints whose zero neither gravity nor coupling tells.
    """

    left: float
    proposed: tuple[Proposed, ...]
    silent: tuple[str, ...]


def compare_frames(
    robot: LoggedRobot, runs: Sequence[MeasuredRun], models: Sequence[Mapping[str, JointModel]]
) -> Compared | None:
    """Zeros and directions that fit better than those believed; None where the runs cannot tell.

    Args:
        robot: with the frames that are believed: those of the sidecar, else of the model.
        runs: of it.
        models: nominal joints of each run by name; their chains say what the drives did.
    """
    judged = [name for name in models[0] if _judged(robot, name)]
    plain = {name: frame for name, frame in robot.frames.items() if name not in judged}
    machine, drives = replace(robot, frames=plain), [{name: each[name] for name in judged} for each in models]
    torques = torques_along(machine, runs, drives, SAMPLES)
    if torques is None:
        return None
    believed = {name: robot.frame(name) for name in torques.joints}
    here = _left(robot, torques, believed)
    best, least = dict(believed), here
    for _ in range(TURNS * len(torques.joints)):  # the one that helps most first: others may do in its place
        tried = [
            {**best, name: frame} for name in torques.joints for frame in _candidates(robot, torques, name, best[name])
        ]
        left = [_left(robot, torques, frames) for frames in tried]
        if not left or min(left) > least - CHANGE:
            break
        best, least = tried[int(np.argmin(left))], min(left)
    proposed: list[Proposed] = []
    if here - least > BETTER:
        torques = torques_along(machine, runs, drives, FINE) or torques
        here = _left(robot, torques, believed)
        sought = _sought(robot, torques, believed, best)
        for frames in (_plainer(robot, torques, believed, sought), sought):
            chosen, mirrored = _likelier(robot, torques, believed, frames)
            found = _changed(chosen, believed)
            if found and found not in [other.frames for other in proposed]:
                proposed.append(Proposed(found, _left(robot, torques, {**believed, **found}), mirrored))
    other = proposed[-1].frames if proposed else {}
    likely = {**believed, **other}
    least = _left(robot, torques, likely)
    silent = [name for name in believed if name not in other and not _shows(robot, torques, likely, name, least)]
    return Compared(here, tuple(proposed), tuple(silent))


def _sought(
    robot: LoggedRobot, torques: Torques, believed: Mapping[str, Frame], best: Mapping[str, Frame]
) -> dict[str, Frame]:
    """The best frames of a grid with the zeros of doubted joints between its points."""
    found = dict(best)
    names = list(_changed(best, believed))
    if not names:
        return found
    starts = np.array([best[name].zero for name in names])

    def moved(zeros: np.ndarray) -> dict[str, Frame]:
        return found | {name: replace(best[name], zero=float(z)) for name, z in zip(names, zeros, strict=True)}

    sought = minimize(
        lambda zeros: _left(robot, torques, moved(zeros)),
        starts,
        method="Powell",
        bounds=[(start - NEAR, start + NEAR) for start in starts],
        options={"xtol": 1e-2, "ftol": 1e-4},
    )
    return moved(sought.x)


def _plainer(
    robot: LoggedRobot, torques: Torques, believed: Mapping[str, Frame], sought: Mapping[str, Frame]
) -> dict[str, Frame]:
    """The same frames with as many zeros and directions as believed as the torques allow."""
    found, here, least = dict(sought), _left(robot, torques, believed), _left(robot, torques, sought)
    enough = least + max(PLAIN * (here - least), CHANGE)
    names = _changed(sought, believed)
    plainer = [{name: believed[name]} for name in names]
    plainer += [
        {name: replace(found[name], zero=believed[name].zero)}
        for name in names
        if abs(found[name].zero - believed[name].zero) < UNSURE
    ]
    for plain in sorted(plainer, key=lambda plain: _left(robot, torques, {**found, **plain})):
        if _left(robot, torques, {**found, **plain}) < enough:
            found |= plain
    return found


def _likelier(
    robot: LoggedRobot, torques: Torques, believed: Mapping[str, Frame], best: Mapping[str, Frame]
) -> tuple[dict[str, Frame], tuple[str, ...]]:
    """These frames or their mirror image, if that fits as well: whichever keeps more joints within the model's ranges,
    else turns fewer; and the joints that the other turns, where it keeps as many within them.
    """
    image = {name: replace(frame, sign=-frame.sign) for name, frame in best.items()}
    if _left(robot, torques, image) > _left(robot, torques, best) + CHANGE:
        return dict(best), ()

    def turned(frames: Mapping[str, Frame]) -> tuple[str, ...]:
        return tuple(name for name, frame in frames.items() if frame.sign != believed[name].sign)

    def outside(frames: Mapping[str, Frame]) -> int:
        return sum(not within(robot, torques, name, frame) for name, frame in frames.items())

    one, other = sorted((dict(best), image), key=lambda frames: (outside(frames), len(turned(frames))))
    return one, turned(other) if outside(other) <= outside(one) else ()


def _changed(frames: Mapping[str, Frame], believed: Mapping[str, Frame]) -> dict[str, Frame]:
    """Those of the frames that differ from what is believed."""
    return {name: frame for name, frame in frames.items() if _apart(frame, believed[name])}


def _apart(one: Frame, other: Frame) -> bool:
    return one.sign != other.sign or abs(np.angle(np.exp(1j * (one.zero - other.zero)))) > FAR


def _judged(robot: LoggedRobot, name: str) -> bool:
    """Whether a joint is a hinge that its drive turns one to one: through a ratio, zeros of drive and joint differ."""
    return not robot.slides(name) and plainly_driven(robot, name)


def plainly_driven(robot: LoggedRobot, name: str) -> bool:
    """Whether a joint of the model moves as its columns say, through no ratio."""
    return robot.number(name) >= 0 and robot.ratio(name) == 1.0


def torques_along(
    robot: LoggedRobot, runs: Sequence[MeasuredRun], models: Sequence[Mapping[str, JointModel]], samples: int
) -> Torques | None:
    """The torques of joints whose chain says what their drive did, at some samples of the runs."""
    names = list(models[0])
    if not names or not all(robot.turns(joint) for joint in range(robot.model.njnt)):
        return None
    each = max(samples // len(runs), 20)
    motions, drives = [], []
    for run, chains in zip(runs, models, strict=True):
        motion = motion_of(robot, run)
        chosen = np.unique(np.linspace(0.02 * len(run.time), 0.98 * len(run.time) - 1, each).astype(int))
        motions.append([getattr(motion, key)[chosen] for key in ("position", "speed", "acceleration")])
        columns = [_drive(run, name, chains[name], motion, robot) for name in names]
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
    command = getattr(log, model.command)
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
        motion.position[:, dof].copy(), w=motion.speed[:, dof].copy(), external=zeros, out=out,
    )  # fmt: skip
    return out[:, 0]


def _left(robot: LoggedRobot, torques: Torques, frames: Mapping[str, Frame]) -> float:
    """Mean share of the joints' torque that the model leaves over with these frames."""
    return float(np.mean(shares_of(robot, torques, frames)))


def shares_of(robot: LoggedRobot, torques: Torques, frames: Mapping[str, Frame], *, level: bool = False) -> list[float]:
    """Share of each joint's torque that the model leaves over with these frames; with ``level`` beside a constant."""
    shares = []
    for drive, load in _compared(robot, torques, frames, level):
        size = float(load @ load)
        scale = max(float(load @ drive) / size, 0.0) if size > 1e-12 else 0.0  # a mass is positive
        whole = float(drive @ drive)
        shares.append(float(np.sum((drive - scale * load) ** 2)) / whole if whole > 1e-12 else 1.0)
    return shares


def load_of(robot: LoggedRobot, torques: Torques, frames: Mapping[str, Frame], name: str) -> float:
    """How many times the model's load a joint's drive carries."""
    drive, load = _compared(robot, torques, frames)[torques.joints.index(name)]
    return float(load @ drive) / max(float(load @ load), 1e-12)


def _compared(
    robot: LoggedRobot, torques: Torques, frames: Mapping[str, Frame], level: bool = False
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Torque of each joint's drive and its load by the model (m,), less what friction and armature explain."""
    model = robot.model
    q, w, a = (getattr(torques.motion, key).copy() for key in ("position", "speed", "acceleration"))
    for name, frame in frames.items():
        dof = int(model.jnt_dofadr[robot.number(name)])
        q[:, dof] = frame.sign * (q[:, dof] - frame.zero)
        w[:, dof] *= frame.sign
        a[:, dof] *= frame.sign
    need = torques_of(model, Motion(q, w, a))
    found = []
    for j, name in enumerate(torques.joints):
        dof = int(model.jnt_dofadr[robot.number(name)])
        speed, slip = torques.motion.speed[:, dof], SLIPS if robot.slides(name) else REVERSAL_SPEED
        columns = [np.tanh(speed / slip), speed, torques.motion.acceleration[:, dof]]
        passive = np.stack([*columns, np.ones(len(speed))] if level else columns, axis=1)
        drive = _beside(passive, torques.drive[:, j])
        load = _beside(passive, frames[name].sign * Turned(model, robot.number(name)).along(need))
        found.append((drive, load))
    return found


def _beside(passive: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (m,) less what friction and armature explain of them."""
    return values - passive @ np.linalg.lstsq(passive, values, rcond=None)[0]


def _candidates(robot: LoggedRobot, torques: Torques, name: str, now: Frame) -> list[Frame]:
    """Frames in which a joint stays within the model's range, the present one turned around among them."""
    zeros = (now.zero, *(float(np.angle(np.exp(1j * zero))) for zero in ZEROS))
    every = [Frame(zero, sign) for sign in (1.0, -1.0) for zero in zeros]
    return [frame for frame in every if within(robot, torques, name, frame)]


def within(robot: LoggedRobot, torques: Torques, name: str, frame: Frame) -> bool:
    """Whether a joint stayed within the model's range, if it has one, by a frame."""
    j = torques.joints.index(name)
    return stays(robot, name, frame, float(torques.low[j]), float(torques.high[j]))


def stays(robot: LoggedRobot, name: str, frame: Frame, low: float, high: float) -> bool:
    """Whether a joint that went from one place of the log to another [rad or m] stayed within the model's range."""
    number = robot.number(name)
    if not robot.model.jnt_limited[number]:
        return True
    ends = frame.to_model(np.array([low, high]))
    lower, upper = robot.model.jnt_range[number]
    margin = MARGIN * (upper - lower) if robot.slides(name) else OUTSIDE
    return bool(ends.min() >= lower - margin and ends.max() <= upper + margin)


def _shows(robot: LoggedRobot, torques: Torques, frames: dict[str, Frame], name: str, reference: float) -> bool:
    """Whether another zero of a joint would explain the torques worse."""
    frame = frames[name]
    turned = [replace(frame, zero=frame.zero + turn) for turn in (-0.5, 0.5)]
    worse = max(_left(robot, torques, {**frames, name: other}) for other in turned) - reference
    return worse > SHOWS / len(torques.joints)
