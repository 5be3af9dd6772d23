"""Two runs that begin within one second have two names: the second one was refused, as one that exists already."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import pytest
from sealegs.commands import cli, loop
from sealegs.common import fresh_names

from tests.servo_runs import PATIENT


class Standing(datetime):
    """A clock that stands still."""

    @classmethod
    def now(cls, tz: object = None) -> Standing:  # type: ignore[override]
        return cls(2026, 1, 31, 12)


@pytest.fixture(autouse=True)
def one_second(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fresh_names, "datetime", Standing)


def test_a_name_that_is_taken_with_another_ending_gets_a_number(tmp_path: Path) -> None:
    first = fresh_names.fresh(tmp_path / "missing", "run", ".csv")
    assert first == tmp_path / "missing" / "run-20260131-120000.csv"
    first.parent.mkdir()
    first.with_suffix(".yaml").touch()
    second = fresh_names.fresh(first.parent, "run", ".csv")
    assert second.name == "run-20260131-120000-2.csv"
    second.touch()
    assert fresh_names.fresh(first.parent, "run").name == "run-20260131-120000-3"


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
