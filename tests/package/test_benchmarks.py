"""The two sides of a comparison do the same work."""

from __future__ import annotations

import multiprocessing
import signal
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from sealegs.envs.bench.robot import BENCH
from sealegs.envs.hopper.robot import HOPPER
from sealegs.gap.log import read_measured
from sealegs.hw.run.measured_log import read_events

from benchmarks import bus, control_loop
from benchmarks.control_loop import spin
from benchmarks.python_hopper import FRAME_SKIP, PythonHopper
from benchmarks.speed import CHAINS, bare_model, told
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
