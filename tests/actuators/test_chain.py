"""Chains as data: what is read, refused, changed and written."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from sealegs.actuators import Chain, ChainError, load_chain
from sealegs.actuators.chain import names
from sealegs.actuators.documentation import PAGE, page
from sealegs.actuators.law import advance, begin, torque
from sealegs.actuators.layout import P_STATE_SIZE
from sealegs.actuators.stages import Stage, build_stage, known_stages, order
from sealegs.actuators.stages.base import in_order
from sealegs.actuators.stages.friction import Friction
from sealegs.configs.script import help_page

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
