"""The two sides of a comparison do the same work."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from benchmarks.python_hopper import FRAME_SKIP, PythonHopper
from benchmarks.speed import CHAINS, bare_model, table
from envs.bench.robot import BENCH
from envs.hopper.robot import HOPPER


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
    page = table([row], None, {"cores": 2, "mujoco": "4", "python": "3"})
    assert "**missed**" in page and "800,000" in page
