"""The report as a person gets it: one file, opened in a real browser."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.gap.experiment import DetectionLimit, Experiment
from sealegs.gap.log.finding import Finding
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.measure.named import Error, NamedCause, Value
from sealegs.gap.output.numbers import GLUE, rounded
from sealegs.gap.output.report import write_report
from sealegs.gap.output.terminal import screen
from sealegs.gap.verdict.verdict import UNUSABLE, DataError, JointDiagnosis, Reason

from tests.quick import quick
from tests.small_diagnosis import small_diagnosis

CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
QUIET = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
VOID = {"area", "base", "br", "col", "hr", "img", "input", "link", "meta", "source"}
MOST_BYTES = 8_000_000


@pytest.fixture(scope="module")
def small() -> tuple[JointDiagnosis, MeasuredSet]:
    return small_diagnosis()


@pytest.fixture(scope="module")
def rich(small: tuple[JointDiagnosis, MeasuredSet]) -> list[JointDiagnosis]:
    """Three joints that between them have everything a report can show."""
    found, _ = small
    time = np.arange(0.0, 4.0, 0.01)
    proposal = Experiment("chirp", "Run 'chirp'.", 2.5, time, np.sin(time), {"steps": 1.0, "chirp": 2.5})
    notes = (
        Finding(
            "velocity.scale", "warning", "servo", "servo.velocity", "The velocity is 0.93 times the <derivative>.", 0.93
        ),
        Finding("clock.jitter", "note", None, "time", "The clock jitters."),
    )
    rival = replace(found.causes[0], rivals=("friction.stribeck",))
    doubtful = found.changed(
        joint="elbow",
        experiment=proposal,
        findings=notes,
        causes=(rival, *found.causes[1:]),
        data_errors=(DataError("column.stuck", "column.stuck", "The battery sags.", "warning", "elbow"),),
    )
    value = Value(0.009, 0.008, 0.010, "s", 0.0)
    late = NamedCause(
        "sensor.delay", "The torque column lags.", "motor", 0.4, 0.99, {"torque.delay": value}, 0.3, "data", "response"
    )
    gap = {"nominal": 0.5, "refitted": 0.2, "extended": 0.1, "noise_floor": 0.02}
    driven = JointDiagnosis.of(
        joint="motor",
        verdict="partly explained",
        sentence="The torque column lags.",
        signal="motor.torque",
        unit="N.m",
        gap={name: Error(rmse, 0.8 * rmse) for name, rmse in gap.items()},
        causes=(late,),
        unexplained=0.1,
        tuned={"inertia [kg.m2]": 0.15},
    )
    broken = JointDiagnosis.of(
        joint="wrist",
        verdict=UNUSABLE,
        sentence="The log cannot be used: time runs backwards.",
        signal="wrist.position",
        unexplained=1.0,
    )
    gap = {"nominal": 0.0007, "refitted": 0.0006, "extended": 0.0006, "noise_floor": 0.0006}
    quiet = JointDiagnosis.of(
        joint="pan",
        verdict="nothing to explain",
        sentence="Nothing to explain: within 0.7 mrad.",
        signal="pan.position",
        gap={name: Error(rmse, 0.8 * rmse) for name, rmse in gap.items()},
        reasons=(Reason("agrees", "It agrees."), Reason("limits", "A wall.")),
        limits=(DetectionLimit("drive.delay", "delay.seconds", "s", 0.0, -np.inf, 0.004),),
    )
    return [doubtful, driven, broken, quiet]


@pytest.fixture(scope="module")
def page(small: tuple[JointDiagnosis, MeasuredSet], tmp_path_factory: pytest.TempPathFactory) -> Path:
    found, data = small
    return write_report([found], data, tmp_path_factory.mktemp("one") / "report.html")


@pytest.fixture(scope="module")
def rich_page(
    rich: list[JointDiagnosis], small: tuple[JointDiagnosis, MeasuredSet], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    return write_report(rich, small[1], tmp_path_factory.mktemp("three") / "report.html")


# --- the file ------------------------------------------------------------------------------------------------------


class Outline(HTMLParser):
    """Headings in order, text outside of scripts, addresses, and whether every tag is closed."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.headings: list[int] = []
        self.addresses: list[str] = []
        self.text = ""
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value for key, value in attrs if key in ("src", "srcset", "href") and value]
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open.pop() == tag, f"</{tag}> closes nothing"

    def handle_data(self, data: str) -> None:
        if not {"script", "style"} & set(self.open):
            self.text += data


@pytest.mark.long
@pytest.mark.parametrize("name", ["page", "rich_page"])
def test_the_page_is_well_formed_and_loads_nothing(name: str, request: pytest.FixtureRequest) -> None:
    path: Path = request.getfixturevalue(name)
    outline = Outline(path.read_text(encoding="utf-8"))
    assert outline.open == []
    assert all(address.startswith(("data:", "#")) for address in outline.addresses)
    assert path.stat().st_size < MOST_BYTES


def test_headings_step_down_one_level_at_a_time(rich_page: Path) -> None:
    levels = Outline(rich_page.read_text(encoding="utf-8")).headings
    assert levels[0] == 1 and levels.count(1) == 1
    assert all(after - before <= 1 for before, after in pairwise(levels))


def test_says_verdict_cause_interval_and_what_changes(small: tuple[JointDiagnosis, MeasuredSet], page: Path) -> None:
    found, data = small
    text = Outline(page.read_text(encoding="utf-8")).text
    assert found.sentence in text.replace(GLUE, " ")
    _, low, high = rounded(found.causes[0].parameters["friction.load"])
    assert f"{low} to {high}" in text
    for run in data.runs:
        assert run.name in text
    for said in ("friction.load_dependent", "tuned within its tolerance", "Plain MuJoCo does not simulate"):
        assert said in text


def test_shows_rivals_experiment_findings_and_data_errors(rich_page: Path) -> None:
    html = rich_page.read_text(encoding="utf-8")
    text = Outline(html).text
    assert "friction.stribeck" in text
    assert "Run 'chirp'." in text
    assert "The battery sags." in text
    assert "The velocity is 0.93 times the <derivative>." in text
    assert "The log cannot be used: time runs backwards." in text
    assert 'download="next_experiment.csv"' in html
    assert "inertia [kg.m2]" in text


def test_what_could_be_there_unseen_is_a_table(rich_page: Path) -> None:
    text = Outline(rich_page.read_text()).text
    assert "0.004 s" in text and "Shows above" in text and "A wall." not in text and "It agrees." in text


@pytest.mark.long
def test_what_is_to_be_checked_first_stands_once(small: tuple[JointDiagnosis, MeasuredSet], tmp_path: Path) -> None:
    """It stood at every joint of a robot, and the table above them said that all is explained."""
    found, data = small
    doubt = Finding("robot.frame", "warning", None, None, "The angles do not match.")
    two = [found.changed(joint=joint, findings=(doubt,)) for joint in ("shoulder", "elbow")]
    text = Outline(write_report(two, data, tmp_path / "report.html").read_text()).text
    assert text.index("Check first") < text.index("Joint shoulder")
    assert text.count("Check first") == 1
    assert "\n".join(screen(two, {})).count("Check first") == 1


@pytest.mark.long
def test_says_where_the_whole_robot_misses_a_joint_by_more_than_it_does_alone(
    small: tuple[JointDiagnosis, MeasuredSet], tmp_path: Path
) -> None:
    found, data = small
    alone = found.gap["extended"].rmse
    whole = {"joints": {found.joint: {"nominal": 9.0 * alone, "extended": 3.0 * alone, "unit": "rad"}}}
    text = Outline(write_report([found], data, tmp_path / "a.html", robot=whole).read_text()).text
    assert f"More than twice the error of the joint alone: {found.joint}." in text
    whole["joints"][found.joint]["extended"] = 1.5 * alone
    text = Outline(write_report([found], data, tmp_path / "b.html", robot=whole).read_text()).text
    assert "joint alone" in text and "More than twice" not in text


def test_takes_the_changes_of_the_caller(small: tuple[JointDiagnosis, MeasuredSet], tmp_path: Path) -> None:
    found, data = small
    rows = [{"path": "friction.load", "from": 0.0, "to": 0.125, "why": "because I say so"}]
    path = write_report([found], data, tmp_path / "report.html", changes=rows)
    assert "because I say so" in path.read_text(encoding="utf-8")


def test_nothing_is_overwritten(small: tuple[JointDiagnosis, MeasuredSet], tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(FileExistsError):
        write_report([small[0]], small[1], path)
    assert path.read_text(encoding="utf-8") == "mine"


# --- in a browser --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A headless Chromium with a profile of its own, which is thrown away."""
    driver = pytest.importorskip("playwright.sync_api", reason="needs the package playwright to drive a browser")
    if CHROMIUM is None:
        pytest.skip("needs Chromium to open the report; on Debian, `apt-get install chromium`")
    with driver.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=list(QUIET))
        yield chromium
        chromium.close()


UNFOLD = "document.querySelectorAll('details').forEach(part => part.open = true)"
FOLD = UNFOLD.replace("true", "false")


@dataclass
class Opened:
    """A page in the browser, and everything it complained about or asked for."""

    tab: Any
    complaints: list[str]


def opened(browser: Any, path: Path, width: int, height: int = 900) -> Opened:
    tab = browser.new_page(viewport={"width": width, "height": height})
    complaints: list[str] = []
    tab.on("console", lambda message: complaints.append(message.text) if message.type in ("error", "warning") else None)
    tab.on("pageerror", lambda error: complaints.append(str(error)))
    tab.on(
        "request",
        lambda request: None if request.url.startswith(("file:", "data:")) else complaints.append(request.url),
    )
    tab.goto(path.as_uri())
    tab.evaluate(UNFOLD)
    tab.wait_for_function(
        "[...document.querySelectorAll('.plotly-graph-div')].every(plot => plot.querySelector('svg.main-svg'))"
    )
    return Opened(tab, complaints)


@pytest.mark.parametrize(
    ("name", "width"),
    [
        ("page", 1280),
        ("rich_page", 390),
        pytest.param("page", 390, marks=pytest.mark.long),
        pytest.param("rich_page", 1280, marks=pytest.mark.long),
    ],
)
def test_every_figure_is_drawn_without_complaint(
    browser: Any, name: str, width: int, request: pytest.FixtureRequest
) -> None:
    view = opened(browser, request.getfixturevalue(name), width)
    plots = view.tab.query_selector_all(".plotly-graph-div")
    assert len(plots) == (1 if name == "page" else 2)
    for plot in plots:
        assert plot.query_selector_all("path.js-line"), "a plot without a line"
        assert plot.bounding_box()["width"] <= width
    images = view.tab.evaluate("[...document.images].map(image => image.complete && image.naturalWidth)")
    assert images and all(size > 300 for size in images)
    assert view.complaints == []
    view.tab.close()


@pytest.mark.parametrize("name", quick(["page", "rich_page"], 2))
def test_a_phone_never_scrolls_sideways(browser: Any, name: str, request: pytest.FixtureRequest) -> None:
    view = opened(browser, request.getfixturevalue(name), 390, 844)
    assert view.tab.evaluate("document.documentElement.scrollWidth") <= 390
    size = view.tab.evaluate("parseFloat(getComputedStyle(document.querySelector('.lead')).fontSize)")
    assert size >= 16.0
    view.tab.close()


@pytest.mark.parametrize(
    ("width", "height", "parts"),
    [(1280, 800, (".lead", ".first-look", ".causes")), (390, 844, (".lead", ".causes"))],
)
def test_sentence_picture_and_causes_are_seen_without_scrolling(
    browser: Any, page: Path, width: int, height: int, parts: tuple[str, ...]
) -> None:
    view = opened(browser, page, width, height)
    view.tab.evaluate(FOLD)
    for part in parts:
        box = view.tab.query_selector(part).bounding_box()
        assert box["y"] + box["height"] < height, part
    view.tab.close()


@pytest.mark.parametrize(("width", "shape"), [(1280, "wide"), (390, "tall")])
def test_each_joint_opens_with_a_picture_that_fits_the_screen(
    browser: Any, rich_page: Path, width: int, shape: str
) -> None:
    """Everything to look at was folded away."""
    view = opened(browser, rich_page, width)
    view.tab.evaluate(FOLD)
    sizes = view.tab.evaluate("[...document.querySelectorAll('.first-look img')].map(i => [i.naturalWidth, i.width])")
    assert len(sizes) == 3  # of the others here, one was refused and no log of it is at hand
    (natural, drawn), *_ = sizes
    assert (natural > 1200) == (shape == "wide") and drawn <= width
    words = view.tab.evaluate("document.querySelector('.first-look img').alt")
    assert "friction.load_dependent" in words and "noise" in words
    view.tab.close()


def test_a_refused_joint_opens_with_its_log(small: tuple[JointDiagnosis, MeasuredSet], tmp_path: Path) -> None:
    found, data = small
    refused = found.changed(verdict=UNUSABLE, gap={}, causes=(), replay=None, search=None, simulated={})
    html = write_report([refused], data, tmp_path / "report.html").read_text(encoding="utf-8")
    assert 'class="first-look"' in html
    assert "The log as it is; no model was compared with it." in Outline(html).text


def test_what_is_read_first_stands_first(rich_page: Path) -> None:
    text = Outline(rich_page.read_text(encoding="utf-8")).text
    order = [
        text.index(part) for part in ("Errors of the log", "Share of the gap", "Next experiment", "Why this verdict")
    ]
    assert order == sorted(order)


@pytest.mark.long
def test_everything_else_is_folded(browser: Any, page: Path) -> None:
    view = opened(browser, page, 390, 844)
    view.tab.evaluate(FOLD)
    assert view.tab.evaluate("document.documentElement.scrollHeight") < 3 * 844
    view.tab.close()


@pytest.mark.long
def test_the_buttons_zoom(browser: Any, page: Path) -> None:
    view = opened(browser, page, 1280)
    reach = "document.querySelector('.plotly-graph-div')._fullLayout.xaxis.range"
    whole = view.tab.evaluate(reach)
    view.tab.click("[data-moment]")
    moment = view.tab.evaluate(reach)
    assert moment[1] - moment[0] < 0.5 * (whole[1] - whole[0])
    view.tab.click("[data-whole]")
    assert view.tab.evaluate(reach) == pytest.approx(whole)
    assert view.complaints == []
    view.tab.close()
