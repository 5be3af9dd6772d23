"""What the matrix of policies tells: intervals, verdicts, and a constant action that is the best of those tried."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import policy_matrix
from benchmarks.policy_matrix import (
    TASKS,
    Cell,
    Judged,
    actors,
    best_constant,
    biped,
    cell,
    cells,
    counted,
    counts,
    read,
)
from benchmarks.verdicts import ALIKE, BETTER, LEAST_POLICIES, LEAST_STARTS, UNJUDGED, WORSE, Estimate, beside, estimate

TRIALS = 1500


def false_verdicts(policies: int, starts: int, spreads: tuple[float, float]) -> float:
    """How often policies are surely better or worse where there is no difference.

    Args:
        policies, starts: their numbers.
        spreads: of policies and of starts, each beside one of 1 of each policy at each start. What there are too few
            of stands for itself alone, and comes to no difference as it is.
    """
    rng, count = np.random.default_rng(0), 0
    of_policies = spreads[0] if policies >= LEAST_POLICIES else 0.0
    of_starts = spreads[1] if starts >= LEAST_STARTS else 0.0
    for _ in range(TRIALS):
        own = rng.normal(size=(policies, starts))
        own += of_policies * rng.normal(size=(policies, 1)) + of_starts * rng.normal(size=(1, starts))
        count += beside(own, np.zeros(starts), True) in (BETTER, WORSE)
    return count / TRIALS


@pytest.mark.parametrize(("policies", "starts"), [(1, 6), (2, 16), (3, 2), (3, 8), (5, 2), (5, 8)])
@pytest.mark.parametrize("spreads", [(0.0, 0.0), (3.0, 0.0), (0.0, 3.0), (3.0, 3.0)])
def test_where_there_is_no_difference_a_verdict_errs_in_one_of_twenty(
    policies: int, starts: int, spreads: tuple[float, float]
) -> None:
    """With starts and policies drawn anew, one policy on two starts was surely better or worse in 49 %."""
    assert false_verdicts(policies, starts, spreads) < 0.07


def test_nothing_is_judged_where_both_policies_and_starts_are_few() -> None:
    own = np.full((LEAST_POLICIES - 1, LEAST_STARTS - 1), 9.0)
    assert math.isnan(estimate(own).low) and str(estimate(own)) == "9"
    assert beside(own, np.zeros(LEAST_STARTS - 1), True) == UNJUDGED
    assert counts([UNJUDGED, UNJUDGED]) == UNJUDGED and counts([BETTER, "", WORSE]) == "1 better, 1 worse"


@pytest.mark.parametrize(("gain", "more", "verdict"), [(1.0, True, BETTER), (1.0, False, WORSE), (0.0, True, ALIKE)])
def test_a_verdict_is_start_by_start(gain: float, more: bool, verdict: str) -> None:
    starts = np.random.default_rng(0).normal(scale=100.0, size=(1, 16))
    noise = np.random.default_rng(1).normal(scale=0.1, size=(3, 16))
    assert beside(starts + gain + noise, starts, more) == verdict
    assert beside(starts, None, more) == ""


def test_each_of_few_policies_stands_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(policy_matrix, "actors", lambda name: ["seed0", "seed1", "reference", "constant"])
    scores = {"seed0": 1.0, "seed1": 3.0, "reference": 5.0, "constant": 5.0}
    rows = {("arm", "net", actor): {"scores": [score], "fell": 0} for actor, score in scores.items()}
    found = cell(rows, "arm", "net")
    assert found is not None and [item.mean for item in found.policies] == [1.0, 3.0]
    assert found.against_reference == UNJUDGED and found.mean == 2.0


def test_starts_that_all_come_to_the_same_are_one() -> None:
    """Eight starts of the arm came to the same within a ten-thousandth, and were eight."""
    rows = read()
    for name, task in TASKS.items():
        found = np.array([row["scores"] for key, row in rows.items() if key[0] == name and row["scores"] is not None])
        assert found.shape[1] == task.starts
        assert task.starts == 1 or (np.ptp(found, axis=1) > 1e-3 * np.abs(found).max(axis=1)).any(), name


def test_a_biped_that_falls_has_lost_all_of_its_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that fell after a quarter of its way was better than a constant action that fell at once."""

    class Moment:
        upright, forward = np.array([True, False]), np.array([0.5, 0.5]) * policy_matrix.JUDGED * policy_matrix.SECONDS

    monkeypatch.setattr(policy_matrix, "moments", lambda *_: [Moment])
    scores, fell = biped({}, None, lambda seen: seen, 2, 0)
    assert scores.tolist() == [0.5, 1.0] and fell.tolist() == [False, True]


@pytest.mark.parametrize("more", [True, False])
def test_the_constant_action_is_the_best_of_those_tried_from_the_same_starts(more: bool) -> None:
    seen = []

    def measure(env: Any, chain: Any, act: Any, count: int, seeds: Any) -> tuple[np.ndarray, np.ndarray]:
        actions = act(np.zeros((count, 1)))
        seen.append((actions, seeds))
        distance = np.abs(actions[:, 0] - 0.3) + np.asarray(seeds) % 7
        return -distance if more else distance, np.zeros(count, bool)

    best = best_constant(Judged(measure, "", (), 1, drawn=50, tried=2, more=more), {}, None, np.zeros((1, 2)))
    ((actions, seeds),) = seen
    assert abs(best[0] - 0.3) == np.abs(actions[:, 0] - 0.3).min() < 0.1
    assert seeds[:2] == seeds[2:4] and (actions[0] == actions[1]).all()


def test_every_committed_policy_is_in_the_matrix() -> None:
    assert {path.parent.parent.name for path in policy_matrix.POLICIES.glob("*/*/policy.json")} == set(TASKS)
    assert all(actors(name)[-2:] == ["reference", "constant"] for name in TASKS)


def test_a_row_of_other_weights_is_no_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A policy that was trained anew kept the row of the one before it, and so did the constant that knows its mean."""
    for seed in ("seed0", "seed1"):
        folder = tmp_path / "leg" / seed
        folder.mkdir(parents=True)
        (folder / "policy.json").write_text("{}")
        (folder / "policy.safetensors").write_bytes(seed.encode())
    monkeypatch.setattr(policy_matrix, "POLICIES", tmp_path)
    monkeypatch.setattr(policy_matrix, "FILE", tmp_path / "rows.jsonl")
    monkeypatch.setattr(policy_matrix, "TASKS", {"leg": TASKS["leg"]})
    rows = [
        {"task": "leg", "model": "net", "actor": actor, "policies": policy_matrix.digest("leg", actor)}
        for actor in actors("leg")
    ]
    policy_matrix.FILE.write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert [actor for *_, actor in read()] == ["seed0", "seed1", "reference", "constant"]
    (tmp_path / "leg" / "seed1" / "policy.safetensors").write_bytes(b"trained anew")
    assert [actor for *_, actor in read()] == ["seed0", "reference"]


def test_a_task_without_rows_is_left_out_and_no_other_chain_takes_the_place_of_its_own() -> None:
    one = Estimate(1.0)
    own = Cell("leg", TASKS["leg"].models[0], one, one, (Estimate(2.0),), 0, 16, BETTER, WORSE)
    other = replace(own, model="net", policies=(Estimate(3.0),))
    assert counted([], {}) == [] and counted([other], {}) == []
    assert [line[4:6] for line in counted([own], {})] == [("2", "")]
    assert [line[4:6] for line in counted([other, own], {"leg": "a leg"})] == [("2", "3 on `net`")]
    assert cells({}) == []
