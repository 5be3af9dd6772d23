"""Mappings and other YAML that a person writes: what is wrong is told in one sentence."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.commands.cli import main
from sealegs.common.documents import parse_yaml
from sealegs.common.errors import SealegsError
from sealegs.envs.engine.randomization import read_randomization
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import Recording, answered, import_logs, read_mapping
from sealegs.gap.log.importers.expression import evaluate
from sealegs.gap.log.importers.mapping import Mapping, filled
from sealegs.gap.log.sidecar import read_sidecar
from sealegs.hw.virtual.machine import hide
from sealegs.hw.virtual.wire import read_faults

from tests.importers.importing import motion, table
from tests.importers.test_import_tables import texts_of

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")
M = motion(5.0, 100.0, seed=1)
COLUMNS = "columns: {time: t, joint.goal: goal, joint.position: q}\n"


def source(folder: Path, **columns: np.ndarray) -> Path:
    return table(folder, {"t": M["time"], "goal": M["goal"], "q": M["smooth"], **columns})


# --- the sidecar -----------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(
    ("sidecar", "sentence"),
    [
        ("{robot_params: [1, 2]}", "the key robot_params must be a mapping, not [1, 2]"),
        ("{robot_params: text}", "the key robot_params must be a mapping, not 'text'"),
        ("{robot_params: {mass: [1]}}", "robot_params.mass must be a finite number, not [1]"),
        ("{robot_params: {mass: heavy}}", "robot_params.mass must be a finite number, not 'heavy'"),
        ("{actuators: [sts3215]}", "the key actuators must be a mapping, not ['sts3215']"),
        ("{actuators: {joint: 5}}", "actuators.joint must be a chain name or a list of stages, not 5"),
        ("{meta: text}", "the key meta must be a mapping, not 'text'"),
        ("{units: deg}", "the key units must be a mapping, not 'deg'"),
        ("{meta: {units: deg}}", "the key units must be a mapping, not 'deg'"),
        ("{robot: [bench]}", "the key robot must name the robot, for example robot: bench, not ['bench']"),
        ("{actuator: {joint: sts3215}}", "unknown key 'actuator' (did you mean 'actuators'?)"),
    ],
)
def test_a_wrong_sidecar_in_a_mapping_gets_one_sentence(
    tmp_path: Path, sidecar: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Most of them ended in a traceback, also where the call says the same key itself."""
    path = tmp_path / "own.yaml"
    path.write_text(f"{COLUMNS}sidecar: {sidecar}\n")
    call = ["import", str(source(tmp_path)), f"out={tmp_path / 'log'}", f"mapping={path}"]
    for answer in ([], ["actuator=sts3215"], ["robot_params={length: 0.1}"]):
        assert main([*call, *answer]) == 2
        said = capsys.readouterr().err.strip()
        assert sentence in said and "\n" not in said and not (tmp_path / "log").exists()


def test_a_sidecar_may_take_its_numbers_from_the_file_and_leave_its_robot_open(tmp_path: Path) -> None:
    path = source(tmp_path)
    path.with_suffix(".meta.json").write_text('{"mass": 0.5}')
    (tmp_path / "own.yaml").write_text(f"{COLUMNS}sidecar: {{robot_params: {{mass: '${{mass}}', length: 1e-1}}}}\n")
    done = import_logs(path, tmp_path / "log", read_mapping(tmp_path / "own.yaml"))
    assert "robot" in done.missing
    assert "mass: 0.5" in done.sidecar.read_text() and "length: 0.1" in done.sidecar.read_text()


# --- empty cells -----------------------------------------------------------------------------------------------------


def test_what_goes_along_a_column_passes_over_its_empty_cells() -> None:
    """One of them left no value in all that follow."""
    angle, empty = np.linspace(0.0, 20.0, 50), np.array([0, 7, 8, 30])
    holes = np.where(np.isin(np.arange(50), empty), np.nan, np.mod(angle, 2.0 * np.pi))
    kept = np.where(np.isnan(holes), np.nan, angle)
    np.testing.assert_allclose(evaluate("unwrap(q)", {"q": holes}, ""), kept)
    np.testing.assert_allclose(evaluate("cumsum(q)", {"q": np.array([1.0, np.nan, 2.0])}, ""), [1.0, np.nan, 3.0])
    np.testing.assert_allclose(
        evaluate("counter(q)", {"q": np.array([250.0, np.nan, 3.0, 9.0])}, ""), [250.0, np.nan, 259.0, 265.0]
    )
    np.testing.assert_allclose(evaluate("unwrap(q)", {"q": np.full(3, np.nan)}, ""), np.full(3, np.nan))


def test_a_wrapped_angle_with_an_empty_cell_is_imported_as_the_advice_says(tmp_path: Path) -> None:
    angle = 4.0 * M["smooth"]
    wrapped = np.mod(angle + np.pi, 2.0 * np.pi) - np.pi
    path = source(tmp_path, q=np.where(np.arange(len(angle)) == 40, np.nan, wrapped), goal=4.0 * M["goal"])
    columns = {"time": "t", "joint.goal": "goal", "joint.position": "unwrap(q)"}
    with pytest.raises(
        LogError, match=r"no value in 1 of 500 samples, the first in row 41; .*`where: known\(unwrap\(q\)\)`"
    ):
        import_logs(path, tmp_path / "log", Mapping(columns))
    sidecar = {"robot": "bench", "robot_params": {"mass": 0.5, "length": 0.1}, "actuators": {"joint": "sts3215"}}
    import_logs(path, tmp_path / "log", Mapping(columns, where="known(q)", sidecar=sidecar))
    (run,) = read_measured(tmp_path / "log").runs
    np.testing.assert_allclose(run.joints["joint"].position, np.delete(angle, 40), atol=1e-6)


def hidden(path: Path) -> object:
    robot: Any = None
    return hide(robot, {}, {}, str(path))


@pytest.mark.parametrize(
    ("read", "text", "key"),
    [
        (load_chain, "- delay: {seconds: 0.01}\n- friction:\n    coulomb: 0.1\n    coulomb: 0.2\n", "coulomb"),
        (
            read_sidecar,
            "robot: bench\nrobot_params: {mass: 0.1, length: 0.1}\nrobot_params: {mass: 0.2}\n",
            "robot_params",
        ),
        (read_mapping, "columns:\n  time: t\n  arm.position: a\n  arm.position: b\n", "arm.position"),
        (hidden, "delay.seconds: 0.01\ndelay.seconds: 0.02\n", "delay.seconds"),
        (read_faults, "- kind: drop\n  at: 2.0\n  at: 3.0\n", "at"),
        (read_randomization, "floor: {friction: [0.6, 1.0]}\nfloor: {friction: [0.1, 1.0]}\n", "floor"),
    ],
)
def test_it_is_refused_with_the_lines(read: Callable[[Path], Any], text: str, key: str, tmp_path: Path) -> None:
    path = tmp_path / "written.yaml"
    path.write_text(text)
    with pytest.raises(SealegsError, match=f"'{key}' stands twice, in lines? [0-9]") as said:
        read(path)
    assert "\n" not in str(said.value) and "unicode string" not in str(said.value)


def test_what_several_places_share_may_be_merged_and_overridden() -> None:
    text = "a: &a {x: 1, y: 2}\nb: &b {<<: *a, y: 3}\nc: {<<: [*a, *b], x: 4}\n"
    assert parse_yaml(text) == {"a": {"x": 1, "y": 2}, "b": {"x": 1, "y": 3}, "c": {"x": 4, "y": 2}}


# --- layouts whose names say little, and what is no log ---------------------------------------------------------------


TIME = M["time"]
DEG = {"goal_deg": np.degrees(M["goal"]), "pos_deg": np.degrees(M["smooth"])}


def names_changed(path: Path, head: str) -> Path:
    lines = path.read_text().splitlines()
    path.write_text("\n".join([head, *lines[1:]]) + "\n")
    return path


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """The sentence on the standard error."""
    said = capsys.readouterr().err.strip()
    assert "\n" not in said and "Warning" not in said and ". ." not in said and ".." not in said.replace("...", "")
    return said


def test_two_columns_of_one_name_are_two_joints_with_names(tmp_path: Path) -> None:
    path = names_changed(table(tmp_path, {"t": TIME, "a": M["goal"], "b": M["smooth"]}), "t,pos,pos")
    columns, asked, shown = texts_of(path)
    assert list(columns) == ["time", "joint.position", "joint2.position"] and "joint2.goal" in asked
    assert "several columns are called pos; the second of them is pos_2 here" in shown


def test_a_file_without_a_clock_is_timed_by_its_rows(tmp_path: Path) -> None:
    path = table(tmp_path, DEG)
    columns, asked, shown = texts_of(path)
    assert asked == ["time"] and columns["time"] == "row/100" and "row/<samples a second>" in shown
    import_logs(path, tmp_path / "log", Mapping(columns))
    (tmp_path / "log" / "log.yaml").write_text("robot: bench\nactuators: {joint: ideal}\n")
    np.testing.assert_allclose(read_measured(tmp_path / "log").runs[0].time, TIME, atol=1e-9)


def test_samples_without_a_value_are_left_out_by_a_line_that_is_offered(tmp_path: Path) -> None:
    holes = DEG | {"pos_deg": np.where(np.arange(len(TIME)) < 20, np.nan, DEG["pos_deg"])}
    path = table(tmp_path, {"t": TIME, **holes})
    columns = texts_of(path)[0]
    with pytest.raises(
        LogError, match=r"no value in 20 of 500 samples, the first in row 1; .*`where: known\(pos_deg\*pi/180\)`"
    ):
        import_logs(path, tmp_path / "log", Mapping(columns))
    done = import_logs(path, tmp_path / "log", Mapping(columns, where="known(pos_deg)"))
    assert len(done.files[0].read_text().splitlines()) == len(TIME) - 20 + 1


@pytest.mark.parametrize("text", ["pos_deg/0", "pos_deg*(9**9**9**9)"])
def test_an_expression_without_a_finite_value_is_told_without_a_warning(
    tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path, {"t": TIME, **DEG})
    lines = f"columns: {{time: t, joint.position: {text}, joint.goal: goal_deg}}\n"
    (tmp_path / "mapping.yaml").write_text(lines)
    assert read_mapping(tmp_path / "mapping.yaml").columns["time"] == "t"
    assert main(["import", str(path), f"out={tmp_path / 'log'}", f"mapping={tmp_path / 'mapping.yaml'}"]) == 2
    said = one_line(capsys)
    assert "column 'joint.position' has no value in 500 of 500 samples" in said


def test_a_question_ends_as_a_sentence_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = table(tmp_path, {"t": TIME[::-1], **DEG})
    assert main(["import", str(path), f"out={tmp_path / 'log'}", "yes=true"]) == 2
    said = one_line(capsys)
    assert said.endswith("in seconds. Call without yes=true and correct the mapping.") and "unit=" not in said
    assert main(["import", str(path), f"out={tmp_path / 'log'}"]) == 0
    capsys.readouterr()
    assert main(["import", str(path), f"out={tmp_path / 'log'}", f"mapping={tmp_path / 'log.mapping.yaml'}"]) == 2
    assert "in seconds. Correct its lines" in one_line(capsys)


def test_a_robot_that_there_is_none_of_is_refused_before_the_import(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = table(tmp_path, {"t": TIME, **DEG}), tmp_path / "log"
    for word, sentence in (("nope.xml", "robot=nope.xml: there is no such file"), ("benhc", "did you mean 'bench'")):
        assert main(["import", str(path), f"out={out}", "yes=true", f"robot={word}"]) == 2
        assert sentence in one_line(capsys) and not out.exists()


def test_a_joint_that_the_robot_has_not_is_refused_before_the_import(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was taken, and only the diagnosis refused it."""
    path, out, model = table(tmp_path, {"t": TIME, **DEG}), tmp_path / "log", tmp_path / "arm.xml"
    body = '<body><joint name="elbw" axis="0 1 0"/><geom size="0.1" mass="1"/></body>'
    model.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    assert main(["import", str(path), f"out={out}", "yes=true", f"robot={model}"]) == 2
    assert "arm.xml has no joint 'joint'; it has elbw. Rename it" in one_line(capsys) and not out.exists()


def test_a_mapping_does_not_hide_what_the_call_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """robot=, actuator= and robot_params= had no effect beside mapping=, and nobody said so."""
    path, out = table(tmp_path, {"t": TIME, **DEG}), tmp_path / "log"
    assert main(["import", str(path), f"out={out}"]) == 0
    capsys.readouterr()
    call = ["import", str(path), f"out={out}", f"mapping={tmp_path / 'log.mapping.yaml'}"]
    assert main([*call, "unit=deg"]) == 2
    assert "unit=deg is for a proposal" in one_line(capsys)
    assert main([*call, "robot=bench", "actuator=sts3215", "robot_params={mass: 0.5, length: 0.1}"]) == 0
    run = read_measured(out).runs[0]
    assert run.robot == "bench" and run.robot_params["mass"] == 0.5 and run.actuators == {"joint": "sts3215"}


def imported(folder: Path, name: str, out: Path, **said: object) -> Path:
    """The sidecar of a run that was imported into a folder, with this said of its machine."""
    path = table(folder, {"t": TIME, **DEG}, f"{name}.csv")
    columns = {"time": "t", "joint.goal": "goal_deg*pi/180", "joint.position": "pos_deg*pi/180"}
    import_logs(path, out, Mapping(columns, sidecar=dict(said)))
    return out / f"{name}.yaml"


LOAD = {"mass": 0.5, "length": 0.1}


def test_a_load_that_a_mapping_leaves_blank_is_given_by_the_call(tmp_path: Path) -> None:
    blank = Mapping({"time": "t"}, sidecar={"robot": "bench", "robot_params": None})
    assert answered(blank, tmp_path, None, None, LOAD, tmp_path).sidecar["robot_params"] == LOAD


@pytest.mark.parametrize(
    ("kp", "group"),
    [(1234567.0, "kp1234567"), (1234568.0, "kp1234568"), (0.1234567891, "kp0.1234567891"), (32, "kp32")],
)
def test_numbers_in_the_name_of_a_group_keep_their_digits(kp: float, group: str) -> None:
    """kp1.23457e+06 were the runs of several gains."""
    recording = Recording("a", {"t": TIME}, Path("a.csv"), "table", {"kp": float(kp)})
    assert filled({"group": "kp${kp}"}, recording) == {"group": group}


def test_a_mass_that_is_a_word_is_told_at_the_import(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entries = [
        {"timestamp": t, "goal_position": g, "position": q}
        for t, g, q in zip(TIME.tolist(), M["goal"].tolist(), M["smooth"].tolist(), strict=True)
    ]
    (tmp_path / "run.json").write_text(json.dumps({"mass": "heavy", "length": 0.1, "entries": entries}))
    assert main(["import", str(tmp_path / "run.json"), f"out={tmp_path / 'log'}", "yes=true"]) == 2
    assert "robot_params.mass must be a finite number, not 'heavy'" in one_line(capsys)
