"""Recordings of other formats: what is proposed, what is asked, what is written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.io import savemat
from sealegs.commands.cli import main
from sealegs.envs.bench.robot import BARE, NUMBERS
from sealegs.gap.load.load import completed
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import import_logs, propose_for, read_mapping, read_recordings
from sealegs.gap.log.importers.expression import evaluate, names_in, shows_sign
from sealegs.gap.log.importers.mapping import Mapping
from sealegs.gap.log.importers.proposal import propose
from sealegs.gap.virtual.bench import LOADS

from tests.importers.importing import motion, table

DATA = Path(__file__).resolve().parents[2] / "../shared/data"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured data in {DATA}")


def proposed(path: Path, unit: str | None = None) -> tuple[dict[str, str], dict[str, str], list[str]]:
    """Expressions, how sure each is, and the columns that are in question."""
    proposal = propose(read_recordings(path), unit)
    asked = [name for question in proposal.questions for name in question.about]
    texts = {name: read.text for name, read in proposal.columns.items()}
    return texts, {name: read.trust for name, read in proposal.columns.items()}, asked


def test_what_is_imported_is_what_was_recorded(tmp_path: Path) -> None:
    m = motion()
    path = table(
        tmp_path, {"t_ms": 1e3 * m["time"], "target_deg": np.degrees(m["goal"]), "q_deg": np.degrees(m["smooth"])}
    )
    load = {"mass": 0.5, "length": 0.1}
    found = propose_for(path, tmp_path / "log", robot="bench", actuator="sts3215", params=load)
    done = import_logs(path, tmp_path / "log", found.mapping)
    log = yaml.safe_load(done.sidecar.read_text())
    assert log["robot"] == "bench" and log["actuators"] == {"joint": "sts3215"} and not done.missing
    run = read_measured(tmp_path / "log").runs[0]
    np.testing.assert_allclose(run.time, m["time"], atol=1e-9)
    np.testing.assert_allclose(run.joints["joint"].position, m["smooth"], atol=1e-8)
    assert run.meta["imported_from"] == str(path)


def test_the_steps_of_an_encoder_tell_the_unit_that_nobody_says(tmp_path: Path) -> None:
    m = motion()
    for turn, behind in ((2 * np.pi, ""), (360.0, "*pi/180"), (1.0, "*2*pi")):
        scale = turn / (2 * np.pi)
        path = table(tmp_path, {"time": m["time"], "target": scale * m["goal"], "angle": scale * m["position"]})
        texts, trust, asked = proposed(path)
        assert texts["joint.position"] == f"angle{behind}" and trust["joint.position"] == "sure"
        assert texts["joint.goal"] == f"target{behind}" and not asked


def test_the_first_call_shows_and_stops_and_the_second_imports(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    m = motion()
    path, out = (
        table(tmp_path, {"t_ms": 1e3 * m["time"], "goal_deg": m["goal"], "pos_deg": m["smooth"]}),
        tmp_path / "log",
    )
    assert main(["import", str(path), f"out={out}"]) == 0
    shown = capsys.readouterr().out
    assert "Nothing is imported yet" in shown and not out.exists()
    file = tmp_path / "log.mapping.yaml"
    assert read_mapping(file).columns["joint.position"] == "pos_deg*pi/180"
    assert main(["import", str(path), f"out={out}", f"mapping={file}"]) == 0
    assert "Fill in robot, robot_params (of a bench) and actuators in" in capsys.readouterr().out
    text = (out / "log.yaml").read_text()
    assert text.count("FILL IN") == 4 and (out / "run.csv").is_file()
    assert main(["import", str(path), f"out={out}", f"mapping={file}"]) == 2
    assert "never overwritten" in capsys.readouterr().err


def test_the_load_of_a_bench_is_asked_for_with_the_rest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The offered command ended at once: the bench's load was missing, and nobody had said so."""
    m = motion()
    path = table(tmp_path, {"t_ms": 1e3 * m["time"], "goal_deg": m["goal"], "pos_deg": m["smooth"]})
    known = ["yes=true", "robot=bench", "actuator=sts3215"]
    assert main(["import", str(path), f"out={tmp_path / 'open'}", *known]) == 0
    assert "Fill in robot_params in" in capsys.readouterr().out
    text = (tmp_path / "open" / "log.yaml").read_text()
    assert "robot_params:  # FILL IN the load: mass [kg]" in text
    (tmp_path / "open" / "log.yaml").write_text(text.replace("# mass", "mass").replace("# length", "length"))
    assert read_measured(tmp_path / "open").runs[0].robot_params == {"mass": 0.5, "length": 0.12}
    given = "robot_params={mass: 0.4, length: 0.1}"
    assert main(["import", str(path), f"out={tmp_path / 'given'}", *known, given]) == 0
    assert "Fill in" not in capsys.readouterr().out
    assert read_measured(tmp_path / "given").runs[0].robot_params == {"mass": 0.4, "length": 0.1}


def test_chains_that_a_robots_file_has_are_not_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """ "Fill in actuators" was said beside a robot's file that holds them."""
    m = motion()
    path = table(tmp_path, {"t_ms": 1e3 * m["time"], "elbow_goal_deg": m["goal"], "elbow_pos_deg": m["smooth"]})
    (tmp_path / "arm.xml").write_text(
        '<mujoco><worldbody><body><joint name="elbow" axis="0 1 0"/><geom size="0.1" mass="1"/></body></worldbody>'
        "</mujoco>"
    )
    (tmp_path / "arm.yaml").write_text("model: arm.xml\njoints: {elbow: {chain: sts3215}}\n")
    assert main(["import", str(path), f"out={tmp_path / 'log'}", "yes=true", f"robot={tmp_path / 'arm.yaml'}"]) == 0
    assert "Fill in" not in capsys.readouterr().out
    assert "FILL IN what" not in (tmp_path / "log" / "log.yaml").read_text()


def test_an_open_question_holds_the_import_and_yes_leaves_its_columns_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    m = motion()
    columns = {"time": m["time"], "goal": m["goal"], "pos": m["position"], "torque": 99.0 + 10 * m["goal"]}
    path, out = table(tmp_path, columns), tmp_path / "log"
    assert main(["import", str(path), f"out={out}"]) == 0
    assert main(["import", str(path), f"out={out}", f"mapping={tmp_path / 'log.mapping.yaml'}"]) == 2
    assert "joint.torque: in which unit is this torque?" in capsys.readouterr().err
    assert main(["import", str(path), f"out={out}", "yes=true", "robot=bench", "actuator=sts3215"]) == 0
    assert "Left out, for they are in question: joint.torque." in capsys.readouterr().out
    assert read_measured(out).runs[0].joints["joint"].torque is None


def test_matlab_vectors_and_numbers_become_columns_and_constants(tmp_path: Path) -> None:
    m = motion(5.0)
    savemat(
        tmp_path / "a.mat",
        {"t": m["time"][:, None], "qm": m["smooth"], "qg": m["goal"], "vir": m["velocity"], "gtau": 2.0},
    )
    (recording,) = read_recordings(tmp_path / "a.mat")
    assert recording.facts == {"gtau": 2.0}
    mapping = Mapping({"time": "t", "j.position": "qm", "j.goal": "qg", "j.torque_command": "vir*gtau"})
    import_logs(tmp_path / "a.mat", tmp_path / "log", mapping)
    (tmp_path / "log" / "log.yaml").write_text("robot: bench\nactuators: {j: ideal}\n")
    log = read_measured(tmp_path / "log").runs[0].joints["j"]
    assert log.torque_command is not None
    np.testing.assert_allclose(log.torque_command, 2.0 * m["velocity"], atol=1e-12)


def test_a_rod_that_nobody_weighed_is_the_benchs_own_in_an_import_too(tmp_path: Path) -> None:
    """It weighed 0 kg in an imported log, and 0.03 kg everywhere else."""
    m = motion(5.0)
    columns = {"time": m["time"], "q_goal": m["goal"], "q": m["smooth"]}
    savemat(tmp_path / "a.mat", {**columns, "mass": 0.5, "length": 0.1})
    found = propose_for(tmp_path / "a.mat", tmp_path / "log", actuator="sts3215")
    import_logs(tmp_path / "a.mat", tmp_path / "log", found.mapping)
    run = read_measured(tmp_path / "log").runs[0]
    assert run.robot == "bench" and completed(run.robot_params)["arm_mass"] == NUMBERS["arm_mass"].value
    assert completed({"mass": 0.0})["arm_mass"] == BARE["arm_mass"] == 0.0, "an empty shaft has none"
    assert all(load["arm_mass"] == NUMBERS["arm_mass"].value for load in LOADS)


# --- expressions -----------------------------------------------------------------------------------------------------


def test_expressions_are_arithmetic(tmp_path: Path) -> None:
    values = {"a": np.array([1.0, 2.0]), "Joint 1 (deg)": np.array([180.0, 90.0]), "k": 3.0, "raw": np.array([65527.0])}
    np.testing.assert_allclose(evaluate("-(a - 2)*k**2/2 + 1e-3", values, ""), [4.501, 0.001])
    np.testing.assert_allclose(evaluate("`Joint 1 (deg)`*pi/180", values, ""), [np.pi, np.pi / 2])
    np.testing.assert_allclose(evaluate("signed16(raw)", values, ""), [-9.0])
    np.testing.assert_allclose(evaluate("unwrap(a*3)", values, ""), [3.0, 6.0])
    assert names_in("unwrap(b) + cumsum(a)*counter(b)") == ["b", "a"], "no function is called for it"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("b + 1", "takes 'b', which is no column"),
        ("__import__('os')", "calls '__import__'"),
        ("open(a)", "calls 'open'"),
        ("a +", "is no arithmetic over columns"),
        ("(a", "is no arithmetic over columns"),
        ("a.__class__", "takes 'a.__class__', which is no column"),
        ("a if a else 1", "is no arithmetic over columns"),
        ("a == 1", "is more than arithmetic over columns"),
        ("[a, 1]", "is more than arithmetic over columns"),
        ("max(a)", "max takes 2 values, not 1"),
        ("-" * 30_000 + "a", "nested too deeply"),
        ("+".join(["a"] * 3000), "write it shorter|is no arithmetic"),
        ("a a", "is no arithmetic over columns"),
        ("(" * 200 + "a", "nested too deeply"),
        ("unwrap(b)", "takes 'b', which is no column"),
    ],
)
def test_a_wrong_expression_gets_one_sentence(text: str, sentence: str) -> None:
    with pytest.raises(LogError, match=sentence):
        evaluate(text, {"a": 1.0}, "x")


# --- measured data ---------------------------------------------------------------------------------------------------


@needs_data
def test_a_bam_recording_is_imported_with_its_pendulum_and_its_gain(tmp_path: Path) -> None:
    source = DATA / "xl330_pendulum" / "raw_2026-01-15_10h28m10.json"
    import_logs(source, tmp_path, propose_for(source, tmp_path).mapping)
    run = read_measured(tmp_path).runs[0]
    assert run.robot_params == {"mass": 0.49, "length": 0.1} and run.meta["group"] == "kp100"
    chain = run.actuators["servo"]
    assert isinstance(chain, list) and chain[0]["position_p"]["gain"] == pytest.approx(
        100 * 4096 / (2 * np.pi) / 256 / 885
    )
    assert {"goal", "position", "velocity", "voltage", "temperature"} <= run.joints["servo"].signals().keys()


@needs_data
@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_an_arm_is_proposed_joint_by_joint_and_its_gripper_asked_about(unit: str) -> None:
    (recording,) = read_recordings(DATA / "so101_arm" / "chirp_sweep.parquet")
    if unit == "deg":
        columns = {
            name: np.degrees(v) if name[:3] in ("pos", "goa", "vel") else v for name, v in recording.columns.items()
        }
        recording = type(recording)(recording.name, columns, recording.source, "table")
    proposal = propose([recording])
    behind = "*pi/180" if unit == "deg" else ""
    for joint in ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"):
        for signal, name in (("position", "pos"), ("goal", "goal"), ("velocity", "vel")):
            assert proposal.columns[f"{joint}.{signal}"].text == f"{name}_{joint}{behind}"
    asked = [name for question in proposal.questions for name in question.about]
    assert "gripper.position" in asked and not any(name.endswith("flex.position") for name in asked)


@needs_data
def test_two_joints_that_were_driven_by_torque_are_told_apart() -> None:
    texts, _, asked = proposed(DATA / "double_pendulum" / "sys_id_00.parquet")
    for k in "12":
        assert texts[f"joint{k}.torque_command"] == f"tau_con{k}" and texts[f"joint{k}.torque"] == f"tau_meas{k}"
        assert texts[f"joint{k}.position"] == f"pos_meas{k}"
    assert {*asked} == {f"joint{k}.{signal}" for k in "12" for signal in ("position", "velocity")}, (
        "no name says a unit"
    )


@needs_data
def test_what_drives_a_slide_is_named_as_what_nobody_claims() -> None:
    texts, _, asked = proposed(DATA / "emps" / "DATA_EMPS.mat")
    assert (texts["joint.position"], texts["joint.goal"]) == ("qm", "qg") and not asked
    assert "joint.torque_command" not in texts


@needs_data
@pytest.mark.parametrize(("word", "folder"), [("emps", "emps"), ("double_pendulum", "double_pendulum")])
def test_a_published_data_set_has_its_mapping(tmp_path: Path, word: str, folder: str) -> None:
    done = import_logs(DATA / folder, tmp_path, read_mapping(word))
    text = done.sidecar.read_text()
    assert "FILL IN" in text and all(path.is_file() for path in done.files)


# --- folders as people have them: notes among the recordings, imports that were interrupted, names that are taken ----

M = motion(5.0, 100.0)
COLUMNS = {"time": "t", "joint.goal": "goal_rad", "joint.position": "pos_rad"}


def runs(folder: Path, *names: str) -> Path:
    """A folder with recordings that differ."""
    folder.mkdir(exist_ok=True)
    for name in names:
        size = 1.0 + 0.1 * (sum(map(ord, name)) % 7)
        table(folder, {"t": M["time"], "goal_rad": size * M["goal"], "pos_rad": size * M["smooth"]}, f"{name}.csv")
    return folder


def names_of(folder: Path) -> list[str]:
    return [one.name for one in read_recordings(folder)]


# --- what is no recording --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "bench 3, servo 7\ncharged battery before run 2\n",
        "Notes\n\nThe first run is cold. The second one, warm, has\na longer lead; see the picture, too.\n",
        "",
        "only one line of words",
    ],
)
def test_a_text_without_numbers_among_recordings_is_left_out_and_told(tmp_path: Path, text: str) -> None:
    """One notes.txt stopped the whole folder."""
    folder = runs(tmp_path / "in", "run1", "run2")
    (folder / "notes.txt").write_text(text)
    assert names_of(folder) == ["run1", "run2"]
    proposed = propose_for(folder, tmp_path / "out")
    assert "# Left out: notes.txt " in proposed.text and len(proposed.recordings) == 2
    assert len(import_logs(folder, tmp_path / "out", Mapping(COLUMNS)).files) == 2


def test_a_text_alone_in_a_folder_is_told_as_before(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("bench 3, servo 7\ncharged battery before run 2\n")
    with pytest.raises(LogError, match=r"notes\.txt: has no column of numbers"):
        read_recordings(tmp_path)


def test_a_text_above_folders_of_recordings_does_not_hide_them(tmp_path: Path) -> None:
    for day in ("monday", "tuesday"):
        runs(tmp_path / day, "run")
    (tmp_path / "notes.txt").write_text("cold on Monday\nwarm on Tuesday\n")
    assert names_of(tmp_path) == ["monday-run", "tuesday-run"]


def test_a_recording_with_a_bad_row_is_not_left_out(tmp_path: Path) -> None:
    folder = runs(tmp_path / "in", "run1", "run2")
    lines = (folder / "run2.csv").read_text().splitlines()
    lines[30] = lines[30].rpartition(",")[0]
    (folder / "run2.csv").write_text("\n".join(lines))
    with pytest.raises(LogError, match=r"run2\.csv: line 31 has 2 values for 3 columns"):
        read_recordings(folder)


def test_a_small_table_of_another_kind_does_not_take_the_place_of_a_run(tmp_path: Path) -> None:
    """Of as many files of each kind, the first by name was imported."""
    folder = runs(tmp_path / "in", "run")
    (folder / "calib.csv").write_text("joint,low,high\nshoulder,100,3900\nelbow,200,3800\n")
    proposed = propose_for(folder, tmp_path / "out")
    assert [one.name for one in proposed.recordings] == [
        "run"
    ] and "# Left out: calib has other columns" in proposed.text


# --- the machine of a mapping ----------------------------------------------------------------------------------------


def test_a_robot_of_ones_own_needs_no_file(tmp_path: Path) -> None:
    for k, robot in enumerate(("so101", "arm2", "Testrig")):
        sidecar = {"robot": robot, "actuators": {"joint": "ideal"}}
        import_logs(runs(tmp_path / "in", "run1"), tmp_path / f"out{k}", Mapping(COLUMNS, sidecar=sidecar))
        assert read_measured(tmp_path / f"out{k}").runs[0].robot == robot


# --- registers with a bit for their sign -----------------------------------------------------------------------------


def test_a_register_with_a_bit_for_its_sign_is_read() -> None:
    raw = np.array([0.0, 300.0, 32768.0, 32768.0 + 300.0, 32767.0, np.nan])
    np.testing.assert_array_equal(
        evaluate("sign_bit(speed, 15)", {"speed": raw}, ""), [0.0, 300.0, 0.0, -300.0, 32767.0, np.nan]
    )
    np.testing.assert_array_equal(evaluate("sign_bit(load, 10)", {"load": np.array([1023.0, 1074.0])}, ""), [1023, -50])


@pytest.mark.parametrize(("bit", "size"), [(15, 900.0), (10, 400.0)])
def test_the_counts_tell_how_a_register_keeps_its_sign(bit: int, size: float) -> None:
    signed = np.round(size * np.sin(3.0 * M["time"]) * np.sin(0.7 * M["time"]))
    magnitude = np.where(signed < 0.0, 2.0**bit - signed, signed)
    assert shows_sign(magnitude, bit)
    for other in (signed, np.abs(signed), 0.1 + magnitude, np.mod(signed, 2.0**16)):
        assert not shows_sign(other, bit)
