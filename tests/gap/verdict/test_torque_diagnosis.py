"""Logs without commands: what the logged torque says, and what no fit of it may see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from sealegs.gap.checks.torque_balance import SHIFT_BIAS, SHIFT_REACHES, WEAK_FORM_WINDOW, Shift
from sealegs.gap.finder.diagnosis import diagnose, diagnose_joint
from sealegs.gap.load.robot import Machine
from sealegs.gap.log.parts import TEST, cut
from sealegs.gap.log.types import JointLog, LogError, MeasuredRun, MeasuredSet
from sealegs.gap.measure.named import CERTAIN, LIKELY, WITHDRAWN
from sealegs.gap.prepare.request import Request
from sealegs.gap.replay.parameters import TIGHT
from sealegs.gap.search.settings import DEFAULT
from sealegs.gap.verdict.verdict import EXPLAINED, NOT_IDENTIFIABLE, NOTHING, JointDiagnosis

MASS, LENGTH = 0.5, 0.12  # [kg], [m]
NO_WISHES = Request()
TONES = np.array([[0.7, 0.31], [0.4, 0.83], [0.15, 1.9]])  # [rad], [Hz]


def swung(
    name: str, delay: float = 0.0, seed: int = 0, group: str = "", *, armature: float = 0.0, coulomb: float = 0.05
) -> MeasuredRun:
    """A pendulum moved for 12 s; the torque that it, an armature [kg.m2] and friction [N.m] need is logged late by a
    delay [s].
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 12.0, 0.005)
    phase = rng.uniform(0.0, 2.0 * np.pi, len(TONES))

    def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rate = 2.0 * np.pi * TONES[:, 1]
        angle = rate * t[:, None] + phase
        size = TONES[:, 0]
        return (
            (size * np.sin(angle)).sum(1),
            (size * rate * np.cos(angle)).sum(1),
            -(size * rate**2 * np.sin(angle)).sum(1),
        )

    q, speed, acceleration = motion(time - delay)
    inertia = MASS * LENGTH**2 + armature
    torque = inertia * acceleration + MASS * 9.81 * LENGTH * np.sin(q) + coulomb * np.tanh(speed / 0.1)
    log = JointLog(
        None,
        motion(time)[0] + rng.normal(0.0, 3e-4, len(time)),
        torque=torque + rng.normal(0.0, 0.005, len(time)),
    )
    return MeasuredRun(
        name,
        time,
        {"servo": log},
        robot_params={"mass": MASS, "length": LENGTH},
        actuators={"servo": "sts3215"},
        meta={"group": group or name},
    )


def diagnose_torque(runs: Sequence[MeasuredRun], request: Request = NO_WISHES) -> JointDiagnosis:
    return diagnose_joint(Machine.of(runs), "servo", (), request)


def believing(run: MeasuredRun, **numbers: float) -> MeasuredRun:
    """The same run with another belief about its bench; its motor has the friction that the plant has."""
    armature = numbers.pop("armature", 0.0)
    chain = [
        {"ideal": {"stiffness": 10.0, "damping": 0.1, "torque_limit": 2.0, "armature": armature}},
        {"friction": {"coulomb": numbers.pop("coulomb", 0.05), "viscous": 0.0}},
    ]
    params = {"mass": MASS, "length": LENGTH, "arm_mass": 0.0, **numbers}
    return replace(run, robot_params=params, actuators={"servo": chain})


@pytest.mark.long
@pytest.mark.parametrize(
    ("wrong", "name", "number", "true"),
    [
        ({"coulomb": 0.15}, "friction.coulomb", "friction.coulomb", 0.05),
        ({"mass": MASS / 1.5}, "load.mass", "load.mass_factor", 1.5),
    ],
)
def test_a_torque_log_names_what_is_wrong_with_friction_and_load(
    wrong: dict[str, float], name: str, number: str, true: float
) -> None:
    """It read "partly explained" without a cause: only a shift could be named."""
    runs = [believing(swung("a", 0.0, 1), **wrong), believing(swung("b", 0.0, 2), **wrong)]
    found = diagnose_torque(runs)
    assert found.causes[0].name == name or name in found.causes[0].rivals
    if found.causes[0].name == name:
        assert found.causes[0].parameters[number].value == pytest.approx(true, rel=0.1)
    assert found.gap["extended"].rmse < 0.5 * found.gap["nominal"].rmse


@pytest.mark.long
def test_only_the_causes_that_were_asked_for_are_named_in_a_torque_log() -> None:
    """``causes=[friction.coulomb]`` was dropped, and load.mass was named."""
    runs = [believing(swung(name, 0.0, seed), mass=MASS / 1.5) for name, seed in (("a", 1), ("b", 2))]
    found = diagnose_torque(runs, Request(causes=("friction.coulomb",)))
    named = [cause.name for cause in found.causes] + [rival for cause in found.causes for rival in cause.rivals]
    assert set(named) <= {"friction.coulomb"}
    shifted = diagnose_torque(RUNS, Request(causes=("friction.coulomb",)))
    assert "sensor.delay" not in [cause.name for cause in shifted.causes]
    open_load = [replace(run, meta={**run.meta, "unknown": ["load"]}) for run in runs]
    assert not {"load.mass", "load.inertia"} & {c.name for c in diagnose_torque(open_load).causes}


@pytest.mark.long
def test_shares_of_a_torque_log_split_what_is_explained() -> None:
    """Each was the share of what its own round removed: a shift and a load together had more than all of it."""
    runs = [believing(swung(name, 0.010, seed), mass=MASS / 1.5) for name, seed in (("a", 1), ("b", 2))]
    found = diagnose_torque(runs)
    assert {cause.name for cause in found.causes} >= {"sensor.delay"}
    assert found.tuned_share + sum(cause.share for cause in found.causes) == pytest.approx(1.0 - found.unexplained)
    assert [c.share for c in found.causes] == sorted((c.share for c in found.causes), reverse=True)
    assert found.tuned_share < 0.1


@pytest.mark.long
def test_thresholds_of_the_search_hold_for_torque_logs_too() -> None:
    runs = [believing(swung(name, 0.0, seed), coulomb=0.15) for name, seed in (("a", 1), ("b", 2))]
    asked = Request(search=replace(DEFAULT, least_gain=2.0))
    assert diagnose_torque(runs).causes and not diagnose_torque(runs, asked).causes


def test_a_torque_log_as_believed_is_nothing_to_explain() -> None:
    found = diagnose_torque([believing(swung("a", 0.0, 1)), believing(swung("b", 0.0, 2))])
    assert found.verdict == NOTHING and not found.causes, found.text


@pytest.mark.long
def test_a_shift_that_raises_the_error_on_held_out_blocks_is_withdrawn() -> None:
    """A shift of 35 ms was named with confidence 0.93 while the error rose from 0.87 to 0.93 N.m."""
    runs = [believing(swung("a", 0.010, 1)), believing(swung("b", 0.010, 2)), believing(swung("c", -0.030, 3))]
    found = diagnose_torque(runs, Request("c"))
    assert "sensor.delay" not in [cause.name for cause in found.causes]
    assert ("sensor.delay", WITHDRAWN) in [(cause.name, cause.standing) for cause in found.open_causes]
    assert found.gap["extended"].rmse <= found.gap["nominal"].rmse


def two(**wrong: float) -> list[MeasuredRun]:
    return [believing(swung(name, 0.0, seed), **wrong) for name, seed in (("a", 1), ("b", 2))]


@pytest.mark.long
def test_tuned_numbers_of_a_torque_log_stay_within_their_tolerance() -> None:
    """All numbers of the balance were fitted freely and called tuned: they took what no cause had explained."""
    found = diagnose_torque(two(coulomb=0.15, mass=MASS / 1.3))
    assert found.tuned_share < 0.1 and "load.mass" in [cause.name for cause in found.causes]
    free = diagnose_torque(two(mass=MASS / 1.3))
    for one in (found, free):
        named = {number for cause in one.causes for number in cause.parameters}
        factors = [factor for number, factor in one.tuned.items() if number not in named]
        assert all(1.0 / (1.0 + TIGHT) <= factor <= 1.0 + TIGHT for factor in factors)


def test_refitted_numbers_of_a_torque_log_that_beat_every_cause_are_the_finding() -> None:
    found = diagnose_torque(two(coulomb=0.15), Request(causes=("load.inertia",)))
    assert found.verdict == NOT_IDENTIFIABLE and found.model == "refitted" and not found.causes
    assert found.tuned["friction.coulomb"] == pytest.approx(1.0 / 3.0, rel=0.05)
    assert "friction.coulomb x 0.33" in found.text


def test_a_load_that_nobody_claims_to_know_is_tuned_and_no_fault_of_the_torque() -> None:
    """With ``unknown: [load]`` the missing half of the mass was named as a torque that reads 1.5 times too much."""
    runs = [replace(run, meta={**run.meta, "unknown": ["load"]}) for run in two(mass=MASS / 1.5)]
    found = diagnose_torque(runs)
    assert found.verdict == NOTHING and not found.causes, found.text
    assert found.tuned["load.mass_factor"] == pytest.approx(1.5, rel=0.02)


ARMATURE = 0.026  # [kg.m2] of a geared servo: four times the load
SIDES = {"shaft": (0.0, 0.0), "drive": (ARMATURE, 0.05)}  # what of armature and friction is in the column


def geared(inside: tuple[float, float], **believed: float) -> list[MeasuredRun]:
    """Armature and friction that the column has in it, and what is believed of load and drive."""
    armature, coulomb = inside
    runs = [swung(name, 0.0, seed, armature=armature, coulomb=coulomb) for name, seed in (("a", 1), ("b", 2))]
    return [believing(run, **believed) for run in runs]


def sided(side: str, **wrong: float) -> list[MeasuredRun]:
    """A servo whose torque is logged behind the gear, or as the drive estimates it; both are believed alike."""
    return geared(SIDES[side], armature=ARMATURE, **wrong)


def side_of(found: JointDiagnosis) -> str:
    """The side that its torque column was taken to be of, and whether the log told it."""
    (note,) = [finding.sentence for finding in found.findings if finding.code == "torque.side"]
    return f"{'shaft' if 'load alone' in note else 'drive'} {'assumed' if 'cannot tell' in note else 'shown'}"


@pytest.mark.parametrize("side", SIDES)
def test_a_torque_column_of_shaft_or_drive_is_nothing_to_explain(side: str) -> None:
    """One of the shaft got ``load.inertia`` with 99 %: the armature was looked for in it."""
    found = diagnose_torque(sided(side))
    assert found.verdict == NOTHING and not found.causes, found.text
    assert side_of(found) == f"{side} shown"


@pytest.mark.long
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("factor", [0.6, 1.5])
def test_a_wrong_mass_is_found_on_either_side_of_the_armature(side: str, factor: float) -> None:
    """The factor was on load and armature together, and came out below zero."""
    found = diagnose_torque(sided(side, mass=MASS / factor))
    (cause,) = found.causes
    alike = {"load.mass", "sensor.scale"} if side == "shaft" else {"load.mass"}  # all of a shaft's torque is its load
    assert cause.name in alike and alike - {cause.name} <= set(cause.rivals), found.text
    (value,) = cause.parameters.values()
    assert value.low <= factor <= value.high and value.value == pytest.approx(factor, rel=0.05)


@pytest.mark.long
def test_the_side_of_a_torque_column_can_be_said() -> None:
    runs = [replace(run, meta={**run.meta, "torque": "drive"}) for run in sided("shaft")]
    found = diagnose_torque(runs)
    assert found.causes and any("as the sidecar says" in f.sentence for f in found.findings)
    with pytest.raises(LogError, match=r"a: meta.torque is 'shaft' \(.*\) or 'drive' \(.*\), not 'motor'"):
        diagnose_torque([replace(run, meta={**run.meta, "torque": "motor"}) for run in runs])
    apart = [runs[0], replace(runs[1], meta={**runs[1].meta, "torque": "shaft"})]
    with pytest.raises(LogError, match=r"b: meta\.torque is 'shaft', that of another run 'drive'"):
        diagnose_torque(apart)


@pytest.mark.parametrize("factor", [1.28, 1.56, 2.0])
def test_an_inertia_that_the_load_lacks_is_not_taken_for_the_armature(factor: float) -> None:
    """A load of 1.56 times the inertia, behind the gear, got ``load.inertia_factor`` 0.24 with 99 %."""
    more = (factor - 1.0) * MASS * LENGTH**2
    found = diagnose_torque(geared((more, 0.0), armature=0.010))
    assert side_of(found).startswith("shaft") and [cause.name for cause in found.causes] == ["load.inertia"]
    assert found.causes[0].parameters["load.extra_inertia"].value == pytest.approx(more, rel=0.01)


@pytest.mark.long
@pytest.mark.parametrize("armature", [0.0, ARMATURE])
@pytest.mark.parametrize("factor", [0.2, 0.5, 2.0])
def test_a_wrong_friction_of_a_drive_is_told_against_what_was_believed_of_it(factor: float, armature: float) -> None:
    """A fifth of it in the column made that one of the shaft: 0.01 N.m of friction, "nominal 0"."""
    found = diagnose_torque(geared((armature, 0.05 * factor), armature=armature))
    assert side_of(found) == "drive shown" and [cause.name for cause in found.causes] == ["friction.coulomb"]
    value = found.causes[0].parameters["friction.coulomb"]
    assert value.nominal == 0.05 and value.value == pytest.approx(0.05 * factor, abs=0.001)


@pytest.mark.long
def test_an_armature_tells_the_side_that_asks_for_a_likely_load_unless_friction_contradicts_it() -> None:
    for column, side in ((0.0, "shaft shown"), (0.0036, "drive shown"), (0.0055, "shaft assumed")):
        runs = geared((column, 0.0), armature=0.0036, coulomb=0.0)
        assert side_of(diagnose_torque(runs)) == side
    assert side_of(diagnose_torque(geared((ARMATURE, 0.0), armature=ARMATURE))) == "shaft assumed"


@pytest.mark.parametrize("side", SIDES)
def test_a_reversed_torque_column_is_found_on_either_side(side: str) -> None:
    """A factor on the torque could not fall below 0; with an armature it was nothing to explain, 2 N.m off."""
    found = diagnose_torque([with_torque(run, -torque_of(run)) for run in sided(side)])
    assert side_of(found) == f"{side} shown" and found.verdict == EXPLAINED, found.text
    (cause,) = found.causes
    assert cause.name == "sensor.scale" and cause.parameters["torque.scale"].value == pytest.approx(-1.0, abs=0.01)


@pytest.mark.long
def test_an_error_that_nothing_explains_is_no_agreement() -> None:
    """It was "nothing to explain", with an error of 0.22 N.m that noise makes 0.002 of."""
    runs = [with_torque(run, torque_of(run) + 0.3 * np.sin(5.0 * run.joints["servo"].position)) for run in two()]
    found = diagnose_torque(runs)
    assert found.verdict == NOT_IDENTIFIABLE and not found.causes
    assert found.sentence.startswith("No known cause explains the gap")


def test_gaps_of_the_clock_are_no_error_of_the_torque() -> None:
    """Position and torque were drawn straight across them: 0.05 N.m off."""
    runs = []
    for run in two():
        kept = run.time % 2.4 > 0.3
        log = JointLog(None, run.joints["servo"].position[kept], torque=torque_of(run)[kept])
        runs.append(replace(run, time=run.time[kept], joints={"servo": log}))
    found = diagnose_torque(runs)
    assert found.verdict == NOTHING and found.gap["nominal"].rmse < 0.01, found.text


def test_a_number_that_does_nothing_in_a_held_out_run_ends_no_diagnosis() -> None:
    """``KeyError: 'load.mass_factor'``: the mass was fitted, and the shaft of the other run was empty."""
    runs = [replace(r, meta={**r.meta, "unknown": ["load"]}) for r in (*two(), believing(swung("c", 0.0, 3)))]
    runs[2] = replace(runs[2], robot_params={"mass": 0.0})
    assert "load.mass_factor" in diagnose_torque(runs, Request("c")).tuned


def test_what_else_a_sidecar_says_of_its_torque_is_no_side() -> None:
    """``meta`` is anybody's own: a number in it was refused."""
    runs = [replace(run, meta={"torque": 2.9}) for run in two()]
    assert diagnose_torque(runs).verdict == NOTHING


def with_torque(run: MeasuredRun, torque: np.ndarray | None) -> MeasuredRun:
    return replace(run, joints={"servo": replace(run.joints["servo"], torque=torque)})


def torque_of(run: MeasuredRun) -> np.ndarray:
    torque = run.joints["servo"].torque
    assert torque is not None
    return torque.copy()


def delay_of(found: JointDiagnosis) -> tuple[float, float, float]:
    """Delay of the torque column with its interval [s]: below zero where the column is early."""
    (value,) = (c.parameters["torque.delay"] for c in found.causes if c.name == "sensor.delay")
    return value.value, value.low, value.high


RUNS = (swung("a", 0.010, 1), swung("b", 0.010, 2))


@pytest.mark.long
@pytest.mark.parametrize("delay", [0.010, -0.010])
def test_a_torque_out_of_step_is_found_with_an_interval_that_allows_for_the_method(delay: float) -> None:
    value, low, high = delay_of(diagnose_torque([swung("a", delay, 1), swung("b", delay, 2)]))
    assert value == pytest.approx(delay, abs=SHIFT_BIAS)
    assert low <= value - SHIFT_BIAS and high >= value + SHIFT_BIAS
    assert low <= delay <= high


@pytest.mark.long
@pytest.mark.parametrize("delay", [0.045, -0.060, 0.100, 0.190])
def test_a_torque_far_out_of_step_is_measured_too(delay: float) -> None:
    """All of these were 40 ms, with an interval of 38 to 42 ms and 99 %."""
    found = diagnose_torque([swung("a", delay, 1), swung("b", delay, 2)])
    value, low, high = delay_of(found)
    assert value == pytest.approx(delay, abs=SHIFT_BIAS) and low <= delay <= high
    assert high - low < 0.2 * abs(delay)
    (cause,) = (cause for cause in found.causes if cause.name == "sensor.delay")
    assert cause.standing in (CERTAIN, LIKELY) and cause.confidence > 0.8


@pytest.mark.long
def test_a_torque_further_out_of_step_than_is_tried_is_not_measured() -> None:
    found = diagnose_torque([swung("a", -0.250, 1), swung("b", -0.250, 2)])
    value, low, high = delay_of(found)
    assert low == value == pytest.approx(-SHIFT_REACHES[-1]) and high > value
    (cause,) = (cause for cause in found.causes if cause.name == "sensor.delay")
    assert cause.standing not in (CERTAIN, LIKELY) and cause.confidence < 0.5


def test_the_noise_floor_of_a_torque_log_is_that_of_its_samples_averaged_and_of_its_calibration() -> None:
    runs = [believing(swung(name, 0.0, seed)) for name, seed in (("a", 1), ("b", 2))]
    floor = diagnose_torque(runs).gap["noise_floor"].rmse
    size = float(np.sqrt(np.mean(np.concatenate([torque_of(run) for run in runs]) ** 2)))
    expected = np.hypot(0.005 / np.sqrt(WEAK_FORM_WINDOW / runs[0].period / 2.0), DEFAULT.column_calibration * size)
    assert 0.8 < floor / expected < 1.25


@pytest.mark.long
def test_a_torque_log_needs_no_actuator() -> None:
    found = diagnose_torque([replace(run, actuators={}) for run in RUNS])
    assert delay_of(found)[0] == pytest.approx(0.010, abs=SHIFT_BIAS)


@pytest.mark.parametrize(("low", "high"), [(-0.012, 0.001), (-0.001, 0.012), (-0.012, 0.0)])
def test_an_interval_across_zero_holds_the_size_of_its_own_value(low: float, high: float) -> None:
    least, most = Shift(0.009 * np.sign(low + high), low, high, 0).size
    assert least == 0.0 and most == pytest.approx(0.012 + SHIFT_BIAS)


@pytest.mark.long
def test_empty_torque_cells_change_little() -> None:
    whole = delay_of(diagnose_torque(RUNS))
    torque = torque_of(RUNS[0])
    torque[[0, 500, 1500]] = np.nan
    torque[900:1100] = np.nan
    found = diagnose_torque([with_torque(RUNS[0], torque), RUNS[1]])
    assert all(np.isfinite([error.rmse, error.mae]).all() for error in found.gap.values())
    assert np.isfinite(found.unexplained) and "nan" not in found.text
    assert delay_of(found)[0] == pytest.approx(whole[0], abs=SHIFT_BIAS)


@pytest.mark.long
def test_a_torque_logged_with_every_second_position_is_used() -> None:
    half = [np.where(np.arange(len(run.time)) % 2, np.nan, torque_of(run)) for run in RUNS]
    runs = [with_torque(run, torque) for run, torque in zip(RUNS, half, strict=True)]
    assert delay_of(diagnose_torque(runs))[0] == pytest.approx(0.010, abs=SHIFT_BIAS)


@pytest.mark.long
def test_a_run_whose_torque_is_stuck_is_left_out() -> None:
    stuck = with_torque(RUNS[0], np.full(len(RUNS[0].time), 0.3))
    (found,) = diagnose(MeasuredSet((stuck, RUNS[1]), "two"))
    assert any(finding.code == "column.stuck" for finding in found.findings)
    assert delay_of(found)[0] == pytest.approx(0.010, abs=SHIFT_BIAS)
    with pytest.raises(LogError, match="no run has a goal or a torque"):
        diagnose_torque([with_torque(run, None) for run in RUNS])


@pytest.mark.long
def test_nothing_that_is_found_depends_on_a_group_kept_for_the_test() -> None:
    last = (swung("c", 0.010, 3), swung("c", 0.025, 3))
    one, two = (diagnose(MeasuredSet((*RUNS, kept), "three"), "c")[0] for kept in last)
    assert one.causes[0].parameters == two.causes[0].parameters
    assert one.tuned == two.tuned
    assert one.gap["extended"] != two.gap["extended"]


@pytest.mark.long
def test_the_seconds_kept_for_the_test_choose_no_shift() -> None:
    spoilt, units = [], cut(RUNS, "servo")
    for number, run in enumerate(RUNS):
        torque, inside = torque_of(run), np.zeros(len(run.time), bool)
        for unit in units:
            if (unit.run, unit.part) == (number, TEST):
                inside[unit.start + unit.judged + 80 : unit.stop - 80] = True
        spoilt.append(with_torque(run, np.where(inside, np.roll(torque, 4), torque)))
    one, two = (diagnose_torque(runs) for runs in (RUNS, spoilt))
    assert one.causes[0].parameters == two.causes[0].parameters
    assert two.gap["extended"].rmse > one.gap["extended"].rmse


def test_an_unknown_test_group_is_refused() -> None:
    with pytest.raises(LogError, match="there is no group 'd' to test on; the logs have a, b"):
        diagnose(MeasuredSet(RUNS, "two"), "d")
    with pytest.raises(LogError, match="all runs are in the group 'a'"):
        diagnose_torque(RUNS[:1], Request("a"))
    untold = [RUNS[0], with_torque(RUNS[1], None)]
    with pytest.raises(LogError, match="no torque is left to test on with the group 'b' held out"):
        diagnose_torque(untold, Request("b"))


def test_a_mistyped_robot_of_the_collection_is_corrected_and_any_other_is_a_machine_of_its_own() -> None:
    with pytest.raises(LogError, match=r"there is no robot 'hexapdo' \(did you mean 'hexapod'\?\)"):
        diagnose(MeasuredSet((replace(RUNS[0], robot="hexapdo"),), "one"))
    with pytest.raises(LogError, match="a measured torque stands in for one on a bench only"):
        diagnose(MeasuredSet((replace(RUNS[0], robot="my_arm", actuators={}),), "one"))
