"""Pictures of a diagnosis: one per cause, showing what the measurement says and what the models say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import rcParams
from matplotlib.image import imread
from matplotlib.patches import Rectangle
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.measure.case import Replay
from sealegs.gap.measure.named import Error, NamedCause
from sealegs.gap.output.pictures import CAUSES, draw_all, picture_of, pictures, png
from sealegs.gap.output.pictures.drive import UNITS, response
from sealegs.gap.output.pictures.evidence import Evidence
from sealegs.gap.output.pictures.first_look import budget_slices, first_look
from sealegs.gap.output.pictures.timeline import timeline, worst_window
from sealegs.gap.output.pictures.transmission import way_since_reversal
from sealegs.gap.verdict.verdict import JointDiagnosis

from tests.small_diagnosis import small_diagnosis


@pytest.fixture(scope="module")
def found() -> JointDiagnosis:
    return small_diagnosis()[0]


@pytest.fixture(scope="module")
def evidence(found: JointDiagnosis) -> Evidence:
    return Evidence(found)


def named(name: str, picture: str, share: float = 0.5) -> NamedCause:
    return NamedCause(name, "A sentence.", "servo", share, 0.9, {}, 0.5, "effect", picture)


def with_problem(found: JointDiagnosis, problem: Any) -> JointDiagnosis:
    return found.changed(replay=Replay(problem, problem))


@pytest.mark.long
def test_every_picture_is_a_file_with_something_on_it(found: JointDiagnosis, tmp_path: Path) -> None:
    drawn = draw_all([found], tmp_path)
    assert {"first_look", "overview", "friction.load_dependent"} <= drawn.keys()
    for path in drawn.values():
        image = imread(path)
        assert min(image.shape[:2]) > 250
        assert image[..., :3].std() > 0.02


def test_nothing_is_overwritten(found: JointDiagnosis, tmp_path: Path) -> None:
    (tmp_path / "overview.png").write_bytes(b"mine")
    with pytest.raises(FileExistsError):
        draw_all([found], tmp_path)
    assert (tmp_path / "overview.png").read_bytes() == b"mine"


def test_several_joints_do_not_share_files(found: JointDiagnosis, tmp_path: Path) -> None:
    drawn = draw_all([found.changed(joint="hip", replay=None), found.changed(joint="knee", replay=None)], tmp_path)
    assert {"hip.first_look", "knee.first_look"} <= drawn.keys()
    assert len(set(drawn.values())) == len(drawn)


def test_the_catalogue_names_only_pictures_that_exist(found: JointDiagnosis) -> None:
    assert found.problem is not None and found.problem.joint is not None
    for cause in catalogue(found.problem.joint.models[0]):
        assert picture_of(named(cause.name, cause.picture)) in CAUSES, cause.name
        assert cause.against in UNITS, cause.name


def test_an_error_is_drawn_against_what_its_cause_says_whatever_its_name(evidence: Evidence) -> None:
    """A table of names said it, and a cause that was new to it was drawn against the speed."""
    cause = replace(named("drive.new", "response"), against="acceleration")
    assert response(evidence, cause).axes[1].get_xlabel().startswith("acceleration")


@pytest.mark.long
@pytest.mark.parametrize("key", CAUSES)
def test_each_picture_can_be_drawn_of_any_log(evidence: Evidence, key: str) -> None:
    assert png(CAUSES[key](evidence, named("drive.deadband", key))).startswith(b"\x89PNG")


@pytest.mark.long
def test_friction_read_off_the_motion_is_that_of_the_hidden_machine(evidence: Evidence) -> None:
    """The plant's dry friction is about 0.05 N.m plus 0.133 of the load; the nominal model lacks the second part."""
    use = evidence.motion.moving
    balance = evidence.extended
    dry = (np.sign(balance.speed) * (balance.observed_friction - balance.viscous))[use]
    slope, constant = np.polyfit(balance.load[use], dry, 1)
    assert slope == pytest.approx(0.133, abs=0.03)
    assert constant == pytest.approx(0.05, abs=0.02)
    assert np.ptp(evidence.nominal.limit[use]) == 0.0


def test_without_duty_and_current_the_law_gives_the_motor_torque(found: JointDiagnosis) -> None:
    assert found.problem is not None
    measured = found.problem.measured.copy()
    measured[:, 1:] = np.nan
    silent = Evidence(with_problem(found, replace(found.problem, measured=measured)))
    assert silent.extended.source == "law"
    for key in ("friction_against_speed", "duty_against_error", "voltage_against_current"):
        assert png(CAUSES[key](silent, named("friction.stribeck", key)))


def test_an_unsigned_current_is_not_taken_for_a_torque(found: JointDiagnosis) -> None:
    assert found.problem is not None
    measured = found.problem.measured.copy()
    measured[:, 3] = np.abs(measured[:, 3])
    unsigned = Evidence(with_problem(found, replace(found.problem, measured=measured)))
    assert unsigned.extended.source == "duty"


def test_the_budget_adds_up(found: JointDiagnosis) -> None:
    slices = budget_slices(found)
    assert sum(piece.share for piece in slices) == pytest.approx(1.0)
    assert slices[0].label == "friction.load_dependent"
    assert slices[-1].label == "noise"


def test_the_first_look_falls_from_the_nominal_error_to_what_is_left(found: JointDiagnosis) -> None:
    chart = first_look(found)
    assert chart is not None
    (signals, errors), (fall,) = (part.axes for part in chart.subfigs)
    drawn = {line.get_label() for line in signals.lines}
    assert {"goal", "measured", "nominal model", "extended model"} <= drawn
    low, high = errors.get_xlim()
    assert high - low <= 1.2
    rows = [label.get_text() for label in fall.get_yticklabels()]
    assert (rows[0], rows[1]) == ("nominal model", "friction.load_dependent")
    assert rows[-2:] == ["what is left", "noise of the reading"]
    rectangles = [bar for bar in fall.patches if isinstance(bar, Rectangle)]
    bars = [(round(bar.get_y() + 0.5 * bar.get_height()), bar.get_x(), bar.get_width()) for bar in rectangles]
    taken = [bar for bar in bars if 0 < bar[0] < len(rows) - 2]
    left = sum(width for row, _, width in bars if row == len(rows) - 2)
    assert 1.0 - sum(width for _, _, width in taken) == pytest.approx(left)
    said = {text.get_text() for text in fall.texts}
    assert f"{1e3 * found.gap['nominal'].rmse:#.3g} mrad" in said
    assert any(text.startswith("\N{MINUS SIGN}") and text.endswith("% of the gap") for text in said)


def test_a_model_that_was_handed_over_as_it_was_is_drawn_once(found: JointDiagnosis) -> None:
    chart = first_look(found.changed(causes=(), model="nominal", unexplained=1.0, tuned_share=0.0))
    assert chart is not None
    assert "extended model" not in {line.get_label() for line in chart.subfigs[0].axes[0].lines}
    rows = [label.get_text() for label in chart.subfigs[1].axes[0].get_yticklabels()]
    assert rows == ["nominal model", "of it unexplained", "noise of the reading"]


def test_many_causes_share_a_row(found: JointDiagnosis) -> None:
    many = tuple(named(f"cause.{k}", "", 0.1) for k in range(9))
    chart = first_look(found.changed(causes=many))
    assert chart is not None
    rows = [label.get_text() for label in chart.subfigs[1].axes[0].get_yticklabels()]
    assert len(rows) <= 9 and any(row.endswith(" more") for row in rows)


def test_a_gap_that_is_all_noise_is_shown_as_noise(found: JointDiagnosis) -> None:
    quiet = {**found.gap, "nominal": Error(0.9 * found.gap["noise_floor"].rmse, 0.0)}
    (piece,) = budget_slices(found.changed(gap=quiet, causes=(), unexplained=0.0))
    assert (piece.label, piece.share) == ("noise", 1.0)


def test_pictures_that_would_look_the_same_are_drawn_once(found: JointDiagnosis) -> None:
    twice = (named("transmission.backlash", "hysteresis"), named("transmission.compliance", "hysteresis", 0.2))
    names = [name for name, _ in pictures(found.changed(causes=twice))]
    assert "transmission.backlash" in names
    assert "transmission.compliance" not in names


def test_thinning_keeps_every_peak(found: JointDiagnosis) -> None:
    line = timeline(found)
    assert line is not None
    thin = line.thinned(300)
    assert len(thin.x) < 600
    assert np.nanmax(thin.measured) == np.nanmax(line.measured)
    assert np.nanmin(thin.measured) == np.nanmin(line.measured)
    assert np.isnan(thin.measured).sum() == np.isnan(line.measured).sum()


def test_the_shown_moment_lies_in_the_test_part(found: JointDiagnosis) -> None:
    line = timeline(found)
    assert line is not None
    start, stop = worst_window(line, 0.4)
    assert stop - start == pytest.approx(0.4)
    assert any(low <= start <= high for low, high in line.tested)


def test_a_reversal_is_more_than_noise() -> None:
    way, direction = way_since_reversal(np.array([0.0, 1.0, 2.0, 1.95, 2.1, 1.0, 0.5]), 0.2)
    assert direction.tolist() == [0.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0]
    assert way[-1] == pytest.approx(1.6)


def test_drawing_leaves_the_style_of_others_alone(found: JointDiagnosis) -> None:
    before = dict(rcParams)
    list(pictures(found.changed(replay=None)))
    assert dict(rcParams) == before
