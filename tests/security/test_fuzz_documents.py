"""Documents that people give, spoiled in thousands of ways: none runs, opens or hangs anything, each gets a sentence.

``make test`` reads some of each kind, ``make test-all`` 1,000 and ``make test-weekly`` 2,000. ``make fuzz`` reads
as many as one likes, from another seed.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import onnx
import pytest
import yaml
from hypothesis import strategies as st
from onnx import TensorProto, helper
from sealegs.actuators.chain import load_chain
from sealegs.actuators.published import bam_stages
from sealegs.configs.compose import compose, override, split
from sealegs.envs.contract import KEY, Contract
from sealegs.envs.described.model_file import read_model
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.randomization import read_randomization
from sealegs.envs.robots import get_robot
from sealegs.gap.log.importers import propose_for
from sealegs.gap.log.importers.expression import column, names_in
from sealegs.gap.log.importers.mapping import converted, read_mapping
from sealegs.gap.log.importers.readers import read_source
from sealegs.gap.log.importers.recording import Recording
from sealegs.gap.log.reader import read_measured
from sealegs.hw.bus.registers import load_model
from sealegs.hw.machine.calibration_file import read_joints
from sealegs.hw.machine.robot import ServoRobot, build_robot
from sealegs.hw.run.policy import Policy
from sealegs.hw.virtual.machine import hide
from sealegs.hw.virtual.wire import read_faults

from tests.fuzzing import (
    CHANGES,
    EXTREMES,
    LONGEST,
    NUMBERS,
    PATHS,
    TEXTS,
    WORDS,
    Change,
    as_json,
    as_xml,
    as_yaml,
    bitten,
    prepare,
    put,
    torn,
    watched,
)

FEW, MANY = 40, 1_000  # inputs of a kind; twice as many weekly
ASKED = int(os.environ.get("SEALEGS_FUZZ", "0"))
"""Inputs a kind that ``make fuzz`` asks for, from the seed beside it."""
SEED = int(os.environ.get("SEALEGS_FUZZ_SEED", "0"))
TEARS = st.one_of(st.just([]), st.just([]), CHANGES)
NUMBER = count()
ROBOTS = Path(__file__).parents[1] / "robots"
MODEL = (ROBOTS / "arm.xml").read_text(encoding="utf-8")
URDF = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 -0.1"/><mass value="0.2"/>
<inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><mesh filename="part.stl" scale="1 1 1"/></geometry></visual>
<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<link name="lower"><inertial><mass value="0.1"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/>
</inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 1" rpy="0 0 0"/>
<axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" effort="3" velocity="5"/>
<dynamics damping="0.1" friction="0.1"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><axis xyz="0 1 0"/>
<limit effort="3" velocity="5"/></joint>
<transmission name="t"><type>SimpleTransmission</type><joint name="elbow"/><actuator name="m">
<mechanicalReduction>50</mechanicalReduction></actuator></transmission></robot>"""
ROBOT = {
    "model": "arm.xml",
    "timestep": 0.002,
    "joints": {
        "shoulder": {"chain": "sts3215", "damping": "chain", "armature": "chain", "servo": {"id": 1}},
        "elbow": {"chain": load_chain("sts3215").to_list(), "servo": {"id": 2}},
    },
    "base": "fixed",
    "deploy": {"servo": "sts3215", "safety": {"max_speed": {"*": 5.0}}, "rate": 100},
}
CHAIN = load_chain("sts3215").to_list()
SIDECAR = {
    "robot": "bench",
    "robot_params": {"mass": 0.5, "length": 0.12},
    "actuators": {"servo": "sts3215"},
    "units": {"servo.position": "rad"},
    "meta": {"date": "2024-02-29", "supply": 12.0},
}
TABLE = "time,servo.goal,servo.position,servo.velocity,servo.current\n" + "".join(
    f"{0.01 * k:.2f},{np.sin(0.1 * k):.4f},{np.sin(0.1 * k - 0.1):.4f},{np.cos(0.1 * k):.4f},{0.1 * k % 3:.3f}\n"
    for k in range(40)
)
FOREIGN = "t_ms;goal (deg);pos_ticks;load\n" + "".join(
    f"{10 * k};{50 * np.sin(0.1 * k):.3f};{int(2048 + 500 * np.sin(0.1 * k - 0.1))};{k % 7}\n" for k in range(60)
)
MAPPING = {
    "columns": {"time": "t", "servo.goal": "goal*pi/180", "servo.position": "(pos - 2048)*2*pi/4096"},
    "constants": {"offset": 2048},
    "questions": [{"about": ["servo.position"], "ask": "Which unit?"}],
    "sidecar": {"robot": "bench", "actuators": {"servo": "sts3215"}, "robot_params": {"mass": "${kp/256}"}},
    "where": "known(pos)",
}
ROWS = [{"t": 0.01 * k, "goal": k % 9, "pos": 2048 + k % 11, "q": [k, k], "imu": {"x": 1.0}} for k in range(30)]
BAM = {"mass": 0.5, "motor": "sts3215", "kp": 16, "vin": 12.0, "length": 0.1, "dt": 0.01, "entries": [
    {"position": 0.1 * k, "goal_position": 0.1, "speed": 0.1, "timestamp": 0.01 * k} for k in range(30)]}  # fmt: skip
FIT = {"model": "m4", "actuator": "sts3215", "kt": 1.0, "R": 2.0, "armature": 0.01, "friction_base": 0.1,
       "friction_viscous": 0.1, "friction_stribeck": 0.1, "load_friction_base": 0.1, "load_friction_stribeck": 0.1,
       "dtheta_stribeck": 1.0, "alpha": 1.0, "load_friction_external": 0.1, "load_friction_motor": 0.1,
       "error_gain": 0.1, "command_delay": 0.01, "max_velocity": 5.0}  # fmt: skip
CALIBRATION = {
    "robot": "bench",
    "servo": "sts3215",
    "date": "2024-02-29T12:00:00+01:00",
    "joints": {"joint": {"id": 1, "zero": 2048, "direction": 1, "range": [-1.0, 1.0], "homing_offset": 85}},
}
HIDDEN = {"delay.seconds": 0.02, "robot.mass": 0.2, "joint": {"friction.coulomb": 0.1, "backlash.width": 0.01}}
FAULTS = [
    {"kind": "drop", "at": 2.0, "seconds": 1.0, "servos": [1]},
    {"kind": "late", "delay": 0.1, "probability": 0.5},
]
RANDOMIZED = {"floor": {"friction": [0.6, 1.0]}, "hip": {"friction.viscous": [0.5, 2.0]}, "mass": {"all": [0.9, 1.1]}}
TOKENS = (
    "a", "b", "`c d`", "kp", "row", "pi", "1", "2.5", "1e308", "1e400", "9" * 400, "0", "+", "-", "*", "/", "**",
    "(", ")",
    ",", "abs(", "sqrt(", "unwrap(", "cumsum(", "counter(", "signed16(", "sign_bit(", "min(", "max(", "hypot(", "hold(",
    "later(", "known(", " ", "`", "'", "[0]", ".x", "__class__", "eval(", "lambda", ";", "é",
    "(" * 60, "-" * 60, "**2" * 60,
    "+a" * 5000, "(a)*" * 2000, "2**" * 40, "word", "name", "min(a,", "hypot(a,b)", "sign_bit(a,", "\n", "\0",
)  # fmt: skip
ARGUMENTS = ("policy=x.onnx", "rate=100", "command=[1,0]", "hw=feetech", "port=/dev/null", "seed=1",
             "safety.max_speed={'*': 5}", "registers={}", "out=x", "excitation=chirp", "reach=0.5")  # fmt: skip


@dataclass(frozen=True)
class Kind:
    """A kind of documents.

    Attributes:
        drawn: strategy of what is written.
        read: reads it; is given a folder in which it may write the document, and a number of its own.
        valid: what must be read without a word, so that what is spoiled is not refused at its first letter.
        longest: that one may take [s of the processor].
    """

    drawn: st.SearchStrategy[Any]
    read: Callable[[Path, int, Any], Any]
    valid: Any
    longest: float = LONGEST


def document(write: Callable[[Any, list[Change], list[Change]], str], valid: Any) -> st.SearchStrategy[str]:
    return st.builds(write, st.just(valid), CHANGES, TEARS)


def text(valid: str) -> st.SearchStrategy[str]:
    return st.builds(torn, st.just(valid), CHANGES)


def of_yaml(valid: Any, read: Callable[[Path], Any]) -> Kind:
    """A kind of which a file is written and read."""
    plain = yaml.safe_dump(valid, sort_keys=False)
    return Kind(document(as_yaml, valid), lambda folder, n, said: read(put(folder, f"{n}.yaml", said)), plain)


def read_expression(folder: Path, number: int, said: str) -> None:
    names_in(said)
    column(said, known(), "here", 50)


@cache
def known() -> dict[str, Any]:
    a = np.linspace(-3.0, 3000.0, 50)
    return {
        "a": a,
        "b": np.where(a > 0.0, a, np.nan),
        "c d": np.zeros(50),
        "kp": 32.0,
        "word": "x",
        "row": np.arange(50.0),
    }


def read_log(folder: Path, number: int, said: tuple[str, str]) -> None:
    sidecar, table = said
    log = put(folder, f"{number}.csv", table)
    put(folder, f"{number}.yaml", sidecar)
    for run in read_measured(log).runs:
        for chain in run.actuators.values():
            load_chain(chain)
        get_robot(run.robot).parameters(run.robot_params)


def read_foreign(ending: str) -> Callable[[Path, int, str | bytes], None]:
    def read(folder: Path, number: int, said: str | bytes) -> None:
        path = put(folder, f"{number}{ending}", said)
        propose_for(path, folder / "logs", robot="bench", actuator="sts3215")

    return read


def read_recording(ending: str) -> Callable[[Path, int, str | bytes], Any]:
    return lambda folder, number, said: read_source(put(folder, f"{number}{ending}", said))


def read_map(path: Path) -> None:
    t = np.arange(50) / 100.0
    columns = {"t": t, "goal": 10.0 * np.sin(t), "pos": 2048.0 + 100.0 * np.sin(t)}
    converted(read_mapping(path), Recording("run", columns, path, "table", facts={"kp": 32.0}))


@cache
def robot_on_servos(name: str) -> ServoRobot:
    return build_robot(compose("deploy", split([f"robot={name}"]))["robot"])


@cache
def bytes_of_policy() -> bytes:
    """A small policy with a contract, of a built-in robot."""
    folder = Path(__file__).resolve().parents[2] / "policies" / "arm" / "seed0"
    return (folder / "policy.onnx").read_bytes()


@cache
def contract() -> dict[str, Any]:
    return json.loads(next(row.value for row in small_policy().metadata_props if row.key == KEY))


@cache
def small_policy() -> onnx.ModelProto:
    return onnx.load_from_string(bytes_of_policy())


def read_contract(folder: Path, number: int, said: str) -> None:
    robot_on_servos("arm").check_contract(Contract.from_json(said, "policy.onnx"))


OPERATORS = (
    "Identity", "Tanh", "Loop", "If", "Scan", "ConstantOfShape", "Range", "Tile", "Expand", "Gemm", "Concat", "Reshape",
    "Cast", "RandomNormal", "StringNormalizer", "Nonsense", "Einsum", "Pad", "Resize", "OneHot", "Slice", "NonZero",
)  # fmt: skip


def spoiled_policy(changes: list[Change], bites: list[Change]) -> bytes:
    """A policy with other operators, shapes, types, names and weights, and bytes of it changed."""
    model = onnx.ModelProto()
    model.CopyFrom(small_policy())
    graph = model.graph
    for change in changes:
        what, where = change.what, change.place
        number = (
            int(min(max(float(NUMBERS[what % len(NUMBERS)]), -9e18), 9e18))
            if np.isfinite(float(NUMBERS[what % len(NUMBERS)]))
            else 7
        )
        node = graph.node[where % len(graph.node)] if graph.node else graph.node.add()
        match change.way:
            case 0:
                node.op_type = OPERATORS[what % len(OPERATORS)]
            case 1 if graph.initializer:
                tensor = graph.initializer[where % len(graph.initializer)]
                tensor.dims[:] = [number, *tensor.dims]
            case 2 if graph.initializer:
                tensor = graph.initializer[where % len(graph.initializer)]
                tensor.ClearField("raw_data")
                tensor.data_location = TensorProto.EXTERNAL
                for key, value in (("location", PATHS[what % len(PATHS)].replace("\0", "")), ("length", str(number))):
                    tensor.external_data.add(key=key, value=value)
            case 3:
                side = (graph.input, graph.output)[what % 2]
                kept = side[where % len(side)] if side else side.add()
                kept.CopyFrom(helper.make_tensor_value_info(kept.name, 1 + what % 16, [number, "n", 3][: what % 4]))
            case 4:
                del graph.node[where % max(len(graph.node), 1) :][:1]
            case 5 if node.input:
                node.input[what % len(node.input)] = graph.node[what % len(graph.node)].output[0]
            case 6:
                shape = helper.make_tensor("huge", TensorProto.INT64, [2], [1 << (what % 62), 1 << (where % 40)])
                graph.node.insert(0, helper.make_node("ConstantOfShape", ["huge shape"], ["huge"]))
                graph.node.insert(0, helper.make_node("Constant", [], ["huge shape"], value=shape))
            case 7:
                model.opset_import[0].version = number % 2**31
            case 8:
                node.domain = WORDS[what % len(WORDS)].encode("ascii", "ignore").decode()
            case 9:
                (graph.input if what % 2 else graph.output).add(name=str(what))
            case 10 if graph.output:
                graph.output[where % len(graph.output)].name = "x"
            case _:
                text = torn(model.metadata_props[0].value, [change])
                model.metadata_props[0].value = text.encode("utf-8", "ignore").decode()
    data = model.SerializeToString()
    return bitten(data, bites)


def read_policy(folder: Path, number: int, said: bytes) -> None:
    policy = Policy(put(folder, f"{number}.onnx", said))
    robot_on_servos("arm").check_contract(policy.contract)


def read_arguments(folder: Path, number: int, said: list[str]) -> None:
    override(plain_config(), split(said))


@cache
def plain_config() -> dict[str, Any]:
    return compose("deploy", {})


@cache
def arrays() -> bytes:
    path = Path(os.environ.get("TMPDIR", "/tmp")) / f"arrays-{os.getpid()}.npz"
    t = np.arange(60) / 100.0
    np.savez_compressed(path, time=t, goal=np.sin(t), position=np.cos(t), name="x")
    data = path.read_bytes()
    path.unlink()
    return data


NET = (Path(__file__).resolve().parents[2] / "configs" / "actuator" / "sts3215_net.npz").read_bytes()


def read_net_chain(folder: Path, number: int, said: bytes) -> None:
    net = put(folder, f"{number}.npz", said)
    load_chain([{"net": {"file": str(net)}}])


def arguments() -> st.SearchStrategy[list[str]]:
    one = st.builds(lambda word, change: torn(word, [change]), st.sampled_from(ARGUMENTS), st.builds(
        Change, st.integers(0, 11), st.integers(0, 2**16), st.integers(0, 2**16)))  # fmt: skip
    value = st.builds(lambda word, extreme: f"{word.partition('=')[0]}={extreme}"[:20_000], st.sampled_from(ARGUMENTS),
                      st.sampled_from([*map(str, EXTREMES), *TEXTS]))  # fmt: skip
    return st.lists(st.one_of(one, value, st.sampled_from(ARGUMENTS)), min_size=1, max_size=3)


BENCH = get_robot("bench")
SERVO = load_model("sts3215")
KINDS: dict[str, Kind] = {
    "expression": Kind(
        st.one_of(
            st.lists(st.sampled_from(TOKENS), max_size=30).map("".join),
            text("hypot(a, b)*2*pi/4096 - unwrap(`c d`)**2 + max(kp, hold(b))"),
        ),
        read_expression,
        "(a - 2048)*2*pi/4096 + hold(b)",
    ),
    "mapping": of_yaml(MAPPING, read_map),
    "sidecar": Kind(st.tuples(document(as_yaml, SIDECAR), st.just(TABLE)), read_log, (yaml.safe_dump(SIDECAR), TABLE)),
    "log": Kind(st.tuples(st.just(yaml.safe_dump(SIDECAR)), text(TABLE)), read_log, (yaml.safe_dump(SIDECAR), TABLE)),
    "foreign table": Kind(text(FOREIGN), read_foreign(".csv"), FOREIGN),
    "rows in JSON": Kind(document(as_json, ROWS), read_recording(".json"), json.dumps(ROWS)),
    "recording of BAM": Kind(document(as_json, BAM), read_recording(".json"), json.dumps(BAM)),  # type: ignore[arg-type]
    "arrays": Kind(st.builds(lambda c: bitten(arrays(), c), CHANGES), read_recording(".npz"), None),
    "robot": replace(of_yaml(ROBOT, load_robot_file), longest=60.0),  # a chain of a new shape is compiled once
    "MJCF": Kind(document(as_xml, MODEL), lambda folder, n, said: read_model(put(folder, f"{n}.xml", said)), MODEL),
    "URDF": Kind(document(as_xml, URDF), lambda folder, n, said: read_model(put(folder, f"{n}.urdf", said)), URDF),
    "contract": Kind(
        st.builds(lambda changes, tears: as_json(contract(), changes, tears), CHANGES, TEARS), read_contract, None
    ),
    "ONNX": Kind(st.builds(spoiled_policy, st.one_of(st.just([]), CHANGES), TEARS), read_policy, None),
    "calibration": of_yaml(CALIBRATION, lambda path: read_joints(path, BENCH, SERVO)),
    "hidden": of_yaml(HIDDEN, lambda path: hide(BENCH, {"joint": "sts3215"}, {}, str(path))),
    "chain": of_yaml(CHAIN, load_chain),
    "fit of BAM": Kind(
        document(as_json, FIT), lambda folder, n, said: bam_stages(put(folder, f"{n}.json", said)), json.dumps(FIT)
    ),
    "actuator net": Kind(st.builds(lambda c: bitten(NET, c), CHANGES), read_net_chain, NET),
    "faults": of_yaml(FAULTS, read_faults),
    "randomization": of_yaml(RANDOMIZED, read_randomization),
    "command line": Kind(arguments(), read_arguments, list(ARGUMENTS[:3])),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fuzz") / "given"
    prepare(folder)
    put(folder, "arm.xml", MODEL)
    put(folder, "net.npz", NET)
    return folder


def attack(kind: Kind, folder: Path, examples: int, seed: int) -> None:
    """Read so many spoiled documents of a kind."""
    settings = hypothesis.settings(
        max_examples=examples,
        derandomize=seed == 0,
        deadline=None,  # the watch has one, of the processor's time
        database=None,
        suppress_health_check=list(hypothesis.HealthCheck),  # type: ignore[arg-type]
        phases=[hypothesis.Phase.explicit, hypothesis.Phase.generate, hypothesis.Phase.shrink],
    )

    @hypothesis.given(said=kind.drawn)
    def read(said: Any) -> None:
        number = next(NUMBER)
        try:
            with watched(folder, kind.longest):
                kind.read(folder, number, said)
        finally:
            for path in folder.glob(f"{number}.*"):
                path.unlink()

    tried = settings(read)
    (hypothesis.seed(seed)(tried) if seed else tried)()


@pytest.mark.parametrize("name", KINDS)
def test_spoiled_documents_get_a_sentence_and_do_nothing(name: str, folder: Path) -> None:
    kind = KINDS[name]
    if kind.valid is not None:
        kind.read(folder, next(NUMBER), kind.valid)
    attack(kind, folder, ASKED or FEW, SEED)


@pytest.mark.long
@pytest.mark.parametrize("count", [MANY, pytest.param(2 * MANY, marks=pytest.mark.weekly)])
@pytest.mark.parametrize("name", KINDS)
def test_thousands_of_spoiled_documents_get_a_sentence_and_do_nothing(name: str, count: int, folder: Path) -> None:
    attack(KINDS[name], folder, count, 0)
