"""What a row rests on is what moves it: each chosen number is changed alone, and the rows are computed again.

``tests/papers/otherwise/<robot>.py`` has for each paper ``rows``, which computes them in short runs, and ``OTHERWISE``,
another value of each chosen number. That a row that names too little is found is tested in ``test_published.py``.
"""

from __future__ import annotations

import importlib
import json
import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from sealegs.papers.published import Paper, Row

from docs.generate import papers as pages

ROBOTS = sorted(path.stem for path in (Path(__file__).parent / "otherwise").glob("*.py") if path.stem != "changes")


def of(robot: str) -> tuple[Paper, Any]:
    """The paper of a robot, and its module here."""
    paper = importlib.import_module(f"sealegs.papers.{robot}.choices").PAPER
    return paper, importlib.import_module(f"tests.papers.otherwise.{robot}")


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_chosen_number_has_another_value(robot: str) -> None:
    paper, module = of(robot)
    assert list(module.OTHERWISE) == list(paper.choices)


@cache
def chosen(robot: str) -> Sequence[Row]:
    """The rows with the chosen numbers."""
    return of(robot)[1].rows()


@pytest.mark.weekly
@pytest.mark.parametrize(("robot", "number"), [(robot, number) for robot in ROBOTS for number in of(robot)[0].choices])
def test_rows_name_a_chosen_number_that_moves_them(robot: str, number: str, monkeypatch: pytest.MonkeyPatch) -> None:
    paper, module = of(robot)
    as_chosen = chosen(robot)
    module.OTHERWISE[number](monkeypatch)
    paper.check_rests(as_chosen, [(number, module.rows())])


# --- the committed results, of which the pages of the papers are written, are those of the commands ------------------

FIGURE = re.compile(r"-?\d+(?:\.(\d+))?(?:e[+-]?\d+)?")
RELATIVE = 1e-3
ROUNDED = 1.01  # units of the last digit of a figure within a text


def same(fresh: Any, kept: Any) -> bool:
    """Whether both have the same words, and figures alike but for rounding."""
    if not isinstance(kept, str):
        return fresh == pytest.approx(kept, rel=RELATIVE, abs=1e-6)
    if FIGURE.sub("#", fresh) != FIGURE.sub("#", kept):
        return False
    return all(
        float(a.group()) == pytest.approx(float(b.group()), rel=RELATIVE, abs=ROUNDED * 10.0 ** -len(b.group(1) or ""))
        for a, b in zip(FIGURE.finditer(fresh), FIGURE.finditer(kept), strict=True)
    )


@pytest.mark.parametrize(
    ("fresh", "kept", "alike"),
    [
        ("falls by 27 mm from 3.9 s on", "falls by 27 mm from 3.9 s on", True),
        ("falls by 28 mm from 3.9 s on", "falls by 27 mm from 3.9 s on", True),
        ("falls by 29 mm from 3.9 s on", "falls by 27 mm from 3.9 s on", False),
        ("rises by 27 mm from 3.9 s on", "falls by 27 mm from 3.9 s on", False),
        ("2e-07 mm", "2e-07 mm", True),
        (2.2830, 2.2826, True),
        (2.30, 2.2826, False),
    ],
)
def test_figures_within_texts_are_compared_up_to_their_last_digit(fresh: Any, kept: Any, alike: bool) -> None:
    assert same(fresh, kept) is alike


@pytest.mark.weekly
@pytest.mark.parametrize("robot", pages.robots())
def test_a_fresh_run_has_the_rows_of_the_page(robot: str, tmp_path: Path) -> None:
    committed = json.loads((pages.RESULTS / f"paper_{robot}.json").read_text(encoding="utf-8"))
    importlib.import_module(f"sealegs.papers.{robot}.report").compare(tmp_path, say=lambda line: None)
    found = json.loads((tmp_path / f"{robot}.json").read_text(encoding="utf-8"))
    told = [(row["name"], row["mark"], row["holds"], row["rests"], row["decides"]) for row in found["rows"]]
    assert told == [(row["name"], row["mark"], row["holds"], row["rests"], row["decides"]) for row in committed["rows"]]
    for fresh, row in zip(found["rows"], committed["rows"], strict=True):
        if row["timed"]:
            continue  # another computer, or another load of it
        assert same(fresh["ours"], row["ours"]), row["name"]
        for kind in ("sensitivity", "rival"):
            for change, ours in (row[kind] or {}).items():
                assert same(fresh[kind][change], ours), f"{row['name']}, {change}"
    assert found["chosen"] == committed["chosen"] and found["not_built"] == committed["not_built"]
