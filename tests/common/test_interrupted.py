"""Files, folders and processes that a stop or a kill interrupts are whole or gone."""

from __future__ import annotations

import errno
import multiprocessing
import os
import time
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from sealegs.commands import cli, loop
from sealegs.common import atomic
from sealegs.common.atomic import REPLACED, UNFINISHED, finish_replacements, folder_written, write_text, written
from sealegs.common.processes import worker_pool

from tests.servo_runs import PATIENT
from tests.waiting import wait_until


def test_a_file_appears_when_its_block_ends(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    with written(target) as fresh:
        fresh.write_text("whole")
        assert fresh.name.startswith(UNFINISHED) and not target.exists()
    assert target.read_text() == "whole" and list(tmp_path.iterdir()) == [target]


def test_a_block_that_fails_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), written(tmp_path / "a.txt") as fresh:
        fresh.write_text("half")
        raise RuntimeError
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("links", [True, False], ids=["hard links", "no hard links"])
def test_a_file_that_is_there_is_replaced_only_where_that_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, links: bool
) -> None:
    def refused(*_: object) -> None:
        raise OSError(errno.EPERM, "no links")

    if not links:
        monkeypatch.setattr(os, "link", refused)
    target = tmp_path / "a.txt"
    write_text(target, "first")
    with pytest.raises(FileExistsError):
        write_text(target, "second")
    assert target.read_text() == "first"
    write_text(target, "third", replace=True)
    assert target.read_text() == "third" and list(tmp_path.iterdir()) == [target]


def filled(folder: Path, text: str, **how: Any) -> None:
    with folder_written(folder, **how) as staged:
        (staged / "inner").mkdir()
        (staged / "inner" / "a.txt").write_text(text)
        (staged / "index").write_text(text)


def test_a_folder_appears_when_its_block_ends_and_an_older_one_stays_unless_asked(tmp_path: Path) -> None:
    target = tmp_path / "run"
    filled(target, "first")
    with pytest.raises(OSError):
        filled(target, "second")
    assert (target / "inner" / "a.txt").read_text() == "first"
    filled(target, "third", replace=True)
    assert (target / "inner" / "a.txt").read_text() == "third" and list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("how", [{}, {"replace": True}, {"last": "index"}], ids=["new", "replaced", "moved into"])
def test_a_folder_whose_block_fails_leaves_nothing(tmp_path: Path, how: dict[str, Any]) -> None:
    target = tmp_path / "run"
    with pytest.raises(RuntimeError), folder_written(target, **how) as staged:
        (staged / "a.txt").write_text("half")
        raise RuntimeError
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_what_is_moved_into_a_folder_leaves_what_else_is_there(tmp_path: Path) -> None:
    (tmp_path / "kept").write_text("before")
    (tmp_path / "inner").mkdir()  # half moved by a session that was killed
    (tmp_path / "inner" / "old").write_text("half")
    filled(tmp_path, "new", last="index")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["index", "inner", "kept"]
    assert [path.name for path in (tmp_path / "inner").iterdir()] == ["a.txt"]


def test_what_a_kill_between_two_renames_left_is_put_right(tmp_path: Path) -> None:
    (tmp_path / f"{REPLACED}run").mkdir()
    (tmp_path / f"{UNFINISHED}other").mkdir()
    finish_replacements(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


class Standing(datetime):
    """A clock that stands still."""

    @classmethod
    def now(cls, tz: object = None) -> Standing:  # type: ignore[override]
        return cls(2026, 1, 31, 12)


@pytest.fixture(autouse=True)
def one_second(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(atomic, "datetime", Standing)


def test_a_name_that_is_taken_with_another_ending_gets_a_number(tmp_path: Path) -> None:
    first = atomic.fresh(tmp_path / "missing", "run", ".csv")
    assert first == tmp_path / "missing" / "run-20260131-120000.csv"
    first.parent.mkdir()
    first.with_suffix(".yaml").touch()
    second = atomic.fresh(first.parent, "run", ".csv")
    assert second.name == "run-20260131-120000-2.csv"
    second.touch()
    assert atomic.fresh(first.parent, "run").name == "run-20260131-120000-3"


def test_two_deployments_within_a_second_write_two_logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        assert (
            cli.main(["deploy", "excitation=steps", "hw.virtual.time=stepped", "live=false", "duration=0.1", *PATIENT])
            == 0
        )
    assert len(list(tmp_path.glob("logs/*/*.csv"))) == 2


def test_what_a_stop_left_is_put_beside_what_an_earlier_one_left(tmp_path: Path) -> None:
    for content in ("first", "second"):
        folder = tmp_path / "policy"
        folder.mkdir()
        (folder / "notes").write_text(content)
        loop.put_aside(folder, tmp_path)
    kept = sorted(path.read_text() for path in (tmp_path / "unfinished").glob("policy-*/notes"))
    assert kept == ["first", "second"]


# --- processes ------------------------------------------------------------------------------------------------------


def test_no_process_of_a_pool_outlives_an_interrupt() -> None:
    before = set(multiprocessing.active_children())
    with pytest.raises(KeyboardInterrupt), worker_pool(2) as pool:
        jobs = [pool.submit(time.sleep, 3600.0) for _ in range(2)]
        wait_until(lambda: all(job.running() for job in jobs))
        raise KeyboardInterrupt
    wait_until(lambda: not set(multiprocessing.active_children()) - before)
