"""What a row rests on is what moves it: each chosen number is changed alone, and the rows are computed again.

``tests/papers/otherwise/<robot>.py`` has for each paper ``rows``, which computes them in short runs, and ``OTHERWISE``,
another value of each chosen number. That a row that names too little is found is tested in ``test_published.py``.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from sealegs.papers.published import Paper, Row

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
