"""Chains as data: what is read, refused, changed and written."""

from __future__ import annotations

import dataclasses
import math
import re
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from sealegs.actuators import Chain, ChainError, Drivetrain, load_chain
from sealegs.actuators.chain import load_chain_set, names, set_names
from sealegs.actuators.documentation import PAGE, page
from sealegs.actuators.law import advance, begin, torque
from sealegs.actuators.layout import P_STATE_SIZE
from sealegs.actuators.stages import Quantity, Stage, build_stage, known_stages, order
from sealegs.actuators.stages.base import in_order, parameter, register
from sealegs.actuators.stages.friction import Friction
from sealegs.actuators.stages.parity import ANGLE, EVEN, ODD, Phase, Swapped
from sealegs.actuators.turning import apart
from sealegs.configs.script import help_page
from sealegs.gap.load.robot import Frame

from tests.gap.replay.test_driven_replay import RIGID, drive

MOTOR = [{"supply": {"volts": 7.4}}, {"dc_motor": {"motor_constant": 1.2, "resistance": 2.7}}]
SERVO = [{"position_p": {"gain": 5.0}}, *MOTOR]
IDEAL = {"ideal": {"stiffness": 5.0}}


@pytest.mark.parametrize("name", names())
def test_a_named_chain_survives_being_written_and_read(name, tmp_path):
    chain = load_chain(name)
    path = tmp_path / "chain.yaml"
    path.write_text(chain.to_yaml())
    assert load_chain(path).stages == chain.stages


def test_the_servos_of_the_literature_have_names():
    assert {"ideal", "regression", "net", "sts3215", "xl330", "sv1270tg", "ak80_6"} <= set(names())


def test_every_stage_has_its_place_in_the_order():
    assert set(order()) == set(known_stages())


def test_the_documentation_is_that_of_the_stages():
    assert PAGE.read_text(encoding="utf-8") == page(), "run python -m sealegs.actuators.documentation"


def refusal(stages) -> str:
    with pytest.raises(ChainError) as caught:
        load_chain(stages)
    sentence = str(caught.value)
    assert sentence.endswith(".") and "\n" not in sentence
    return sentence


@pytest.mark.parametrize(
    ("stages", "words"),
    [
        ([{"positon_p": {"gain": 5.0}}], "there is no stage 'positon_p' (did you mean 'position_p'?)"),
        ([{"position_p": {"gian": 5.0}}], "has no parameter 'gian' (did you mean 'gain'?)"),
        ([{"position_p": {}}], "needs the parameter 'gain', a number in 1/rad"),
        ([{"position_p": {"gain": "5 N.m"}}], "wrong unit in '5 N.m'; it is a bare number in 1/rad"),
        ([{"position_p": {"gain": "high"}}], "must be a number in 1/rad, not 'high'"),
        ([{"position_p": {"gain": float("nan")}}], "gain is nan; it must lie between"),
        ([{"position_p": {"gain": True}}], "must be a number"),
        ([{"delay": {"seconds": "5 ms"}}, *SERVO], "write 0.005, a number in s"),
        ([{"delay": {"seconds": 20}}, *SERVO], "(20 milliseconds would be 0.02)"),
        ([*SERVO, {"backlash": {"width": 2}}], "(2 degrees would be 0.03491)"),
        ([*SERVO, {"encoder": {"offset": "90 deg"}}], "write 1.5708, a number in rad"),
        ([{"rate_limit": {"speed": "60 rpm"}}, *SERVO], "write 6.28319, a number in rad/s"),
        ([*MOTOR, {"position_p": {"gain": 5.0}}], "in the order position_p > supply > dc_motor"),
        (MOTOR, "add what misses"),
        ([{"position_p": {"gain": 5.0}}], "the chain ends in duty"),
        ([*SERVO, {"encoder": {}}, {"friction": {}}], "must end in the order friction > meshing > spring"),
        ([*SERVO, {"friction": {}}, {"friction": {}}], "'friction' stands 2 times"),
        ([*SERVO, {"friction": {}}, {"gear": {"ratio": 2}}], "'gear' must stand directly behind its motor"),
        (
            [IDEAL, {"torque_limit": {"limit": 1}}, {"gear": {"ratio": 2}}],
            "'gear' must stand directly behind its motor",
        ),
        ([*SERVO, {"offset": {"value": 1}}, {"torque_limit": {"limit": 1}}, {"gear": {"ratio": 2}}], "directly behind"),
        ([IDEAL, {"thermal": {"loss": 0.01}}], "'thermal' weakens a 'dc_motor', which the chain lacks"),
        ([*SERVO, {"spring": {"stiffness": 1}}, {"compliance": {"stiffness": 1}}], "the same element"),
        (
            [
                {"position_p": {"gain": 5.0}},
                {"supply": {"volts": 7.0, "resistance": 0.1}},
                {"current_limit": {"limit": 1}},
            ],
            "the chain ends in voltage",
        ),
        ([{"net": {"file": "nowhere.npz"}}], "there is no actuator net at nowhere.npz"),
        ([["position_p", 5.0]], "expected one 'name: {parameters}'"),
        ([], "a chain is a list of stages"),
        ([{"position_p": [5.0]}], "needs its parameters as 'name: value' pairs"),
    ],
)
def test_a_wrong_chain_is_refused_with_one_sentence(stages, words):
    assert words in refusal(stages)


def test_a_wrong_name_is_answered_with_the_nearest_right_one():
    assert "did you mean 'sts3215'?" in refusal("sts321")
    assert "not 5" in refusal(5)


def test_help_and_error_list_the_same_actuators():
    """The error left out the sets for the joints of one robot, which the help page lists and robots take."""
    page = help_page("train", "").partition("actuator=")[2].partition("  agent")[0]
    listed = set(re.findall(r"\w+", page.partition("\n\n")[0]))
    with pytest.raises(ChainError) as refusal:
        load_chain("no such chain")
    said = str(refusal.value).partition("give one of ")[2].partition(" or the path")[0]
    assert set(said.split(", ")) == listed and {"sts3215", "silo4_pd"} <= listed


def test_a_typing_error_in_a_file_is_named_with_its_line(tmp_path):
    path = tmp_path / "chain.yaml"
    path.write_text("- delay: {seconds: 0.005}\n- position_p: {gain: 5.0\n")
    assert re.search(r"chain\.yaml is not valid YAML in line \d", refusal(path))
    assert "cannot be read" in refusal(tmp_path / "missing.yaml")


def test_yaml_numbers_that_yaml_itself_takes_for_text_are_numbers(tmp_path):
    path = tmp_path / "chain.yaml"
    path.write_text("- delay: {seconds: 5e-3}\n- position_p: {gain: 5}\n- supply: {volts: 7}\n")
    with pytest.raises(ChainError):
        load_chain(path)  # no motor yet, but no complaint about 5e-3
    path.write_text(path.read_text() + "- dc_motor: {motor_constant: 1, resistance: 2}\n")
    assert load_chain(path).value("delay.seconds") == 0.005


def test_a_changed_parameter_leaves_the_chain_it_came_from():
    chain = load_chain("sts3215")
    assert chain.with_value("friction.coulomb", 0.2).value("friction.coulomb") == 0.2
    assert chain.value("friction.coulomb") == 0.052
    with pytest.raises(ChainError, match="did you mean 'coulomb'"):
        chain.with_value("friction.coulom", 0.2)
    with pytest.raises(ChainError, match="has no stage 'frictio'"):
        chain.with_value("frictio.coulomb", 0.2)


def test_a_new_stage_is_put_where_it_belongs():
    chain = load_chain("sts3215")
    longer = chain.with_stage(build_stage("rate_limit", {"speed": 5.0}, "test"))
    assert str(longer).startswith("delay > rate_limit > position_p")
    longer = longer.with_stage(build_stage("backlash", {"width": 0.01}, "test"))
    assert str(longer).endswith("friction > backlash > encoder")
    assert longer.without_stage("backlash").without_stage("rate_limit").stages == chain.stages
    replaced = chain.with_stage(Friction(coulomb=0.3))
    assert len(replaced.stages) == len(chain.stages) and replaced.value("friction.coulomb") == 0.3


def test_the_gear_carries_the_motor_to_the_joint():
    chain = load_chain([*SERVO, {"gear": {"ratio": 10.0}}]).with_value("dc_motor.armature", 1e-4)
    assert chain.gear_ratio() == 10.0
    assert chain.armature() == pytest.approx(1e-2)


def test_every_numeric_parameter_has_unit_bounds_and_meaning():
    for stage in known_stages().values():
        for item in dataclasses.fields(stage):
            if item.name == "file":
                continue
            assert item.metadata["unit"] and item.metadata["doc"], f"{stage.name}.{item.name}"
            assert item.metadata["low"] < item.metadata["high"]


def test_the_order_of_a_chain_comes_from_the_stages_themselves():
    assert (
        *("delay", "scale", "offset", "goal_filter", "rate_limit", "dead_band"),
        *("position_p", "position_pd", "position_pi", "ideal", "torque_command"),
        *("velocity_pi", "ideal_velocity", "derivative", "net"),
        *("duty_step", "minimum_duty", "duty_limit", "regression", "supply", "current_limit", "dc_motor"),
        *("torque_limit", "gear", "thermal", "friction", "meshing", "spring", "compliance", "backlash", "encoder"),
    ) == order()


def test_a_stage_that_nothing_follows_stands_directly_behind_the_one_it_names():
    class Newcomer(Stage):
        name = "newcomer"
        after = "gear"

    names = in_order({**known_stages(), "newcomer": Newcomer})
    assert names[names.index("gear") + 1] == "newcomer"


@pytest.mark.parametrize("name", names())
def test_every_number_of_a_law_stands_in_the_program_where_its_field_says(name):
    chain = load_chain(name)
    program = chain.program()
    for stage in chain.stages:
        if stage.law is not None:
            values = stage.law_values(chain)
            assert {key: program[chain.address(f"{stage.name}.{key}")] for key in stage.record_names()} == values


def test_a_neutral_stage_changes_no_torque():
    for name, stage in known_stages().items():
        try:
            neutral = stage.neutral()
        except ChainError:
            continue
        chain = load_chain("sts3215")
        if chain.find(name) is not None or name in ("compliance", "backlash"):
            continue
        assert _torques(chain.with_stage(neutral)) == pytest.approx(_torques(chain), rel=1e-12), name


def _torques(chain: Chain) -> list[float]:
    program = chain.program()
    state = np.zeros(int(program[P_STATE_SIZE]))
    begin(program, state, 0.0, 0.0, 0.0, 0.0)
    found = []
    for k in range(50):
        if k:
            advance(program, state, k * 0.01)
        goal = 0.3 * np.sin(0.1 * k)
        torque(program, state, k * 0.01, goal, 0.1, 0.2, 0.0, True)
        found.append(torque(program, state, k * 0.01 + 0.005, goal, 0.1, 0.2, 0.0, False))
    return found


# --- A drive stays the same where its joint's angle is counted otherwise, whatever its stages ------------------------

FRAMES = [(0, -1.0), (300, 1.0), (-250, -1.0)]
"""Zeros in ticks of the encoder, and directions."""
TURNED_SERVO = [
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
    delay, controller, *drive, friction = load_chain(TURNED_SERVO).stages
    if stage.gives is Quantity.DUTY:
        return Chain((delay, stage, *drive, friction))
    if stage.name == "regression":
        return Chain((delay, controller, stage, friction))
    return load_chain(TURNED_SERVO).with_stage(stage)


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
    "spring": [*TURNED_SERVO, {"spring": {"stiffness": 8.0, "damping": 0.1}}],
    "spring against a stop": [*TURNED_SERVO, {"spring": {"stiffness": 8.0, "inertia": 0.01, "unilateral": 1}}],
    "play": [*TURNED_SERVO, {"backlash": {"width": 0.05}}],
    "friction": [
        *TURNED_SERVO[:-1],
        {"friction": {"coulomb": 0.1, "asymmetry": 0.06, "ripple": 0.05, "ripple_count": 3.0}},
    ],
    "latency": [*TURNED_SERVO, {"encoder": {"offset": 0.1, "scale": 1.02, "latency": 0.01}}],
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
    chain = load_chain([*TURNED_SERVO[:-1], {"friction": {"coulomb": 0.05, "asymmetry": 0.02}}])
    assert apart(chain) < 1e-9
    assert apart(Chain((*chain.stages[:-1], Stubborn(coulomb=0.05, asymmetry=0.02)))) > 1e-3


class Stubborn(Friction):
    """Friction that does not turn."""

    def turned(self, frame: Any) -> Stage:
        del frame
        return self
