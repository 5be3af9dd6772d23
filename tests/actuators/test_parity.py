"""A drive stays the same where its joint's angle is counted otherwise, whatever its stages."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from sealegs.actuators import Drivetrain
from sealegs.actuators.chain import Chain, load_chain, load_chain_set, names, set_names
from sealegs.actuators.stages import ChainError, Quantity, Stage, known_stages
from sealegs.actuators.stages.base import parameter, register
from sealegs.actuators.stages.friction import Friction
from sealegs.actuators.stages.parity import ANGLE, EVEN, ODD, Phase, Swapped
from sealegs.actuators.turning import apart
from sealegs.gap.load.robot import Frame

from tests.gap.replay.test_driven_replay import RIGID, drive

FRAMES = [(0, -1.0), (300, 1.0), (-250, -1.0)]
"""Zeros in ticks of the encoder, and directions."""
SERVO = [
    {"delay": {"seconds": 0.011}},
    {"position_pi": {"gain": 5.3, "integral": 2.0, "damping": 0.05}},
    {"supply": {"volts": 7.4}},
    {"dc_motor": {"motor_constant": 1.2, "resistance": 2.7, "armature": 0.02}},
    {"friction": {"coulomb": 0.05, "viscous": 0.06}},
]
NET = [{"net": {"file": "configs/actuator/sts3215_net.npz"}}, {"encoder": {"ticks": 4096}}]
CHAINS = [*names(), *(f"{name}: {pattern}" for name in set_names() for pattern in load_chain_set(name) or {})]


def angle(chain: Chain, ticks: int) -> float:
    """So many ticks of a chain's encoder [rad]; of one without ticks, of 4096 a turn."""
    encoder = chain.find("encoder")
    return ticks * 2.0 * math.pi / ((encoder.ticks if encoder is not None else 0.0) or 4096.0)


@pytest.mark.parametrize(("ticks", "sign"), FRAMES)
@pytest.mark.parametrize("name", CHAINS)
def test_every_chain_that_is_shipped_turns_with_its_joint(name: str, ticks: int, sign: float) -> None:
    """The chain ``net`` was 1.2 % off: a net that was trained on one servo is not quite the same in both directions."""
    chain_set, _, pattern = name.partition(": ")
    chain = (load_chain_set(chain_set) or {})[pattern] if pattern else load_chain(name)
    assert apart(chain, angle(chain, ticks), sign) < 1e-9


def holding(stage: Stage) -> Chain:
    """A servo with a stage where it belongs."""
    if stage.gives is Quantity.TORQUE and stage.takes in ((Quantity.POSITION_GOAL,), (Quantity.SPEED_GOAL,)):
        return Chain((stage,))
    delay, controller, *drive, friction = load_chain(SERVO).stages
    if stage.gives is Quantity.DUTY:
        return Chain((delay, stage, *drive, friction))
    if stage.name == "regression":
        return Chain((delay, controller, stage, friction))
    return load_chain(SERVO).with_stage(stage)


def values_of(stage: type[Stage]) -> st.SearchStrategy[dict[str, Any]]:
    """Numbers of a stage within its bounds, of sizes that are met."""
    drawn: dict[str, st.SearchStrategy[Any]] = {}
    for item in dataclasses.fields(stage):
        if item.name == "file":
            drawn["file"] = st.just("configs/actuator/sts3215_net.npz")
        elif (stage.name, item.name) == ("net", "direction"):
            drawn["direction"] = st.sampled_from([-1.0, 1.0])
        elif (stage.name, item.name) in (("net", "rate"), ("encoder", "ticks")):
            continue
        else:
            low, high = item.metadata["low"], item.metadata["high"]
            drawn[item.name] = st.floats(max(low, -2.0), max(min(high, 2.0), 1.1 * low))
    return st.fixed_dictionaries({}, optional=drawn)


@pytest.mark.parametrize("name", known_stages())
@settings(max_examples=30, deadline=None, derandomize=True, database=None)
@given(data=st.data())
def test_every_stage_turns_with_its_joint(name: str, data: st.DataObject) -> None:
    stage = known_stages()[name]
    needed = {item.name for item in dataclasses.fields(stage) if item.default is dataclasses.MISSING}
    values = data.draw(values_of(stage))
    assume(needed <= set(values))
    # where an output jumps, another zero moves the moment by rounding; another direction does not
    ticks, sign = data.draw(st.sampled_from(FRAMES[:1] if stage.switches else FRAMES))
    try:
        chain = holding(stage(**values))
    except ChainError:
        assume(False)
        raise
    zero = angle(chain, ticks)
    assert apart(chain, zero, sign) < 1e-6
    for before, after in zip(chain.stages, chain.turned(zero, sign).turned(-sign * zero, sign).stages, strict=True):
        assert before.parameters() == pytest.approx(after.parameters(), abs=1e-9)


MIRRORED = {
    "spring": [*SERVO, {"spring": {"stiffness": 8.0, "damping": 0.1}}],
    "spring against a stop": [*SERVO, {"spring": {"stiffness": 8.0, "inertia": 0.01, "unilateral": 1}}],
    "play": [*SERVO, {"backlash": {"width": 0.05}}],
    "friction": [*SERVO[:-1], {"friction": {"coulomb": 0.1, "asymmetry": 0.06, "ripple": 0.05, "ripple_count": 3.0}}],
    "latency": [*SERVO, {"encoder": {"offset": 0.1, "scale": 1.02, "latency": 0.01}}],
    "net": NET,
}


@pytest.mark.parametrize("name", MIRRORED)
def test_a_mirrored_joint_moves_mirrored_in_the_engine(name: str) -> None:
    chain = load_chain(MIRRORED[name])
    own, mirrored = moved(chain, 1.0), moved(chain.turned(0.0, -1.0), -1.0)
    assert np.ptp(own) > 0.1
    np.testing.assert_allclose(-mirrored, own, atol=1e-6)


def moved(chain: Chain, sign: float) -> np.ndarray:
    """Angles (n,) of a pendulum whose drive is told the same goals, in the frame of ``sign``."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.integrator = 0.001, mujoco.mjtIntegrator.mjINT_RK4
    arm = spec.worldbody.add_body(name="arm")
    arm.add_joint(name="joint", axis=(0.0, 1.0, 0.0))
    arm.add_geom(size=(0.02, 0.0, 0.0), pos=(0.0, 0.0, -0.12), mass=0.5)
    model = Drivetrain(spec, {"joint": chain}).model
    data = mujoco.MjData(model)
    angles = []
    for k in range(600):
        data.ctrl[0] = sign * (0.6 * math.sin(0.01 * k) + 0.3 * (k > 300))
        mujoco.mj_step(model, data)
        angles.append(data.qpos[0])
    return np.array(angles)


@pytest.mark.parametrize(("zero", "sign"), [(0.4, -1.0), (-0.3, 1.0)])
def test_a_chain_in_the_frame_of_the_model_gives_the_torques_of_the_log_there(zero: float, sign: float) -> None:
    """The phase of friction over the angle was left as it was: other angles then had the extended model's friction."""
    frame = Frame(zero, sign)
    friction = {"coulomb": 0.05, "viscous": 0.3, "ripple": 0.03, "ripple_count": 5.0, "ripple_phase": 0.7}
    sensor = {"encoder": {"scale": 1.02, "offset": 0.01}}
    chain = load_chain([*(row for row in RIGID[:-1] if "friction" not in row), {"friction": friction}, sensor])
    time = np.arange(0.0, 3.0, 0.005)
    motion = np.stack([0.8 * np.sin(2.5 * time), 2.0 * np.cos(2.5 * time), -5.0 * np.sin(2.5 * time)], axis=1)
    goal = motion[:, 0] + 0.02 * np.cos(1.7 * time)
    there = np.stack([frame.to_model(motion[:, 0]), sign * motion[:, 1], sign * motion[:, 2]], axis=1)
    logged = drive(chain.to_list(), goal, motion, time)
    modelled = drive(frame.chain_to_model(chain).to_list(), frame.to_model(goal), there, time)
    np.testing.assert_allclose(modelled[5:, 1:], sign * logged[5:, 1:], atol=1e-9)
    assert frame.chain_to_log(frame.chain_to_model(chain)).value("friction.ripple_phase") == pytest.approx(0.7)


def stage_with(**parameters: Any) -> type[Stage]:
    """A new class of stages with these parameters."""
    body = {"name": "newcomer", "after": "gear", "takes": (Quantity.TORQUE,), "__annotations__": {}}
    body |= parameters
    body["__annotations__"] = dict.fromkeys(parameters, float)
    return dataclass(frozen=True, kw_only=True)(type("Newcomer", (Stage,), body))


@pytest.mark.parametrize(
    ("parameters", "sentence"),
    [
        ({"size": parameter(0.0, "N.m", 0.0, 1.0, "a size")}, r"newcomer.size does not state .* parity=EVEN"),
        ({"bias": parameter(0.0, "N.m", 0.0, 1.0, "a bias", parity=ODD)}, r"newcomer.bias changes sign.* 0 and 1"),
        (
            {"up": parameter(0.0, "N.m", 0.0, 1.0, "one way", parity=Swapped("down"))},
            r"newcomer.up swaps with 'down', which must swap with it",
        ),
        (
            {"phase": parameter(0.0, "rad", -4.0, 4.0, "a phase", parity=Phase("count"))},
            r"newcomer.phase is the phase of 'count', which is no parameter",
        ),
        (
            {
                "count": parameter(1.0, "1/turn", 0.0, 9.0, "periods", parity=EVEN),
                "phase": parameter(0.0, "rad", 0.0, 1.0, "a phase", parity=Phase("count")),
            },
            r"newcomer.phase is a phase, so its bounds must hold all",
        ),
        ({"at": parameter(0.0, "rad", -1.0, 2.0, "an angle", parity=ANGLE)}, r"newcomer.at changes sign"),
    ],
)
def test_a_stage_that_does_not_say_how_it_turns_is_refused(parameters: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ChainError, match=sentence):
        register(stage_with(**parameters))
    assert "newcomer" not in known_stages()


def test_a_stage_that_states_its_parity_wrongly_is_found() -> None:
    """Friction that differs between the directions, called even: the check must have teeth."""
    chain = load_chain([*SERVO[:-1], {"friction": {"coulomb": 0.05, "asymmetry": 0.02}}])
    assert apart(chain) < 1e-9
    assert apart(Chain((*chain.stages[:-1], Stubborn(coulomb=0.05, asymmetry=0.02)))) > 1e-3


class Stubborn(Friction):
    """Friction that does not turn."""

    def turned(self, frame: Any) -> Stage:
        del frame
        return self
