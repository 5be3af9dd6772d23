"""A policy file from anybody: what does not fit its contract is refused as it is loaded, and loading is bounded."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper
from sealegs.configs.compose import compose
from sealegs.envs.contract import KEY, ContractError
from sealegs.evaluation.comparison import compare
from sealegs.hw.machine.robot import build_robot
from sealegs.hw.run import policy as policy_module
from sealegs.hw.run.commands import PolicyCommands
from sealegs.hw.run.deployment import prepare
from sealegs.hw.run.policy import Policy, PolicyError

from tests.servo_runs import config, gentle_policy

FLOAT, DOUBLE = TensorProto.FLOAT, TensorProto.DOUBLE
Change = Callable[[onnx.ModelProto], None]


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return gentle_policy(tmp_path_factory.mktemp("policy") / "policy.onnx")


def changed(good: Path, folder: Path, change: Change) -> Path:
    """The policy with its graph changed."""
    model = onnx.load(good)
    change(model)
    (path := folder / "changed.onnx").write_bytes(model.SerializeToString())
    return path


def node(operator: str, *inputs: str, output: str, **attributes: Any) -> onnx.NodeProto:
    return helper.make_node(operator, list(inputs), [output], **attributes)


def constant(model: onnx.ModelProto, name: str, value: Any) -> str:
    model.graph.initializer.append(numpy_helper.from_array(np.asarray(value), name))
    return name


def replaced(output: str, *nodes: onnx.NodeProto, **constants: Any) -> Change:
    """Another origin of an output; ``was`` is what it was."""

    def change(model: onnx.ModelProto) -> None:
        for made in model.graph.node:
            made.output[:] = ["was" if name == output else name for name in made.output]
            made.input[:] = ["was" if name == output else name for name in made.input]
        for name, value in constants.items():
            constant(model, name, value)
        model.graph.node.extend(nodes)

    return change


def declared(side: str, name: str, kind: int | None = None, shape: list[Any] | None = None) -> Change:
    """Another declaration of an input or output, and for an output another tensor to go with it."""

    def change(model: onnx.ModelProto) -> None:
        (item,) = (item for item in getattr(model.graph, side) if item.name == name)
        was = item.type.tensor_type
        sizes = [size.dim_param or size.dim_value for size in was.shape.dim] if shape is None else shape
        item.CopyFrom(helper.make_tensor_value_info(name, kind or was.elem_type, sizes))

    return change


def both(*changes: Change) -> Change:
    def change(model: onnx.ModelProto) -> None:
        for one in changes:
            one(model)

    return change


def more(model: onnx.ModelProto) -> None:
    model.graph.input.append(helper.make_tensor_value_info("image", FLOAT, [1, 3]))


def renamed(model: onnx.ModelProto) -> None:
    model.graph.node.append(node("Identity", "goal", output="target"))
    declared("output", "goal")(model)
    (item,) = (item for item in model.graph.output if item.name == "goal")
    item.name = "target"


WRONG: dict[str, tuple[Change, str]] = {
    "an input that no policy gets": (more, "wants an input 'image', which no policy gets"),
    "no output of goals": (renamed, "has no output 'goal'"),
    "goals of too many joints, declared": (
        both(
            replaced("goal", node("Concat", "was", "was", output="goal", axis=1)),
            declared("output", "goal", shape=["n", 2]),
        ),
        "its output 'goal' is (n, 2) of float64, and by its contract it must be (n, 1)",
    ),
    "goals of too many joints, seen only in a call": (
        both(
            replaced(
                "goal",
                node("Mul", "command", "zero", output="zeros"),
                node("ReduceSum", "zeros", output="sum", keepdims=0),
                node("Cast", "sum", output="nothing", to=TensorProto.INT64),
                node("Add", "nothing", "two", output="size"),
                node("Expand", "was", "size", output="goal"),
                zero=np.float64(0.0),
                two=np.array([1, 2]),
            ),
            declared("output", "goal", shape=["n", "m"]),
        ),
        "gave 'goal' as (1, 2) of float64, and its contract says (1, 1)",
    ),
    "goals that are whole numbers": (
        both(
            replaced("goal", node("Cast", "was", output="goal", to=TensorProto.INT64)),
            declared("output", "goal", TensorProto.INT64),
        ),
        "its output 'goal' is (n, 1) of tensor(int64)",
    ),
    "an observation of another size": (
        declared("input", "observation", shape=["n", 99]),
        "its input 'observation' is (n, 99) of float32, and by its contract it must be (n, ",
    ),
    "an observation of another rank": (
        declared("input", "observation", shape=["n", 1, 4]),
        "its input 'observation' is (n, 1, 4)",
    ),
    "more rows than one": (declared("input", "command", shape=[8, 1]), "its input 'command' is (8, 1)"),
}


def refusal(path: Path) -> str:
    with pytest.raises(ContractError) as caught:
        Policy(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("what", WRONG)
def test_a_file_that_is_not_what_its_contract_says_is_refused_as_it_is_loaded(
    what: str, good: Path, tmp_path: Path
) -> None:
    change, says = WRONG[what]
    said = refusal(changed(good, tmp_path, change))
    assert says in said or "no ONNX file that can be read" in said, said
    if "another" not in what:  # where onnxruntime itself sees that the graph does not fit
        assert says in said, said


def test_deploy_dry_or_not_and_evaluate_refuse_it_before_they_open_anything(good: Path, tmp_path: Path) -> None:
    path = changed(good, tmp_path, WRONG["goals of too many joints, seen only in a call"][0])
    for script, does in (("deploy", prepare), ("evaluate", lambda settings: compare(settings, tmp_path))):
        with pytest.raises(ContractError, match=r"gave 'goal' as \(1, 2\)"):
            does(compose(script, {"policy": str(path)}))


def said(**values: Any) -> Change:
    """Another contract."""

    def change(model: onnx.ModelProto) -> None:
        (entry,) = (entry for entry in model.metadata_props if entry.key == KEY)
        entry.value = json.dumps({**json.loads(entry.value), **values})

    return change


def test_a_delay_that_no_cycle_has_room_for_is_refused_as_the_file_is_loaded(good: Path, tmp_path: Path) -> None:
    """The dry run said nothing, and half a second after torque came on the supervisor ended a loop that slept."""
    with pytest.raises(ContractError, match=r"delay is 1e\+09 s, and must be less than the 0\.02 s of a goal"):
        Policy(changed(good, tmp_path, said(delay=1e9)))
    assert Policy(changed(good, tmp_path, said(delay=0.019))).contract.delay == 0.019


def test_an_argument_that_the_environment_does_not_have_is_told_as_the_contracts(good: Path, tmp_path: Path) -> None:
    env = {**Policy(good).contract.env, "nothing": 1}
    policy = Policy(changed(good, tmp_path, said(env=env)))
    robot = build_robot(compose("deploy", {})["robot"])
    with pytest.raises(ContractError, match=r"the policy's contract: there is no argument 'nothing'"):
        policy.contract.task_on(robot.robot)


def not_finite(output: str) -> Change:
    return replaced(output, node("Mul", "was", "none", output=output), none=np.float64(np.nan))


@pytest.mark.parametrize("output", ["goal", "next_state"])
def test_what_is_not_finite_is_refused_before_a_run(output: str, good: Path, tmp_path: Path) -> None:
    policy = Policy(changed(good, tmp_path, not_finite(output)))
    with pytest.raises(PolicyError, match=f"gave '{output}' that is not finite"):
        PolicyCommands(policy, build_robot(config()["robot"]))


def test_an_observation_that_is_not_finite_is_named_with_what_came_of_it(good: Path) -> None:
    policy = Policy(good)
    names = policy.contract.observation_names
    observation, command = np.zeros((1, len(names)), np.float32), np.zeros((1, policy.contract.commands))
    observation[0, 1:] = np.nan
    with pytest.raises(PolicyError, match=re.escape(f"neither is '{names[1]}' of its observation")):
        policy.act(observation, command, np.asarray(policy.contract.state)[None])
    with pytest.raises(PolicyError, match="broke off"):
        policy.act(observation[:, 1:], command, np.asarray(policy.contract.state)[None])


# --- files that mean harm -------------------------------------------------------------------------------------------


def for_ever() -> onnx.GraphProto:
    """A body that changes nothing and never ends."""
    flags = [helper.make_tensor_value_info(name, TensorProto.BOOL, []) for name in ("goes", "on")]
    value = [helper.make_tensor_value_info(name, DOUBLE, None) for name in ("value", "same")]
    step = helper.make_tensor_value_info("step", TensorProto.INT64, [])
    nodes = [node("Identity", "goes", output="on"), node("Identity", "value", output="same")]
    return helper.make_graph(nodes, "body", [step, flags[0], value[0]], [flags[1], value[1]])


def elsewhere(model: onnx.ModelProto) -> None:
    """Weights in another file, as ``location`` of a tensor says."""
    tensor = model.graph.initializer[0]
    size = len(numpy_helper.to_array(tensor).tobytes())
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    for key, value in (("location", "secret.bin"), ("offset", "0"), ("length", str(size))):
        entry = tensor.external_data.add()
        entry.key, entry.value = key, value


def functions(model: onnx.ModelProto) -> None:
    """Functions that call one another ten times each, as entities of XML did in a billion laughs."""
    opset = [helper.make_operatorsetid("", 18), helper.make_operatorsetid("own", 1)]
    model.opset_import.append(opset[1])
    for depth in range(12):
        inner = [
            helper.make_node(
                "Identity" if depth == 0 else f"f{depth - 1}", [f"x{k}"], [f"x{k + 1}"], domain="own" if depth else ""
            )
            for k in range(10)
        ]
        model.functions.append(helper.make_function("own", f"f{depth}", ["x0"], ["x10"], inner, opset))


def foreign(model: onnx.ModelProto) -> None:
    model.opset_import.append(helper.make_operatorsetid("evil", 1))
    replaced("goal", helper.make_node("Evil", ["was"], ["goal"], domain="evil"))(model)


HUGE = replaced(
    "goal",
    node("ConstantOfShape", "size", output="all"),
    node("ReduceSum", "all", output="sum"),
    node("Cast", "sum", output="one", to=DOUBLE),
    node("Add", "was", "one", output="goal"),
    size=np.array([1 << 33]),
)


def words(kind: str) -> Change:
    """Text that is made, whose memory is outside of what policies may compute in."""
    text = numpy_helper.from_array(np.array(["x" * 1000], object), "text")
    made = {
        "cast": node("Cast", "was", output="text", to=TensorProto.STRING),
        "constant": node("Constant", output="text", value=text),
        "value": node("Constant", output="text", value_strings=["x" * 1000]),
        "labels": helper.make_node(
            "LabelEncoder", ["none"], ["text"], domain="ai.onnx.ml", keys_int64s=[0], values_strings=["x" * 1000]
        ),
    }
    nodes = [
        node("Mul", "command", "zero", output="zeros"),
        node("Cast", "zeros", output="none", to=TensorProto.INT64),
        *([made[kind]] if kind in made else []),
        node("Expand", "text", "many", output="all"),
        node("Shape", "all", output="size"),
        node("Cast", "size", output="one", to=DOUBLE),
        node("Add", "was", "one", output="goal"),
    ]
    change = replaced("goal", *nodes, zero=np.float64(0.0), many=np.array([300]))

    def changed_graph(model: onnx.ModelProto) -> None:
        model.opset_import.append(helper.make_operatorsetid("ai.onnx.ml", 2))
        change(model)
        if kind == "weight":
            model.graph.initializer.append(text)

    return changed_graph


@pytest.mark.parametrize("kind", ["cast", "constant", "value", "labels", "weight"])
def test_a_policy_that_computes_with_text_is_refused(kind: str, good: Path, tmp_path: Path) -> None:
    """What text takes is not within the memory that policies may compute in."""
    assert "computes with text, whose memory nothing bounds" in refusal(changed(good, tmp_path, words(kind)))


def nested(depth: int) -> onnx.GraphProto:
    """Graphs within graphs."""
    graph = onnx.GraphProto()
    for _ in range(depth):
        outer = onnx.GraphProto()
        outer.node.append(helper.make_node("If", ["x"], ["y"], then_branch=graph))
        graph = outer
    return graph


def test_graphs_that_are_nested_without_an_end_are_no_policy(good: Path, tmp_path: Path) -> None:
    path = changed(good, tmp_path, lambda model: model.graph.CopyFrom(nested(25)))
    assert "no ONNX file that can be read: it is damaged, or of another kind" in refusal(path)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (HUGE, "broke off"),
        (elsewhere, "has weights in another file, and none is read beside it; export the policy as one file."),
        (functions, "holds functions of its own"),
        (foreign, "no ONNX file that can be read"),
    ],
    ids=["gigabytes", "weights of another file", "functions that multiply", "operators of others"],
)
def test_a_file_that_means_harm_is_refused(
    change: Change, says: str, good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "secret.bin").write_bytes(bytes(1 << 16))
    assert says in refusal(changed(good, tmp_path, change))


def test_a_call_that_never_ends_is_broken_off(good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(policy_module, "TRIAL", 0.2)
    endless = replaced(
        "goal",
        node("Loop", "many", "true", "was", output="goal", body=for_ever()),
        many=np.int64(2**62),
        true=np.bool_(True),
    )
    assert "a call took longer than 0.2 s and was broken off" in refusal(changed(good, tmp_path, endless))


def test_a_file_that_is_too_large_or_none_is_refused(
    good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for text in (b"", b"\xff" * 4096, b"\x00" * 64, good.read_bytes()[:-7], b"\x0b" + good.read_bytes()):
        (path := tmp_path / "other.onnx").write_bytes(text)
        assert "no ONNX file that can be read" in refusal(path), text[:8]
    monkeypatch.setattr(policy_module, "SIZE", 1 << 10)
    assert "is larger than" in refusal(good)


def test_the_contract_stays_in_the_files_that_are_changed_here(good: Path, tmp_path: Path) -> None:
    path = changed(good, tmp_path, lambda model: None)
    assert Policy(path).contract == Policy(good).contract
    assert KEY in {entry.key for entry in onnx.load(path).metadata_props}
