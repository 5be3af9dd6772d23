"""What the matrix of policies tells: intervals, verdicts, and a constant action that is the best."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.policy_matrix import ALIKE, BETTER, TASKS, WORSE, Judged, actors, beside, best_constant, middle


def test_the_interval_is_over_starts_of_few_policies_and_over_both_of_more() -> None:
    policies = np.array([[0.0], [1.0], [2.0], [3.0], [4.0]]) + np.zeros(8)
    mean, low, high = middle(policies)
    assert mean == pytest.approx(2.0) and low < 1.5 and high > 2.5, "policies differ"
    assert middle(policies[:2])[1:] == (0.5, 0.5), "two policies are what they are, and starts are all alike"


@pytest.mark.parametrize(("gain", "more", "verdict"), [(1.0, True, BETTER), (1.0, False, WORSE), (0.0, True, ALIKE)])
def test_a_verdict_is_start_by_start(gain: float, more: bool, verdict: str) -> None:
    starts = np.random.default_rng(0).normal(scale=100.0, size=(1, 16))
    noise = np.random.default_rng(1).normal(scale=0.1, size=(3, 16))
    assert beside(starts + gain + noise, starts, more) == verdict
    assert beside(starts, None, more) == ""


@pytest.mark.parametrize("more", [True, False])
def test_the_constant_action_is_the_best_of_those_tried_from_the_same_starts(more: bool) -> None:
    seen = []

    def measure(env: Any, chain: Any, act: Any, count: int, seeds: Any) -> tuple[np.ndarray, np.ndarray]:
        actions = act(np.zeros((count, 1)))
        seen.append((actions, seeds))
        distance = np.abs(actions[:, 0] - 0.3) + np.asarray(seeds) % 7
        return -distance if more else distance, np.zeros(count, bool)

    best = best_constant(Judged(measure, "", (), 1, drawn=50, more=more), {}, None, np.zeros((1, 2)))
    ((actions, seeds),) = seen
    assert abs(best[0] - 0.3) == np.abs(actions[:, 0] - 0.3).min() < 0.1
    assert seeds[:2] == seeds[2:4] and (actions[0] == actions[1]).all()


def test_every_committed_policy_is_in_the_matrix() -> None:
    from benchmarks.policies_on_the_bus import POLICIES

    assert {path.parent.parent.name for path in POLICIES.glob("*/*/policy.json")} == set(TASKS)
    assert all(actors(name)[-2:] == ["reference", "constant"] for name in TASKS)
