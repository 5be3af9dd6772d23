"""Rows, marks and pages of all papers; and what the biped's comparison judges."""

from __future__ import annotations

import importlib
import json
import math
import re
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.common.errors import SealegsError
from sealegs.envs.biped.drive import DRIVES
from sealegs.envs.engine.numbers import Number
from sealegs.papers.biped import balance, choices, paper, report, rig, tables, tune_on_rigid, validation
from sealegs.papers.biped.hopping import Hopping
from sealegs.papers.biped.identification import (
    Cable,
    Leg,
    Motor,
    Pulleys,
    Spring,
    chirp,
    fit_pulleys,
)
from sealegs.papers.published import (
    MARKS,
    Choice,
    NotBuilt,
    Otherwise,
    Paper,
    Row,
    assumed,
    documents,
    half_digit,
    row_lines,
)

from benchmarks.kept import read
from docs.generate import papers as pages
from docs.generate.templates import PAGES
from tests.typed import typed

ROWS = [
    Row(
        "stiffness", "IV", 100.0, 100.05, "follows from the inputs", "N.m/rad", 1e-3, judged="half a digit", rests=()
    ),
    Row(
        "hops", "VIII", 92.0, 80.0, "predicted", within=0.01, judged="a hop", rests=("floor", "lean"),
        sensitivity=(Otherwise("floor friction 0.6", 16.0),),
    ),
    Row(
        "legs irreversible", "6", "yes", "yes", "fitted", agrees=True, judged="holds", rests=("breakaway",),
        note="friction was chosen so",
    ),
    Row(
        "frequency", "IV", 2.9, 2.8, "predicted", "Hz", 0.1, judged="scatter of the paper", rests=("floor",),
        rival=Otherwise("ideal motors", 4.0),
    ),
]  # fmt: skip
PAPER = Paper(
    "paper 009",
    {
        "floor": Choice("0.8", "plausible"),
        "lean": Choice("8.7 deg", "searched", ()),
        "breakaway": Choice("740 N", "tried", ("legs irreversible",)),
    },
    (NotBuilt("V", "fuel is saved", "the engine burns none"),),
)


def test_a_row_agrees_within_its_bound_and_is_marked_missed_beyond_it() -> None:
    assert [row.holds for row in ROWS] == [True, False, True, True]
    text = row_lines("paper 009", ROWS)
    assert [line[0] for line in text if "VIII" in line] == ["!"]
    assert any("- " not in line and "-13.04%" in line for line in text)


def test_every_line_tells_its_mark_and_the_legend_what_it_means() -> None:
    text = "\n".join(row_lines("paper 009", ROWS))
    for row in ROWS:
        assert any(row.name in line and line.endswith(row.mark) for line in text.splitlines())
        assert MARKS[row.mark] in text
    assert "planted and recovered" not in text
    assert "predicted: " in text and "2 of 4 rows, 1 of 2 judged agree" in text
    assert "floor friction 0.6: 16" in text and "friction was chosen so" in text


def test_rows_become_json_with_mark_and_sensitivity() -> None:
    rows = json.loads(json.dumps(documents(ROWS)))
    assert rows[1]["mark"] == "predicted" and rows[1]["sensitivity"] == {"floor friction 0.6": 16.0}
    assert rows[0]["off"] == pytest.approx(5e-4) and rows[2]["off"] is None


def test_a_mark_that_there_is_not_is_refused() -> None:
    wrong: Any = "guessed"
    with pytest.raises(SealegsError, match="no mark 'guessed'"):
        Row("hops", "", 1.0, 1.0, wrong)


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        (replace(ROWS[2], mark="predicted"), "is predicted, though 'breakaway' was chosen to reach it"),
        (replace(ROWS[2], rests=()), "does not name 'breakaway', which was chosen to reach it"),
        (replace(ROWS[1], mark="fitted"), "is fitted, though nothing was chosen to reach it"),
        (replace(ROWS[2], agrees=None), "is fitted, and does not say whether it fits"),
        (replace(ROWS[1], rests=("flor",)), "rests on 'flor', which is not in the list"),
        (replace(ROWS[1], rests=None), "does not say which chosen numbers it rests on"),
        (replace(ROWS[1], judged=""), "does not say where its tolerance comes from"),
        (replace(ROWS[1], within=0.2), "may be off by 20%, which is neither fitted nor assumed"),
        (replace(ROWS[0], rests=("floor",)), "follows from the inputs, though it rests on 'floor'"),
    ],
)
def test_a_mark_that_the_chosen_numbers_contradict_is_refused(changed: Row, sentence: str) -> None:
    rows = [changed if row.name == changed.name else row for row in ROWS]
    with pytest.raises(SealegsError, match=sentence):
        PAPER.check(rows)


def test_a_number_chosen_for_a_row_that_there_is_not_is_refused() -> None:
    PAPER.check(ROWS)
    with pytest.raises(SealegsError, match="chosen to reach 'legs irreversible', which is no row"):
        PAPER.check(ROWS[:2])


def test_a_row_that_moves_with_a_number_it_does_not_name_is_refused() -> None:
    moved = [replace(row, ours=81.0, agrees=None) if row.name == "hops" else row for row in ROWS]
    PAPER.check_rests(ROWS, [("floor", moved), ("lean", moved)])
    lie = [replace(row, rests=("floor",)) if row.name == "hops" else row for row in ROWS]
    with pytest.raises(SealegsError, match="row 'hops' moves with 'lean', which it does not name"):
        PAPER.check_rests(lie, [("floor", moved), ("lean", moved)])
    arithmetic = [replace(ROWS[0], ours=99.0), *ROWS[1:]]
    with pytest.raises(SealegsError, match="row 'stiffness' moves with 'floor'"):
        PAPER.check_rests(ROWS, [("floor", arithmetic)])
    noise = [replace(row, ours=row.ours * (1.0 + 1e-5)) if isinstance(row.ours, float) else row for row in moved]
    PAPER.check_rests(ROWS, [("floor", noise)])


def test_a_row_that_comes_to_agree_or_is_gone_has_moved_and_one_that_measures_the_computer_has_not() -> None:
    for changed in (ROWS[:2] + ROWS[3:], [replace(row, agrees=None) for row in ROWS]):
        with pytest.raises(SealegsError, match="'legs irreversible' moves with 'floor'"):
            PAPER.check_rests(ROWS, [("floor", changed)])
    timed = [replace(row, timed=True, rests=()) for row in ROWS]
    PAPER.check_rests(timed, [("floor", [replace(row, ours=1.0) for row in timed])])


def test_a_number_that_moves_nothing_is_told() -> None:
    with pytest.raises(SealegsError, match="'floor' moves none of the 2 rows that name it"):
        PAPER.check_rests(ROWS, [("floor", ROWS)])


def test_two_rows_of_one_name_are_refused() -> None:
    with pytest.raises(SealegsError, match="'hops' is the name of 2 rows"):
        PAPER.check([*ROWS, replace(ROWS[1], where="IX")])


def test_a_wide_tolerance_passes_where_it_says_that_it_is_assumed() -> None:
    PAPER.check([*ROWS[:1], replace(ROWS[1], within=0.2, judged="assumed"), *ROWS[2:]])


def test_only_a_prediction_that_another_model_misses_decides() -> None:
    assert [row.decides for row in ROWS] == [False, False, False, True]
    for changed in (
        replace(ROWS[3], mark="fitted"),
        replace(ROWS[3], rival=Otherwise("ideal motors", 2.7)),
        replace(ROWS[3], ours=4.0),
    ):
        assert not changed.decides


def test_the_comparison_shows_the_other_model_the_choices_and_what_is_not_built() -> None:
    text = "\n".join(PAPER.lines(ROWS))
    assert "frequency [Hz]: printed 2.9, ours 2.8\n    ideal motors: 4\n" in text
    assert "breakaway = 740 N: legs irreversible (1 rows)" in text
    assert "V, fuel is saved: the engine burns none" in text
    written = PAPER.document(ROWS)
    assert json.loads(json.dumps(written)) == json.loads(json.dumps(written))
    assert written["chosen"]["floor"] == {"value": "0.8", "why": "plausible", "reach": ()}


def test_a_printed_number_leaves_half_a_digit_open() -> None:
    assert half_digit(2.5, 1) == pytest.approx(0.02) and half_digit(-12.0, 0) == pytest.approx(1.0 / 24.0)


def test_the_assumed_numbers_of_a_robot_are_its_choices() -> None:
    numbers = {
        "mass": Number(2.0, "kg", "paper 009, table I"),
        "length": Number(0.1, "m", "assumed: searched"),
        "share": Number(0.5, "-", "assumed"),
    }
    found = assumed(numbers, length=("hops",))
    assert found == {"length": Choice("0.1 m", "searched", ("hops",)), "share": Choice("0.5", "plausible")}
    with pytest.raises(SealegsError, match="no assumed number is called mass"):
        assumed(numbers, mass=("hops",))


@pytest.mark.parametrize("robot", pages.robots())
def test_a_page_is_that_of_the_results(robot: str) -> None:
    written = (PAGES / f"{robot}.md").read_text(encoding="utf-8")
    assert written == pages.page(robot), "run python -m docs.generate.papers"


@pytest.mark.parametrize("robot", pages.robots())
def test_kept_results_are_those_of_the_present_list_of_chosen_numbers(robot: str) -> None:
    """An assumed number that is changed or added asks for a new run: the marks would be of another machine."""
    paper: Paper = importlib.import_module(f"sealegs.papers.{robot}.choices").PAPER
    kept = read(f"paper_{robot}")
    now = json.loads(json.dumps({key: asdict(choice) for key, choice in paper.choices.items()}))
    assert kept["chosen"] == now, f"run sealegs evaluate paper={robot}, then python -m docs.generate.papers"
    assert kept["not_built"] == [asdict(item) for item in paper.not_built]


@pytest.mark.parametrize("robot", pages.robots())
def test_no_kept_row_passes_by_more_than_a_tenth_without_fitted_or_assumed(robot: str) -> None:
    rows = read(f"paper_{robot}")["rows"]
    wide = [row["name"] for row in rows if row["holds"] and row["off"] is not None and abs(row["off"]) > 0.1
            and row["within"] is not None and row["mark"] != "fitted" and "assumed" not in row["judged"]]  # fmt: skip
    assert wide == []


UNDECIDED = {"arm", "biped"}
"""Robots of whose paper no prediction decides against another model: a bar that is missed, as their page says."""


@pytest.mark.parametrize("robot", pages.robots())
def test_a_prediction_that_another_model_would_have_missed_is_kept_or_said_to_be_none(robot: str) -> None:
    result = read(f"paper_{robot}")
    assert any(row["decides"] for row in result["rows"]) is (robot not in UNDECIDED)
    assert (pages.tables(result)["decided"] == "None.") is (robot in UNDECIDED)


def test_a_page_has_the_figures_of_its_rows() -> None:
    found = pages.tables(json.loads(json.dumps(PAPER.document(ROWS))))
    assert "| hops | VIII | 92 | 80 | -13.0% | 1 %: a hop | predicted | **no** |" in found["rows"]
    assert "| frequency [Hz] | 2.9 | 2.8 | ideal motors | 4 |" in found["decided"]
    assert "| `breakaway` | 740 N | tried | legs irreversible | 1 |" in found["chosen_numbers"]


# --- the biped beside its paper (paper 003): which rows are judged, and by what --------------------------------------

IMPACT, ENERGY = validation.Impact(1.0, 2.0), validation.Energy(4.0, 16.0)


def test_the_balanced_centre_of_mass_lies_over_the_support() -> None:
    on_foot, hanging = balance.distances(np.random.default_rng(0))
    assert len(on_foot) == 10 and len(hanging) == 7
    assert max(np.abs(on_foot).max(), np.abs(hanging).max()) < balance.PRINTED
    assert np.abs(on_foot).max() > 1e-4, "fingertips are felt"


def canned(name: str, *_: object) -> paper.Identified:
    drive = DRIVES[name]
    pulleys = tuple(
        Pulleys(inertia, friction, drive.bias, 0.0)
        for inertia, friction in zip(drive.lumped_inertia, drive.lumped_friction, strict=True)
    )
    cable = Cable(1.1 * drive.cable_stiffness, drive.cable_damping)
    leg = Leg(drive.leg_friction, drive.leg_bias, 0.0, 1.0)
    stiff = replace(leg, bias=0.5 * leg.bias)
    return paper.Identified(pulleys, Motor(drive.motor_constant, drive.inertia_factor), leg, stiff, cable)


@pytest.mark.long
def test_the_comparison_writes_numbers_and_pictures_and_never_over_old_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, hopping: Hopping
) -> None:
    rigid = hopping.rows((hopping.hop == 31) & (hopping.time < hopping.time[hopping.hop == 31][0] + 0.3))
    figures = paper.measure(hopping)
    spring = paper.SpringTest(np.array([10.0, 40.0]), np.array([0.1, 0.36]), Spring(115.0, 0.0), np.array([0.2, 0.5]))
    monkeypatch.setattr(paper, "hop", lambda hops: (hopping, rigid))
    monkeypatch.setattr(paper, "identify", canned)
    monkeypatch.setattr(paper, "spring_test", lambda side: spring)
    tuned = [paper.Change(paper.ON_RIGID, cables, figures) for cables in (paper.TUNED, paper.RIGID, paper.STRETCHING)]
    changes = [paper.Change("boom_length", "2.6 m", figures), *tuned]
    monkeypatch.setattr(paper, "sensitivity", lambda seconds, say: changes)
    others = [
        Row(name, "", "stated", "", "fitted", agrees=True, judged="canned", rests=(*choices.HOPPING,))
        for name in (choices.LANDING, choices.HEALS, choices.SOLES, choices.ALIKE)
    ]
    nothing = validation.Validated({}, {}, {}, {}, IMPACT, (IMPACT, ENERGY))
    monkeypatch.setattr(validation, "validate", lambda *given: nothing)
    monkeypatch.setattr(validation, "rows", lambda *given: others)
    monkeypatch.setattr(report, "step_cells", lambda substeps: (str(substeps),) * 5)
    lines: list[str] = []
    out = tmp_path / "comparison"
    report.compare(out, 30.0, lines.append)
    text = "\n".join(lines)
    assert "left leg angle: K_C" in text and "+10.00%" in text
    assert "hops without a fall" in text and "boom_length" in text
    written = json.loads((out / "biped.json").read_text())
    assert written["hopping"]["hops"] >= 92
    unjudged = [row["name"] for row in written["rows"] if row["holds"] is None]
    assert unjudged == [f"right leg angle: {what}" for what in ("K_C [N.m/rad]", "K_dC [N.m.s/rad]")], "which are lost"
    rows = {row["name"]: row for row in written["rows"]}
    assert not rows["left leg angle: K_C [N.m/rad]"]["holds"], "ten percent more than planted"
    assert not rows["on cables that stretch they do not hop steadily"]["holds"], "they hop as on rigid ones"
    for picture in ("positions", "torques", "stretch", "springs", "balance"):
        assert (out / f"{picture}.png").stat().st_size > 10_000
    with pytest.raises(SealegsError, match="holds a comparison already"):
        report.compare(out, 30.0, lines.append)


def test_biases_are_negligible_and_the_torso_is_not_only_where_the_period_says_so() -> None:
    def ran(name: str, value: str, period: float, fell: bool = False) -> paper.Change:
        return paper.Change(name, value, paper.Figures(40, fell, period, 0.01, 0.3, -0.1))

    chosen = ran(paper.CHOSEN, "", 0.8)
    mass, inertia = paper.TORSO
    torso = [ran(mass, "0.9 times", 0.7), ran(mass, "1.1 times", math.nan, fell=True), ran(inertia, "0.9 times", 0.79)]
    rows = validation.carried_rows([chosen, ran(paper.NO_BIAS, "0", 0.81), *torso])
    assert [row.holds for row in rows] == [True, True, False] and "40 hops, then a fall" in str(rows[1].ours)
    torso = [ran(mass, "0.9 times", 0.79), ran(inertia, "0.9 times", 0.95)]
    rows = validation.carried_rows([chosen, ran(paper.NO_BIAS, "0", 0.95), *torso])
    assert [row.holds for row in rows] == [False, False, True]
    assert not validation.carried_rows([chosen])


def test_controllers_tuned_on_rigid_cables_are_drawn_by_the_search() -> None:
    assert set(choices.TUNED_ON_RIGID) <= set(tune_on_rigid.drawn())
    assert all(gait.torso_gain == 0.0 for gait in choices.TUNED_ON_RIGID), "the update came later"


def test_only_runs_that_end_count_as_hops_before_the_end() -> None:
    def ran(hops: int, fell: bool) -> paper.Figures:
        return paper.Figures(hops, fell, 0.7, 0.01, 0.3, -0.1)

    runs = [ran(5, True), ran(3, False), ran(7, True), ran(43, False), ran(44, False)]
    rigid = [paper.Change(paper.ON_RIGID, cables, ran(40, False)) for cables in (paper.TUNED, paper.RIGID)]
    rows = report.rigid_rows([*rigid, *(paper.Change(paper.ON_RIGID, paper.STRETCHING, run) for run in runs)])
    assert rows[-1].ours == 5.0, "of 5, 3 and 7 hops; 43 and 44 go on"
    assert "2 of 5 do not end" in rows[-1].note


def test_a_lost_number_is_not_judged_and_a_damaged_one_is_shown_as_it_stands() -> None:
    rows = {row.name: row for row in report.identified_rows({name: canned(name) for name in DRIVES})}
    lost, exchanged = rows["right leg angle: K_C [N.m/rad]"], rows["left leg angle: K_T"]
    assert (lost.printed, lost.holds, lost.judged) == ("lost, taken as 3.5", None, "")
    assert (exchanged.printed, exchanged.holds) == ("1.332, exchanged: 1.087", True)
    assert set(report.DAMAGED) <= set(rows)


def test_each_motor_alone_has_the_inertia_of_table_three() -> None:
    record = rig.pulleys_record("left_leg_angle", 0, np.random.default_rng(1), chirp((0.1, 1.0), cycles=1))
    assert fit_pulleys(record).inertia == pytest.approx(DRIVES["left_leg_angle"].lumped_inertia[0], rel=5e-3)


def test_friction_with_the_legs_on_tells_the_order_of_the_motor_constants() -> None:
    taken = [tables.friction_with_leg(drive, drive.motor_constant) for drive in DRIVES.values()]
    printed = [tables.friction_with_leg(DRIVES[name], value) for name, value in tables.TABLE_IV.items()]
    assert min(taken) > 1.0 > min(printed)


def test_every_assumed_number_of_the_model_is_changed_in_the_comparison() -> None:
    changed = {name for name, *_ in paper.changes()}
    assert {"boom_length", "foot_radius", "contact_time", "contact_damping", "gains K_p", "torque limits"} <= changed


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["paper=biped", "seconds=-1"], "seconds is -1; it must be positive"),
        (["paper=bipod"], "did you mean 'biped'"),
    ],
)
def test_a_wrong_evaluation_is_answered_in_one_sentence(arguments: list[str], sentence: str) -> None:
    done = typed("evaluate", *arguments)
    assert done.returncode == 2 and sentence in done.stderr and "Traceback" not in done.stderr


@pytest.mark.long
def test_biases_are_recovered_where_both_coordinates_of_a_leg_move_at_once() -> None:
    identified = {name: canned(name) for name in DRIVES}
    found = validation.legs_together("left", identified)
    printed = [DRIVES[f"left_leg_{kind}"].leg_bias for kind in ("angle", "shape")]
    assert found.bias == pytest.approx(printed, abs=5e-3)
    assert found.residual[0] < 0.1 * found.spread[0] and found.residual[1] < 0.1 * found.spread[1]
    assert found.unadjusted[1] > found.unadjusted[0], "small errors of the bias show above all in the shape"


@pytest.mark.long
def test_friction_that_was_found_wrong_shows_where_both_coordinates_move() -> None:
    names = [f"left_leg_{kind}" for kind in ("angle", "shape")]
    right = {name: canned(name) for name in names}
    wrong = {
        name: replace(item, leg=replace(item.leg, friction=3.0 * item.leg.friction)) for name, item in right.items()
    }
    one, other = (validation.legs_together("left", identified).residual for identified in (right, wrong))
    assert min(b / a for a, b in zip(one, other, strict=True)) > 1.5


# --- the chosen numbers that rows rest on -----------------------------------------------------------------------------


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
    committed = read(f"paper_{robot}")
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
