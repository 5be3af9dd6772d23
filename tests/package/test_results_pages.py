"""Pages of docs/results have the figures of the kept results, and none that was typed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from docs.generate import papers, results
from docs.generate.templates import PAGES, FigureError, Page, Table, fill, summarised

TEMPLATES = {path.stem: path for path in results.TEXTS.glob("*.md")}
TEMPLATES |= {robot: papers.TEXTS / robot / "page.md" for robot in papers.robots()}
NO_FIGURE = re.compile(r"```.*?```|`[^`]*`|\{[^{}]*\}|\]\([^)]*\)|^#[^\n]*", re.DOTALL | re.MULTILINE)
TYPED = re.compile(r"(?<![\w.-])\d+(?:\.\d+)?(?![\w.]*\w)")
GIVEN = {
    "arm": "002 5.3 3.1 5.2 6 1",  # sections, and a control rate
    "biped": "003 44 24 30 1",  # equations, and settings of the simulation
    "confidence": "0.9 0.6",  # edges of the bins
    "diagnosis": "5 20 24 0.9 1.2 95 120 240 1050 1060 1180",  # settings, seeds and bars
    "hexapod": "001 34 10 1.5 3 1 5",  # an equation, loads, legs and a speed of the paper
    "hopper": "004 3 7 2.5 0.3 0.23 1",  # what the paper prints
    "how-fast": "24 1 100",  # settings
    "index": "0.9 0.6 10 72 100",  # edges of the bins, and settings
    "leg": "000 1 3 5 7",  # the paper's rule and its figure
    "papers": "004 001 000 003 002",
    "policies": "60 0.1 20 30 100",  # settings
    "safety": "100 10",
    "transfer": "64 000 10 20 5 30 32 85 1",  # settings, ranges of the randomisation and a bar
}
"""Numbers in the text of a page that are no figure of a run."""


@pytest.mark.parametrize("name", results.pages())
def test_a_page_of_results_is_that_of_what_is_kept(name: str) -> None:
    written = (PAGES / f"{name}.md").read_text(encoding="utf-8")
    assert written == results.page(name), "run python -m docs.generate.results"


def test_every_page_of_results_has_its_template() -> None:
    assert {path.stem for path in PAGES.glob("*.md")} == set(TEMPLATES)


@pytest.mark.parametrize("name", sorted(TEMPLATES))
def test_the_text_of_a_page_has_no_figure_of_a_run(name: str) -> None:
    text = NO_FIGURE.sub(" ", TEMPLATES[name].read_text(encoding="utf-8"))
    assert set(TYPED.findall(text)) == set(GIVEN[name].split())


def test_a_field_is_a_cell_of_a_table_without_its_unit_or_a_line_of_a_list(tmp_path: Path) -> None:
    page = tmp_path / "speed.md"
    page.write_text("- slow: 3 of 40\n\n| servos | time [ms] | |\n|---|---|---|\n| 1 | 2.5 | yes |\n| 6 | 1,300 | |\n")
    found = Page(page)
    assert (found[1]["time"], found["6"]["time"], found["slow"]) == ("2.5", "1,300", "3 of 40")
    assert (found["*"]["time"], found["max"]["time"]) == ("2.5 to 1,300", "1,300")
    with pytest.raises(FigureError, match=r"speed.md has no '7' with 'time'"):
        found["7"]["time"]
    assert found.tables == [Table(("servos", "time", ""), (("1", "2.5", "yes"), ("6", "1,300", "")))]


def test_shares_of_a_column_add_up() -> None:
    assert summarised(["49 of 50", "50 of 50"], "sum") == "99 of 100"


def test_a_field_without_a_figure_is_named(tmp_path: Path) -> None:
    template = tmp_path / "page.md"
    template.write_text("{here} and {nowhere[a][b]}")
    with pytest.raises(FigureError, match=r"no benchmarks/results/nowhere.md"):
        fill(template, {"here": 1})


def test_a_share_that_misses_its_bar_is_called_missed() -> None:
    assert results.marked("covered", "17 of 20 (85 %)") == "17 of 20 (85 %)"
    assert results.marked("covered", "16 of 20 (80 %)") == "16 of 20 (80 %): missed"
    assert results.marked("worse", "2 of 120") == "2 of 120: missed"
    assert results.wanted("worse") == "at most 1 %"
