"""Mappings: what is proposed for layouts whose names say little, and what is said of those that are no log."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from sealegs.commands.cli import main
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import Recording, answered, import_logs, read_mapping
from sealegs.gap.log.importers.mapping import Mapping, filled

from tests.importers.importing import motion, table
from tests.importers.test_import_tables import texts_of

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")
M = motion(5.0, 100.0, seed=1)
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
