"""Every check of a log finds the defect planted in a clean one, and is silent on clean logs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline
from sealegs.actuators import load_chain
from sealegs.gap.checks.data_set import (
    Finding,
    check_run,
    check_set,
    corrected,
    mended,
    merged,
    noise_floor,
    unusable,
)
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet

from testbed import NOISE_FLOOR, hidden_bench
from tests.logged_robots import JOINT, signal, with_log, with_torque
from tests.quick import quick

TICK = 2 * np.pi / 4096


@cache
def clean(seed: int = 0) -> MeasuredSet:
    return hidden_bench({}, seed)[0]


def without(run: MeasuredRun, since: float, until: float) -> MeasuredRun:
    """A run that lacks the samples of a stretch."""
    keep, log = (run.time < since) | (run.time > until), run.joints[JOINT]
    kept = {name: values[keep] for name, values in log.signals().items()}
    return replace(run, time=run.time[keep], joints={JOINT: replace(log, **kept)})


def found(run: MeasuredRun, code: str) -> Finding:
    findings = [finding for finding in check_run(run) if finding.code == code]
    assert findings, f"{code} not among {[finding.code for finding in check_run(run)]}"
    return findings[0]


@pytest.mark.parametrize("seed", quick(range(4), 4))
def test_clean_logs_raise_no_error_and_no_warning(seed: int) -> None:
    data = hidden_bench({}, seed, load=("light", "medium", "heavy"))[0]
    assert [finding for finding in check_set(data) if finding.severity != "note"] == []
    assert unusable(check_set(data), data) is None


@pytest.mark.parametrize(
    "effect",
    quick(["friction.coulomb", "friction.stribeck", "drive.supply_sag", "drive.delay", "transmission.backlash"], 2),
)
def test_physics_is_not_mistaken_for_a_data_error(effect: str) -> None:
    findings = check_set(hidden_bench({effect: "clear"}, 3)[0])
    assert [finding for finding in findings if finding.data_error] == []


def test_the_noise_floor_is_that_of_the_encoder() -> None:
    for run in clean().runs:
        assert noise_floor(run, JOINT) == pytest.approx(NOISE_FLOOR, rel=0.15)


def test_small_motion_in_degrees_is_recognised_without_an_encoder_grid() -> None:
    run = clean().runs[0]
    rng = np.random.default_rng(0)
    smooth = signal(run, "position") + rng.normal(0, 1e-4, len(run.time))
    one = with_log(run, position=smooth * 180 / np.pi)
    assert found(one, "unit.degrees").column == "servo.position"


def test_a_wheel_that_turns_far_is_not_in_degrees() -> None:
    time = np.arange(0, 20, 0.005)
    angle = 4.0 * time + np.sin(time)
    run = MeasuredRun("wheel", time, {JOINT: JointLog(angle + 0.01, np.round(angle / TICK) * TICK)})
    assert "unit.degrees" not in {finding.code for finding in check_run(run)}


def ticks(values: np.ndarray) -> np.ndarray:
    return np.round(2048 + values / TICK)


@pytest.mark.parametrize("columns", [("position",), ("goal",), ("goal", "position")])
def test_raw_ticks_are_named_and_refused_and_nothing_else_is_said(columns: tuple[str, ...]) -> None:
    for run in clean().runs:
        raw = with_log(run, **{name: ticks(signal(run, name)) for name in columns})
        findings = [finding for finding in check_run(raw) if finding.severity != "note"]
        assert {(finding.code, finding.column) for finding in findings} == {
            ("unit.ticks", f"servo.{name}") for name in columns
        }
        assert unusable(findings, MeasuredSet((raw,), "x")) is not None


def test_whole_degrees_are_no_ticks() -> None:
    run = clean().runs[1]
    whole = with_log(run, position=np.round(np.degrees(signal(run, "position")) * 4))  # far beyond a turn
    whole = replace(whole, joints={JOINT: replace(whole.joints[JOINT], goal=signal(run, "goal") * 4)})
    assert found(whole, "unit.degrees").column == "servo.position"


def test_a_fault_of_several_windows_of_a_run_is_counted_once() -> None:
    runs = clean().runs[:2]
    findings = [found(with_log(run, position=ticks(signal(run, "position"))), "unit.ticks") for run in runs]
    one, two = (replace(finding, run=run.name) for finding, run in zip(findings, runs, strict=True))
    window = replace(one, run=f"{one.run}[0:500]")
    assert "found in 2 runs" in merged([one, window, two])[0].sentence
    assert "found in" not in merged([one, window])[0].sentence


@pytest.mark.parametrize(("ratio", "name"), [(180 / np.pi, "degrees per second"), (9.549, "revolutions per minute")])
def test_a_velocity_in_another_unit_is_named(ratio: float, name: str) -> None:
    run = clean().runs[0]
    finding = found(with_log(run, velocity=signal(run, "velocity") * ratio), "unit.velocity")
    assert name in finding.sentence


def torque_run(**column: float) -> MeasuredRun:
    return with_torque(*hidden_bench({}, 0), **column).runs[0]


@pytest.mark.long
@pytest.mark.parametrize("armature", [0.0, 0.12])
def test_a_right_torque_column_raises_nothing(armature: float) -> None:
    """A drive's estimate has the armature of its motor in it: sixteen times the load's inertia made it another unit."""
    run = torque_run(armature=armature)
    chain = {"ideal": {"stiffness": 10.0, "damping": 0.1, "torque_limit": 2.0, "armature": 0.12}}
    named = replace(run, actuators={"servo": [chain]})
    assert [f for f in check_run(named) if f.column == "servo.torque"] == []


def test_the_side_that_a_sidecar_says_its_torque_is_of_is_believed() -> None:
    """What fitted better was taken, whatever the sidecar said."""
    chain = {"ideal": {"stiffness": 10.0, "damping": 0.1, "torque_limit": 2.0, "armature": 0.12}}
    run = replace(torque_run(armature=0.12), actuators={"servo": [chain]})
    for side, codes in (("drive", []), ("shaft", ["torque.gear_side"])):
        said = replace(run, meta={**run.meta, "torque": side})
        assert [f.code for f in check_run(said) if f.column == "servo.torque"] == codes


@pytest.mark.long
@pytest.mark.parametrize("delay", [0.050, -0.080, 0.120])
def test_a_torque_column_far_out_of_step_is_measured(delay: float) -> None:
    """All were 40 ms, where the search ended."""
    finding = found(torque_run(delay=delay), "torque.lag" if delay > 0 else "torque.lead")
    assert finding.low is not None and finding.high is not None
    assert finding.low <= abs(delay) <= finding.high < 1.1 * abs(delay)


@pytest.mark.long
def test_a_torque_column_further_out_of_step_than_is_tried_is_told_as_at_least_that() -> None:
    """Its ratio to what the motion needs then says nothing of a gear."""
    run = torque_run(delay=0.3)
    assert [f.code for f in check_run(run) if f.column == "servo.torque"] == ["torque.lag"]
    finding = found(run, "torque.lag")
    assert finding.high is None and "at least" in finding.sentence


@pytest.mark.long
def test_a_reversed_estimate_of_a_drive_has_the_wrong_sign_and_is_of_no_other_gear() -> None:
    """It was taken as of the shaft, and 1/2.11 of what the motion needs."""
    chain = {"ideal": {"stiffness": 10.0, "damping": 0.1, "torque_limit": 2.0, "armature": 0.12}}
    for friction in ([], [{"friction": {"coulomb": 0.05, "viscous": 0.0}}]):
        run = replace(torque_run(armature=0.12, factor=-1.0), actuators={"servo": [chain, *friction]})
        findings = [f for f in check_run(run) if f.column == "servo.torque"]
        assert [f.code for f in findings] == ["torque.sign"]
        assert findings[0].value == pytest.approx(-1.0, abs=0.02)


@pytest.mark.parametrize("inside", [0.0, 1.0])
def test_the_torque_of_an_empty_shaft_is_of_no_other_gear(inside: float) -> None:
    """A drive's estimate ended the check: a ratio to a load of nothing was divided by."""
    data, truth = hidden_bench({}, 0)
    run, q = data.runs[0], truth["clean_position"][0]
    motion = make_smoothing_spline(run.time, q, lam=1e-9)
    torque = 0.002 * motion.derivative(2)(run.time) + 0.2 * np.tanh(motion.derivative(1)(run.time) / 0.1)
    chain = {"ideal": {"stiffness": 10.0, "damping": 0.1, "torque_limit": 2.0, "armature": 0.002}}
    noise = np.random.default_rng(0).normal(0, 0.005, len(q))
    bare = {**run.robot_params, "mass": 0.0, "arm_mass": 0.0}
    run = replace(with_log(run, torque=inside * torque + noise), robot_params=bare, actuators={"servo": [chain]})
    assert [f.code for f in check_run(run) if f.column == "servo.torque"] == []


def test_an_unsigned_torque_is_named() -> None:
    run = clean().runs[0]
    assert found(with_log(run, torque=np.abs(signal(run, "current"))), "torque.unsigned").data_error


def test_an_encoder_that_wraps_on_every_swing_is_named() -> None:
    run = clean().runs[0]
    goal = 0.8 * np.sin(2 * np.pi * 2.0 * run.time)  # four times a second, in 2 % of the samples
    wrapped = (goal - 0.1) % (2 * np.pi) + 0.1
    assert found(with_log(run, goal=goal, position=wrapped), "position.wrap").value == pytest.approx(2 * np.pi, rel=0.1)


@pytest.mark.parametrize("unit", [1.0, 180.0 / np.pi])
def test_what_a_joint_moved_in_a_gap_of_its_log_is_no_wrap(unit: float) -> None:
    """53 degrees within a second that was not logged were a wrap of the encoder, and the positions were converted."""
    run = clean().runs[0]
    swing = unit * 0.9 * np.sin(2 * np.pi * 0.2 * run.time)
    gapped = without(with_log(run, goal=swing, position=swing), 6.8, 8.2)
    assert "clock.gaps" in {finding.code for finding in check_run(gapped)}
    assert "position.wrap" not in {finding.code for finding in check_run(gapped)}


def test_a_log_that_lies_on_another_turn_than_its_goals_is_named_and_put_back() -> None:
    run = clean().runs[0]
    turned = with_log(run, position=signal(run, "position") - 4 * np.pi)
    finding = found(turned, "position.wrap")
    assert "2 whole turns from servo.goal" in finding.sentence
    back = mended(turned, [finding])
    np.testing.assert_allclose(signal(back, "position"), signal(run, "position"), atol=1e-12)


def test_single_wrong_readings_are_not_called_a_wrap() -> None:
    run = clean().runs[0]
    position = signal(run, "position").copy()
    position[[500, 1700, 3100]] += 3.0
    assert found(with_log(run, position=position), "position.spikes").severity == "error"


@pytest.mark.filterwarnings("error")
def test_a_duty_that_never_rests_is_no_trouble_for_the_supply() -> None:
    run = clean().runs[0]
    duty = signal(run, "duty")
    pushed = np.where(duty < 0.0, -1.0, 1.0) * np.maximum(np.abs(duty), 0.2)
    assert not [f for f in check_run(with_log(run, duty=pushed)) if f.code == "voltage.aliased"]


def test_a_column_that_stops_updating_is_named() -> None:
    run = clean().runs[0]
    velocity = signal(run, "velocity").copy()
    velocity[200:700] = velocity[200]
    finding = found(with_log(run, velocity=velocity), "column.stuck")
    assert finding.value == pytest.approx(2.5, abs=0.1)


@pytest.mark.long
def test_a_duty_that_stops_updating_is_named_and_one_that_a_drive_holds_is_not() -> None:
    run = clean().runs[0]
    duty = signal(run, "duty").copy()
    duty[200:700] = duty[200]
    assert found(with_log(run, duty=duty), "column.stuck").value == pytest.approx(2.5, abs=0.1)
    for size in ("clear", "moderate"):  # in slow motion, such a drive gives its least duty for half a second
        data = hidden_bench({"drive.minimum_duty": size}, 5, load=("light", "medium", "heavy"))[0]
        assert [finding for finding in check_set(data) if finding.data_error] == []


def test_a_current_of_coarse_steps_keeps_its_value_at_constant_speed() -> None:
    run = clean().runs[0]
    for step in (0.1, 0.3):
        coarse = with_log(run, current=np.round(signal(run, "current") / step) * step)
        assert "column.stuck" not in {finding.code for finding in check_run(coarse)}
    current = signal(run, "current").copy()
    current[200:700] = current[200]
    assert found(with_log(run, current=current), "column.stuck").value == pytest.approx(2.5, abs=0.1)


def test_a_duty_that_should_be_at_its_limit_throughout_tells_no_unit() -> None:
    """With a stiff controller and a late command the chain expects its limit at every moment, the servo does not."""
    run = clean().runs[0]
    stiff = load_chain("sts3215").with_value("position_p.gain", 3000.0).to_list()
    error = signal(run, "goal") - signal(run, "position")
    run = replace(with_log(run, duty=np.round(0.2 * np.tanh(50.0 * error), 3)), actuators={JOINT: stiff})
    assert [finding.code for finding in check_run(run) if finding.code == "unit.duty"] == []


def test_a_joint_at_rest_under_a_steady_duty_is_no_stuck_column() -> None:
    run = clean().runs[0]
    position, duty = signal(run, "position").copy(), signal(run, "duty").copy()
    rest = slice(600, len(duty))
    noise = np.random.default_rng(0).normal(0.0, 3.9e-4, len(duty))
    position[rest], duty[rest] = TICK * np.round((position[600] + noise[rest]) / TICK), -0.016
    time_ = run.time.copy()
    time_[rest] = time_[600] + 4.0 * (time_[rest] - time_[600])  # a minute and a half
    still = replace(with_log(run, position=position, duty=duty), time=time_)
    assert "column.stuck" not in {finding.code for finding in check_run(still)}


def test_a_joint_at_rest_makes_a_log_unusable() -> None:
    run = clean().runs[0]
    still = with_log(run, position=np.full_like(run.time, 0.3), velocity=np.zeros_like(run.time))
    finding = found(still, "motion.none")
    assert finding.severity == "error"
    assert unusable(check_run(still), MeasuredSet((still,), "still")) is not None


def test_a_goal_that_never_moves_is_noted() -> None:
    run = clean().runs[0]
    assert found(with_log(run, goal=np.zeros_like(run.time)), "goal.still").severity == "warning"


def test_too_little_motion_is_noted() -> None:
    run = clean().runs[0]
    ramp = np.linspace(0.0, 0.8, len(run.time))
    slow = with_log(run, goal=ramp, position=np.round(ramp / TICK) * TICK, velocity=None, duty=None, current=None)
    assert "reverses" in found(slow, "excitation.little").sentence


def test_saturation_and_a_switched_off_drive_are_noted() -> None:
    run = clean().runs[0]
    assert found(run, "duty.saturated").severity == "note"
    enabled = (run.time < 12.0).astype(float)
    assert found(with_log(run, enabled=enabled), "drive.off").value == pytest.approx(0.5, abs=0.01)


def test_gaps_irregular_and_rounded_clocks_are_found() -> None:
    run = clean().runs[0]
    assert found(without(run, 5.0, 5.4), "clock.gaps").value == pytest.approx(0.4, abs=0.02)
    shaky = np.cumsum(np.random.default_rng(0).uniform(0.002, 0.008, len(run.time)))
    assert found(replace(run, time=shaky), "clock.irregular")
    assert found(replace(run, time=np.arange(1, len(run.time) + 1) * 0.0053 // 0.001 * 0.001), "clock.quantised")


def test_the_same_recording_twice_is_found() -> None:
    run = clean().runs[0]
    findings = check_set(MeasuredSet((run, replace(run, name="copy")), "twice"))
    assert "set.duplicate" in {finding.code for finding in findings}


def test_two_stretches_of_rest_are_not_the_same_recording() -> None:
    rest = MeasuredRun("rest", np.arange(0.0, 4.0, 0.005), {JOINT: JointLog(np.zeros(800), np.full(800, 0.3))})
    findings = check_set(MeasuredSet((rest, replace(rest, name="more")), "still"))
    assert "set.duplicate" not in {finding.code for finding in findings}


def test_a_current_that_a_load_holds_on_one_side_in_one_run_is_signed_in_all() -> None:
    """A slide that carries weight draws one way in slow runs; its column was set aside in all of them."""
    signed, held = clean().runs[:2]
    held = with_log(held, current=np.abs(signal(held, "current")))
    assert "current.unsigned" in {finding.code for finding in check_set(MeasuredSet((held,), "x"))}
    assert "current.unsigned" not in {finding.code for finding in check_set(MeasuredSet((signed, held), "x"))}


@pytest.mark.long
def test_a_current_without_sign_in_one_run_has_none_in_any() -> None:
    """Where a run pushes one way only, a magnitude looks like a current of another scale."""
    both, one_way = (with_log(run, current=np.abs(signal(run, "current"))) for run in clean().runs[:2])
    one_way = with_log(one_way, duty=np.abs(signal(one_way, "duty")))
    data = MeasuredSet((both, one_way), "x")
    mended, said = corrected(data, check_set(data))
    assert [run.joints[JOINT].current for run in mended.runs] == [None, None]
    assert "converted" not in " ".join(finding.sentence for finding in said)


def test_findings_of_many_runs_merge_to_one_per_column() -> None:
    runs = tuple(with_log(run, velocity=0.9 * signal(run, "velocity")) for run in clean().runs)
    findings = [f for f in merged(check_set(MeasuredSet(runs, "x"))) if f.code == "velocity.scale"]
    assert len(findings) == 1 and "found in 3 runs" in findings[0].sentence
