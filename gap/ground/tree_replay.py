"""Many pieces of a walking robot's log on many grounds at once, in the engine.

All joints follow their measured motion, so what is judged is how the base moves on the ground. A joint is so heavy that
only the force which makes it follow its path can move it; no drive takes part.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ...envs.engine.base import BaseLayout
from ..checks.signal import derivatives
from ..load.robot import Frame
from ..log.parts import SPEED_REACH
from ..log.types import MeasuredRun
from .pieces import (
    ENGINE_STEP,
    PIECE_SECONDS,
    UNKNOWN_SPEED,
    WITHOUT_END,
    Piece,
    Replayer,
    made_heavy,
    polynomial,
    sample_error,
    thinned,
)
from .problem import Judged
from .tree_model import TreeModel, ground_of

ALONG = ("x", "y", "yaw")  # of the ground: where on it a robot is does not matter
FIT_SAMPLES = 3.5  # to both sides of a start, at least, from which its state is fitted
UNJUDGED_SECONDS = 0.04  # [s] of a piece that is not judged: its contacts settle
START_CHOICE = 0.1
"""[s] within which a piece starts where the base moves most evenly; the first begins as much into its run."""
MAX_PIECES = 36  # pieces of a data set; more cost time and teach little
MODEL_ERRORS = {"m": 5e-4, "rad": 2e-3}
"""What two right models of contact differ by over a piece [m, rad]: assumed, some ticks of the joints at the feet."""
LAW_ERROR = 0.2  # relative, of friction: assumed, an independent walker of soft ground showed 13 and 18 %
START_SPREADS = {"m": 5e-4, "rad": 1e-3}
"""How much less well a start is known than its parabola says [m, rad]: assumed; feet bear on the ground with it."""


@dataclass(frozen=True, eq=False)
class BaseColumns:
    """How the base of a robot was logged.

    Attributes:
        layout: its quantities.
        names: of them, in the order of a state.
        units: m or rad, of each.
        logged: whether each was, in all runs.
    """

    layout: BaseLayout
    names: tuple[str, ...]
    units: tuple[str, ...]
    logged: np.ndarray

    @property
    def directions(self) -> tuple[str, ...]:
        """What each is: ``trunk.roll`` a roll, and so ``torso_pitch`` of a base of slides and hinges a pitch."""
        return tuple(re.split(r"[._]", name)[-1] for name in self.names)

    @staticmethod
    def of(layout: BaseLayout, runs: Sequence[MeasuredRun]) -> BaseColumns:
        """Of some runs."""
        names = layout.names
        logged = [all(_column(run, name) is not None for run in runs) for name in names]
        return BaseColumns(layout, names, tuple(layout.units[name] for name in names), np.array(logged))

    def missing(self) -> list[str]:
        """Columns that a replay cannot do without: what says how the base stands on the ground."""
        rows = zip(self.names, self.directions, self.logged, strict=True)
        return [f"base.{name}" for name, direction, logged in rows if not (logged or direction in ALONG)]

    def judged(self, runs: Sequence[MeasuredRun]) -> Judged:
        """What is compared, with the noise of each column."""
        rows = [[sample_error(run.time, column) for column in self.values(run).T] for run in runs]
        errors = np.array([MODEL_ERRORS[unit] for unit in self.units])
        names = tuple(f"base.{name}" for name in self.names)
        return Judged(names, self.units, errors, np.median(np.array(rows), axis=0), UNJUDGED_SECONDS, LAW_ERROR)

    def values(self, run: MeasuredRun) -> np.ndarray:
        """The columns of a run (n, k), NaN where one was not logged; angles go on beyond a turn."""
        missing = np.full(len(run.time), np.nan)
        found = [_column(run, name) if said else missing for name, said in zip(self.names, self.logged, strict=True)]
        columns = [missing if column is None else column for column in found]
        return np.stack(
            [_whole(c) if unit == "rad" else c for c, unit in zip(columns, self.units, strict=True)], axis=1
        )


def find_pieces(runs: Sequence[MeasuredRun], columns: BaseColumns, judged: Judged) -> list[Piece]:
    """Pieces one behind the other, thinned evenly to :data:`MAX_PIECES`."""
    found = []
    for k, run in enumerate(runs):
        values = columns.values(run)
        rough = _roughness(run, columns, values, judged)
        for begin in np.arange(
            run.time[0] + START_CHOICE, run.time[-1] - PIECE_SECONDS - START_CHOICE, PIECE_SECONDS + START_CHOICE
        ):
            first, last = np.searchsorted(run.time, (begin, begin + START_CHOICE))
            start = int(first + np.argmin(rough[first : max(last, first + 1)]))
            stop = int(np.searchsorted(run.time, run.time[start] + PIECE_SECONDS))
            if (piece := _piece(run, columns, values, k, start, stop, judged)) is not None:
                found.append(piece)
    return thinned(found, MAX_PIECES)


def _roughness(run: MeasuredRun, columns: BaseColumns, values: np.ndarray, judged: Judged) -> np.ndarray:
    """How much each sample's neighbourhood speeds up (n,), in parts of the noise: an impact gives a poor start."""
    total = np.zeros(len(run.time))
    for c in np.flatnonzero(columns.logged):
        good = np.isfinite(values[:, c])
        _, _, change = derivatives(run.time, np.interp(run.time, run.time[good], values[good, c]), 2.0 * SPEED_REACH)
        total += (change / judged.noise[c]) ** 2
    return total


def _piece(
    run: MeasuredRun, columns: BaseColumns, values: np.ndarray, k: int, start: int, stop: int, judged: Judged
) -> Piece | None:
    """A piece with its start state: parabolas through what was logged; what was not is at zero, its speed unknown."""
    size = len(columns.names)
    state, spread = np.zeros(2 * size), np.zeros(2 * size)
    time = run.time - run.time[start]
    half = max(SPEED_REACH, FIT_SAMPLES * float(np.median(np.diff(run.time))))
    for c in range(size):
        if not columns.logged[c]:
            spread[size + c] = UNKNOWN_SPEED
            continue
        near = np.flatnonzero((np.abs(time) <= half) & np.isfinite(values[:, c]))
        if len(near) < 5:
            return None
        state[[c, c + size]], own = polynomial(time[near], values[near, c], 2, float(judged.noise[c]))
        spread[[c, c + size]] = np.hypot(own, [START_SPREADS[columns.units[c]], START_SPREADS[columns.units[c]] / half])
    return Piece(k, start, stop, state, spread)


def _column(run: MeasuredRun, name: str) -> np.ndarray | None:
    """A quantity of the base as it was logged: by its joint's name, or of a free joint without it."""
    joint, _, key = name.rpartition(".")
    for word in (name, key if joint else name):
        if word in run.base and np.isfinite(run.base[word]).sum() > 5:
            return np.asarray(run.base[word], float)
    return None


def _whole(angle: np.ndarray) -> np.ndarray:
    """An angle (n,) [rad] without jumps of a turn."""
    good = np.isfinite(angle)
    out = angle.copy()
    out[good] = np.unwrap(angle[good])
    return out


MAX_LOOP_STEPS, LOOP_TOLERANCE = 20, 1e-10  # steps in which passive joints close a robot's loops, and how well


class TreeReplay(Replayer[TreeModel]):
    """The engine with a robot in it.

    Attributes:
        joints: that follow, in the order of ``position``.
        links: behind their springs.
        rest: positions and speeds at the start of each piece (pieces, nq + nv).
    """

    def __init__(
        self,
        robot: TreeModel,
        runs: Sequence[MeasuredRun],
        pieces: Sequence[Piece],
        columns: BaseColumns,
        frames: Mapping[str, Frame],
    ) -> None:
        """Build the robot; its ground may differ from replay to replay."""
        super().__init__(robot, runs, pieces, columns, frames)
        self._columns = columns
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        names = [item.name for item in self.drivetrain.coordinates]
        self.joints, motors = shares([self.drivetrain.terms(name) for name in names])
        self.links, links = shares([self.drivetrain.terms(name, "link") for name in names])
        made_heavy(self.model, self.joints)
        ticks = np.arange(self.steps + 1) * ENGINE_STEP
        paths = [[self._path(run, name, frames) for name in names] for run in runs]
        angles = np.empty((self.steps + 1, len(self.pieces), len(names)))
        for k, piece in enumerate(self.pieces):
            at = runs[piece.run].time[piece.start] + ticks
            for row, path in enumerate(paths[piece.run]):
                angles[:, k, row] = path(np.minimum(at, path.x[-1]))
        self._begin = angles[:2] @ links.T
        self._follow(angles @ motors.T)
        self.rest = np.stack([self._closed(k) for k in range(len(self.pieces))])

    def _path(self, run: MeasuredRun, name: str, frames: Mapping[str, Frame]) -> CubicHermiteSpline:
        """A smooth path through the readings of a coordinate, in the frame of the model."""
        log, frame = run.joints[name], frames.get(name, Frame())
        encoder = self.drivetrain.chains[name].find("encoder")
        scale, offset = (1.0, 0.0) if encoder is None else (encoder.scale, encoder.offset)
        good = np.isfinite(log.position)
        values = frame.sign * (np.interp(run.time, run.time[good], log.position[good]) - frame.zero)
        smooth, rate, _ = derivatives(run.time, (values - offset) / scale, SPEED_REACH)
        return CubicHermiteSpline(run.time, smooth, rate)

    def _closed(self, k: int) -> np.ndarray:
        """Positions and speeds (nq + nv,) at the start of a piece, with the loops of the robot closed."""
        model, data = self.model, mujoco.MjData(self.model)
        mujoco.mj_resetData(model, data)
        for j, name in enumerate(self.links):  # behind springs, they start where their motors are
            first, second = self._begin[:, k, j]
            data.joint(name).qpos[0], data.joint(name).qvel[0] = first, (second - first) / ENGINE_STEP
        for j, name in enumerate(self.joints):
            data.joint(name).qpos[0], data.joint(name).qvel[0] = self.position[0, k, j], self.speed[0, k, j]
        driven = [int(model.joint(name).dofadr[0]) for name in dict.fromkeys([*self.links, *self.joints])]
        if not model.neq:
            return np.concatenate([data.qpos, data.qvel])
        base = {dof for number in self._columns.layout.joints for dof in _dofs(model, number)}
        passive = [dof for dof in range(model.nv) if dof not in base and dof not in driven]
        for _ in range(MAX_LOOP_STEPS):
            mujoco.mj_fwdPosition(model, data)
            rows = data.efc_type[: data.nefc] == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
            error = data.efc_pos[: data.nefc][rows]
            slope = self._dense(data)[rows]
            change = np.zeros(model.nv)
            change[passive] = -np.linalg.pinv(slope[:, passive]) @ error
            if not rows.any() or np.abs(change).max() < LOOP_TOLERANCE:
                break
            mujoco.mj_integratePos(model, data.qpos, change, 1.0)
        if rows.any():
            data.qvel[passive] = -np.linalg.pinv(slope[:, passive]) @ (slope[:, driven] @ data.qvel[driven])
        return np.concatenate([data.qpos, data.qvel])

    def _dense(self, data: mujoco.MjData) -> np.ndarray:
        """Jacobian of all constraints (nefc, nv)."""
        if not mujoco.mj_isSparse(self.model):
            return np.array(data.efc_J).reshape(-1, self.model.nv)[: data.nefc]
        dense = np.zeros((data.nefc, self.model.nv))
        mujoco.mju_sparse2dense(dense, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
        return dense

    def _run(
        self, models: Sequence[TreeModel], ground: np.ndarray, piece: np.ndarray, states: np.ndarray
    ) -> np.ndarray:
        n, model, layout = len(ground), self.model, self._columns.layout
        batch = self._begun(n)
        floor, body = ground_of(model)
        batch.expand("geom_friction")[:n, floor, 0] = np.array([m.value("contact.friction") for m in models])[ground]
        batch.expand("geom_solref")[:n, floor] = np.array([m.solref() for m in models])[ground]
        places = [m.place() for m in models]
        batch.expand("body_pos")[:n, body] = np.array([place for place, _ in places])[ground]
        batch.expand("body_quat")[:n, body] = np.array([turned for _, turned in places])[ground]
        qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
        size = len(layout.names)
        values, rates = (dict(zip(layout.names, part.T, strict=True)) for part in (states[:, :size], states[:, size:]))
        placed, moving = layout.qpos(values, n), layout.qvel(values, rates, n)
        qpos[:n] = np.where(np.isfinite(placed), placed, self.rest[piece, : model.nq])
        qvel[:n] = np.where(np.isfinite(moving), moving, self.rest[piece, model.nq :])
        control = np.zeros((n, self.steps, model.nv))
        for j, name in enumerate(self.joints):
            dof = int(model.joint(name).dofadr[0])
            control[:, :, dof] = WITHOUT_END * self.acceleration[:, piece, j].T
        spec = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
        path = batch.rollout(self.steps, control, spec, ("qpos",), np.arange(n))["qpos"]
        recorded = np.empty((self.steps + 1, n, size))
        recorded[0] = states[:, :size]
        recorded[1:] = layout.quantities(path).transpose(1, 0, 2)
        turning = [c for c, unit in enumerate(layout.units.values()) if unit == "rad"]
        recorded[..., turning] = np.unwrap(recorded[..., turning], axis=0)
        return recorded


def shares(rows: Sequence[tuple[tuple[str, float], ...]]) -> tuple[list[str], np.ndarray]:
    """Joints that make coordinates, and the matrix (joints, coordinates) that gives them from these."""
    joints = list(dict.fromkeys(joint for row in rows for joint, _ in row))
    matrix = np.zeros((len(rows), len(joints)))
    for k, row in enumerate(rows):
        for joint, coefficient in row:
            matrix[k, joints.index(joint)] = coefficient
    return joints, np.linalg.pinv(matrix)


def _dofs(model: mujoco.MjModel, joint: int) -> range:
    """Degrees of freedom of a joint by number."""
    first = int(model.jnt_dofadr[joint])
    return range(first, first + (6 if int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_FREE) else 1))
