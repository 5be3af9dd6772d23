"""A JSON file with a list of entries is BAM's where it says something that BAM does, and a table elsewhere."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from sealegs.gap.log.importers import propose_for, read_recordings

from tests.importers.test_import import motion

M = motion(5.0, 100.0)
TIME, GOAL, POSITION = (M[name].tolist() for name in ("time", "goal", "smooth"))


def entries(per: float = 1.0) -> list[dict[str, float]]:
    return [
        {"timestamp": t, "goal_position": per * g, "position": per * q}
        for t, g, q in zip(TIME, GOAL, POSITION, strict=True)
    ]


def written(folder: Path, content: Any) -> Path:
    path = folder / "run.json"
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize("own", [{"kp": 32}, {"motor": "sts3215"}, {"mass": 0.5, "length": 0.1}])
def test_entries_with_a_load_a_gain_or_a_motor_are_of_bam(tmp_path: Path, own: dict[str, Any]) -> None:
    (recording,) = read_recordings(written(tmp_path, {**own, "entries": entries()}))
    assert recording.kind == "bam" and recording.roles["goal_position"] == "servo.goal"


@pytest.mark.parametrize("key", ["entries", "samples"])
@pytest.mark.parametrize("per", [57.3, 4.0])
def test_any_other_list_of_rows_is_a_table_in_the_unit_that_the_file_says(tmp_path: Path, key: str, per: float) -> None:
    """Its angles were taken for rad, which the format was to say."""
    proposed = propose_for(written(tmp_path, {"robot": "arm", "unit": "deg", key: entries(per)}), tmp_path / "out")
    assert proposed.recordings[0].kind == "table" and not proposed.mapping.questions
    assert proposed.mapping.columns["joint.position"] == "`position [deg]`*pi/180"
    assert proposed.mapping.columns["joint.goal"] == "`goal_position [deg]`*pi/180"
    assert "# Note: the units that the file says stand in brackets behind the names." in proposed.text


def test_a_motor_beside_entries_in_another_unit_is_not_of_bam(tmp_path: Path) -> None:
    content = {"motor": "mx28", "units": {"position": "deg", "goal_position": "deg"}, "entries": entries(10.0)}
    proposed = propose_for(written(tmp_path, content), tmp_path / "out")
    assert proposed.mapping.columns["joint.position"] == "`position [deg]`*pi/180" and not proposed.mapping.questions


def test_entries_without_a_unit_are_asked_about_as_in_any_table(tmp_path: Path) -> None:
    proposed = propose_for(written(tmp_path, {"entries": entries(57.3)}), tmp_path / "out")
    assert any("joint.position" in one.about for one in proposed.mapping.questions)


def test_a_unit_of_the_file_is_not_put_over_that_of_a_name(tmp_path: Path) -> None:
    rows = [{"t": t, "goal_deg": g, "pos_deg": q} for t, g, q in zip(TIME, GOAL, POSITION, strict=True)]
    proposed = propose_for(written(tmp_path, {"unit": "rad", "log": rows}), tmp_path / "out")
    assert proposed.mapping.columns["joint.position"] == "pos_deg*pi/180"


def test_rows_beside_columns_of_their_length_stay_one_table(tmp_path: Path) -> None:
    states = [{"q": q, "goal": g} for g, q in zip(GOAL, POSITION, strict=True)]
    (recording,) = read_recordings(written(tmp_path, {"time": TIME, "states": states}))
    assert set(recording.columns) == {"time", "states.q", "states.goal"}


def test_the_unit_of_the_file_holds_for_a_row_a_joint_too(tmp_path: Path) -> None:
    rows = [
        {"time": t, "joint": joint, "position": size * q, "goal": size * g}
        for t, g, q in zip(TIME, GOAL, POSITION, strict=True)
        for joint, size in (("hip", 5.0), ("knee", 3.0))
    ]
    proposed = propose_for(written(tmp_path, {"unit": "deg", "rows": rows}), tmp_path / "out")
    assert proposed.mapping.columns["knee.goal"].endswith("*pi/180") and not proposed.mapping.questions
