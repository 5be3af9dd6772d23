"""All joints of a robot as one problem: each replayed by itself, with loads that numbers of the whole robot change.

Paths of a joint's own parameters begin with its name: ``elbow|friction.coulomb*``. What joints share has paths of the
robot: ``body.forearm.mass_factor``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from ..load.terms import T_OWN, T_SIZE
from ..log.types import Array
from ..replay.parameters import address
from ..replay.problem import NOISE_FLOORS, JointProblem, Problem, rows_of
from ..search.correlated import excess

SMOOTHING_LEFT = 0.03
"""What is left, of a number, of the smoothing of measured accelerations: 1 to 4 % on steps of an independent arm."""


MAX_KEPT_BYTES = 2**27
"""Bytes of replays that are kept for the next fit."""
Own = tuple[tuple[str, float], ...]
"""Numbers of one joint by path, without its name."""
Shared = tuple[tuple[str, float], ...]
"""Numbers of the robot that change something at one joint."""


@dataclass(frozen=True, eq=False)
class RobotModel:
    """What is believed of a robot.

    Attributes:
        joints: believed of each joint in the first run.
        neutral: value by number at which what joints share changes nothing.
        units: of those numbers.
    """

    joints: Mapping[str, JointProblem]
    neutral: Mapping[str, float]
    units: Mapping[str, str]

    def value(self, path: str) -> float:
        """A number by path."""
        at = address(path)
        return self.joints[at.joint].models[0].value(at.own) if at.joint else self.neutral[path]

    def unit(self, path: str) -> str:
        """Its unit."""
        at = address(path)
        return self.joints[at.joint].models[0].unit(at.own) if at.joint else self.units[path]

    def __repr__(self) -> str:
        return f"RobotModel({ {name: problem.models for name, problem in self.joints.items()} })"


class Replays(dict[tuple[Any, ...], Array]):
    """Channels of one joint (n, 4) by what was asked for, as much as memory may hold."""

    def add(self, found: Mapping[tuple[Any, ...], Array]) -> None:
        """Keep more of them."""
        self.update({asked: row.copy() for asked, row in found.items()})

    def recalled(self, asked: tuple[Any, ...]) -> Array:
        """What was asked for, which is the last to be dropped from now on."""
        self[asked] = self.pop(asked)
        return self[asked]

    def forget(self) -> None:
        """Drop those that were not asked for for the longest time, beyond what memory may hold."""
        held = sum(row.nbytes for row in self.values())
        for asked in list(self):
            if held <= MAX_KEPT_BYTES:
                return
            held -= self.pop(asked).nbytes


@dataclass(frozen=True, eq=False, kw_only=True)
class RobotProblem(Problem):
    """Joints of a robot, a problem whose samples are those of one joint after the other.

    Attributes:
        joints: by name.
        rows: by number of the robot and joint, what the number adds to the joint's terms per unit (n, T_SIZE).
        models: what is believed.
        slices: samples of each joint.
    """

    joints: Mapping[str, JointProblem]
    rows: Mapping[str, Mapping[str, Array]]
    models: tuple[RobotModel, ...]
    slices: Mapping[str, slice]

    @classmethod
    def of(
        cls,
        joints: Mapping[str, JointProblem],
        rows: Mapping[str, Mapping[str, Array]],
        models: tuple[RobotModel, ...],
    ) -> Self:
        """The joints one after the other; arguments as the attributes."""
        every = list(joints.values())
        ends = np.cumsum([0, *(len(problem.time) for problem in every)])
        starts = [problem.starts[1:] + at for problem, at in zip(every, ends[:-1], strict=True)]
        return cls(
            joints=joints,
            rows=rows,
            models=models,
            slices={name: slice(int(a), int(b)) for name, a, b in zip(joints, ends[:-1], ends[1:], strict=True)},
            units=tuple(unit for problem in every for unit in problem.units),
            time=np.concatenate([problem.time for problem in every]),
            measured=np.concatenate([problem.measured for problem in every]),
            judged=np.concatenate([problem.judged for problem in every]),
            starts=np.concatenate([np.zeros(1, int), *starts]),
            weight=np.array([1.0 / _noise(joints), 0.0, 0.0, 0.0]),
            step=min(problem.step for problem in every),
        )

    @property
    def open_loop(self) -> bool:
        """Whether nothing holds one of the joints near what was measured."""
        return any(problem.open_loop for problem in self.joints.values())

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels."""
        return next(iter(self.joints.values())).channels

    @property
    def sampled(self) -> tuple[int, ...]:
        """The position."""
        return (0,)

    @property
    def groups(self) -> int:
        """Groups of samples of all joints."""
        return sum(problem.groups for problem in self.joints.values())

    @property
    def signal(self) -> tuple[str, str]:
        """The position, and the unit of all joints; noise floors where hinges and slides have units of their own."""
        return "position", _unit(self.joints)

    @property
    def noise(self) -> float:
        """Noise floor of the position: root of the mean square over the judged samples of all joints."""
        return _noise(self.joints)

    def part(self, *parts: int) -> Self:
        """The problem that has only the units of these parts."""
        joints, kept = {}, {}
        for name, problem in self.joints.items():
            joints[name] = problem.part(*parts)
            kept[name] = rows_of(problem, parts)[1]
        rows = {number: {j: table[kept[j]] for j, table in found.items()} for number, found in self.rows.items()}
        return self.of(joints, rows, self.models)

    def with_step_factor(self, factor: float) -> Self:
        """The problem with so many times longer a step of what plays and switches."""
        return self.each(lambda problem: problem.with_step_factor(factor))

    def each(self, change: Callable[[JointProblem], JointProblem]) -> Self:
        """The problem with each joint changed, which keeps its samples."""
        return self.of({name: change(problem) for name, problem in self.joints.items()}, self.rows, self.models)

    def simulate(self, variants: Sequence[Mapping[str, float]], step: float | None = None) -> np.ndarray:
        """Channels (v, n, 4) of every variant; what is alike for a joint is replayed once.

        A number turns one joint, or what all share: of the many variants that a fit asks for, and the next fit again,
        most joints have few.
        """
        out = np.empty((len(variants), len(self.time), len(self.channels)))
        for name in self.joints:
            out[:, self.slices[name]] = self.replayed(name, variants, step)
        return out

    def replayed(self, name: str, variants: Sequence[Mapping[str, float]], step: float | None = None) -> np.ndarray:
        """Channels (v, m, 4) of one joint."""
        problem = self.joints[name]
        out = np.empty((len(variants), len(problem.time), len(self.channels)))
        asked: dict[Shared, dict[Own, list[int]]] = {}
        for k, values in enumerate(variants):
            addresses = ((address(path), x) for path, x in values.items())
            own = tuple((at.own, x) for at, x in addresses if at.joint == name)
            shared = tuple(
                (path, x)
                for path, x in values.items()
                if name in self.rows.get(path, {}) and x != self.models[0].neutral[path]
            )
            asked.setdefault(shared, {}).setdefault(own, []).append(k)
        for shared, each in asked.items():
            fresh = [own for own in each if (name, shared, own, step) not in self._kept]
            if fresh:
                moved = replace(problem, terms=self.terms(name, dict(shared)))
                found = moved.simulate([dict(own) for own in fresh], step)
                self._kept.add({(name, shared, own, step): row for own, row in zip(fresh, found, strict=True)})
            for own, numbers in each.items():
                out[numbers] = self._kept.recalled((name, shared, own, step))
        self._kept.forget()
        return out

    def felt_by(self, path: str) -> tuple[str, ...]:
        """Names of the joints that a number turns."""
        at = address(path)
        return (at.joint,) if at.joint else tuple(name for name in self.joints if name in self.rows.get(path, {}))

    def residual_of(self, joint: str, variants: Sequence[Mapping[str, float]], every: int = 1) -> np.ndarray:
        """Weighted errors (v, m) of one joint."""
        return self.joints[joint].residual(self.replayed(joint, variants), every)

    @cached_property
    def _kept(self) -> Replays:
        return Replays()

    def terms(self, joint: str, shared: Mapping[str, float]) -> np.ndarray:
        """What a joint works against with other numbers of the robot (n, T_COLUMNS)."""
        terms = self.joints[joint].terms
        assert terms is not None
        terms = terms.copy()
        for number, value in shared.items():
            if joint in self.rows.get(number, {}):
                terms[:, T_OWN : T_OWN + T_SIZE] += (value - self.models[0].neutral[number]) * self.rows[number][joint]
        return terms

    def residual(self, simulated: np.ndarray, every: int = 1) -> np.ndarray:
        """Weighted errors (v, m) of simulated channels (v, n, 4): of all positions, then of all else."""
        first, rest = [], []
        for name, problem in self.joints.items():
            errors = problem.residual(simulated[:, self.slices[name]], every)
            count = -(-int(problem.judged.sum()) // every)
            first.append(errors[:, :count])
            rest.append(errors[:, count:])
        return np.concatenate([*first, *rest], axis=1)

    def blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Block number of each entry of :meth:`residual` (m,), and entries per block (b,)."""
        return self._blocks

    @cached_property
    def _blocks(self) -> tuple[np.ndarray, np.ndarray]:
        first, rest, at = [], [], 0
        for problem in self.joints.values():
            numbers, sizes = problem.blocks()
            count = int(problem.judged.sum())
            first.append(numbers[:count] + at)
            rest.append(numbers[count:] + at)
            at += len(sizes)
        numbers = np.concatenate([*first, *rest])
        return numbers, np.bincount(numbers, minlength=at)

    def position_error(self, simulated: np.ndarray) -> np.ndarray:
        """Errors of the positions of one variant (n, 4) at the judged samples, in the unit of the signal."""
        return np.concatenate(
            [
                scale * self.joints[name].position_error(simulated[self.slices[name]])
                for name, scale in _scales(self.joints).items()
            ]
        )

    def left_over(self, simulated: np.ndarray) -> float | None:
        """As :meth:`excess_loss`."""
        return self.excess_loss(simulated)

    def excess_loss(self, simulated: np.ndarray) -> float | None:
        """Loss per judged value beyond that of noise, the mean of the joints."""
        counts = [len(problem.blocks()[0]) for problem in self.joints.values()]
        levels = [excess(problem, simulated[self.slices[name]]) for name, problem in self.joints.items()]
        return float(np.average(levels, weights=counts))

    def systematic_error(self, path: str) -> float:
        """Relative error of a number that columns and simulation share in all data."""
        del path
        return SMOOTHING_LEFT


def _unit(joints: Mapping[str, JointProblem]) -> str:
    """Unit of the positions of all joints; noise floors where hinges and slides have units of their own."""
    units = {problem.signal[1] for problem in joints.values()}
    return units.pop() if len(units) == 1 else NOISE_FLOORS


def _scales(joints: Mapping[str, JointProblem]) -> dict[str, float]:
    """By joint what its position is multiplied by to be in that unit."""
    mixed = _unit(joints) == NOISE_FLOORS
    return {name: float(problem.weight[0]) if mixed else 1.0 for name, problem in joints.items()}


def _noise(joints: Mapping[str, JointProblem]) -> float:
    """Noise floor of the positions: root of the mean square over the judged samples of all joints."""
    floors = [scale * joints[name].noise for name, scale in _scales(joints).items()]
    counts = [int(problem.judged.sum()) for problem in joints.values()]
    return float(np.sqrt(np.average(np.square(floors), weights=counts)))
