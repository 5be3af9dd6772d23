"""Rows of a comparison with a paper say what they are worth."""

from __future__ import annotations

import json
from typing import Any

import pytest
from sealegs.common.errors import SealegsError
from sealegs.papers.published import MARKS, Otherwise, Row, documents, row_lines

ROWS = [
    Row("stiffness", "IV", 100.0, 100.05, "follows from the inputs", "N.m/rad", within=1e-3),
    Row("hops", "VIII", 92.0, 80.0, "predicted", within=0.01, sensitivity=(Otherwise("floor friction 0.6", 16.0),)),
    Row("legs irreversible", "6", "yes", "yes", "fitted", agrees=True, note="friction was chosen so"),
]


def test_a_row_agrees_within_its_bound_and_is_marked_missed_beyond_it() -> None:
    assert [row.holds for row in ROWS] == [True, False, True]
    text = row_lines("paper 009", ROWS)
    assert [line[0] for line in text if "VIII" in line] == ["!"]
    assert any("- " not in line and "-13.04%" in line for line in text)


def test_every_line_tells_its_mark_and_the_legend_what_it_means() -> None:
    text = "\n".join(row_lines("paper 009", ROWS))
    for row in ROWS:
        assert any(row.name in line and line.endswith(row.mark) for line in text.splitlines())
        assert MARKS[row.mark] in text
    assert "planted and recovered" not in text
    assert "predicted: " in text and "1 of 3 rows, 0 of 1 judged agree" in text
    assert "floor friction 0.6: 16" in text and "friction was chosen so" in text


def test_rows_become_json_with_mark_and_sensitivity() -> None:
    rows = json.loads(json.dumps(documents(ROWS)))
    assert rows[1]["mark"] == "predicted" and rows[1]["sensitivity"] == {"floor friction 0.6": 16.0}
    assert rows[0]["off"] == pytest.approx(5e-4) and rows[2]["off"] is None


def test_a_mark_that_there_is_not_is_refused() -> None:
    wrong: Any = "guessed"
    with pytest.raises(SealegsError, match="no mark 'guessed'"):
        Row("hops", "", 1.0, 1.0, wrong)
