"""Measured logs are read as written, with their gaps and the parts that count, and refused with one sentence."""

from __future__ import annotations

import errno
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from sealegs.envs.robots import robot_meant
from sealegs.gap.checks.columns import check_clock
from sealegs.gap.log import JointLog, LogError, MeasuredRun, iterate_runs, read_measured, write_run
from sealegs.gap.log.parts import FIT_A, FIT_B, TEST, WARM_UP, cut, known_commands

from testbed.bench import NOISE_FLOOR
from tests.logged_robots import JOINTS, free_replay, nominal_error, two_link_run

SIDECAR = {"robot": "bench", "robot_params": {"mass": 0.5, "length": 0.12}, "actuators": {"servo": "sts3215"}}


def sine_run(name: str = "run", samples: int = 400) -> MeasuredRun:
    rng = np.random.default_rng(1)
    time = 3.0 + np.cumsum(rng.uniform(0.004, 0.006, samples))
    velocity = np.cos(time)
    velocity[5] = np.nan
    return MeasuredRun(
        name=name,
        time=time,
        joints={"servo": JointLog(goal=np.sin(time), position=np.sin(time - 0.1), velocity=velocity)},
        base={"height": 0.1 * time},
        host={"sent": time + 0.002},
        robot_params={"mass": 0.5, "length": 0.12, "arm_mass": 0.0},
        actuators={"servo": [{"position_p": {"gain": 5.3}}]},
        meta={"group": "a", "operator": "me"},
    )


def write_table(folder: Path, text: str, sidecar: object = SIDECAR, name: str = "log.csv") -> Path:
    path = folder / name
    path.write_text(text)
    if sidecar is not None:
        path.with_suffix(".yaml").write_text(sidecar if isinstance(sidecar, str) else yaml.safe_dump(sidecar))
    return path


def table(columns: str = "time,servo.goal,servo.position", rows: int = 20) -> list[str]:
    width = columns.count(",")
    return [columns] + [",".join([f"{0.005 * i:.3f}"] + [f"{0.1 * i}"] * width) for i in range(rows)]


@pytest.mark.parametrize("format", ["csv", "parquet"])
def test_a_run_is_read_back_bit_for_bit(tmp_path: Path, format: str) -> None:
    run = sine_run()
    path = write_run(run, tmp_path, format)
    back = read_measured(path).runs[0]
    assert back.columns().keys() == run.columns().keys()
    for name, values in run.columns().items():
        np.testing.assert_array_equal(values, back.columns()[name])
    assert (back.robot_params, back.actuators, back.meta) == (run.robot_params, run.actuators, run.meta)


def test_a_folder_is_one_data_set_and_its_log_yaml_holds_for_all(tmp_path: Path) -> None:
    for name in ("b", "a"):
        write_table(tmp_path, "\n".join(table()), {"robot_params": {"mass": 0.7}}, f"{name}.csv")
    (tmp_path / "log.yaml").write_text(yaml.safe_dump(SIDECAR))
    data = read_measured(tmp_path)
    assert [run.name for run in data.runs] == ["a", "b"]
    assert data.name == tmp_path.name
    assert data.runs[0].robot_params == {"mass": 0.7, "length": 0.12}


def test_a_torque_driven_log_needs_no_goal(tmp_path: Path) -> None:
    path = write_table(tmp_path, "\n".join(table("time,servo.position,servo.torque")))
    assert read_measured(path).runs[0].joints["servo"].goal is None


def test_a_log_of_one_joint_need_not_name_it(tmp_path: Path) -> None:
    for sidecar, name in ((SIDECAR, "servo"), ({"robot": "bench", "actuators": {"joint": "sts3215"}}, "joint")):
        folder = tmp_path / name
        folder.mkdir()
        path = write_table(folder, "\n".join(table("time,goal,position,host.sent")), sidecar)
        assert set(read_measured(path).runs[0].columns()) == {
            "time", f"{name}.goal", f"{name}.position", "host.sent",
        }  # fmt: skip


def test_a_joint_may_be_driven_by_a_commanded_torque(tmp_path: Path) -> None:
    path = write_table(tmp_path, "\n".join(table("time,servo.position,servo.torque_command")))
    log = read_measured(path).runs[0].joints["servo"]
    assert log.goal is None and log.torque is None and log.torque_command is not None
    back = read_measured(write_run(read_measured(path).runs[0], tmp_path / "again")).runs[0].joints["servo"]
    np.testing.assert_array_equal(back.torque_command, log.torque_command)


def test_a_long_log_is_read_in_pieces_that_make_the_whole(tmp_path: Path) -> None:
    run = sine_run(samples=1001)
    path = write_run(run, tmp_path)
    pieces = list(iterate_runs(path, rows=250))
    assert max(len(piece.time) for piece in pieces) <= 251
    np.testing.assert_array_equal(np.concatenate([piece.time for piece in pieces]), run.time)


def swapped(rows: list[str], row: int, text: str) -> list[str]:
    return [*rows[:row], text, *rows[row + 1 :]]


BAD_TABLES = {
    "missing position": (table("time,servo.goal"), "'servo.position'"),
    "missing goal": (table("time,servo.position"), "'servo.goal'"),
    "missing time": (table("t,servo.goal,servo.position"), "'t'"),
    "unknown column": (table("time,servo.goal,servo.position,servo.velocty"), "did you mean 'servo.velocity'"),
    "slash in a joint": (table("time,/arm/j1.goal,/arm/j1.position"), "'/arm/j1' has a slash in its name"),
    "a column without joint beside one with": (
        table("time,servo.goal,servo.position,velocity"),
        "'velocity' names no joint, as servo.velocity does",
    ),
    "NaN in a commanded torque": (
        swapped(table("time,servo.torque_command,servo.position"), 5, "0.020,nan,0"),
        "'servo.torque_command' has no value (NaN) in row 5",
    ),
    "column twice": (table("time,servo.goal,servo.position,servo.goal"), "twice"),
    "time backwards": (swapped(table(), 9, "0.001,0,0"), "backwards in row 9"),
    "time repeated": (swapped(table(), 9, "0.035,0,0"), "repeats in row 9"),
    "NaN in goal": (swapped(table(), 5, "0.020,nan,0"), "'servo.goal' has no value (NaN) in row 5"),
    "empty position": (swapped(table(), 5, "0.020,0,"), "'servo.position' has no value (NaN) in row 5"),
    "infinite": (swapped(table(), 5, "0.020,0,inf"), "infinite in row 5"),
    "text": (swapped(table(), 5, "0.020,zero,0"), "column 'servo.goal', row 5: 'zero' is not a number"),
    "short row": (swapped(table(), 5, "0.020,0"), "row 5 has 2 values for 3 columns"),
    "one sample": (table(rows=1), "has 1 sample"),
    "no sample": (table(rows=0), "has no samples"),
    "empty": ([], "is empty"),
    "semicolons": ([row.replace(",", ";") for row in table()], "separates columns by semicolons"),
    "some semicolons": ([row.replace(",", ";", 1) for row in table()], "separates columns by semicolons"),
    "milliseconds": (
        ["time,servo.goal,servo.position"] + [f"{5 * i},{i},{i}" for i in range(20)],
        "convert it to seconds",
    ),
    "mixed rates": (
        ["time,servo.goal,servo.position"]
        + [f"{0.005 * i if i < 100 else 0.5 + 0.1 * (i - 100):.3f},0,0" for i in range(200)],
        "split it into one file per rate",
    ),
}


@pytest.mark.parametrize("case", BAD_TABLES)
def test_a_wrong_table_is_refused_with_one_sentence(tmp_path: Path, case: str) -> None:
    rows, expected = BAD_TABLES[case]
    path = write_table(tmp_path, "\n".join(rows))
    with pytest.raises(LogError) as error:
        read_measured(path)
    assert expected in str(error.value)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


BAD_SIDECARS = {
    "missing": (None, "sidecar log.yaml is missing"),
    "unknown key": (SIDECAR | {"actuator": {}}, "did you mean 'actuators'"),
    "bad YAML": ("robot: bench\n  mass: [1,", "not valid YAML in line 2"),
    "no mapping": ("just text", "must be a mapping"),
    "no robot": ({"actuators": {"servo": "sts3215"}}, "robot"),
    "unit in a number": (SIDECAR | {"robot_params": {"mass": "0.5 kg"}}, "robot_params.mass must be a finite number"),
    "wrong joint": (SIDECAR | {"actuators": {"sevro": "sts3215"}}, "did you mean 'servo'"),
    "a joint's other name": (SIDECAR | {"actuators": {"motor": "sts3215"}}, "its joints are servo"),
    "an import that is not filled in": (
        SIDECAR | {"robot": None},
        "robot is left open, in it or in the log.yaml beside it",
    ),
    "no actuator": ({"robot": "bench"}, "has no entry under actuators"),
}


@pytest.mark.parametrize("case", BAD_SIDECARS)
def test_a_wrong_sidecar_is_refused_with_one_sentence(tmp_path: Path, case: str) -> None:
    sidecar, expected = BAD_SIDECARS[case]
    path = write_table(tmp_path, "\n".join(table()), sidecar)
    with pytest.raises(LogError) as error:
        read_measured(path)
    assert expected in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["log.csv", "log.parquet"])
def test_binary_garbage_is_refused_with_one_sentence(tmp_path: Path, name: str) -> None:
    path = write_table(tmp_path, "", name=name)
    path.write_bytes(np.random.default_rng(0).bytes(5000))
    with pytest.raises(LogError, match=r"CSV|Parquet"):
        read_measured(path)


def test_a_truncated_parquet_file_is_refused_with_one_sentence(tmp_path: Path) -> None:
    path = write_run(sine_run(), tmp_path, "parquet")
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(LogError, match="damaged"):
        read_measured(path)


def test_nothing_is_read_where_nothing_is(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no such file"):
        read_measured(tmp_path / "absent.csv")
    with pytest.raises(LogError, match="no measured log"):
        read_measured(tmp_path)


def test_robots_do_not_mix_in_a_data_set(tmp_path: Path) -> None:
    write_table(tmp_path, "\n".join(table()), name="a.csv")
    write_table(tmp_path, "\n".join(table()), SIDECAR | {"robot": "hopper"}, name="b.csv")
    with pytest.raises(LogError, match="one machine per folder"):
        read_measured(tmp_path)


@pytest.mark.parametrize("format", ["csv", "parquet"])
def test_a_recording_is_never_overwritten(tmp_path: Path, format: str) -> None:
    path = write_run(sine_run(), tmp_path, "csv")
    before = path.read_bytes()
    with pytest.raises(LogError, match="never overwritten"):
        write_run(sine_run(samples=50), tmp_path, format)
    assert path.read_bytes() == before
    assert sorted(file.name for file in tmp_path.iterdir()) == ["run.csv", "run.yaml"]


def test_a_full_disk_leaves_earlier_files_and_no_half_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_run(sine_run("first"), tmp_path)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(LogError, match="disk is full") as error:
        write_run(sine_run("second"), tmp_path)
    assert "\n" not in str(error.value)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_a_run_name_cannot_leave_its_folder(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="plain file name"):
        write_run(sine_run("../escape"), tmp_path / "logs")


def test_a_base_that_is_measured_in_six_directions_reads_back(tmp_path: Path) -> None:
    columns = ["time", "leg.goal", "leg.position", "base.body.x", "base.body.yaw", "base.body_z", "host.leg_status"]
    rows = ["0.0,0.1,0.1,1.0,2.0,3.0,0", "0.1,0.1,0.1,1.5,2.5,3.5,0"]
    (tmp_path / "run.csv").write_text("\n".join([",".join(columns), *rows]) + "\n")
    (tmp_path / "run.yaml").write_text("robot: hexapod\nactuators: {leg: sts3215}\n")
    run = read_measured(tmp_path / "run.csv").runs[0]
    assert list(run.base) == ["body.x", "body.yaw", "body_z"] and list(run.host) == ["leg_status"]
    assert run.base["body.yaw"].tolist() == [2.0, 2.5] and list(run.joints) == ["leg"]


def test_a_folder_of_folders_names_one_that_can_be_read(tmp_path: Path) -> None:
    for servo in ("left", "right"):
        write_run(sine_run(), tmp_path / servo)
    with pytest.raises(LogError, match=r"holds no measured log.*such as \S*left, or all 2 as a fleet"):
        read_measured(tmp_path)


def lacking(run: MeasuredRun, start: float, stop: float) -> MeasuredRun:
    """The run without the samples between two times [s]."""
    kept = (run.time < start) | (run.time > stop)
    joints = {
        name: replace(log, **{key: values[kept] for key, values in log.signals().items()})
        for name, log in run.joints.items()
    }
    return replace(run, time=run.time[kept], joints=joints)


def test_motion_after_lost_commands_does_not_count_until_it_has_forgotten_them(tmp_path: Path) -> None:
    """A replay ran on under the last command, and its error was a gap of 105 mrad on a machine with nothing hidden."""
    run = lacking(two_link_run(tmp_path, 8.0), 3.0, 3.3)
    (finding,) = [found for found in check_clock(run) if found.code == "clock.gaps"]
    assert "motion counts again 1.5 s later" in finding.sentence
    assert all(nominal_error(free_replay(run, joint)) < 2.0 * NOISE_FLOOR for joint in JOINTS)


def test_what_counts_after_a_gap() -> None:
    time = np.delete(np.arange(0.0, 10.0, 0.01), np.arange(300, 330))
    changing, held = np.sin(time), np.zeros_like(time)
    assert known_commands(time, held).all(), "nothing was lost that a held command does not say"
    known = known_commands(time, changing)
    assert not known[(time > 2.99) & (time < 3.3 + WARM_UP)].any()
    assert known[(time < 2.9) | (time > 3.31 + WARM_UP)].all()
    assert known_commands(np.arange(0.0, 1.0, 0.01), np.arange(100.0)).all(), "a clock without gaps"


def test_half_of_what_lies_between_frequent_gaps_counts() -> None:
    time = np.arange(0.0, 10.0, 0.01)
    time = time[(time % 1.0) > 0.1]
    known = known_commands(time, np.sin(time))
    assert 0.4 < known[time > 1.0].mean() < 0.6


def recorded(seconds: float, link: bool = False) -> MeasuredRun:
    time = np.arange(0.0, seconds, 0.005)
    angle = 0.3 * np.sin(6.0 * time)
    log = JointLog(goal=angle, position=angle, link_position=angle if link else None)
    return MeasuredRun("run", time, {"servo": log}, robot="bench")


@pytest.mark.parametrize(
    ("seconds", "link", "unjudged"),
    [(1.5, False, 0.1), (10.0, False, 0.4), (60.0, False, 1.0), (10.0, True, 1.25), (60.0, True, 1.5)],
)
def test_what_came_before_a_run_is_forgotten_before_it_is_judged(seconds: float, link: bool, unjudged: float) -> None:
    runs = [replace(recorded(seconds, link), meta={"group": str(k % 3)}) for k in range(6)]
    for unit in cut(runs, "servo"):
        assert runs[unit.run].time[unit.judged] == pytest.approx(unjudged, abs=0.01)


@pytest.mark.parametrize(("seconds", "whole"), [(12.0, True), (70.0, False)])
def test_each_part_gets_of_every_run_that_is_long(seconds: float, whole: bool) -> None:
    """Of eight motions of a public arm, the limit of the acceleration showed in one part, and was no cause in both."""
    runs = [recorded(seconds) for _ in range(8)]
    parts = [{unit.part for unit in cut(runs, "servo") if unit.run == k} for k in range(8)]
    assert all(len(of_run) == (1 if whole else 3) for of_run in parts)
    mixed = [*runs[:7], recorded(70.0)]
    found = cut(mixed, "servo")
    assert {unit.part for unit in found if unit.run == 7} == {FIT_A, FIT_B, TEST}
    assert all(len([unit for unit in found if unit.run == k]) == 1 for k in range(7)) or not whole


@pytest.mark.parametrize("seconds", [8.0, 60.0])
@pytest.mark.parametrize("first", [True, False])
def test_a_single_run_beside_the_test_group_is_fitted_in_both_parts(seconds: float, first: bool) -> None:
    """Part B was empty, and the refusal called logs of any length too short."""
    kept = replace(recorded(seconds), name="kept", meta={"group": "kept"})
    runs = [recorded(seconds), kept] if first else [kept, recorded(seconds)]
    units = cut(runs, "servo", "kept")
    assert [unit.part for unit in units if runs[unit.run] is kept] == [TEST]
    fitted = [unit for unit in units if runs[unit.run] is not kept]
    assert {unit.part for unit in fitted} == {FIT_A, FIT_B} and len(fitted) >= 4
    judged = [set(range(unit.start + unit.judged, unit.stop)) for unit in fitted]
    assert max(unit.stop for unit in fitted) == len(kept.time)
    assert sum(map(len, judged)) <= len(set().union(*judged)) + len(fitted), "no sample is judged in both parts"


@pytest.mark.parametrize(("word", "meant"), [("hexapdo", "hexapod"), ("arm2", ""), ("so101", ""), ("arm", "")])
def test_a_robots_word_is_misspelt_or_ones_own(word: str, meant: str) -> None:
    """A diagnosis refused words of one's own that an import takes: arm2 is no arm."""
    assert robot_meant(word) == (f" (did you mean '{meant}'?)" if meant else "")
