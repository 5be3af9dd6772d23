"""Least squares where the data are of several joints: each turns numbers of its own, and a few numbers turn several.

One damping for all would let the joint that is hardest to fit reject the steps of all others. So each joint has a
damping of its own, and takes that of the tried steps which does best for it; shared numbers take the step that does
best for all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol, Self, runtime_checkable

import numpy as np

from ..replay.comparison import robust_loss, robust_weight
from ..replay.problem import JointProblem
from .bounded import damped_step, may_turn

CONVERGED = 5e-4  # relative improvement of the cost below which a fit ends
TRIED = (0.1, 1.0, 20.0)  # dampings that each iteration tries, relative to the last ones
DAMPING = 1e-3  # of the first iteration
STIFFER = 400.0  # factor on the damping of a joint for which no step was better
LEAST, MOST = 1e-7, 1e6  # dampings


@runtime_checkable
class Several(Protocol):
    """Data of several joints."""

    def felt_by(self, path: str) -> tuple[str, ...]:
        """Names of the joints that a number turns."""
        ...

    def each(self, change: Callable[[JointProblem], JointProblem]) -> Self:
        """With each joint changed."""
        ...

    def residual_of(self, joint: str, variants: Sequence[Mapping[str, float]], every: int = 1) -> np.ndarray:
        """Weighted errors (v, m) of one joint."""
        ...


class JointByJoint:
    """A fit to several joints in progress.

    Attributes:
        at: numbers in the optimiser's coordinate (p,).
        cost: sum of the losses.
    """

    def __init__(
        self,
        problem: Several,
        paths: Sequence[str],
        values: Callable[[np.ndarray], dict[str, float]],
        start: np.ndarray,
        bounds: tuple[np.ndarray, np.ndarray],
        reach: np.ndarray,
        every: int,
    ) -> None:
        """Begin at a start.

        Args:
            problem: the data.
            paths: of the numbers.
            values: numbers by path of a point (p,).
            start: first point (p,).
            bounds: low and high (p,).
            reach: steps of the finite differences (p,).
            every: only so many-th sample counts.
        """
        self.problem, self.values, self.every = problem, values, every
        self.at, (self.low, self.high), self.reach = start, bounds, reach
        felt = [problem.felt_by(path) for path in paths]
        self.joints = tuple(dict.fromkeys(name for names in felt for name in names))
        self.feels = {j: [k for k, names in enumerate(felt) if j in names] for j in self.joints}
        self.shared = np.array([len(names) != 1 for names in felt])
        self.owner = [names[0] if len(names) == 1 else "" for names in felt]
        self.damping = dict.fromkeys((*self.joints, ""), DAMPING)
        self.here = {j: self.errors(j, [self.at])[0] for j in self.joints}
        self.costs = {j: _loss(errors) for j, errors in self.here.items()}
        self.both_sides = False

    @property
    def cost(self) -> float:
        return sum(self.costs.values())

    def errors(self, joint: str, points: Iterable[np.ndarray]) -> np.ndarray:
        """Weighted errors (v, m) of a joint at points."""
        return self.problem.residual_of(joint, [self.values(point) for point in points], self.every)

    def run(self, iterations: int) -> np.ndarray:
        """The point (p,) after so many iterations, or fewer where it converged."""
        for _ in range(iterations if self.cost > 0.0 else 0):
            before = self.cost
            if not self.iterate() or before - self.cost < CONVERGED * before:
                if self.both_sides:
                    break
                # differences to one side are cheaper and carry a fit most of its way
                self.both_sides, self.damping = True, dict.fromkeys(self.damping, DAMPING)
        return self.at

    def iterate(self) -> bool:
        """One iteration; whether anything may be turned."""
        slope, curvature = self.derivatives()
        if not may_turn(self.at, slope, self.low, self.high):
            return False
        damping = np.array([self.damping[name] for name in self.owner])
        points = [damped_step(self.at, slope, curvature, damping * more, self.low, self.high) for more in TRIED]
        # ripple in the Jacobian looks like curvature and shortens steps along a valley: also try further
        points.append(np.clip(self.at + 3.0 * (points[0] - self.at), self.low, self.high))
        tried = {j: self.errors(j, points) for j in self.joints}
        if not self.shared.any():
            self.take(points, tried)
            return True
        sums = [sum(_loss(tried[j][k]) for j in self.joints) for k in range(len(points))]
        best = int(np.argmin(sums))
        if not self.take_shared(points, tried, best):
            self.stiffen("")
            kept = [np.where(self.shared, self.at, point) for point in points]
            turned = [j for j in self.joints if self.shared[self.feels[j]].any()]
            self.take(kept, tried | {j: self.errors(j, kept) for j in turned})
        return True

    def derivatives(self) -> tuple[np.ndarray, np.ndarray]:
        """Slope (p,) and curvature (p, p) of the cost."""
        slope, curvature = np.zeros(len(self.at)), np.zeros((len(self.at), len(self.at)))
        up = np.where(self.at + self.reach <= self.high, self.reach, -self.reach)
        back = np.where((self.at - up >= self.low) & (self.at - up <= self.high), up, 0.0)
        for joint, feels in self.feels.items():
            ahead, steps = self.errors(joint, self.at + np.diag(up)[feels]), up[feels]
            behind = self.here[joint]
            if self.both_sides:
                behind = self.errors(joint, self.at - np.diag(back)[feels])
                steps = steps + back[feels]
            jacobian = (ahead - behind) / steps[:, None]
            weighted = jacobian * robust_weight(self.here[joint])
            slope[feels] += weighted @ self.here[joint]
            curvature[np.ix_(feels, feels)] += weighted @ jacobian.T
        return slope, curvature

    def take(self, points: Sequence[np.ndarray], tried: Mapping[str, np.ndarray]) -> None:
        """Each joint takes its best point, as far as its own numbers go, where that is better than now."""
        for joint in self.joints:
            losses = [_loss(errors) for errors in tried[joint]]
            best = int(np.argmin(losses))
            if losses[best] < self.costs[joint]:
                self.move(joint, points[best], tried[joint][best])
                self.soften(joint, best)
            else:
                self.stiffen(joint)

    def take_shared(self, points: Sequence[np.ndarray], tried: Mapping[str, np.ndarray], best: int) -> bool:
        """Shared numbers go to one point, and each joint to the best of its own there; whether all are better then."""
        shared = np.where(self.shared, points[best], self.at)
        taken: dict[str, tuple[int, np.ndarray, np.ndarray]] = {}
        for joint in self.joints:
            losses = [_loss(errors) for errors in tried[joint]]
            first = int(np.argmin(losses))
            if not self.shared[self.feels[joint]].any():
                better = losses[first] < self.costs[joint]
                taken[joint] = (
                    (first, points[first], tried[joint][first]) if better else (-1, self.at, self.here[joint])
                )
                continue
            taken[joint] = best, points[best], tried[joint][best]
            if first != best or losses[first] >= self.costs[joint]:
                others = [np.where(self.shared, shared, point) for point in (*points, self.at)]
                errors = self.errors(joint, others)
                k = int(np.argmin([_loss(one) for one in errors]))
                if _loss(errors[k]) < losses[best]:
                    taken[joint] = (k if k < len(points) else -1), others[k], errors[k]
        if sum(_loss(errors) for _, _, errors in taken.values()) >= self.cost:
            return False
        self.at = shared
        self.soften("", best)
        for joint, (k, point, errors) in taken.items():
            self.move(joint, point, errors)
            if k >= 0:
                self.soften(joint, k)
            else:
                self.stiffen(joint)
        return True

    def move(self, joint: str, point: np.ndarray, errors: np.ndarray) -> None:
        """Give a joint the numbers of its own at a point."""
        own = [k for k in self.feels[joint] if not self.shared[k]]
        self.at = self.at.copy()
        self.at[own] = point[own]
        self.here[joint], self.costs[joint] = errors, _loss(errors)

    def stiffen(self, name: str) -> None:
        """A larger damping, after no step was better."""
        self.damping[name] = min(STIFFER * self.damping[name], MOST)

    def soften(self, name: str, best: int) -> None:
        """The damping of the step that did best, from which the next iteration begins."""
        self.damping[name] = min(max(self.damping[name] * (*TRIED, TRIED[0])[best], LEAST), MOST)


def _loss(errors: np.ndarray) -> float:
    return float(robust_loss(errors).sum())
