"""What README and docs tell to type does what they say."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import sealegs
from sealegs.gap.causes.catalogue import checked
from sealegs.gap.causes.cause import ENTRIES, GROUND
from sealegs.gap.virtual.bench import record

from docs.generate import catalogue as catalogue_page
from docs.generate import dialects as dialects_page
from docs.generate import papers, results
from docs.generate import thresholds as thresholds_page
from docs.generate.templates import PAGES, FigureError, Page, Table, fill, summarised
from tests.doc_blocks import NO_DATA, NOT_RUN, REPOSITORY, Block, blocks, check, pages, why_not, world

BLOCKS = [block for path in pages() for block in blocks(path)]
LINK = re.compile(r"\]\((?!https?:|#)([^)\s#]+)(#[^)\s]*)?\)")
INTERNAL = re.compile(r"seed 00\d|issue \d|\bhelper [A-Z]\b", re.IGNORECASE)


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: f"{block.page}:{block.line}")
def test_a_block_is_of_a_command_or_a_text_that_there_is(block: Block) -> None:
    check(block)


TABLE = re.compile(r"(?:^[ \t]*\|.*\n)+", re.MULTILINE)
RULE = re.compile(r"\|(?:\s*:?-+:?\s*\|)+")


def cells(row: str) -> int:
    return len(re.findall(r"(?<!\\)\|", row))


@pytest.mark.parametrize("path", [*pages(), *sorted((REPOSITORY / "envs").glob("*/env.py"))], ids=str)
def test_every_table_has_a_head_and_rows_as_wide_as_it(path: Path) -> None:
    for table in TABLE.findall(path.read_text(encoding="utf-8") + "\n"):
        head, rule, *rows = [*table.strip().splitlines(), ""]
        assert RULE.fullmatch(rule.strip()), f"no head: {head}"
        assert [row for row in rows if row and cells(row) != cells(head)] == []


@pytest.mark.parametrize("path", pages(), ids=lambda path: path.name)
def test_links_of_a_page_lead_somewhere(path: Path) -> None:
    own = {"changelog.md", "contributing.md"}  # the site makes these of the files at the top
    made = re.compile(r"results/[a-z0-9_]+\.md$")  # and these of benchmarks/results
    for target, _ in LINK.findall(path.read_text(encoding="utf-8")):
        if target in own or (made.search(target) and (path.parents[0] / "../benchmarks" / target).is_file()):
            continue
        assert (path.parent / target).exists(), f"{path.name}: {target}"


@pytest.mark.parametrize("path", pages(), ids=lambda path: path.name)
def test_a_page_speaks_of_nothing_internal(path: Path) -> None:
    assert not INTERNAL.search(path.read_text(encoding="utf-8"))


def test_the_catalogue_page_is_that_of_the_causes() -> None:
    assert catalogue_page.PAGE.read_text(encoding="utf-8") == catalogue_page.page(), "python -m docs.generate.catalogue"


def test_every_cause_of_joint_and_ground_has_its_picture_and_every_picture_its_cause() -> None:
    folder = catalogue_page.PAGE.parent / "pictures" / "causes"
    assert {path.stem for path in folder.glob("*.png")} == {*catalogue_page.causes(), *GROUND}


@pytest.mark.parametrize("name", sorted(checked(None)))
def test_every_cause_is_on_the_page_of_the_catalogue(name: str) -> None:
    page = catalogue_page.PAGE.read_text(encoding="utf-8")
    assert f"### {name}\n" in page or f"`{name}`" in page.rpartition("## ")[2]


def test_the_page_of_thresholds_is_that_of_the_settings() -> None:
    page = thresholds_page.PAGE.read_text(encoding="utf-8")
    assert page == thresholds_page.page(), "python -m docs.generate.thresholds"


def test_the_page_of_dialects_is_that_of_their_rows() -> None:
    assert dialects_page.PAGE.read_text(encoding="utf-8") == dialects_page.page(), "python -m docs.generate.dialects"


# --- typed from top to bottom ----------------------------------------------------------------------------------------

PRESUPPOSED = {
    "docs/actuation-chain.md": ("diagnosis",),
    "docs/deploy.md": ("logs/bench", "diagnosis", "runs/first", "sit.csv"),
    "docs/diagnose-more.md": ("logs/bench",),
    "docs/index.md": ("logs/bench",),
    "docs/next-experiment.md": ("diagnosis",),
    "docs/train-and-deploy.md": ("logs/bench", "diagnosis", "runs/loop-1/diagnosis", "bench.csv"),
}
"""What a page takes for granted, since another one made it."""
CONSIDERED = ("friction.coulomb", "drive.delay")


def few_causes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every diagnosis of a test consider few causes, so that it takes seconds."""
    kept = {name: entry for name, entry in ENTRIES.items() if name in CONSIDERED}
    monkeypatch.setattr("sealegs.gap.causes.catalogue.ENTRIES", kept)


WEEKLY = ("deploy.md", "your-own-robot.md", "diagnose-your-servo.md")
"""Pages that take a minute and more; what they do has tests of its own."""


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Logs, a diagnosis of them and a trained policy, by the path that pages call them."""
    folder = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as patch, world(folder, {}) as reader:
        few_causes(patch)
        record(Path("logs/bench"), "sts3215", {"friction.coulomb": 0.12}, excitations=("chirp", "steps", "multisine"))
        Path("sit.csv").write_text("time,hip.goal,knee.goal\n0,-0.6,1.0\n0.5,-0.6,1.0\n")
        reader.run(["sealegs", "characterize", "repeats=1", "out=brake"])
        Path("brake/table.csv").rename("bench.csv")
        reader.run(["sealegs", "diagnose", "log=logs/bench", "out=diagnosis"])
        reader.run(["sealegs", "train", "name=first"])
    names = ("logs/bench", "diagnosis", "runs/first", "bench.csv", "sit.csv")
    return {name: folder / name for name in names} | {"runs/loop-1/diagnosis": folder / "diagnosis"}


@pytest.mark.long
@pytest.mark.parametrize(
    "path",
    [pytest.param(page, marks=pytest.mark.weekly) if page.name in WEEKLY else page for page in pages()],
    ids=lambda path: path.name,
)
def test_a_page_can_be_typed_from_top_to_bottom(
    path: Path, request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few_causes(monkeypatch)
    places = PRESUPPOSED.get(str(path.relative_to(REPOSITORY)), ())
    made = request.getfixturevalue("made") if places else {}
    with world(tmp_path, {place: made[place] for place in places}) as reader:
        for block in blocks(path):
            reader.do(block)


def test_what_is_not_run_has_a_reason_that_some_command_needs() -> None:
    commands = [command for block in BLOCKS if block.language == "sh" for command in block.commands]
    reasons = {why_not(command) for command in commands} - {None, NO_DATA}
    assert reasons == set(NOT_RUN.values())
    assert sum(why_not(command) in (None, NO_DATA) for command in commands) > 0.7 * len(commands)


def test_every_page_of_results_is_led_to_by_a_question_of_the_navigation() -> None:
    """Thirty-eight pages stood in one list."""
    docs = REPOSITORY / "docs"
    named = (REPOSITORY / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:")[2]
    results = named.partition("  - Results:")[2].partition("  - API:")[0]
    questions = [docs / page for page in re.findall(r"(\S+\.md)$", results, re.MULTILINE)]
    assert 5 <= len(questions) <= 9
    led_to = {(page.parent / target).resolve() for page in questions for target, _ in LINK.findall(page.read_text())}
    measured = [*(REPOSITORY / "benchmarks" / "results").glob("*.md"), *(docs / "results").glob("*.md")]
    assert measured and {path for path in measured if path.resolve() not in led_to} <= {docs / "results" / "index.md"}


@pytest.mark.long
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs")
    root = Path(__file__).parents[2]
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(
        build, cwd=root, capture_output=True, text=True, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site" / "index.html").is_file()
    public = (tmp_path / "site" / "api" / "index.html").read_text(encoding="utf-8")
    headings = re.findall(r"<h2 .*?</h2>", public, re.DOTALL)
    assert not [heading for heading in headings if "doc-module-name" in heading]  # "diagnose" was the checkout's script
    for name in sealegs.__all__:
        assert any(f"sealegs.{name}" in re.sub(r"<[^>]*>", "", heading) for heading in headings), name


# --- pages of docs/results have the figures of the kept results, and none that was typed -----------------------------

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
    "policies": "60 0.1 20 30 100 5",  # settings
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
