"""Pieces of a legged log, and the engine in which they are replayed on many grounds at once."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Generic, Self, TypeVar

import mujoco
import numpy as np
from mujoco.batch import Batch

from ...actuators import Drivetrain
from ...actuators.engine import install
from ..checks.signal import sample_noise
from ..log.types import MeasuredRun
from ..replay.parameters import absolute

ENGINE_STEP = 1e-3  # [s] of the engine: halving it moves a stance by less than right models of contact differ
MOST_SIMULATIONS = 512  # side by side
WITHOUT_END = 1e6
"""Inertia [kg.m2] or mass [kg] of what follows its measured motion, whatever acts on it, and place [rad or m] of a stop
that nothing reaches."""
PIECE_SECONDS = 0.3  # [s]
NOISE_HALF = 3  # samples to either side: a leg moves fast
START_SPREAD_FACTOR = 1.5  # standard deviations of a start state, over those of the parabola: it is no parabola exactly
UNKNOWN_SPEED = 0.5  # [m/s] standard deviation of a speed that no column tells


@dataclass(frozen=True, eq=False)
class Piece:
    """One piece of a run.

    Attributes:
        run: index of its run.
        start, stop: samples.
        state: of the judged columns, then their speeds, at the first sample (2 c,).
        spread: standard deviations of it (2 c,).
    """

    run: int
    start: int
    stop: int
    state: np.ndarray
    spread: np.ndarray


def sample_error(time: np.ndarray, values: np.ndarray) -> float:
    """Rms error of a sample of a column (n,); NaN where it was not logged."""
    good = np.isfinite(values)
    if good.sum() < 20:
        return np.nan
    return sample_noise(time[good], values[good], half=NOISE_HALF, jumps=True)  # impacts are no noise


def thinned(pieces: list[Piece], most: int) -> list[Piece]:
    """So many pieces at most, evenly spread over all of them."""
    if len(pieces) <= most:
        return pieces
    return [pieces[i] for i in np.linspace(0, len(pieces) - 1, most).round().astype(int)]


def polynomial(t: np.ndarray, x: np.ndarray, order: int, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Value and slope at zero of a polynomial through samples, and their standard deviations."""
    inverse = np.linalg.pinv(np.stack([t**power for power in range(order + 1)], axis=1))
    return (inverse @ x)[:2], START_SPREAD_FACTOR * noise * np.linalg.norm(inverse[:2], axis=1)


@dataclass(frozen=True, eq=False)
class Grounded(ABC):
    """A robot with its chains, on a ground whose numbers vary.

    Attributes:
        units: of the numbers of the ground, by path.
        ground: their values.
    """

    units: ClassVar[Mapping[str, str]]

    ground: Mapping[str, float] = field(default_factory=dict, kw_only=True)

    def value(self, path: str) -> float:
        """A number of the ground by path."""
        return float(self.ground[path])

    def unit(self, path: str) -> str:
        """Its unit."""
        return self.units[path]

    def with_fitted(self, values: Mapping[str, float]) -> Self:
        """The robot on another ground; factors are on this one's own values."""
        return replace(self, ground={**self.ground, **absolute(values, self)})

    @abstractmethod
    def drivetrain(self) -> Drivetrain:
        """The robot in the engine, on its ground."""

    def mjcf(self) -> str:
        """The robot on its ground, for plain MuJoCo."""
        return self.drivetrain().spec.to_xml()


Robot = TypeVar("Robot", bound=Grounded)


class Replayer(ABC, Generic[Robot]):
    """The engine with a robot in it, whose joints follow their measured motion over pieces of its log.

    Attributes:
        drivetrain, model: of the robot.
        pieces: of the log, in the order of their numbers.
        time: of the samples of each piece since its start [s].
        steps: of the engine in a piece.
        position, speed, acceleration: of what follows, at every step (steps, pieces, k) [rad, rad/s, rad/s2].
    """

    position: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray

    def __init__(self, robot: Robot, runs: Sequence[MeasuredRun], pieces: Sequence[Piece], *others: Any) -> None:
        """Build the robot; its ground may differ from replay to replay."""
        self._made_from = (robot, runs, pieces, *others)
        self.drivetrain, self.pieces = robot.drivetrain(), list(pieces)
        self.model = self.drivetrain.model
        self.model.opt.timestep = ENGINE_STEP
        # friction holds a foot that does not slide; with the default it creeps by tenths of a millimetre per stance
        self.model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        self.model.opt.impratio = max(self.model.opt.impratio, 10.0)
        self.steps = int(np.ceil(PIECE_SECONDS / ENGINE_STEP)) + 1
        self.time = [runs[p.run].time[p.start : p.stop] - runs[p.run].time[p.start] for p in self.pieces]
        self._batch: Batch | None = None

    def __reduce__(self) -> tuple[type[Self], tuple[object, ...]]:
        """Pickled as what it is made from: an engine cannot be."""
        return type(self), self._made_from

    def simulate(
        self, models: Sequence[Robot], rows: Sequence[int], states: np.ndarray | None = None
    ) -> list[np.ndarray]:
        """Replay pieces on every ground: every pair of them is simulated, and read at the piece's own samples.

        Args:
            models: differ in their ground only (v).
            rows: numbers of the pieces (s).
            states: start of each piece, one per ground (v, s, 2 c); default: as measured.

        Returns:
            Per piece the judged columns at its samples (v, samples, c).
        """
        count = len(rows)
        if states is None:
            states = np.array([self.pieces[row].state for row in rows])
        size = states.shape[-1]
        states = np.broadcast_to(states, (len(models), count, size)).reshape(-1, size)
        ground, piece = np.repeat(np.arange(len(models)), count), np.tile(np.asarray(rows), len(models))
        parts = [slice(first, first + MOST_SIMULATIONS) for first in range(0, len(ground), MOST_SIMULATIONS)]
        recorded = [self._run(models, ground[part], piece[part], states[part]) for part in parts]
        paths = np.clip(np.nan_to_num(np.concatenate(recorded, axis=1), nan=1e3), -1e3, 1e3)
        out = []
        for k, row in enumerate(rows):
            at = self.time[row] / ENGINE_STEP
            low = np.minimum(at.astype(int), len(paths) - 2)
            share = (at - low)[:, None, None]
            path = paths[:, k::count]
            out.append(((1.0 - share) * path[low] + share * path[low + 1]).transpose(1, 0, 2))
        return out

    @abstractmethod
    def _run(self, models: Sequence[Robot], ground: np.ndarray, piece: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Simulate pairs of a ground and a piece, both by number (n,), from states (n, 2 c): what is judged at each
        step of the engine (steps + 1, n, c).
        """

    def _follow(self, position: np.ndarray) -> None:
        """Let motors follow a path (steps + 1, pieces, k), as the engine integrates: a speed first, with which it then
        moves.
        """
        moved = np.diff(position, axis=0)
        self.position, self.speed = position, np.concatenate([moved[:1], moved]) / ENGINE_STEP
        self.acceleration = np.diff(self.speed, axis=0) / ENGINE_STEP

    def _begun(self, count: int) -> Batch:
        """The engine with so many simulations at least, reset."""
        if self._batch is None or self._batch.nsim < count:
            self._batch = Batch(self.model, count, 0)
        install()
        self._batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        return self._batch


def made_heavy(model: mujoco.MjModel, joints: Sequence[str]) -> list[int]:
    """Degrees of freedom of joints that are made so heavy that only the force which makes them follow their path can
    move them.
    """
    dofs = []
    for name in joints:
        number = model.joint(name).id
        dof = int(model.jnt_dofadr[number])
        model.dof_armature[dof], model.dof_frictionloss[dof], model.dof_damping[dof] = WITHOUT_END, 0.0, 0.0
        model.jnt_range[number], model.jnt_stiffness[number] = (-WITHOUT_END, WITHOUT_END), 0.0
        dofs.append(dof)
    return dofs
