"""The extended model as files: nothing but what was named differs, and plain MuJoCo reproduces what is native."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.actuators.gravity import GRAVITY
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.causes.cause import Cause
from sealegs.gap.output.mjcf import native_mjcf, not_native
from sealegs.gap.replay.engine import bench, replay_in_engine
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.parameters import address

from tests.smooth_bench import CHAIN, PARAMS

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
