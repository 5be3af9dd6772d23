"""The biped beside its paper (paper 003): which rows are judged, and by what."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealegs.common.errors import SealegsError
from sealegs.envs.biped.drive import DRIVES
from sealegs.papers.biped import balance, choices, paper, report, rig, tables, tune_on_rigid, validation
from sealegs.papers.biped.cable_fit import Cable
from sealegs.papers.biped.hopping import Hopping
from sealegs.papers.biped.identification import (
    Leg,
    Motor,
    Pulleys,
    Spring,
    chirp,
    fit_pulleys,
)
from sealegs.papers.published import Row

from tests.typed import typed

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
