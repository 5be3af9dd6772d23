"""The next experiment: within the joint's limits, on disk as deploy.py takes it, and telling apart what was open."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.common.errors import SealegsError
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.experiment import (
    GOAL_RATE,
    DetectionLimit,
    Experiment,
    Limits,
    default_limits,
    experiment_for_still,
    goal_table,
    read_goals,
    write_experiment,
)
from sealegs.gap.experiment.detection import too_many
from sealegs.gap.experiment.excitations import GRAVITY_STALL_SHARE, abilities, excitations, slewed
from sealegs.gap.experiment.proposal import Hypothesis, everything, experiment_sentence, kept_within
from sealegs.gap.finder.diagnosis import diagnose, first_look
from sealegs.gap.log.sidecar import read_sidecar
from sealegs.gap.log.types import LogError
from sealegs.gap.measure.case import ROBOT
from sealegs.gap.measure.unseen import harm_of
from sealegs.gap.output.extension import changes
from sealegs.gap.output.terminal import lines_of
from sealegs.gap.prepare.request import Request
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.search.fit import Fit
from sealegs.gap.search.result import Search
from sealegs.gap.verdict.verdict import NOT_IDENTIFIABLE, NOTHING, UNUSABLE, JointDiagnosis

from benchmarks.next_experiment import POOR, outcome, record_experiment, summary
from testbed import hidden_bench, hidden_wide
from testbed.everyday import drawn
from testbed.logs import hidden_everyday

LOAD = {"mass": 0.5, "arm_mass": 0.03, "length": 0.12}
NOMINAL = JointModel(load_chain("sts3215"))


# --- excitations ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("limits", [Limits(-0.5, 0.8), Limits(0.2, 0.4), Limits(-1.2, 1.2, 2.0)])
def test_excitations_keep_to_the_limits(limits: Limits) -> None:
    for name, goal in excitations(limits, NOMINAL, LOAD).items():
        assert goal.min() >= limits.lower - 1e-9 and goal.max() <= limits.upper + 1e-9, name
        assert np.abs(np.diff(goal)).max() * GOAL_RATE <= limits.speed + 1e-6, name


def test_nothing_goes_where_the_servo_cannot_hold_its_load() -> None:
    heavy = {"mass": 4.0, "arm_mass": 0.03, "length": 0.12}
    stall = 1.2 * 7.4 / 2.7
    for name, goal in excitations(Limits(-1.2, 1.2), NOMINAL, heavy).items():
        assert NOMINAL.load.gravity_torque(heavy) * math.sin(np.abs(goal).max()) <= 0.61 * stall, name


@pytest.mark.parametrize(("believed", "proposed"), [(0.0, False), (0.05, True)])
def test_no_motion_is_proposed_to_tell_how_friction_that_is_not_there_changes_with_the_angle(
    believed: float, proposed: bool
) -> None:
    model = JointModel(load_chain("sts3215")).with_values({"friction.coulomb": believed})
    nothing, ripple = Fit({}, np.zeros((0, 4)), 1.0), "friction.position_dependent"
    search = Search((), (), (), np.zeros(0), (nothing, nothing), tuple(catalogue(model, [ripple, "drive.delay"])))
    names = {one.name for one in everything(SimpleNamespace(models=(model,)), search)}  # pyright: ignore[reportArgumentType]
    assert "drive.delay" in names and (ripple in names) is proposed


TOO_HEAVY = {"mass": 5.0, "arm_mass": 0.0, "length": 0.2}


def test_a_load_that_the_servo_cannot_hold_within_the_limits_gets_no_motion() -> None:
    assert excitations(Limits(1.0, 1.5), NOMINAL, TOO_HEAVY) == {}
    assert excitations(Limits(0.15, 1.5), NOMINAL, TOO_HEAVY) == {}
    assert excitations(Limits(0.0, 1.5), NOMINAL, TOO_HEAVY)


def test_no_experiment_is_proposed_where_the_servo_holds_no_load_within_the_limits() -> None:
    data, _ = hidden_bench({}, 3, runs=1, duration=3.0, schedules=(POOR["still"],))
    runs = [replace(run, robot_params=TOO_HEAVY) for run in data.runs]
    assert experiment_for_still(runs, "servo", [NOMINAL], Limits(1.0, 1.5), causes=["drive.delay"]) is None


def test_a_motion_made_smaller_stays_within_the_limits_and_where_its_load_is_held(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    limits, heavy = Limits(0.0, 1.5), {"mass": 4.0, "arm_mass": 0.0, "length": 0.12}
    held = math.asin(GRAVITY_STALL_SHARE * abilities(NOMINAL)[0] / NOMINAL.load.gravity_torque(heavy))
    overshoot = 6.0

    def measurement(problem: object, load: object, goal: np.ndarray, along: object = None) -> SimpleNamespace:
        middle = 0.5 * (goal.min() + goal.max())
        return SimpleNamespace(simulate=lambda variants: (middle + overshoot * (goal - middle))[None, :, None])

    monkeypatch.setattr("sealegs.gap.experiment.proposal.measurement", measurement)
    for name, goal in excitations(limits, NOMINAL, heavy).items():
        kept = kept_within(None, heavy, goal, [Hypothesis("any", {}, ())], limits)  # type: ignore[arg-type]
        assert kept is not None and kept.min() >= limits.lower and kept.max() <= held + 1e-9, name
        assert measurement(None, heavy, kept).simulate([]).min() >= limits.lower - 0.05 * limits.reach - 1e-9, name


@pytest.mark.parametrize(("overshoot", "kept"), [(40.0, True), (1e6, False)])
def test_a_motion_that_a_hypothesis_lets_shoot_far_beyond_is_made_small_enough_or_dropped(
    monkeypatch: pytest.MonkeyPatch, overshoot: float, kept: bool
) -> None:
    """After three halvings it was proposed all the same."""

    def measurement(problem: object, load: object, goal: np.ndarray, along: object = None) -> SimpleNamespace:
        return SimpleNamespace(simulate=lambda variants: (overshoot * goal)[None, :, None])

    monkeypatch.setattr("sealegs.gap.experiment.proposal.measurement", measurement)
    goal = np.sin(np.arange(200) / 10.0)
    found = kept_within(None, {}, goal, [Hypothesis("any", {}, ())], Limits(-1.0, 1.0))  # type: ignore[arg-type]
    assert (found is not None) == kept
    if found is not None:
        assert overshoot * np.abs(found).max() <= 1.1 + 1e-9


def test_smooth_motions_are_slow_enough_for_the_motor() -> None:
    found = excitations(Limits(-3.0, 3.0), NOMINAL, {**LOAD, "mass": 0.05})
    for name in ("chirp", "fast chirp", "multisine"):
        assert np.abs(np.diff(found[name])).max() * GOAL_RATE <= 0.81 * 7.4 / 1.2


def test_a_speed_limit_makes_ramps_of_steps() -> None:
    goal = slewed(np.repeat([0.0, 1.0], 50), 2.0)
    assert np.abs(np.diff(goal)).max() == pytest.approx(0.02)


@pytest.mark.parametrize("limits", [(1.0, -1.0), (0.0, 0.0), (math.nan, 1.0)])
def test_limits_without_room_are_refused(limits: tuple[float, float]) -> None:
    with pytest.raises(SealegsError, match="limits="):
        Limits(*limits)


def test_a_speed_that_is_none_is_refused_by_the_name_of_its_setting() -> None:
    with pytest.raises(SealegsError, match="speed_limit=0 "):
        Limits(-1.0, 1.0, 0.0)


def test_the_range_of_the_log_widens_the_default_limits() -> None:
    assert default_limits(np.array([-0.1, 0.1])) == Limits(-1.2, 1.2)
    assert default_limits(np.array([-2.0, 0.1])).lower == -2.0


# --- files ---------------------------------------------------------------------------------------------------------


def test_the_file_is_read_back_and_its_sidecar_names_the_load(tmp_path: Path) -> None:
    time = np.arange(0.0, 1.0, 0.01)
    proposal = Experiment("steps", "Run it.", 2.0, time, np.sin(time), {"steps": 2.0}, {**LOAD, "mass": 1.0})
    written = write_experiment(proposal, "servo", tmp_path, "sts3215")
    joint, back, goal = read_goals(written["experiment"])
    assert joint == "servo"
    np.testing.assert_allclose(back, time)
    np.testing.assert_allclose(goal, proposal.goal, atol=1e-6)
    sidecar = read_sidecar(written["experiment"])
    assert sidecar.robot_params["mass"] == 1.0 and sidecar.actuators == {"servo": "sts3215"}
    assert goal_table(proposal, "servo").splitlines()[0] == "time,servo.goal"


@pytest.mark.parametrize("text", ["", "time,x\n0,1\n", "time,servo.goal\n0,a\n1,2\n", "time,servo.goal\n1,0\n0,1\n"])
def test_a_file_that_is_no_experiment_is_refused_with_a_sentence(tmp_path: Path, text: str) -> None:
    path = tmp_path / "next.csv"
    path.write_text(text)
    with pytest.raises(LogError, match="is no experiment"):
        read_goals(path)


# --- on the hidden bench -------------------------------------------------------------------------------------------


def test_a_joint_that_never_moved_gets_a_first_experiment() -> None:
    data, _ = hidden_bench({}, 3, runs=1, duration=3.0, schedules=(POOR["still"],))
    resting = [replace(run, joints={j: replace(log, position=0 * log.position + 0.3) for j, log in run.joints.items()})
               for run in data.runs]  # fmt: skip
    (found,) = diagnose(replace(data, runs=tuple(resting)), causes=("drive.delay", "friction.viscous"))
    assert found.verdict == UNUSABLE
    assert found.experiment is not None and np.ptp(found.experiment.goal) > 0.5


@pytest.mark.parametrize(
    ("effect", "size", "motion", "seed", "considered", "other_load"),
    [
        pytest.param(
            "load.mass", "moderate", "sine", 11, ("load.mass", "load.centre_of_mass"), True, marks=pytest.mark.long
        ),
        pytest.param(
            "drive.saturation",
            "clear",
            "small",
            11,
            ("drive.saturation", "drive.overload"),
            False,
            marks=pytest.mark.long,
        ),
        # a joint that only settles: viscous friction fits that as well, alone and with confidence
        pytest.param(
            "friction.load_dependent",
            "clear",
            "still",
            13,
            ("friction.load_dependent", "friction.viscous"),
            False,
            marks=pytest.mark.long,
        ),
    ],
)
def test_what_a_poor_log_leaves_open_the_proposed_experiment_names(
    effect: str, size: str, motion: str, seed: int, considered: tuple[str, ...], other_load: bool
) -> None:
    data, truth = hidden_bench({effect: size}, seed, "medium", runs=2, duration=8.0, schedules=(POOR[motion],))
    (found,) = diagnose(data, causes=considered)
    assert found.verdict == NOT_IDENTIFIABLE or found.rivals, found.sentence
    assert found.experiment is not None
    assert (found.experiment.load["mass"] != data.runs[0].robot_params["mass"]) == other_load
    (found,) = diagnose(record_experiment(data, truth, found.experiment, 5), causes=considered)
    assert outcome(effect, summary(found)) == "right", found.sentence


@pytest.mark.parametrize(
    ("hidden", "considered", "worthless"), [(1, 3, False), (2, 3, True), (1, 1, True), (7, 28, False), (8, 28, True)]
)
def test_one_hidden_cause_of_a_few_that_were_asked_for_does_not_make_a_log_worthless(
    hidden: int, considered: int, worthless: bool
) -> None:
    assert too_many(hidden, considered) == worthless


@pytest.mark.parametrize(
    ("rivals", "separation", "said"),
    [
        (("friction.coulomb", "nothing more"), 0.0, "tells whether friction.coulomb is there (at most 0.00 times"),
        (("friction.coulomb", "nothing more"), 0.0, "log more columns (current, duty), or measure it directly."),
        (
            ("friction.coulomb", "drive.delay"),
            4.0,
            "together with the old ones: it tells friction.coulomb and drive.delay",
        ),
    ],
)
def test_the_sentence_of_an_experiment_says_what_it_tells(
    rivals: tuple[str, ...], separation: float, said: str
) -> None:
    best = Experiment("steps", "", separation, np.arange(5.0), np.zeros(5), {}, {}, rivals=rivals)
    assert said in experiment_sentence(best, [{}], False, alone=False)


@pytest.mark.parametrize("blind", [False, True])
def test_an_experiment_that_tells_nothing_apart_says_so_and_what_is_needed(blind: bool) -> None:
    """One whose rivals differ by less than the noise was recommended as if it helped."""
    best = Experiment("steps", "", 0.12, np.arange(5.0), np.zeros(5), {}, {}, rivals=("drive.delay", "nothing more"))
    said = experiment_sentence(best, [{}], blind, alone=False)
    assert said.startswith("Within the limits of motion, no motion and no load of the library tells ")
    assert "at most 0.12 times the noise" in said and "limits=[lower,upper]" in said
    logged = experiment_sentence(best, [{}], blind, alone=False, lacking=())
    assert "log more columns" not in logged and "(limits=[lower,upper]) or measure" in logged
    best = replace(best, separation=0.4)
    assert experiment_sentence(best, [{}], blind, alone=False).startswith("Run 'steps' 3 times")


# --- what finding nothing is worth, what a first look says, and that a model which spoils others is not handed over --

CAUSES = ("friction.coulomb", "drive.gain", "sensor.scale", "sensor.delay", "friction.presliding")


@cache
def nothing_hidden(scale: float = 1.0) -> JointDiagnosis:
    effects: dict[str, Any] = {} if scale == 1.0 else {"sensor.scale": scale}
    schedules = (("chirp", "steps"), ("multisine", "triangle"))
    data, _ = hidden_bench(effects, 31, ("medium",), duration=6.0, schedules=schedules)
    (found,) = diagnose(data, causes=CAUSES)
    return found


def limits() -> dict[str, DetectionLimit]:
    return {limit.name: limit for limit in nothing_hidden().limits}


@pytest.mark.long
def test_each_cause_has_a_limit_around_what_is_believed() -> None:
    assert nothing_hidden().verdict == NOTHING
    assert set(limits()) == set(CAUSES)
    gain, friction, late = (limits()[name] for name in ("drive.gain", "friction.coulomb", "sensor.delay"))
    assert gain.low < gain.nominal < gain.high < 1.1 * gain.nominal
    assert friction.low < 1.06 * friction.nominal and friction.high < 1.5 * friction.nominal
    assert not np.isfinite(late.low) and 0.0 < late.high < 0.01  # a reading is never early


@pytest.mark.long
def test_bristles_hide_where_they_are_stiff() -> None:
    """Their stiffness is zero where nothing gives way: the softest of all were told not to show."""
    bristles = limits()["friction.presliding"]
    assert np.isfinite(bristles.low) and not np.isfinite(bristles.high), bristles.sentence
    assert "friction.presliding above" in bristles.sentence and bristles.hides(1e3) and not bristles.hides(0.1)


@pytest.mark.long
def test_a_number_that_tuning_takes_up_has_a_wider_limit() -> None:
    """An encoder that read 0.96 of the angle was taken up by tuned numbers, and nothing said that it might be there."""
    scale = limits()["sensor.scale"]
    assert scale.hides(0.99) and scale.hides(1.01) and not scale.hides(0.8)


@pytest.mark.long
def test_what_the_limit_does_not_hide_is_found() -> None:
    beyond = min(0.97 * limits()["sensor.scale"].low, 0.93)
    assert nothing_hidden(beyond).verdict != NOTHING


@pytest.mark.long
def test_nothing_along_a_measured_motion_names_what_it_cannot_show() -> None:
    """Friction that moved the joint by 11 noise floors was "nothing to explain" where only the current was judged."""
    (found,) = diagnose(hidden_wide(236)[0])
    assert found.verdict == NOT_IDENTIFIABLE and not found.causes, found.sentence
    assert "friction.stribeck" in found.text and "friction.asymmetric" in found.text


LATE = 0.0223  # [s] of the machine below


def test_a_first_look_tells_what_moves_a_joint_most() -> None:
    data, _ = hidden_bench({"drive.delay": 0.012, "friction.coulomb": "clear"}, seed=3, duration=5.0)
    found = first_look(data, Request())
    assert found.latency is None  # one joint shares nothing
    lines = list(lines_of(found))
    assert "provisional" in lines[0]
    told = [line.split()[0] for line in lines if line.startswith("  ")]
    assert told[0] == "drive.delay" and "friction.coulomb" in told
    delays = [float(line.split(" = ")[1].split()[0]) for line in lines if "delay.seconds = " in line]
    assert delays == pytest.approx([0.017], abs=2e-4)


@pytest.mark.long
def test_a_first_look_is_at_the_joints_that_were_asked_for(tmp_path: Path) -> None:
    """It ignored joints=."""
    data, _ = hidden_everyday(replace(drawn(1, 101), duration=7.0, runs=3), tmp_path)
    found = first_look(data, Request(), ["tilt"])
    assert list(found.joints) == ["tilt"] and found.latency is None
    with pytest.raises(SealegsError, match="no joint 'lift'"):
        first_look(data, Request(), ["lift"])


@pytest.mark.long
def test_a_latency_of_the_bus_is_told_once_and_is_in_the_chain_of_each_joint(tmp_path: Path) -> None:
    """A late bus, 10 mrad of friction at one joint: the search named a delay at each, with another number."""
    data, _ = hidden_everyday(replace(drawn(1, 101), duration=7.0, runs=3), tmp_path)
    found = {one.joint: one for one in diagnose(data, causes=["drive.delay", "friction.coulomb"])}
    told = found[ROBOT].causes[0]
    value = told.parameters["delay.seconds"]
    assert told.name == "drive.delay" and told.confidence > 0.9 and value.low <= LATE <= value.high
    for joint in ("pan", "tilt"):
        assert "drive.delay" not in [cause.name for cause in found[joint].causes]
        row = next(row for row in changes(found[joint]) if row["path"] == "delay.seconds")
        assert row["why"] == "drive.delay" and row["to"] == pytest.approx(LATE, abs=1e-3)
    assert found["pan"].verdict == "explained" and "latency of all joints" in found["pan"].sentence


NOISE = 1e-3
BLOCK = np.repeat(np.arange(10), 50)
RNG = np.random.default_rng(0)
QUIET = NOISE * RNG.standard_normal(500)


def after_a_trip(size: float) -> np.ndarray:
    """Errors that are noise until something trips in the last third."""
    return QUIET + np.where(BLOCK >= 7, size, 0.0)


def test_a_model_that_is_off_where_the_believed_one_was_exact_does_harm() -> None:
    """An overload trip was handed over as fivefold friction: 16 mrad off where the believed model was exact."""
    assert harm_of(after_a_trip(0.1), QUIET + 0.016, BLOCK, 10, NOISE) > 0.015


def test_a_model_that_mends_the_rest_and_stays_near_the_noise_does_none() -> None:
    assert harm_of(after_a_trip(0.1), 1.5 * QUIET, BLOCK, 10, NOISE) == 0.0


def test_a_believed_model_that_is_right_almost_nowhere_says_nothing() -> None:
    nominal = QUIET + np.where(BLOCK >= 1, 0.05, 0.0)
    assert harm_of(nominal, QUIET + 0.016, BLOCK, 10, NOISE) == 0.0
