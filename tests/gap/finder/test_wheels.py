"""Logs of speed goals: what a hidden wheel does otherwise is found, by a plant that shares no code with the models."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sealegs
from sealegs.common.errors import SealegsError
from sealegs.gap.checks.data_set import check_set
from sealegs.gap.log.arrays import measured_set

from testbed.wheel import Wheel, nominal, record_wheel

MODEL = """<mujoco><worldbody><body name="rim"><joint name="wheel" axis="0 1 0"/>
<inertial pos="0 0 0" mass="0.4" diaginertia="0.002 0.004 0.002"/></body></worldbody></mujoco>"""
ROBOT = "model: wheel.xml\njoints:\n  wheel: {chain: sts3215_wheel, range: [-5, 5], damping: chain, armature: chain}\n"
CAUSES = ("drive.delay", "drive.gain", "drive.goal_filter", "friction.coulomb", "friction.viscous", "friction.stribeck",
          "drive.motor_constant", "load.inertia", "sensor.delay", "drive.offset", "drive.saturation")  # fmt: skip


def logged(
    folder: Path, hidden: Mapping[str, float], runs: int = 3, seed: int = 0
) -> tuple[list[dict[str, np.ndarray]], dict[str, Any]]:
    """Columns of runs of a wheel that hides something, and their sidecar."""
    (folder / "wheel.xml").write_text(MODEL)
    (folder / "wheel.yaml").write_text(ROBOT)
    sidecar = {"robot": str(folder / "wheel.yaml"), "actuators": {"wheel": nominal()}}
    recorded = record_wheel(str(folder / "wheel.yaml"), Wheel(**hidden), seed=seed, runs=runs)
    columns = [{"time": r.time} | {f"wheel.{k}": v for k, v in r.joints["wheel"].items()} for r in recorded]
    return columns, sidecar


def test_a_log_of_speeds_is_told_apart_from_one_of_positions(tmp_path: Path) -> None:
    columns, sidecar = logged(tmp_path, {}, runs=1)
    with pytest.raises(
        SealegsError, match="'wheel' has no goals but goal_velocity; give it a chain that is told speeds"
    ):
        sealegs.diagnose(columns, sidecar=sidecar | {"actuators": {"wheel": "sts3215"}})


@pytest.mark.long
@pytest.mark.parametrize(
    ("hidden", "found"),
    [
        ({"delay": 0.025}, "drive.delay"),
        ({"integral": 2.6, "gain": 0.125}, "drive.gain"),
        ({"coulomb": 0.15}, "friction.coulomb"),
    ],
)
def test_what_a_wheel_hides_is_found(tmp_path: Path, hidden: dict[str, float], found: str) -> None:
    columns, sidecar = logged(tmp_path, hidden)
    diagnosis = sealegs.diagnose(columns, sidecar=sidecar, causes=CAUSES)
    assert [cause.name for cause in diagnosis.causes] == [found] and diagnosis.verdict == "explained"


@pytest.mark.parametrize("seed", range(4))
def test_a_duty_that_holds_a_speed_is_no_column_that_is_stuck(tmp_path: Path, seed: int) -> None:
    """It stays for 0.6 s while the wheel turns, and was set aside in every log."""
    columns, sidecar = logged(tmp_path, {}, seed=seed)
    assert [finding for finding in check_set(measured_set(columns, sidecar)) if finding.data_error] == []


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_named_of_a_wheel_that_hides_nothing(tmp_path: Path, seed: int) -> None:
    """Of all causes that there are, none; nor an error of the log, nor a number that was refitted."""
    columns, sidecar = logged(tmp_path, {}, seed=seed)
    diagnosis = sealegs.diagnose(columns, sidecar=sidecar)
    assert diagnosis.causes == () and diagnosis.data_errors == ()
    # the noise is reached; what the motion would hide is listed in the sentence
    assert diagnosis.verdict in ("nothing to explain", "not identifiable")
    assert diagnosis.sentence.startswith("The simulation of 'wheel' is within 0.")
