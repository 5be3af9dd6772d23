"""Files appear whole or not at all."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
from sealegs.actuators.atomic import UNFINISHED, write_text, written


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
