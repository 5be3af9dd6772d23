"""The fit of several joints together: each has its own damping, and shared numbers do what is best for all."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from sealegs.gap.replay.comparison import robust_loss
from sealegs.gap.search.several import JointByJoint, Several

TIMES = np.linspace(0.0, 1.0, 60)
TRUE = {"easy|slope": 2.0, "easy|offset": -1.0, "hard|rate": 3.0, "hard|size": 1.5, "mass": 1.3}


class TwoJoints:
    """One joint is linear in its numbers, one has a valley that turns; a shared number turns both."""

    def __init__(self) -> None:
        self.asked = {"easy": 0, "hard": 0}
        self.measured = {joint: self.model(joint, TRUE) for joint in self.asked}

    @staticmethod
    def model(joint: str, values: Mapping[str, float]) -> np.ndarray:
        mass = values.get("mass", 1.0)
        if joint == "easy":
            return 20.0 * (mass * values["easy|slope"] * TIMES + values["easy|offset"])
        return 20.0 * values["hard|size"] * np.exp(-(values["hard|rate"] ** 2) * TIMES) * np.cos(6.0 * mass * TIMES)

    def felt_by(self, path: str) -> tuple[str, ...]:
        joint, bar, _ = path.partition("|")
        return (joint,) if bar else ("easy", "hard")

    def residual_of(self, joint: str, variants: Sequence[Mapping[str, float]], every: int = 1) -> np.ndarray:
        self.asked[joint] += len(variants)
        return np.stack([self.model(joint, values) - self.measured[joint] for values in variants])[:, ::every]

    def each(self, change: Callable[[Any], Any]) -> Any:
        raise NotImplementedError


def fitted(paths: Sequence[str], start: Sequence[float], iterations: int = 40) -> tuple[JointByJoint, dict[str, float]]:
    problem = TwoJoints()
    assert isinstance(problem, Several)

    def values(point: np.ndarray) -> dict[str, float]:
        return {**{path: TRUE[path] for path in TRUE}, **dict(zip(paths, map(float, point), strict=True))}

    bounds = np.full(len(paths), 0.05), np.full(len(paths), 6.0)
    bounds[0][[path.endswith("offset") for path in paths]] = -3.0
    fit = JointByJoint(problem, paths, values, np.array(start, float), bounds, np.full(len(paths), 1e-3), 1)
    return fit, values(fit.run(iterations))


def test_own_and_shared_numbers_are_found_together() -> None:
    fit, found = fitted(list(TRUE), [0.5, 0.0, 2.0, 1.0, 1.0])
    assert fit.cost < 1e-3
    assert found == pytest.approx(TRUE, rel=1e-2)


def test_a_joint_that_is_hard_to_fit_does_not_hold_up_another() -> None:
    """With one damping for all, steps that the hard joint rejects were taken from the easy one too."""
    paths = ["easy|slope", "easy|offset", "hard|rate", "hard|size"]
    fit, found = fitted(paths, [0.21, 0.44, 4.74, 0.47], iterations=3)
    assert fit.costs["easy"] < 1e-6 < 100.0 < fit.costs["hard"]
    assert (found["easy|slope"], found["easy|offset"]) == pytest.approx((2.0, -1.0), abs=1e-3)


@pytest.mark.parametrize("seed", range(8))
def test_no_iteration_makes_it_worse(seed: int) -> None:
    start = np.random.default_rng(seed).uniform([0.1, -2.0, 0.1, 0.1, 0.2], [5, 2, 5, 5, 4])
    fit, _ = fitted(list(TRUE), list(start), 0)
    for _ in range(12):
        before = dict(fit.costs)
        fit.iterate()
        assert fit.cost <= sum(before.values()) + 1e-9
        here = {joint: fit.errors(joint, [fit.at])[0] for joint in fit.joints}
        assert {j: float(robust_loss(e).sum()) for j, e in here.items()} == pytest.approx(fit.costs)
        assert (fit.at >= fit.low).all() and (fit.at <= fit.high).all()
