"""Logs of robots that cannot be read as they stand: too short, slides in other units, and units nobody knows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.actuators.errors import SealegsError
from sealegs.gap.checks.data_set import check_set, corrected
from sealegs.gap.diagnose import diagnose
from sealegs.gap.load.robot import robot_of
from sealegs.gap.load.units import in_model_units
from sealegs.gap.log.arrays import measured_set
from sealegs.gap.log.types import MeasuredSet

MODEL = """<mujoco><compiler angle="radian" autolimits="true"/><worldbody><body name="cart">
<joint name="rail" type="slide" axis="1 0 0" {range}/><geom type="box" size="0.05 0.05 0.02" mass="1"/>
<body name="arm"><joint name="shoulder" axis="0 1 0" range="-1.5 1.5"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.01" mass="0.2"/></body></body></worldbody></mujoco>"""
SERVO = {"ideal": {"stiffness": 800.0, "damping": 60.0}}


def table(seconds: float = 6.0, **factors: float) -> dict[str, Any]:
    """A cart and an arm that follow their goals a little late."""
    time = np.arange(0.0, seconds, 0.01)
    noise = np.random.default_rng(2).normal(0.0, 1e-4, (2, len(time)))
    columns: dict[str, Any] = {"time": time}
    for k, (joint, size) in enumerate({"rail": 0.15, "shoulder": 0.6}.items()):
        for signal, late, jitter in (("goal", 0.0, 0.0), ("position", 0.05, noise[k])):
            values = size * np.sin(2.0 * np.pi * 0.7 * (time - late)) + jitter
            columns[f"{joint}.{signal}"] = factors.get(f"{joint}_{signal}", 1.0) * values
    return columns


def log(folder: Path, columns: dict[str, Any], limits: str = 'range="-0.3 0.3"', **more: Any) -> MeasuredSet:
    path = folder / "cart.xml"
    path.write_text(MODEL.format(range=limits))
    sidecar = {"robot": str(path), "actuators": {"rail": [SERVO], "shoulder": [SERVO]}, **more}
    return measured_set(columns, sidecar)


@pytest.mark.parametrize("limits", ['range="-0.3 0.3"', ""])
def test_a_slide_in_millimetres_is_told_and_converted(limits: str, tmp_path: Path) -> None:
    plain, wrong = table(), table(rail_position=1000.0, rail_goal=1000.0)
    data = log(tmp_path, wrong, limits)
    mended, findings = corrected(data, check_set(data))
    assert {f.column for f in findings if f.code == "unit.millimetres"} == {"rail.position", "rail.goal"}
    assert all("is in millimetres, not in metres" in f.sentence for f in findings if f.code == "unit.millimetres")
    assert not [f for f in findings if f.code in ("unit.degrees", "unit.ticks")]
    np.testing.assert_allclose(mended.runs[0].joints["rail"].position, plain["rail.position"])
    assert not [f for f in check_set(log(tmp_path, plain, limits)) if f.code.startswith("unit.")]


def test_a_slide_in_no_unit_that_fits_its_range_is_neither_degrees_nor_ticks(tmp_path: Path) -> None:
    data = log(tmp_path, {k: v if k == "time" else np.round(1e9 * v) for k, v in table().items()})
    found = {(f.code, f.column) for f in check_set(data)}
    assert ("unit.length", "rail.position") in found and ("unit.ticks", "shoulder.position") in found
    assert ("unit.ticks", "rail.position") not in found


def test_a_unit_that_is_not_the_models_is_refused(tmp_path: Path) -> None:
    sidecar = log(tmp_path, table(), units={"rail.position": "furlong"})
    with pytest.raises(SealegsError, match=r"rail\.position is in furlong, and the model has that joint in m; convert"):
        diagnose(sidecar, causes=["friction.coulomb"])


def test_a_percentage_of_the_range_and_other_units_are_converted(tmp_path: Path) -> None:
    plain = table()
    said = {"rail.position": ("percent", (plain["rail.position"] + 0.3) / 0.6 * 100.0)}
    said |= {"rail.goal": ("mm", 1000.0 * plain["rail.goal"])}
    said |= {"shoulder.goal": ("fraction", (plain["shoulder.goal"] + 1.5) / 3.0)}
    said |= {"shoulder.position": ("deg", np.degrees(plain["shoulder.position"]))}
    other = plain | {column: values for column, (_, values) in said.items()}
    data = log(tmp_path, other, units={column: unit for column, (unit, _) in said.items()})
    robot = robot_of(data.runs[0])
    assert robot is not None
    converted, notes = in_model_units(data, robot)
    for column, values in converted.runs[0].columns().items():
        np.testing.assert_allclose(values, plain[column], atol=1e-12, err_msg=column)
    assert {note.column for note in notes} == {"rail.position", "shoulder.goal"}
    assert "that share of the joint's range in the model, -0.3 to 0.3 m" in notes[0].sentence
    assert in_model_units(converted, robot)[1] == []
    without = log(tmp_path, other, "", units={"rail.position": "percent"})
    robot = robot_of(without.runs[0])
    assert robot is not None
    with pytest.raises(SealegsError, match="the model gives it no range; add one to the model, or convert"):
        in_model_units(without, robot)


@pytest.mark.parametrize("samples", [2, 3, 12])
def test_a_run_of_a_few_samples_is_refused_in_a_sentence(samples: int, tmp_path: Path) -> None:
    short = {name: values[:samples] for name, values in table().items()}
    with pytest.raises(SealegsError, match=rf"has {samples} samples, and a diagnosis of a robot needs 30 at least"):
        diagnose(log(tmp_path, short), causes=["friction.coulomb"])
