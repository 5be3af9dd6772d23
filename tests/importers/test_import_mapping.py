"""Mappings that a person writes: what is wrong in them is told in a sentence, and empty cells spoil no others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.commands.cli import main
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import import_logs, read_mapping
from sealegs.gap.log.importers.expression import evaluate
from sealegs.gap.log.importers.mapping import Mapping

from tests.importers.test_import import motion, table

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
    with pytest.raises(LogError, match=r"no value in 1 sample, the first in row 41; .*`where: known\(q\)`"):
        import_logs(path, tmp_path / "log", Mapping(columns))
    sidecar = {"robot": "bench", "robot_params": {"mass": 0.5, "length": 0.1}, "actuators": {"joint": "sts3215"}}
    import_logs(path, tmp_path / "log", Mapping(columns, where="known(q)", sidecar=sidecar))
    (run,) = read_measured(tmp_path / "log").runs
    np.testing.assert_allclose(run.joints["joint"].position, np.delete(angle, 40), atol=1e-6)
