"""The committed results, of which the pages of the papers are written, are those of the commands."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import pytest

from docs.generate import papers as pages


@pytest.mark.weekly
@pytest.mark.parametrize("robot", ["arm", "hexapod", "leg"])
def test_a_fresh_run_has_the_rows_of_the_page(robot: str, tmp_path: Path) -> None:
    committed = json.loads((pages.RESULTS / f"paper_{robot}.json").read_text(encoding="utf-8"))
    importlib.import_module(f"sealegs.papers.{robot}.report").compare(tmp_path, say=lambda line: None)
    found = json.loads((tmp_path / f"{robot}.json").read_text(encoding="utf-8"))
    told = [(row["name"], row["mark"], row["holds"], row["rests"]) for row in found["rows"]]
    assert told == [(row["name"], row["mark"], row["holds"], row["rests"]) for row in committed["rows"]]
    for fresh, row in zip(found["rows"], committed["rows"], strict=True):
        if isinstance(row["ours"], float) and abs(row["ours"]) > 1e-6:
            assert fresh["ours"] == pytest.approx(row["ours"], rel=1e-3), row["name"]
    assert found["chosen"] == committed["chosen"] and found["not_built"] == committed["not_built"]
