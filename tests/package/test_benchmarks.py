"""What benchmarks compare does the same work, and what they tell of policies is sure."""

from __future__ import annotations

import json
import math
import multiprocessing
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from sealegs.envs.bench.robot import BENCH
from sealegs.envs.hopper.robot import HOPPER
from sealegs.gap.log import read_measured
from sealegs.hw.run.measured_log import read_events

from benchmarks import bus, control_loop, policy_matrix
from benchmarks.control_loop import spin
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
from benchmarks.python_hopper import FRAME_SKIP, PythonHopper
from benchmarks.speed import CHAINS, bare_model, told
from benchmarks.verdicts import ALIKE, BETTER, LEAST_POLICIES, LEAST_STARTS, UNJUDGED, WORSE, Estimate, beside, estimate
from tests.simulated_runs import Simulation, sine


def test_the_python_hopper_moves_as_the_compiled_one():
    plain = PythonHopper()
    plain.reset(seed=0)
    driven = HOPPER.drivetrain("sv1270tg")
    data = mujoco.MjData(driven.model)
    data.qpos[:], data.qvel[:] = plain.data.qpos, plain.data.qvel
    rng = np.random.default_rng(0)
    for _ in range(25):
        action = rng.uniform(-1.0, 1.0, 2)
        plain.step(action)
        data.ctrl[:] = plain.goal_centre + plain.goal_half * action
        mujoco.mj_step(driven.model, data, FRAME_SKIP)
    assert data.qpos == pytest.approx(plain.data.qpos, abs=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("chain", CHAINS)
def test_bare_mujoco_holds_the_bench_where_the_chain_does(chain):
    driven = BENCH.drivetrain(chain)
    angles = []
    for model in (driven.model, bare_model(driven)):
        data = mujoco.MjData(model)
        data.ctrl[:] = 0.3
        mujoco.mj_step(model, data, 2000)
        angles.append(float(data.qpos[0]))
    assert angles[0] == pytest.approx(angles[1], abs=0.05)


def test_a_missed_bar_is_said_in_the_table():
    row = {
        "robot": "bench",
        "chain": "ideal",
        "simulations": 1,
        "steps_per_second": 8e5,
        "bare_steps_per_second": 1e6,
        "ratio": 0.8,
        "ratio_low": 0.7,
        "ratio_high": 0.9,
        "bar": 0.9,
    }
    page = told([row], None, {"cores": 2, "mujoco": "4", "python": "3"})
    assert "**missed**" in page and "800,000" in page


STOPPED = {
    "fault": "silence",
    "named": "NoReplyError",
    "right_servo": True,
    "cycles_to_stop": 2,
    "rows_lacking": 0,
    "torque_left_on": 0,
    "released_after_naming": 0.002,
}


def test_a_safety_stop_counts_only_if_it_is_in_time_right_and_whole():
    assert control_loop.missed_because(STOPPED) is None
    for key, value in (
        ("named", "late"),
        ("named", None),
        ("right_servo", False),
        ("cycles_to_stop", control_loop.STOP_CYCLES + 1),
        ("rows_lacking", 1),
        ("torque_left_on", 1),
        ("released_after_naming", 0.2),
    ):
        assert control_loop.missed_because({**STOPPED, key: value}) is not None, key
    early = {key: STOPPED[key] for key in ("fault", "named")}
    assert "before the fault" in str(control_loop.missed_because(early))


@pytest.mark.long
@pytest.mark.parametrize(
    "last", [{"kind": "overheat", "servos": [1]}, {"kind": "silence", "servos": [3]}, {"kind": "silence"}]
)
def test_no_cycle_is_counted_as_lacking_where_all_or_some_servos_were_silent(
    last: dict[str, Any], tmp_path: Path
) -> None:
    faults = [
        {"kind": "silence", "at": 0.15, "seconds": 0.02},  # on the way to the start
        {"kind": "drop", "servos": [2], "probability": 0.4, "at": 1.0, "seconds": 1.0},
        {"kind": "silence", "at": 2.5, "seconds": 0.03},
        {**last, "at": 3.5},
    ]
    limits = {"loss": 0.9, "silent": 0.2, "range_margin": 9.0}
    simulation = Simulation("row", commands=sine(0.1), faults=faults, limits=limits, folder=tmp_path)
    outcome = simulation.run(6.0)
    events, rows = read_events(tmp_path / "run.csv"), len(read_measured(tmp_path / "run.csv").runs[0].time)
    missed = [event for event in events if event["event"] == "missed"]
    assert outcome.fault is not None and any(len(event["servos"]) < 4 for event in missed)
    assert any(len(event["servos"]) == 4 for event in missed)
    assert len(control_loop.without_row(events)) < len(missed), "not those on the way to the start"
    assert control_loop.rows_lacking(events, outcome, rows) == 0
    assert control_loop.rows_lacking(events, outcome, rows - 1) == 1


def test_a_bare_loop_counts_its_overruns_as_the_control_loop_does() -> None:
    here, there = multiprocessing.Pipe(duplex=False)
    before = signal.getsignal(signal.SIGINT)
    spin(1000.0, 0.3, 0.0025, there)  # long enough for a busy machine
    signal.signal(signal.SIGINT, before)
    timing = here.recv()
    assert timing["cycles"] > 5 and timing["overruns"] >= timing["cycles"] - 1, "2.5 ms of work each millisecond"
    assert timing["skipped"] >= timing["overruns"] - 1


def test_stolen_time_is_a_share_of_all_or_not_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stat = tmp_path / "stat"
    monkeypatch.setattr(control_loop, "STAT", stat)
    assert control_loop.processor_times() is None
    stat.write_text("cpu  100 0 50 800 10 0 5 35 7 0\ncpu0 50 0 25 400 5 0 3 17 0 0\n")
    assert control_loop.processor_times() == (35, 1000)
    assert control_loop.stolen_share((35, 1000), (85, 1200)) == 0.25
    assert control_loop.stolen_share(None, (85, 1200)) is None and control_loop.stolen_share((1, 9), (1, 9)) is None


def test_a_bus_that_loses_cycles_says_so_in_the_table():
    row = {
        "servos": 3,
        "cycles_per_second": 700.0,
        "bare_cycles_per_second": 720.0,
        "wire_cycles_per_second": 1099.0,
        "ratio": 700 / 720,
        "ratio_low": 0.9,
        "ratio_high": 1.0,
        "cpu_microseconds": 30.0,
        "bare_cpu_microseconds": 10.0,
        "ratio_alone": 0.97,
        "bar": 0.9,
        "failed_cycles": 7,
        "bare_failed_cycles": 5,
    }
    page = bus.told([row], {"cores": 2, "python": "3", "load": 0.1})
    assert "| reached | 7, 5 |" in page
    assert "machine too busy" in bus.told(
        [{**row, "bare_cycles_per_second": 10.0}], {"cores": 2, "python": "3", "load": 9.0}
    )


# --- the matrix of policies -------------------------------------------------------------------------------------------


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
