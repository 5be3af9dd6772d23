"""What of a diagnosis a robot takes: no more than keeps it from missing its own log by more than before."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.actuators.gravity import GRAVITY
from sealegs.envs.extended import Change, Extended
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.causes.cause import Cause
from sealegs.gap.checks.signal import Z95
from sealegs.gap.diagnose import diagnose
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.measure.case import ROBOT
from sealegs.gap.measure.named import NamedCause, Value
from sealegs.gap.output import hand_over as module
from sealegs.gap.output.extension import extended_of
from sealegs.gap.output.hand_over import bodies_of, confirm_whole, hand_over, harmed, spread_of, with_draws
from sealegs.gap.output.mjcf import native_mjcf, not_native
from sealegs.gap.replay.engine import bench, replay_in_engine
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.parameters import Parameter, address
from sealegs.gap.verdict.verdict import JointDiagnosis

from testbed.bench import NOISE_FLOOR
from testbed.logs import hidden_arm
from tests.logged_robots import JOINTS, two_link_run
from tests.made_once import SHARED, made_once
from tests.small_diagnosis import small_diagnosis
from tests.smooth_bench import CHAIN, PARAMS


@made_once
def diagnosed() -> tuple[MeasuredSet, list[JointDiagnosis]]:
    """An arm with more friction at its elbow than believed, and nominal numbers that are a little wrong."""
    folder = Path(tempfile.mkdtemp(dir=os.environ[SHARED]))
    data, _ = hidden_arm(folder, "two_link", {"friction": ("elbow", "clear")}, 3, runs=1, duration=4.0)
    return data, list(diagnose(data, causes=["friction.coulomb"]).joints)


@pytest.fixture
def arm() -> tuple[MeasuredSet, list[JointDiagnosis]]:
    return diagnosed()


def answers(monkeypatch: pytest.MonkeyPatch, errors: Mapping[str, tuple[float, float] | None]) -> list[str]:
    """Let the simulation of the whole robot find these errors (shoulder, elbow) of each model, 3 and 5 mrad before."""
    asked: list[str] = []

    def confirm(*_: Any, **__: Any) -> dict[str, Any]:
        taken = _[4] if len(_) > 4 else "all"
        asked.append(taken)
        found = errors[taken]
        if found is None:
            return {"reason": "its base moves"}
        joints = zip(("shoulder", "elbow"), (0.003, 0.005), found, strict=True)
        return {"joints": {n: {"nominal": a, "extended": b, "unit": "rad"} for n, a, b in joints}}

    monkeypatch.setattr(module, "confirm_whole", confirm)
    return asked


def tuned_bodies(extended: Any) -> list[str]:
    return [change.path for change in extended.changes if change.owner == "robot" and not change.cause]


def test_all_is_taken_where_the_whole_robot_gains(arm: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = answers(monkeypatch, {"all": (0.001, 0.002)})
    extended, found = hand_over(arm[1], arm[0])
    assert asked == ["all"] and found is not None and found["taken"] == "all"
    assert "left" not in found and "harm" not in found and tuned_bodies(extended)


def test_masses_that_were_only_tuned_stay_where_they_do_harm(arm: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Masses that each joint had guessed for itself moved an arm away from its log by ten times its nominal error."""
    answers(monkeypatch, {"all": (0.03, 0.002), "own": (0.002, 0.002)})
    extended, found = hand_over(arm[1], arm[0])
    assert extended is not None and found is not None and found["taken"] == "own" and not tuned_bodies(extended)
    assert "'shoulder' by 30 mrad (3 as believed)" in found["left"]
    assert found["joints"]["shoulder"] == {"nominal": 0.003, "extended": 0.002, "unit": "rad"}
    assert any(change.cause == "friction.coulomb" for change in extended.changes)


def test_a_joint_without_a_cause_stays_as_believed_where_its_tuned_numbers_do_harm(
    arm: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers(monkeypatch, {"all": (0.03, 0.002), "own": (0.02, 0.002), "named": (0.003, 0.002)})
    extended, found = hand_over(arm[1], arm[0])
    assert extended is not None and found is not None and found["taken"] == "named" and "harm" not in found
    assert {change.joint for change in extended.changes if change.owner == "chain"} == {"elbow"}
    assert extended.chains["shoulder"][0].file == ""


def test_harm_that_remains_is_said(arm: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    answers(monkeypatch, {"all": (0.03, 0.002), "own": (0.02, 0.002), "named": (0.01, 0.002)})
    _, found = hand_over(arm[1], arm[0])
    assert found is not None and "'shoulder' by 10 mrad (3 as believed)" in found["harm"]


def test_bodies_stay_where_the_whole_robot_cannot_be_simulated(arm: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    answers(monkeypatch, {"all": None})
    extended, found = hand_over(arm[1], arm[0])
    assert found is not None and "its base moves" in found["reason"] and found["left"] == module.UNSEEN
    assert not tuned_bodies(extended)


def test_what_is_changed_of_bodies_is_told() -> None:
    """A hip was handed over at 0.05 times its mass, and no page said so."""
    rows = [
        Change("hip", "body.mass_factor", 1.0, 0.05, "", "robot"),
        Change("foot", "body.payload", 0.0, 0.09, "load.mass", "robot"),
        Change("thigh", "body.mass_factor", 1.0, 1.001, "", "robot"),
        Change("hip", "friction.coulomb", 0.05, 0.1, "", "chain"),
    ]
    told = bodies_of(Extended("leg.xml", {}, {}, tuple(rows)))
    assert told == "Bodies as handed over: hip mass x 0.05 (tuned), foot payload +0.09 kg (load.mass)."
    assert bodies_of(Extended("leg.xml", {}, {})) == ""


def test_an_error_within_the_noise_is_no_harm() -> None:
    joints = {"elbow": {"nominal": 1e-4, "extended": 2e-4}, "wrist": {"nominal": 1e-3, "extended": 2e-3}}
    assert harmed(joints, {"elbow": 5e-4, "wrist": 5e-4}) == ["wrist"]


@pytest.mark.long
def test_joints_that_were_not_diagnosed_keep_the_chains_that_their_log_states(tmp_path: Path) -> None:
    """They lost damping and friction: with one joint diagnosed, the others missed a motion by twenty times more."""
    data, _ = hidden_arm(tmp_path, "two_link", {}, 5, runs=1, duration=6.0)
    found = list(diagnose(data, joints=["elbow"], causes=["friction.coulomb"]).joints)
    extended = module.extended_of(found, replace(data))
    assert extended is not None and set(extended.chains) == {"shoulder", "elbow"}
    (shoulder,) = extended.chains["shoulder"]
    assert shoulder.chain.find("friction").coulomb == 0.052


@pytest.mark.parametrize(("standing", "handed"), [("certain", True), ("likely", True), ("possible", False)])
def test_an_encoder_whose_error_is_doubted_stays_as_believed(standing: str, handed: bool) -> None:
    """An encoder that reads right was handed over as one that reads 10 % too little, at 29 %; the policy was worse."""
    found, data = small_diagnosis()
    assert found.search is not None
    (entry,) = catalogue(found.problem.models[0], ["sensor.scale"])  # type: ignore[union-attr]
    value = Value(0.9, 0.89, 0.91, "1", 1.0)
    parameters = {"encoder.scale": value}
    cause = NamedCause("sensor.scale", "", found.joint, 0.3, 0.29, parameters, 0.5, "effect", standing=standing)
    accepted = replace(found.search.accepted[0], cause=entry, variant=entry.variants[0])
    misread = found.changed(
        search=replace(found.search, accepted=(*found.search.accepted, accepted)),
        causes=(*found.causes, cause),
        values={**found.values, "encoder.scale": 0.9},
    )
    model, said = hand_over([misread], data)
    assert model is not None and any(change.path == "encoder.scale" for change in model.changes) == handed
    assert any(change.path == "friction.load" for change in model.changes)
    assert handed or (said is not None and "sensor.scale of 'servo' (confidence 29%)" in said["left"])


def test_only_encoders_are_withheld_where_they_are_doubted() -> None:
    """A payload of the robot that a centre of mass might have been was not handed over, as if it were an encoder."""
    found, _ = small_diagnosis()
    assert found.search is not None and found.problem is not None and found.problem.joint is not None
    (entry,) = catalogue(found.problem.joint.models[0], ["load.mass"])
    payload = Parameter("body.foot.payload", "kg", 0.0, 1.0, 0.0, 0.01)
    cause = NamedCause("load.mass", "", found.joint, 0.3, 0.29, {}, 0.5, "number", standing="possible")
    accepted = replace(found.search.accepted[0], cause=entry, variant=(payload,))
    values = {payload.path: 0.1}
    heavier = found.changed(search=replace(found.search, accepted=(accepted,)), causes=(cause,), values=values)
    assert not module.doubted_encoders(heavier) and module.without_doubted_encoders(heavier).values == values


@pytest.mark.long
def test_a_log_in_degrees_is_simulated_in_radians(tmp_path: Path) -> None:
    """The errors were those of a machine that flew apart: 86 rad, under warnings of the engine."""
    run = two_link_run(tmp_path, 6.0)
    joints = {
        name: replace(log, position=np.degrees(log.position), goal=np.degrees(np.asarray(log.goal)), velocity=None)
        for name, log in run.joints.items()
    }
    said = replace(run, joints=joints, meta={**run.meta, "units": {"position": "deg", "goal": "deg"}})
    data = MeasuredSet((said,), "degrees")
    diagnoses = list(diagnose(data, causes=["friction.coulomb"]).joints)
    extended = extended_of(diagnoses, data)
    assert extended is not None
    found = confirm_whole(diagnoses, data, extended)
    assert found is not None
    assert all(found["joints"][joint]["nominal"] < 3.0 * NOISE_FLOOR for joint in JOINTS)


# --- machines as the diagnosed one may be: as wide as the intervals, together where the fit knows so ------------------


@pytest.fixture(scope="module")
def small() -> tuple[JointDiagnosis, MeasuredSet]:
    return small_diagnosis()


def drawn_numbers(found: JointDiagnosis, data: MeasuredSet, *others: JointDiagnosis) -> dict[str, np.ndarray]:
    model = extended_of([found], data)
    assert model is not None
    draws = with_draws(model, [found, *others], data, "all").draws
    assert draws is not None
    return {key[3]: column for key, column in zip(draws.numbers, np.array(draws.machines).T, strict=True)}


def test_a_cause_is_drawn_as_wide_as_its_interval(small: tuple[JointDiagnosis, MeasuredSet]) -> None:
    found, data = small
    (cause,) = (one for one in found.causes if one.name == "friction.load_dependent")
    value = cause.parameters["friction.load"]
    told = drawn_numbers(found, data)["friction.load"]
    assert told.mean() == pytest.approx(value.value, rel=0.1)
    assert told.std() == pytest.approx((value.high - value.low) / (2.0 * Z95), rel=0.5)


def test_numbers_that_make_up_for_each_other_are_drawn_together(small: tuple[JointDiagnosis, MeasuredSet]) -> None:
    found, data = small
    spread = spread_of(found)
    assert spread is not None
    correlation = spread.root @ spread.root.T
    np.testing.assert_allclose(np.diag(correlation), 1.0, atol=1e-6)
    paths = [p.number for p in spread.parameters]
    apart = np.triu(np.abs(correlation), 1)
    row, column = np.unravel_index(apart.argmax(), apart.shape)
    assert apart.max() > 0.5
    told = drawn_numbers(found, data)
    seen = np.corrcoef(told[paths[row]], told[paths[column]])[0, 1]
    assert seen == pytest.approx(correlation[row, column], abs=0.35)


def test_a_latency_of_all_joints_is_drawn_once(small: tuple[JointDiagnosis, MeasuredSet]) -> None:
    found, data = small
    delay = extended_of([found], data).chains[found.joint][0].chain.value("delay.seconds")  # type: ignore[union-attr]
    latency = NamedCause(
        name="drive.delay", sentence="", joint=ROBOT, share=0.5, confidence=1.0, gain=0.5, kind="number",
        parameters={"delay.seconds": Value(delay, delay - 0.002, delay + 0.002, "s", delay)},
    )  # fmt: skip
    robot = JointDiagnosis.of(joint=ROBOT, causes=(latency,))
    joints = [
        found.changed(case=dataclasses.replace(found.case, joint=name), shared={"delay.seconds": "drive.delay"})
        for name in ("hip", "knee")
    ]
    runs = tuple(
        dataclasses.replace(
            run,
            joints=dict.fromkeys(("hip", "knee"), *run.joints.values()),
            actuators=dict.fromkeys(("hip", "knee"), *run.actuators.values()),
        )
        for run in data.runs
    )
    both = dataclasses.replace(data, runs=runs)
    model = extended_of(joints, both)
    assert model is not None
    draws = with_draws(model, [*joints, robot], both, "all").draws
    assert draws is not None
    columns = dict(zip(draws.numbers, np.array(draws.machines).T, strict=True))
    hip, knee = (columns["chain", joint, "0", "delay.seconds"] for joint in ("hip", "knee"))
    np.testing.assert_allclose(hip, knee, rtol=1e-4)
    assert hip.std() == pytest.approx(0.002 / Z95, rel=0.5)
    other = [columns["chain", joint, "0", "friction.load"] for joint in ("hip", "knee")]
    assert np.abs(other[0] - other[1]).max() > 1e-6, "the rest is each joint's own"


def test_what_is_handed_over_has_machines_and_equal_seeds_give_equal_ones(
    small: tuple[JointDiagnosis, MeasuredSet],
) -> None:
    found, data = small
    one, other = (hand_over([found], data)[0] for _ in range(2))
    assert one is not None and other is not None
    assert one.draws is not None and len(one.draws.machines) > 20
    assert one.draws == other.draws
    first = one.machines()[0]
    assert first.numbers() != one.numbers()
    assert first.numbers().keys() == one.numbers().keys()


# --- the extended model as files: nothing but what was named differs, and plain MuJoCo reproduces what is native -----

NOMINAL = JointModel(load_chain(CHAIN))
CAUSES = {cause.name: cause for cause in catalogue(NOMINAL)}
PLAIN = """
import json, sys
import mujoco, numpy as np
work = json.load(sys.stdin)
goals, found = np.array(work["goals"]), {}
for name, text in work["models"].items():
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    joints = [model.joint(k).name for k in range(model.njnt)]
    at = model.joint("joint_motor" if "joint_motor" in joints else "joint").qposadr[0]
    each, row = round(0.005 / model.opt.timestep), []
    for goal in goals:
        row.append(float(data.qpos[at]))
        data.ctrl[0] = goal
        mujoco.mj_step(model, data, each)
    found[name] = row
assert not [name for name in sys.modules if name.split(".")[0] in ("actuators", "gap", "envs")]
json.dump(found, sys.stdout)
"""
NATIVE = {
    "nominal": ({}, 0.02),
    "armature": ({"dc_motor.armature": 0.04}, 0.02),
    "Coulomb friction": ({"friction.coulomb": 0.15}, 0.02),
    "viscous friction": ({"friction.viscous": 0.12}, 0.02),
    "resistance": ({"dc_motor.resistance": 4.0}, 0.02),
    "motor constant": ({"dc_motor.motor_constant": 0.9}, 0.02),
    "gear ratio": ({"gear_ratio.factor": 1.3}, 0.02),
    "gain": ({"position_p.gain": 3.0}, 0.02),
    "delay": ({"delay.seconds": 0.0123}, 0.3),  # due between time steps: late by less than one
    "saturation": ({"duty_limit.limit": 0.5}, 0.02),
    "rate limit": ({"rate_limit.speed": 2.0}, 2.0),  # half a time step late
    "overload": ({"torque_limit.limit": 0.6}, 0.02),
    "compliance": ({"compliance.stiffness": 15.0, "compliance.damping": 0.02}, 0.02),
    "backlash": ({"backlash.width": 0.05}, 0.02),
    "bouncing teeth": (
        {"backlash.width": 0.1, "backlash.tooth_stiffness": 900.0, "backlash.tooth_damping": 0.5},
        0.1,  # every bounce enlarges what differs before it
    ),
    "mass": ({"load.mass_factor": 1.3}, 0.02),
    "inertia": ({"load.extra_inertia": 0.003}, 0.02),
    "centre of mass": ({"load.centre_shift": 0.02}, 0.02),
    "blocked": ({"load.stop_angle": 0.3}, 0.02),
    "blocked softly": ({"load.stop_angle": 0.3, "load.stop_stiffness": 120.0}, 0.02),
}
"""Native effects, and how far [mrad rms] plain MuJoCo may be from the extended simulation."""


def excitation() -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and goal [rad] at 200 Hz, from rest."""
    rng = np.random.default_rng(0)
    time = np.arange(0.0, 4.0, 0.005)
    smooth = sum(0.3 / (1 + f) * np.sin(2 * np.pi * f * time + rng.uniform(0, 6)) for f in (0.2, 0.5, 1.1, 1.9))
    steps = rng.uniform(-0.8, 0.8, 8)[(time / 0.7).astype(int)]
    return time, np.where(time < 2.0, smooth * np.clip(time / 0.5, 0.0, 1.0), steps)


@pytest.fixture(scope="module")
def plain() -> dict[str, list[float]]:
    """Positions that plain MuJoCo gives for every native effect, in a process that imports nothing of sealegs."""
    models = {name: native_mjcf(NOMINAL.with_values(values), PARAMS) for name, (values, _) in NATIVE.items()}
    work = json.dumps({"goals": excitation()[1].tolist(), "models": models})
    done = subprocess.run(
        [sys.executable, "-c", PLAIN], input=work, capture_output=True, text=True, cwd="/", check=True
    )
    return json.loads(done.stdout)


@pytest.mark.long
@pytest.mark.parametrize("name", NATIVE)
def test_plain_mujoco_reproduces_a_native_effect(name: str, plain: dict[str, list[float]]) -> None:
    values, tolerance = NATIVE[name]
    joint = NOMINAL.with_values(values)
    time, goal = excitation()
    ours = replay_in_engine(bench(joint, PARAMS), time, goal, (0.0, 0.0))[:, 0]
    rms = 1e3 * float(np.sqrt(np.mean((np.array(plain[name]) - ours) ** 2)))
    assert rms < tolerance, f"{rms:.4f} mrad"
    if values:
        effect = 1e3 * float(np.sqrt(np.mean((np.array(plain["nominal"]) - plain[name]) ** 2)))
        assert effect > 3.0 * rms, f"the effect of {effect:.3f} mrad would not show beside an error of {rms:.3f} mrad"
    assert not_native(joint.chain) == []


def test_teeth_beside_a_compliance_are_listed_as_left_out() -> None:
    play = {"backlash.width": 0.1, "backlash.tooth_stiffness": 900.0}
    assert not_native(NOMINAL.with_values(play).chain) == []
    both = NOMINAL.with_values({**play, "compliance.stiffness": 15.0})
    assert not_native(both.chain) == ["backlash.tooth_stiffness"]


def test_only_teeth_that_carry_the_load_can_bounce() -> None:
    def numbers(joint: JointModel) -> set[str]:
        (cause,) = [cause for cause in catalogue(joint) if cause.name == "transmission.backlash"]
        return {parameter.path for variant in cause.variants for parameter in variant}

    assert "backlash.tooth_damping" in numbers(NOMINAL)
    assert numbers(NOMINAL.with_values({"compliance.stiffness": 15.0})) == {"backlash.width"}


def chosen(cause: Cause) -> dict[str, float]:
    """A size of a cause, by path, that differs from doing nothing."""
    values = {p.path: p.start for p in cause.variants[0]}
    first = cause.variants[0][0]
    values[first.path] = first.from_fit(first.to_fit(first.start) + 1.0)
    return values


@pytest.mark.parametrize("name", CAUSES)
def test_the_extended_joint_differs_by_the_named_numbers_only(name: str) -> None:
    values = chosen(CAUSES[name])
    extended = NOMINAL.with_fitted(values)
    named = {address(path).number for path in values}
    if "gear_ratio.factor" in named:
        named = {"dc_motor.motor_constant", "dc_motor.armature"}
    changed = set()
    for stage in extended.chain.stages:
        before = NOMINAL.chain.find(stage.name)
        if before is None:
            assert any(path.startswith(f"{stage.name}.") for path in named), f"{stage.name} was added without reason"
            continue
        changed |= {f"{stage.name}.{k}" for k, v in stage.parameters().items() if v != before.parameters()[k]}
    assert len(extended.chain.stages) >= len(NOMINAL.chain.stages)
    assert changed <= named
    if extended.load != NOMINAL.load:
        assert all(path.startswith("load.") for path in named)
    unlike = extended.chain != NOMINAL.chain or extended.load != NOMINAL.load
    assert unlike or extended.host_offset != 0.0 or extended.host_scale != 1.0


@pytest.mark.parametrize("name", CAUSES)
def test_the_mjcf_of_every_cause_compiles_without_the_law(name: str) -> None:
    import mujoco

    model = mujoco.MjModel.from_xml_string(native_mjcf(NOMINAL.with_fitted(chosen(CAUSES[name])), PARAMS))
    assert model.nu == 1
    assert model.actuator_biastype[0] != mujoco.mjtBias.mjBIAS_USER


@pytest.mark.parametrize(
    ("values", "left_out"),
    [
        ({"friction.load": 0.1}, ["friction.load"]),
        ({"friction.stribeck": 0.1, "friction.stribeck_velocity": 0.2}, ["friction.stribeck"]),
        ({"friction.bristle_stiffness": 4.0}, ["friction.bristle_stiffness"]),
        ({"dead_band.width": 0.01}, ["dead_band.width"]),
        ({"minimum_duty.value": 0.1}, ["minimum_duty.value"]),
        ({"supply.resistance": 0.3}, ["supply.resistance"]),
        ({"encoder.latency": 0.004}, ["encoder.latency"]),
        ({"encoder.scale": 0.97}, ["encoder.scale"]),
        ({"offset.value": 0.01}, ["offset.value"]),
        ({"thermal.loss": 0.01}, ["thermal.loss"]),
    ],
)
def test_what_is_not_native_is_listed(values: dict[str, float], left_out: list[str]) -> None:
    assert not_native(NOMINAL.with_values(values).chain) == left_out


def test_a_chain_without_a_native_actuator_lists_all_of_it_and_still_loads(tmp_path: Path) -> None:
    import mujoco

    chain = load_chain("regression")
    path = tmp_path / "extended.xml"
    path.write_text(native_mjcf(JointModel(chain), PARAMS))
    assert mujoco.MjModel.from_xml_path(str(path)).nu == 0
    assert any(name.startswith("regression.") for name in not_native(chain))


def test_a_rate_limit_of_an_ideal_servo_is_listed() -> None:
    chain = load_chain([{"rate_limit": {"speed": 2.0}}, {"ideal": {"stiffness": 10.0, "damping": 0.1}}])
    assert not_native(chain) == ["rate_limit.speed"]


def test_a_torque_limit_before_a_gear_is_that_of_the_joint_in_the_mjcf() -> None:
    joint = JointModel(load_chain("ak80_6"))
    ratio = joint.chain.gear_ratio()
    assert ratio > 1.0
    (cause,) = [cause for cause in catalogue(joint) if cause.name == "drive.overload"]
    (number,) = cause.variants[0]
    limited = joint.with_values({"torque_limit.limit": 1.0})
    assert f'saturation="{ratio:.9g} 0 0"' in native_mjcf(limited, PARAMS)
    stall = ratio * joint.value("dc_motor.motor_constant") * joint.value("supply.volts")
    assert ratio * number.low < 0.05 * stall / joint.value("dc_motor.resistance")


def test_a_load_that_the_search_found_is_that_of_the_bench_in_the_engine() -> None:
    params = {"mass": 0.1, "arm_mass": 0.1, "length": 0.12}
    found = {"load.mass_factor": 1.4, "load.extra_inertia": 0.0026, "load.centre_shift": 0.01, "load.stop_angle": 0.7}
    joint = NOMINAL.with_values(found)
    model = bench(joint, params).model
    body, data = model.body("pendulum").id, mujoco.MjData(model)
    data.qpos[0] = np.pi / 2.0
    mujoco.mj_forward(model, data)
    weight = model.body_mass[body] * GRAVITY * abs(data.xipos[body][0])
    inertia = model.body_inertia[body][0] + model.body_mass[body] * model.body_ipos[body][2] ** 2
    assert weight == pytest.approx(joint.load.gravity_torque(params))
    assert inertia == pytest.approx(joint.load.inertia(params))
    assert model.jnt_limited[0] and model.jnt_range[0][1] == pytest.approx(0.7)
