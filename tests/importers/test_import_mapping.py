"""Mappings and other YAML that a person writes: what is wrong is told in one sentence."""

from __future__ import annotations

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
from sealegs.gap.log.importers import import_logs, read_mapping
from sealegs.gap.log.importers.expression import evaluate
from sealegs.gap.log.importers.mapping import Mapping
from sealegs.gap.log.sidecar import read_sidecar
from sealegs.hw.virtual.faults import read_faults
from sealegs.hw.virtual.hidden import hide

from tests.importers.importing import motion, table

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
