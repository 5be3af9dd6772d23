"""Which calibration is the newest is read from the files: neither their names nor their stamps on the disk decide."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import yaml
from sealegs.hw.machine.joints import CalibrationError
from sealegs.hw.machine.newest_calibration import newest

OLD, NEW = "2026-03-01T10:00:00+01:00", "2026-04-01T10:00:00+02:00"


def write(folder: Path, name: str, robot: str = "arm", date: str | None = None, touched: float = 0.0) -> Path:
    """A calibration as far as it says whose it is; touched so many seconds after 2001-09-09."""
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump({"robot": robot, **({} if date is None else {"date": date}), "joints": {}}))
    os.utime(path, (1e9 + touched, 1e9 + touched))
    return path


def test_the_calibration_of_a_robot_whose_name_goes_on_is_not_taken(tmp_path: Path) -> None:
    mine = write(tmp_path, "arm-20260301-100000", "arm", OLD)
    write(tmp_path, "arm-left-20260401-100000", "arm-left", NEW, 9.0)
    assert newest("arm", tmp_path) == mine
    assert newest("leg", tmp_path) is None


def test_a_copy_or_a_touch_does_not_bring_an_old_zero_back(tmp_path: Path) -> None:
    write(tmp_path, "arm-20260301-100000", "arm", OLD, 9.0)
    write(tmp_path, "arm-spare", "arm", OLD, 99.0)
    now = write(tmp_path, "arm-20260401-100000", "arm", NEW)
    assert newest("arm", tmp_path) == now


def test_the_date_in_the_file_counts_before_the_one_in_its_name(tmp_path: Path) -> None:
    now = write(tmp_path, "arm-20250101-000000", "arm", NEW)
    write(tmp_path, "arm-20260501-000000", "arm", OLD, 9.0)
    assert newest("arm", tmp_path) == now


def test_a_date_that_yaml_reads_as_one_counts_too(tmp_path: Path) -> None:
    write(tmp_path, "arm-a", "arm", OLD, 9.0)
    now = tmp_path / "arm-b.yaml"
    now.write_text("robot: arm\ndate: 2026-04-01\njoints: {}\n")
    os.utime(now, (1e9, 1e9))
    assert newest("arm", tmp_path) == now


def test_without_a_date_the_stamp_in_the_name_counts(tmp_path: Path) -> None:
    now = write(tmp_path, "arm-20260401-100000")
    write(tmp_path, "arm-20260301-100000", touched=9.0)
    assert newest("arm", tmp_path) == now


def test_one_file_needs_no_date_and_of_several_it_is_asked_for(tmp_path: Path) -> None:
    only = write(tmp_path, "arm-workshop")
    assert newest("arm", tmp_path) == only
    write(tmp_path, "arm-20260401-100000", "arm", NEW, 9.0)
    with pytest.raises(CalibrationError, match=r"arm-workshop\.yaml says no date.*calibration=<file>"):
        newest("arm", tmp_path)


DAMAGED = ["robot: [", "- 1", "", "date: 2026-04-01", "robot: arm\ndate: yesterday", b"\xff\xfe\x00"]


@pytest.mark.parametrize("text", DAMAGED)
@pytest.mark.parametrize("name", ["arm-20260501-100000", "arm-workshop"])
def test_a_damaged_file_that_may_be_the_newest_is_told(text: str | bytes, name: str, tmp_path: Path) -> None:
    write(tmp_path, "arm-20260401-100000", "arm", NEW)
    (tmp_path / f"{name}.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(CalibrationError, match=rf"{name}\.yaml .*calibration=<file>") as refusal:
        newest("arm", tmp_path)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("name", ["arm-20260301-100000", "arm-left-20260501-100000"])
def test_a_damaged_file_that_is_older_or_another_robots_does_not_matter(name: str, tmp_path: Path) -> None:
    now = write(tmp_path, "arm-20260401-100000", "arm", NEW)
    (tmp_path / f"{name}.yaml").write_text("robot: [")
    assert newest("arm", tmp_path) == now


def test_a_damaged_file_alone_is_told(tmp_path: Path) -> None:
    (tmp_path / "arm-20260301-100000.yaml").mkdir()
    with pytest.raises(CalibrationError, match=r"cannot be read: Is a directory"):
        newest("arm", tmp_path)
