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

from tests.importers.test_import import motion, table
from tests.importers.test_import_tables import texts_of

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")
M, N = motion(5.0, 100.0, seed=1), motion(5.0, 100.0, seed=2)
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


def test_a_column_that_is_called_as_the_goal_without_its_word_is_the_position(tmp_path: Path) -> None:
    slide = {"time_us": 1e6 * TIME, "x_cmd_mm": 30 * M["goal"], "x_mm": 30 * M["smooth"], "force_N": M["velocity"]}
    columns, asked, _ = texts_of(table(tmp_path, slide))
    assert columns["x.position"] == "x_mm*1e-3" and columns["x.goal"] == "x_cmd_mm*1e-3" and not asked
    two = {"t": TIME, "elbow": M["smooth"], "elbow_cmd": M["goal"], "wrist": N["smooth"], "wrist_cmd": N["goal"]}
    columns = texts_of(table(tmp_path, two, "two.csv"))[0]
    assert columns["elbow.position"] == "elbow" and columns["wrist.goal"] == "wrist_cmd"


def test_topics_of_one_joint_come_together(tmp_path: Path) -> None:
    columns = {"__time": 1000.0 + TIME}
    for joint, one in (("elbow", M), ("shoulder", N)):
        columns |= {f"/joint_states/{joint}/position": one["smooth"], f"/joint_states/{joint}/velocity": 0.0 * TIME}
        columns[f"/cmd/{joint}/data"] = one["goal"]
    texts, asked, shown = texts_of(table(tmp_path, columns))
    assert list(dict.fromkeys(name.rpartition(".")[0] for name in texts)) == ["", "elbow", "shoulder"]
    assert texts["elbow.goal"] == "`/cmd/elbow/data`" and not asked
    assert "/joint_states/elbow/velocity: a velocity that never changes is not measured" in shown
    sides = {"t": TIME, "left_elbow_pos": M["smooth"], "right_elbow_pos": N["smooth"], "elbow_cmd": M["goal"]}
    texts, _, shown = texts_of(table(tmp_path, sides, "sides.csv"))
    assert "left_elbow.goal" not in texts and "elbow_cmd: goal of 'elbow', which has no position" in shown.replace(
        "''", "'"
    )


def test_two_columns_of_one_name_are_two_joints_with_names(tmp_path: Path) -> None:
    path = names_changed(table(tmp_path, {"t": TIME, "a": M["goal"], "b": M["smooth"]}), "t,pos,pos")
    columns, asked, shown = texts_of(path)
    assert list(columns) == ["time", "joint.position", "joint2.position"] and "joint2.goal" in asked
    assert "several columns are called pos; the second of them is pos_2 here" in shown


@pytest.mark.parametrize(
    ("time", "sentence"),
    [
        (TIME[::-1], "it runs backwards, from 4.99 to 0: turn the order of the rows round"),
        (np.repeat(TIME[:250], 2), "2 rows have the same stamp: of a row for each joint make a column for each joint"),
        (np.floor(TIME), "100 rows have the same stamp: export it with fractions of a second"),
        (TIME % 2.5, "it jumps back in row 251, from 2.49 to 0: there one recording ends and the next begins"),
        (1e12 * TIME, "its steps of 1e+10 are no sample period"),
    ],
)
def test_what_is_wrong_with_a_clock_is_said(tmp_path: Path, time: np.ndarray, sentence: str) -> None:
    columns, asked, shown = texts_of(table(tmp_path, {"t": time, **DEG}))
    assert asked == ["time"] and columns["time"] == "t"
    assert sentence in shown and "another clock" not in shown


def test_days_of_a_spreadsheet_are_a_clock(tmp_path: Path) -> None:
    path = table(tmp_path, {"Zeit": TIME, **DEG})
    lines = path.read_text().splitlines()
    rest = (line.partition(",")[2] for line in lines[1:])
    path.write_text(
        "\n".join([lines[0], *(f"{45413.5 + t / 86400:.10f},{r}" for t, r in zip(TIME, rest, strict=True))])
    )
    columns, asked, shown = texts_of(path)
    assert columns["time"] == "Zeit*86400" and not asked and "days, as of a spreadsheet" in shown


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
    with pytest.raises(LogError, match=r"no value in 20 samples, the first in row 1; .*`where: known\(pos_deg\)`"):
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
    assert "column 'joint.position' has no finite value in any sample; correct '" in said


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
BENCH = {"robot": "bench", "robot_params": LOAD, "actuators": {"joint": "sts3215"}}


def test_a_second_import_into_a_folder_keeps_what_its_file_says(tmp_path: Path) -> None:
    """It got the machine of the first one, whose log.yaml was there already."""
    out = tmp_path / "log"
    imported(tmp_path, "a", out, **BENCH, group="low", machine="first")
    before = (out / "log.yaml").read_text()
    own = imported(tmp_path, "b", out, **BENCH | {"robot_params": LOAD | {"mass": 1.5, "arm_mass": 0.02}})
    imported(tmp_path, "c", out, **BENCH | {"actuators": {"joint": "ideal"}}, units={"joint.velocity": "deg/s"})
    a, b, c = read_measured(out).runs
    assert (a.robot_params["mass"], b.robot_params, c.robot_params) == (
        0.5,
        {**LOAD, "mass": 1.5, "arm_mass": 0.02},
        LOAD,
    )
    assert [run.actuators["joint"] for run in (a, b, c)] == ["sts3215", "sts3215", "ideal"]
    assert [run.meta.get("group") for run in (a, b, c)] == ["low", None, None], "nobody said their group"
    assert b.meta["machine"] == "first" and "units" not in b.meta and c.meta["units"] == {"joint.velocity": "deg/s"}
    assert "length" not in own.read_text() and (out / "log.yaml").read_text() == before


def test_what_a_second_import_leaves_open_holds_as_the_folder_says_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "log"
    imported(tmp_path, "a", out, **BENCH)
    path = table(tmp_path, {"t": TIME, **DEG}, "b.csv")
    assert main(["import", str(path), f"out={out}", "yes=true"]) == 0
    assert "Fill in" not in capsys.readouterr().out
    assert read_measured(out).runs[1].robot_params == LOAD


@pytest.mark.parametrize(
    ("first", "second", "sentence"),
    [
        (BENCH, BENCH | {"robot": "hopper"}, "is of the robot bench, and .* is imported for hopper"),
        (BENCH | {"robot_params": LOAD | {"arm_mass": 0.1}}, BENCH, r"gives robot_params\.arm_mass for every log"),
        (BENCH | {"actuators": {"joint": "ideal", "elbow": "ideal"}}, BENCH, "an actuator of 'elbow' for every log"),
        (BENCH | {"units": {"joint.position": "deg"}}, BENCH, r"joint\.position is in deg for every log"),
    ],
)
def test_what_no_sidecar_takes_back_is_refused_before_anything_is_written(
    first: dict[str, object], second: dict[str, object], sentence: str, tmp_path: Path
) -> None:
    out = tmp_path / "log"
    imported(tmp_path, "a", out, **first | {"actuators": {"joint": "ideal"}})
    (out / "log.yaml").write_text(json.dumps(first))
    there = sorted(out.iterdir())
    with pytest.raises(LogError, match=rf"log\.yaml .*{sentence}.* import it into a folder of its own\.$"):
        imported(tmp_path, "b", out, **second)
    assert sorted(out.iterdir()) == there


def test_an_import_says_nothing_of_logs_that_were_there_before(tmp_path: Path) -> None:
    """The log.yaml that it wrote gave them its own group and load."""
    out = tmp_path / "log"
    imported(tmp_path, "a", out, **BENCH)
    own = (out / "log.yaml").read_text()
    (out / "log.yaml").rename(out / "a.yaml")
    imported(tmp_path, "b", out, **BENCH | {"robot_params": LOAD | {"arm_mass": 0.1}}, group="high")
    a, b = read_measured(out).runs
    assert a.robot_params == LOAD and "group" not in a.meta and (out / "a.yaml").read_text() == own
    assert b.robot_params["arm_mass"] == 0.1 and b.meta["group"] == "high"


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


def test_the_velocity_of_a_slide_in_centimetres_is_in_its_own_unit(tmp_path: Path) -> None:
    """It was taken for that of a hinge: 'as rpm would be'."""
    slide = {"t": TIME, "x_cmd_cm": 3 * M["goal"], "x_cm": 3 * M["smooth"], "x_vel [mm/s]": 30 * M["velocity"]}
    columns, asked, _ = texts_of(table(tmp_path, slide))
    assert columns["x.velocity"] == "`x_vel [mm/s]`*1e-3" and not asked


def test_a_mass_that_is_a_word_is_told_at_the_import(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entries = [
        {"timestamp": t, "goal_position": g, "position": q}
        for t, g, q in zip(TIME.tolist(), M["goal"].tolist(), M["smooth"].tolist(), strict=True)
    ]
    (tmp_path / "run.json").write_text(json.dumps({"mass": "heavy", "length": 0.1, "entries": entries}))
    assert main(["import", str(tmp_path / "run.json"), f"out={tmp_path / 'log'}", "yes=true"]) == 2
    assert "mass is 'heavy', no number [kg]; correct it in the file." in one_line(capsys)


@pytest.mark.parametrize(
    ("goal", "position", "velocity", "unit"),
    [
        ("Goal Position [deg]", "Present Position [deg]", "Present Velocity [rev/min]", "deg"),
        ("input_pos", "pos_estimate", "vel_estimate", "turn"),
        ("control_position (rev)", "position (rev)", "velocity (rev/s)", "turn"),
        ("Consigne (deg)", "Mesure (deg)", "Vitesse (tr/min)", "deg"),
        ("Referencia (grados)", "Posición (grados)", "Velocidad (rpm)", "deg"),
        ("Soll [°]", "Ist [°]", "Drehzahl [U/min]", "deg"),
        (
            "/arm_controller/controller_state/reference/positions[0]",
            "/arm_controller/controller_state/feedback/positions[0]",
            "/arm_controller/controller_state/feedback/velocities[0]",
            "rad",
        ),
    ],
)
def test_names_of_common_tools_are_known(tmp_path: Path, goal: str, position: str, velocity: str, unit: str) -> None:
    per = {"deg": 180 / np.pi, "turn": 0.5 / np.pi, "rad": 1.0}[unit]
    rate = 30 / np.pi if unit == "deg" else per
    columns = {"t": TIME, goal: per * M["goal"], position: per * M["smooth"], velocity: rate * M["velocity"]}
    texts, asked, shown = texts_of(table(tmp_path, columns | {"q_current (A)": M["velocity"]}))
    assert not asked, shown
    signals = sorted(name.rpartition(".")[2] for name in texts)
    assert signals == ["current", "goal", "position", "time", "velocity"]
    (joint,) = {name.rpartition(".")[0] for name in texts if name != "time"}
    assert goal in texts[f"{joint}.goal"] and position in texts[f"{joint}.position"]


def test_joint_states_and_the_state_of_their_controller_are_one_joint(tmp_path: Path) -> None:
    state = "/arm_controller/state"
    columns = {
        "__time": TIME, "/joint_states/elbow/position": M["smooth"], "/joint_states/wrist/position": N["smooth"],
        f"{state}/desired/positions/elbow": M["goal"], f"{state}/actual/positions/elbow": M["smooth"],
        "/wrist_cmd/data": N["goal"],
    }  # fmt: skip
    texts, asked, _ = texts_of(table(tmp_path, columns))
    assert texts["elbow.goal"] == f"`{state}/desired/positions/elbow`" and texts["wrist.goal"] == "`/wrist_cmd/data`"
    assert len(texts) == 5 and not asked
    one = {"t": TIME, "/joint_states/position[0]": M["smooth"], "/position_controller/commands/data[0]": M["goal"]}
    texts = texts_of(table(tmp_path, one, "one.csv"))[0]
    assert next(text for name, text in texts.items() if name.endswith("goal")) == f"`{list(one)[2]}`"


def test_registers_are_asked_about_and_fahrenheit_is_converted(tmp_path: Path) -> None:
    tick = 2 * np.pi / 4096
    columns = {
        "Time(ms)": 1e3 * TIME, "Goal Position": np.round(2048 + M["goal"] / tick),
        "Present Position": np.round(2048 + M["smooth"] / tick),
        "Present Velocity": np.round(M["velocity"] / (0.229 * np.pi / 30)),
        "Present Current": np.round(40 * M["velocity"]), "temp_F": 95.0 + 0 * TIME,
    }  # fmt: skip
    texts, asked, _ = texts_of(table(tmp_path, columns))
    assert {"joint.position", "joint.velocity", "joint.current"} <= {*asked}
    expression, _, per_count = texts["joint.velocity"].rpartition("*")
    assert expression == "`Present Velocity`" and float(per_count) == pytest.approx(0.229 * np.pi / 30, rel=0.02)
    assert texts["joint.temperature"] == "(temp_F - 32)/1.8"


def test_cells_with_their_unit_and_sample_periods_are_read(tmp_path: Path) -> None:
    columns = {"t": TIME, **DEG}
    lines = table(tmp_path, columns).read_text().splitlines()
    cells = (line.split(",") for line in lines[1:])
    text = "".join(f"{t} s,{float(g):.3f} deg,{float(q):.3f}°\n" for t, g, q in cells)
    (tmp_path / "units.csv").write_text("t,goal,pos\n" + text)
    texts, asked, _ = texts_of(tmp_path / "units.csv")
    assert texts["joint.goal"] == "`goal [deg]`*pi/180" and texts["time"] == "`t [s]`" and not asked
    path = table(tmp_path, {"dt_ms": 10.0 + 0 * TIME, **DEG}, "dt.csv")
    texts, asked, _ = texts_of(path)
    assert texts["time"] == "cumsum(dt_ms)*1e-3" and not asked


def test_a_letter_of_physics_beside_its_unit_is_of_no_joint(tmp_path: Path) -> None:
    """A current ``elbow_I_mA`` was of a joint 'elbow I', and left out."""
    columns = {"t": TIME, "elbow_goal_rad": M["goal"], "elbow_pos_rad": M["smooth"], "elbow_I_mA": 300 * M["velocity"]}
    texts, asked, shown = texts_of(table(tmp_path, columns))
    assert not asked, shown
    assert "elbow_I_mA" in texts["elbow.current"]
