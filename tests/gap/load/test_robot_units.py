"""Logs that cannot be read as they stand: too short, or in units that their sidecar names, hides or makes up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.common.errors import SealegsError
from sealegs.gap.checks.data_set import check_run, check_set, corrected
from sealegs.gap.diagnose import diagnose
from sealegs.gap.load.robot import robot_of
from sealegs.gap.load.units import in_model_units
from sealegs.gap.log.finding import Finding
from sealegs.gap.log.reader import measured_set
from sealegs.gap.log.types import LogError, MeasuredSet
from sealegs.gap.prepare.checking import check_log

from testbed import hidden_bench
from tests.logged_robots import JOINT
from tests.quick import quick

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


def test_a_slide_that_may_be_in_centimetres_is_not_taken_for_millimetres(tmp_path: Path) -> None:
    """0.147 m became 0.0147 m."""
    data = log(tmp_path, table(rail_position=100.0, rail_goal=100.0))
    asked = [f for f in check_set(data) if f.code.startswith("unit.")]
    assert {f.code for f in asked} == {"unit.length"}
    assert "cm or mm would fit. Say which it is in the sidecar, units: {rail.position: cm}" in asked[0].sentence
    said = log(tmp_path, table(rail_position=100.0, rail_goal=100.0), units={"rail.position": "cm", "rail.goal": "cm"})
    machine = robot_of(said.runs[0])
    assert machine is not None
    assert not [f for f in check_set(in_model_units(said, machine)[0]) if f.code.startswith("unit.")]


def test_a_slide_in_no_unit_that_fits_its_range_is_neither_degrees_nor_ticks(tmp_path: Path) -> None:
    data = log(tmp_path, {k: v if k == "time" else np.round(1e9 * v) for k, v in table().items()})
    found = {(f.code, f.column) for f in check_set(data)}
    assert ("unit.length", "rail.position") in found and ("unit.ticks", "shoulder.position") in found
    assert ("unit.ticks", "rail.position") not in found


def test_a_unit_that_is_not_the_models_is_refused(tmp_path: Path) -> None:
    sidecar = log(tmp_path, table(), units={"rail.position": "furlong"})
    with pytest.raises(SealegsError, match=r"rail\.position is in furlong, and the model has that joint in m; convert"):
        diagnose(sidecar, causes=["friction.coulomb"])


def test_a_joint_that_the_robot_has_not_is_told_before_its_unit(tmp_path: Path) -> None:
    """ "slide.position is in m, and the model has that joint in rad": there was no such joint."""
    columns = {name.replace("rail", "slide"): values for name, values in table().items()}
    own = {"slide": [SERVO], "shoulder": [SERVO]}
    data = log(tmp_path, columns, actuators=own, units={"slide.position": "mm", "slide.goal": "mm"})
    with pytest.raises(SealegsError, match=r"drives no 'slide'.*it drives rail, shoulder"):
        check_log(data, lambda text: None)


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


# --- a bench, and robots without a file ------------------------------------------------------------------------------

SIZES = {"rad": 1.0, "deg": 180.0 / np.pi, "turn": 0.5 / np.pi, "mm": 1000.0}


@cache
def bench() -> MeasuredSet:
    return hidden_bench({}, 0)[0]


def recorded(
    position: str, goal: str, units: Mapping[str, str], noise: float = 0.0, robot: str = "bench"
) -> MeasuredSet:
    """The bench's log with its angles in these units, and with what its sidecar says of them."""
    runs = []
    for k, run in enumerate(bench().runs):
        log = run.joints[JOINT]
        assert log.goal is not None
        angle = log.position + noise * np.random.default_rng(k).normal(size=len(run.time))
        log = replace(log, position=SIZES[position] * angle, goal=SIZES[goal] * log.goal)
        runs.append(replace(run, robot=robot, joints={JOINT: log}, meta={**run.meta, "units": dict(units)}))
    return replace(bench(), runs=tuple(runs))


def both(unit: str) -> dict[str, str]:
    return {f"{JOINT}.position": unit, f"{JOINT}.goal": unit}


def checked(data: MeasuredSet) -> list[Finding]:
    """What is found in a log, whose angles are those of the bench afterwards."""
    got, findings, stop = check_log(data, lambda text: None)
    assert stop is None
    for now, run in zip(got.runs, bench().runs, strict=True):
        np.testing.assert_allclose(now.joints[JOINT].position, run.joints[JOINT].position, atol=1e-9)
        goal, wanted = now.joints[JOINT].goal, run.joints[JOINT].goal
        assert goal is not None and wanted is not None
        np.testing.assert_allclose(goal, wanted, atol=1e-9)
    return findings


@pytest.mark.parametrize("robot", quick(["bench", "hopper", "a machine of ours"], 3))
@pytest.mark.parametrize("unit", ["deg", "turn", "mm"])
def test_columns_of_a_robot_without_a_file_are_converted_as_its_sidecar_says(unit: str, robot: str) -> None:
    """A right log in turns or degrees was `not identifiable`."""
    usual = [(finding.code, finding.column) for finding in check_log(bench(), lambda text: None)[1]]
    data = recorded(unit, unit, both(unit), robot=robot)
    assert [(finding.code, finding.column) for finding in checked(data)] == usual


@pytest.mark.long
def test_a_position_may_be_in_another_unit_than_its_goal() -> None:
    usual = [(finding.code, finding.column) for finding in check_log(bench(), lambda text: None)[1]]
    found = checked(recorded("turn", "rad", {"position": "turn"}))
    assert [(finding.code, finding.column) for finding in found] == usual


def test_rates_are_converted_too() -> None:
    run = bench().runs[0]
    speed = np.gradient(run.joints[JOINT].position, run.time)
    logged = replace(run.joints[JOINT], velocity=speed / (2.0 * np.pi))
    data = MeasuredSet((replace(run, joints={JOINT: logged}, meta={"units": {"velocity": "turn/s"}}),), "log")
    velocity = in_model_units(data, None)[0].runs[0].joints[JOINT].velocity
    assert velocity is not None
    np.testing.assert_allclose(velocity, speed, atol=1e-12)


def test_checks_of_a_run_see_the_units_of_the_model() -> None:
    """Pieces of a long log are checked before anything is converted: a turn of 360 is one of 2 pi there."""
    data = recorded("deg", "deg", both("deg"))
    run = data.runs[0]
    turned = np.mod(run.joints[JOINT].position + 5.0, 360.0)
    run = replace(run, joints={JOINT: replace(run.joints[JOINT], position=turned)})
    (wrap,) = [finding for finding in check_run(run) if finding.code == "position.wrap"]
    assert wrap.value == pytest.approx(2.0 * np.pi, rel=0.02)


@pytest.mark.long
@pytest.mark.parametrize(
    ("units", "column"),
    [({}, "both"), (both("rad"), "both"), ({"position": "deg"}, "goal"), ({"goal": "deg"}, "position")],
)
def test_a_column_in_degrees_is_told_where_its_unit_is_not_said(units: dict[str, str], column: str) -> None:
    told = {finding.column for finding in checked(recorded("deg", "deg", units)) if finding.code == "unit.degrees"}
    assert told == ({*both("")} if column == "both" else {f"{JOINT}.{column}"})


@pytest.mark.long
@pytest.mark.parametrize(
    ("position", "goal", "units", "noise", "sentence"),
    [
        ("rad", "rad", both("deg"), 0.0, r"servo\.position is in deg, and it is in rad: its step of 0\.001534 is a"),
        ("turn", "turn", both("deg"), 0.0, r"is in deg, and it is in turn: .* divided by 4096; correct the entry"),
        ("deg", "deg", both("turn"), 0.0, r"is in turn, and it is in deg"),
        ("deg", "deg", both("turn"), 5e-4, r"is in turn, and with that servo\.position is in degrees, not in radians"),
        ("rad", "rad", {"goal": "deg"}, 5e-4, r"servo\.goal is in deg, and as .* it and servo\.position move alike"),
        ("rad", "rad", {"position": "deg"}, 5e-4, r"servo\.position is in deg, and as they .* servo\.goal move alike"),
        ("rad", "rad", both("furlong"), 0.0, r"in furlong, and this joint is in rad; conv.*\(rad, deg, turn, m, cm"),
        ("rad", "rad", both("mm") | {"servo.goal": "rad"}, 0.0, r"servo\.goal is in rad, and this joint is in m"),
        ("rad", "rad", both("percent"), 0.0, r"a percent of the joint's range, and of a bench no range is known; conv"),
    ],
)  # fmt: skip
def test_a_unit_that_is_not_that_of_the_column_is_refused_in_a_sentence(
    position: str, goal: str, units: dict[str, str], noise: float, sentence: str
) -> None:
    with pytest.raises(LogError, match=sentence) as error:
        check_log(recorded(position, goal, units, noise), lambda text: None)
    assert "\n" not in str(error.value) and "units says that" in str(error.value)


def test_runs_of_one_machine_may_say_their_units_apart() -> None:
    """What one sidecar says is converted; what the other one leaves out is told, of that run alone."""
    said, unsaid = recorded("deg", "deg", both("deg")).runs[0], recorded("deg", "deg", {}).runs[1:]
    findings = checked(replace(bench(), runs=(said, *unsaid)))
    told = {finding.run for finding in findings if finding.code == "unit.degrees"}
    assert said.name not in told and told <= {None, *(run.name for run in unsaid)} and told


def test_a_share_of_a_range_that_nobody_says_is_noted() -> None:
    findings = check_log(recorded("rad", "rad", both("fraction"), robot="a machine of ours"), lambda text: None)[1]
    notes = [finding for finding in findings if finding.code == "unit.share"]
    assert {note.column for note in notes} == {*both("")} and len(notes) == 2, "once for the machine"
    assert "a fraction of a range that nobody says" in notes[0].sentence
