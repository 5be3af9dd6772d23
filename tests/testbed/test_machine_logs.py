"""A leg and an arm without gravity that hide something at one joint, for the finder to name."""

from __future__ import annotations

from pathlib import Path

import pytest

from testbed.arm import DELAY, MACHINES, SERVOS, mjcf
from testbed.logs import hidden_arm


@pytest.mark.long
def test_what_the_machines_hide_is_seen_at_the_joint_that_has_it(tmp_path: Path) -> None:
    for machine, effect, joint in (("leg", "meshing", "joint_3"), ("flat", "softer", "joint_2")):
        runs = []
        for effects in ({}, {effect: (joint, "clear")}):
            folder = tmp_path / f"{machine}{len(runs)}{len(effects)}"
            folder.mkdir()
            data, _ = hidden_arm(folder, machine, effects, seed=3, runs=1, duration=3.0, nominal_error=0.0)
            runs.append(data.runs[0])
        off = {
            name: float(abs(runs[0].joints[name].position - runs[1].joints[name].position).max())
            for name in runs[0].joints
        }
        assert off[joint] > 3e-3 and (machine == "flat" or off[joint] == max(off.values())), (
            off
        )  # a level arm swings along
    assert DELAY > 0.0 and set(SERVOS) <= set(MACHINES) and "joint_3" in mjcf(MACHINES["leg"])
