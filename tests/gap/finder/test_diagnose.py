"""diagnose.py from the outside: what a person gives it and what comes back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import pytest
import sealegs
import yaml
from sealegs.actuators import load_chain
from sealegs.common.errors import SealegsError
from sealegs.gap.checks.data_set import check_set
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log import read_measured
from sealegs.gap.log.reader import measured_set
from sealegs.gap.virtual.bench import LOADS, record

from testbed import hidden_bench
from testbed.wheel import Wheel, nominal, record_wheel
from tests.made_once import folder_made_once
from tests.typed import diagnose_command

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"


CONSIDERED = ("friction.load_dependent", "friction.viscous", "drive.delay")
"""Causes that the shared diagnosis considers, so that it takes seconds; a long test has the whole catalogue."""


@pytest.fixture(scope="session")
def hidden() -> Path:
    """Logs of a virtual bench of the hopper's servo whose gearbox loses torque under load."""
    shapes = ("steps", "multisine", "slow triangle")
    return folder_made_once(
        "virtual bench",
        lambda folder: record(folder, "sv1270tg", {"friction.load": 0.2}, 3, LOADS[:1], excitations=shapes),
    )


@pytest.fixture(scope="session")
def diagnosis(hidden: Path) -> Path:
    """What diagnose.py writes about them."""

    def made(folder: Path) -> None:
        assert diagnose_command(f"log={hidden}", f"out={folder}", f"causes=[{','.join(CONSIDERED)}]") == 0

    return folder_made_once("diagnosis of the virtual bench", made)


def test_names_the_hidden_effect_with_its_size(diagnosis: Path) -> None:
    found = json.loads((diagnosis / "diagnosis.json").read_text())
    assert found["verdict"] == "explained"
    assert found["causes"][0]["name"] == "friction.load_dependent"
    value = found["causes"][0]["parameters"]["friction.load"]
    assert value["value"] == pytest.approx(0.2, rel=0.05)
    # one 95 % interval may miss by a little; how often it covers the truth is what `make hidden` counts
    width = value["high"] - value["low"]
    assert value["low"] - width / 2 <= 0.2 <= value["high"] + width / 2
    assert width < 0.02
    assert value["unit"] == "1"
    gap = found["gap"]
    assert gap["signal"] == "servo.position"
    assert gap["extended"]["rmse"] < 1.3 * gap["noise_floor"]["rmse"] < gap["refitted"]["rmse"] < gap["nominal"]["rmse"]
    assert 0.0 <= found["unexplained"] < 0.1
    explained = sum(cause["share"] for cause in found["causes"])
    assert explained > 0.4
    assert explained + found["tuned_share"] + found["unexplained"] == pytest.approx(1.0), (
        "the rest is the tuned numbers'"
    )


def test_the_engine_confirms_what_the_search_found(diagnosis: Path) -> None:
    engine = json.loads((diagnosis / "diagnosis.json").read_text())["extension"]["engine"]
    assert engine["distance"] < 2e-4


def test_the_extended_chain_differs_by_the_listed_numbers_only(diagnosis: Path) -> None:
    listed = json.loads((diagnosis / "diagnosis.json").read_text())["extension"]["changes"]
    nominal, extended = load_chain("sv1270tg"), load_chain(diagnosis / "extended.yaml")
    allowed = {change["path"] for change in listed}
    for stage in extended.stages:
        before = nominal.find(stage.name)
        for key, value in stage.parameters().items():
            if f"{stage.name}.{key}" not in allowed:
                assert before is not None and value == pytest.approx(before.parameters()[key])


def test_the_extended_mjcf_loads_in_plain_mujoco(diagnosis: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(diagnosis / "extended.xml"))
    assert {model.joint(k).name for k in range(model.njnt)} == {"joint", "joint_motor"}  # of the chain's spring


def test_pictures_and_report_are_written(diagnosis: Path) -> None:
    assert (diagnosis / "report.html").stat().st_size > 10_000
    assert list((diagnosis / "pictures").glob("*.png"))


def test_training_takes_the_extended_chain_as_it_is(diagnosis: Path) -> None:
    from sealegs.envs.robots import get_robot

    assert get_robot("hopper").drivetrain(str(diagnosis / "extended.yaml")).model.nu == 2


@pytest.mark.long
def test_the_whole_catalogue_names_the_hidden_effect_too(hidden: Path, tmp_path: Path) -> None:
    assert diagnose_command(f"log={hidden}", f"out={tmp_path / 'whole'}") == 0
    test_names_the_hidden_effect_with_its_size(tmp_path / "whole")


@pytest.mark.long
def test_nothing_hidden_is_nothing_to_explain(tmp_path: Path) -> None:
    record(tmp_path, "sv1270tg", {}, seed=5, excitations=("steps", "multisine", "slow triangle"))
    (found,) = diagnose(read_measured(tmp_path))
    assert found.verdict == "nothing to explain"
    assert not found.causes


def test_an_existing_diagnosis_is_never_overwritten(
    hidden: Path, diagnosis: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (diagnosis / "diagnosis.json").read_bytes()
    assert diagnose_command(f"log={hidden}", f"out={diagnosis}") == 2
    assert "not empty" in capsys.readouterr().err
    assert (diagnosis / "diagnosis.json").read_bytes() == before


@pytest.mark.parametrize(
    ("cause", "extra", "path", "true"),
    [
        pytest.param("friction.coulomb", {"coulomb_extra": 0.108}, "friction.coulomb", 0.16, marks=pytest.mark.long),
        pytest.param("friction.viscous", {"viscous_extra": 0.14}, "friction.viscous", 0.199, marks=pytest.mark.long),
    ],
)
def test_a_number_several_times_wrong_is_named_as_that_number(
    cause: str, extra: dict[str, float], path: str, true: float
) -> None:
    data, _ = hidden_bench({cause: extra}, 7, ("light", "medium", "heavy"), duration=9.0, nominal_error=0.0)
    (found,) = diagnose(data)
    assert [named.name for named in found.causes] == [cause]
    assert found.causes[0].parameters[path].value == pytest.approx(true, rel=0.03)


# --- wrong input ---------------------------------------------------------------------------------------------------


@pytest.fixture
def log(hidden: Path, tmp_path: Path) -> Path:
    """A copy of one run, to be spoiled."""
    source = sorted(hidden.glob("*.csv"))[0]
    target = tmp_path / "log" / source.name
    target.parent.mkdir()
    target.write_bytes(source.read_bytes())
    target.with_suffix(".yaml").write_bytes(source.with_suffix(".yaml").read_bytes())
    return target


def spoil_table(change):
    def spoil(log: Path) -> None:
        table = pd.read_csv(log)
        change(table).to_csv(log, index=False)

    return spoil


def spoil_sidecar(change):
    def spoil(log: Path) -> None:
        sidecar = yaml.safe_load(log.with_suffix(".yaml").read_text())
        change(sidecar)
        log.with_suffix(".yaml").write_text(yaml.safe_dump(sidecar))

    return spoil


def backwards(table: pd.DataFrame) -> pd.DataFrame:
    table.loc[100, "time"] = table.loc[50, "time"]
    return table


def motionless(table: pd.DataFrame) -> pd.DataFrame:
    for name in table.columns:
        if name != "time":
            table[name] = 0.0
    return table


BAD = {  # one of each place that refuses; what the reader does is in tests/gap/log
    "time backwards": (spoil_table(backwards), "time"),
    "no motion": (spoil_table(motionless), "mov"),
    "unknown robot": (spoil_sidecar(lambda sidecar: sidecar.update(robot="bensh")), "bench"),
    "unknown chain": (spoil_sidecar(lambda sidecar: sidecar.update(actuators={"servo": "sts3251"})), "sts3215"),
    "wrong order": (
        spoil_sidecar(
            lambda sidecar: sidecar.update(
                actuators={
                    "servo": [
                        {"duty_limit": {"limit": 1.0}},
                        {"position_p": {"gain": 1.0}},
                        {"ideal": {"stiffness": 1.0}},
                    ]
                }
            )
        ),
        "order",
    ),
    "misspelt number": (spoil_sidecar(lambda sidecar: sidecar["robot_params"].update(mas=0.5)), "'mas'"),
}


LONG = ("no motion",)  # an experiment is proposed with all of the catalogue


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.long] if name in LONG else []) for name in BAD])
def test_wrong_input_gets_one_sentence(
    name: str, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, hint = BAD[name]
    spoil(log)
    before = {path.name: path.read_bytes() for path in log.parent.iterdir()}
    assert diagnose_command(f"log={log}", f"out={tmp_path / 'out'}") == 2
    said = capsys.readouterr().err.strip()
    assert hint.lower() in said.lower()
    assert "Traceback" not in said and len(said.splitlines()) == 1
    assert before == {path.name: path.read_bytes() for path in log.parent.iterdir()}
    out = tmp_path / "out"
    assert not out.exists() or (out / "diagnosis.json").exists(), "a folder without a finding is left behind"


def test_a_mistyped_key_names_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert diagnose_command("lgo=x") == 2
    assert "'log'" in capsys.readouterr().err


def test_a_missing_log_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert diagnose_command(f"log={tmp_path / 'none.csv'}", f"out={tmp_path / 'out'}") == 2
    assert "none.csv" in capsys.readouterr().err


# --- real machines -------------------------------------------------------------------------------------------------


@pytest.mark.xfail(
    reason="a shift of 12 ms (7 to 16) lowers the error of unseen data too little to be chosen", strict=True
)
@pytest.mark.skipif(not (DATA / "ak80_pendulum").is_dir(), reason="the AK80 logs (../shared/data) are not here")
def test_ak80_torque_column_is_not_read_with_the_motion() -> None:
    from sealegs.gap.log.importers import import_logs, read_mapping

    pytest.importorskip("pandas")
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        import_logs(DATA / "ak80_pendulum", Path(folder), read_mapping("ak80"))
        (found,) = diagnose(read_measured(Path(folder)))
    delay = next(cause for cause in found.causes if cause.name == "sensor.delay")
    assert delay.confidence > 0.95 and found.sentence.startswith("sensor.delay")
    assert 0.006 <= delay.parameters["torque.delay"].value <= 0.014


@pytest.mark.long
@pytest.mark.skipif(not (DATA / "xl330_pendulum").is_dir(), reason="the XL330 logs (../shared/data) are not here")
def test_xl330_loses_torque_under_load(tmp_path: Path) -> None:
    from sealegs.gap.log.importers import import_logs, read_mapping

    # those that come nearest; `python -m benchmarks.real_data` takes all of the catalogue, and four times as long
    near = ("friction.load_dependent", "friction.stribeck", "drive.supply_sag")
    import_logs(DATA / "xl330_pendulum", tmp_path, read_mapping("xl330"))
    (found,) = diagnose(read_measured(tmp_path), test_group="kp400", causes=near)
    assert found.causes[0].name == "friction.load_dependent"
    assert found.gap["extended"].mae < 0.67 * found.gap["refitted"].mae
    assert found.gap["extended"].mae < 0.05  # [rad]; the published models M1 to M6 reach 34 to 71 mrad
    assert found.problem is not None
    chain = found.problem.chain(found.values)
    assert chain is not None
    assert max(chain.value(f"friction.{form}") for form in ("load", "load_quadratic")) > 0.0


@pytest.mark.parametrize("words", ["joints=wrist_roll", "causes=drive.delay", "joints=[a,b]"])
def test_a_single_name_needs_no_brackets(words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert diagnose_command(f"log={tmp_path / 'none.csv'}", f"out={tmp_path / 'out'}", words) == 2
    said = capsys.readouterr().err
    assert "none.csv" in said and "must be a list" not in said and not (tmp_path / "out").exists()


# --- logs of speed goals: what a hidden wheel does otherwise is found, by a plant that shares no code with the
# models.

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
@pytest.mark.parametrize("seed", [2, *(pytest.param(seed, marks=pytest.mark.weekly) for seed in (0, 1))])
def test_nothing_is_named_of_a_wheel_that_hides_nothing(tmp_path: Path, seed: int) -> None:
    """Of all causes that there are, none; nor an error of the log, nor a number that was refitted."""
    columns, sidecar = logged(tmp_path, {}, seed=seed)
    diagnosis = sealegs.diagnose(columns, sidecar=sidecar)
    assert diagnosis.causes == () and diagnosis.data_errors == ()
    # the noise is reached; what the motion would hide is listed in the sentence
    assert diagnosis.verdict in ("nothing to explain", "not identifiable")
    assert diagnosis.sentence.startswith("The simulation of 'wheel' is within 0.")
