"""A policy from its ONNX file: what deployment needs of learning, and all of it.

A file may come from anybody. It is checked against its contract and tried when it is loaded. Only onnxruntime's own
operators run, no file beside it is read, and its size, its memory and the time of its first call are bounded.
"""

from __future__ import annotations

import functools
import os
import re
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import onnxruntime

from ...common.errors import SealegsError
from ...envs.any_robot.user import trained_in
from ...envs.contract import KEY, Contract, ContractError

FILE = "policy.onnx"
SIZE = 64 << 20  # [byte] of a file; those of policies/ have 60 thousand
MEMORY = 256 << 20  # [byte] that policies of a process may compute in
TRIAL = 5.0  # [s] after which a first call is broken off
AGAIN = "export the policy again"
MARK = re.compile(r"^\[ONNXRuntimeError\] : \d+ : \w+ : ")  # before what onnxruntime says is wrong
TYPES = {"tensor(float)": "float32", "tensor(double)": "float64"}
INPUTS = {"observation": "float32", "command": "float64", "state": "float64"}
OUTPUTS = ("action", "goal", "next_state")


class PolicyError(SealegsError):
    """A policy that failed as it was asked: it broke off, or gave what is no action, goal or state."""


class Policy:
    """A policy and the contract that it came with.

    Attributes:
        path: of its file.
        contract: what it takes for granted about the robot.
    """

    def __init__(self, path: str | Path, task: str | None = None) -> None:
        """Load the policy, and try it once.

        Args:
            path: ONNX file, or a folder with a ``policy.onnx``.
            task: ``path/to/task.py:MyTask`` that it was trained in, where that is a file of one's own. It is run; the
                file that the contract names is not.

        Raises:
            ContractError: there is no such file, it is no ONNX file, it has no contract, or its inputs and outputs are
                not those of its contract.
            SealegsError: its task is code that nobody named.
        """
        self.path = Path(path) / FILE if os.path.isdir(path) else Path(path)
        if not os.path.isfile(self.path):
            beside = ""
            if any((self.path.parent / name).is_file() for name in ("policy.safetensors", "model.zip")):
                beside = f"; make it with: sealegs export {self.path.parent}"
            elif (final := self.path.parent / "final").is_dir():
                beside = f"; a run's policies are in its folders: {final}, or best beside it"
            raise ContractError(f"there is no policy {self.path}{beside}.")
        self._session = _session(self.path)
        try:
            metadata = self._session.get_modelmeta().custom_metadata_map
        except UnicodeDecodeError:
            raise ContractError(f"{self.path} holds metadata that is no text: it is damaged; {AGAIN}.") from None
        if KEY not in metadata:
            raise ContractError(
                f"{self.path} has no contract, so nothing says which robot it is for; export it with sealegs export."
            )
        contract = self.contract = Contract.from_json(metadata[KEY], str(self.path))
        state = len(contract.state)
        self._given = {"observation": len(contract.observation_names), "command": contract.commands, "state": state}
        self._made = {"action": len(contract.actions), "goal": len(contract.joints), "next_state": state}
        self._check_declared()
        self._check_tried()
        self.contract = replace(contract, env=trained_in(contract.env, str(self.path), task))

    def act(
        self, observation: np.ndarray, command: np.ndarray, state: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The next goals; to be asked ``contract.goal_rate`` times a second.

        Args:
            observation: (n, size); what the policy knows itself (clock, memory, latest action, command) is ignored.
            command: what is asked for (n, c).
            state: ``contract.state`` at the start, then the state that the call before gave (n, s).

        Returns:
            Actions in force (n, a) in [-1, 1], goals (n, k) [rad or m], and the next state (n, s).

        Raises:
            PolicyError: it broke off, or what it gives has another shape, or is not finite.
        """
        action, goal, following = found = self._run(observation, command, state)
        for name, value in zip(OUTPUTS, found, strict=True):
            if not np.isfinite(value).all():
                raise PolicyError(
                    f"the policy {self.path} gave '{name}' that is not finite{self._unread(observation)}."
                )
        return action, goal, following

    def _unread(self, observation: np.ndarray) -> str:
        """The first element of an observation that was not finite itself, in words."""
        names = self.contract.observation_names
        bad = np.flatnonzero(~np.isfinite(observation).all(axis=0))
        return f"; neither is '{names[bad[0]]}' of its observation" if len(bad) else ""

    def _run(
        self,
        observation: np.ndarray,
        command: np.ndarray,
        state: np.ndarray,
        options: onnxruntime.RunOptions | None = None,
    ) -> tuple[np.ndarray, ...]:
        """What it gives, as numbers of the shapes of the contract."""
        given = zip(INPUTS.items(), (observation, command, state), strict=True)
        feeds = {name: np.asarray(values, kind) for (name, kind), values in given}
        try:
            found = tuple(np.asarray(value) for value in self._session.run(OUTPUTS, feeds, options))
        except Exception as error:  # onnxruntime has a class of its own for each way that a call can fail
            raise PolicyError(f"the policy {self.path} broke off: {_reason(error)}") from None
        for (name, width), value in zip(self._made.items(), found, strict=True):
            if value.shape != (wanted := (len(feeds["state"]), width)) or value.dtype.kind != "f":
                raise PolicyError(
                    f"the policy {self.path} gave '{name}' as {value.shape} of {value.dtype}, and its contract says "
                    f"{wanted} of floating point; {AGAIN}."
                )
        return found

    def _check_declared(self) -> None:
        """Compare what the file says of its inputs and outputs with the contract."""
        got = {item.name: item for item in self._session.get_inputs()}
        made = {item.name: item for item in self._session.get_outputs()}
        if more := next((name for name in got if name not in self._given), None):
            raise ContractError(f"{self.path} wants an input '{more}', which no policy gets; {AGAIN}.")
        for side, declared, widths in (("input", got, self._given), ("output", made, self._made)):
            for name, width in widths.items():
                if name not in declared:
                    raise ContractError(f"{self.path} has no {side} '{name}'; {AGAIN}.")
                item = declared[name]
                kind, shape = TYPES.get(item.type, item.type), item.shape
                types = (INPUTS[name],) if side == "input" else tuple(TYPES.values())
                if kind not in types or not _fits(shape, width):
                    raise ContractError(
                        f"{self.path}: its {side} '{name}' is {_told(shape)} of {kind}, and by its contract it must be "
                        f"(n, {width}) of {' or '.join(types)}; {AGAIN}."
                    )

    def _check_tried(self) -> None:
        """One call, of zeros: whether it ends, and what it gives; zeros may be asked for nothing, so NaN may come."""
        options = onnxruntime.RunOptions()
        slow = threading.Timer(TRIAL, setattr, (options, "terminate", True))
        slow.daemon = True
        slow.start()
        try:
            observation, command = (np.zeros((1, self._given[name])) for name in ("observation", "command"))
            self._run(observation, command, np.asarray(self.contract.state)[None], options)
        except PolicyError as error:
            if options.terminate:
                raise ContractError(f"{self.path}: a call took longer than {TRIAL:g} s and was broken off.") from None
            raise ContractError(str(error)) from None
        finally:
            slow.cancel()


def _fits(shape: list[int | str | None], width: int) -> bool:
    """Whether a declared shape may be (1, width); no shape is any, and so is a size without a number."""
    sizes = zip(shape, (1, width), strict=False)
    return not shape or (len(shape) == 2 and all(size == wanted or not isinstance(size, int) for size, wanted in sizes))


def _told(shape: list[int | str | None]) -> str:
    return f"({', '.join('?' if size is None else str(size) for size in shape)})"


def _reason(error: Exception) -> str:
    """The first line of an error of onnxruntime, without its marks."""
    line = str(error).strip().partition("\n")[0]
    return MARK.sub("", line.rpartition("Status Message: ")[2]).removesuffix(".") + "."


def _session(path: Path) -> onnxruntime.InferenceSession:
    """The file, loaded.

    Raises:
        ContractError: it is none that can be read.
    """
    with path.open("rb") as file:
        data = file.read(SIZE + 1)
    if len(data) > SIZE:
        raise ContractError(f"{path} is larger than {SIZE >> 20} MiB, which no policy is; give another file.")
    try:
        held = held_by(data)
    except LookupError:
        raise ContractError(f"{path} is no ONNX file that can be read: it is damaged, or of another kind.") from None
    if held.functions:
        raise ContractError(f"{path} holds functions of its own, whose size nothing bounds; {AGAIN}.")
    if held.elsewhere:
        raise ContractError(
            f"{path} has weights in another file, and none is read beside it; export the policy as one file."
        )
    if held.text:
        raise ContractError(f"{path} computes with text, whose memory nothing bounds; {AGAIN}.")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # microseconds of work: threads only add jitter
    options.log_severity_level = 4  # what is wrong is said in a sentence
    options.add_session_config_entry("session.load_model_format", "ONNX")
    # weights in files of their own are not looked for: a path in a file may name any other file
    options.add_session_config_entry("session.model_external_initializers_file_folder_path", "/nonexistent")
    options.add_session_config_entry("session.use_env_allocators", "1")
    _bound_memory()
    try:
        if not held.graph:
            raise ValueError("it has no graph.")
        # constants are computed in the trial call, which can be broken off, and not as the file is loaded
        return onnxruntime.InferenceSession(
            data, options, providers=["CPUExecutionProvider"], disabled_optimizers=["ConstantFolding"]
        )
    except Exception as error:  # onnxruntime has a class of its own for each way that a file can be damaged
        raise ContractError(f"{path} is no ONNX file that can be read: {_reason(error)}") from None


@functools.cache
def _bound_memory() -> None:
    """Give onnxruntime a memory of its own for policies, of a bounded size; once in a process."""
    kinds = onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, onnxruntime.OrtMemType.DEFAULT
    memory = onnxruntime.OrtMemoryInfo("Cpu", kinds[0], 0, kinds[1])
    grows_as_needed = {"max_mem": MEMORY, "arena_extend_strategy": 1}
    onnxruntime.create_and_register_allocator(memory, onnxruntime.OrtArenaCfg(grows_as_needed))


# --- what an ONNX file holds that a policy may not, read from its bytes before onnxruntime sees them -----------------
#
# The format is protobuf: messages of numbered fields. Only the fields that lead to tensors and attributes are
# followed.

MOST_FIELDS = 1 << 19  # of a file that is read; the largest of policies/ has 2 thousand
DEEPEST = 40  # messages within messages
VARINT, BYTES = 0, 2  # how a field of a number and one of a length are marked
STRING, EXTERNAL = 8, 1  # data type of text, and location of a tensor in another file
OF_ONNX = (b"", b"ai.onnx")  # domains of the standard operators

MESSAGES: Mapping[str, Mapping[int, str]] = {
    "model": {7: "graph", 25: "function"},
    "graph": {1: "node", 5: "tensor", 15: "sparse tensor"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse tensor", 23: "sparse tensor"},
    "sparse tensor": {1: "tensor", 2: "tensor"},
    "tensor": {},
    "function": {},
}
"""Fields of each message that are messages themselves, as onnx.proto numbers them."""
NODE_DOMAIN = 7
ATTRIBUTE_NAME, ATTRIBUTE_NUMBER, ATTRIBUTE_TEXTS = 1, 3, 9
TENSOR_TYPE, TENSOR_TEXT, TENSOR_ELSEWHERE, TENSOR_LOCATION = 2, 6, 13, 14
OF_A_TYPE, OF_A_TEXT = (b"to", b"dtype"), (b"value_string", b"value_strings")


@dataclass
class Held:
    """What was found in a file.

    Attributes:
        graph: it has one.
        functions: operators of its own.
        elsewhere: weights in another file.
        text: constants that are text, or an operator that makes some.
        fields: how many were read.
    """

    graph: bool = False
    functions: bool = False
    elsewhere: bool = False
    text: bool = False
    fields: int = field(default=0, repr=False)


def held_by(data: bytes) -> Held:
    """What a file holds.

    Raises:
        LookupError: it is no protobuf, breaks off, or is larger or deeper than a policy is.
    """
    held = Held()
    _read(memoryview(data), "model", held, 0)
    return held


def _read(data: memoryview, message: str, held: Held, depth: int) -> list[tuple[int, int | memoryview]]:
    """The fields of a message, after those of the messages in it."""
    if depth > DEEPEST:
        raise LookupError
    held.graph |= message == "graph"
    held.functions |= message == "function"
    fields, texts = [], False
    for number, value in _fields(data):
        held.fields += 1
        if held.fields > MOST_FIELDS:
            raise LookupError
        fields.append((number, value))
        inner = MESSAGES[message].get(number)
        if inner is not None and isinstance(value, memoryview):
            within = _read(value, inner, held, depth + 1)
            texts |= inner == "attribute" and any(number == ATTRIBUTE_TEXTS for number, _ in within)
    if message == "tensor":
        found = dict(fields)
        held.elsewhere |= TENSOR_ELSEWHERE in found or found.get(TENSOR_LOCATION) == EXTERNAL
        held.text |= TENSOR_TEXT in found or found.get(TENSOR_TYPE) == STRING
    elif message == "attribute":
        name = _last(fields, ATTRIBUTE_NAME)
        held.text |= name in OF_A_TEXT or (name in OF_A_TYPE and dict(fields).get(ATTRIBUTE_NUMBER) == STRING)
    elif message == "node":
        held.text |= texts and _last(fields, NODE_DOMAIN) not in OF_ONNX
    return fields


def _last(fields: list[tuple[int, int | memoryview]], number: int) -> bytes:
    """The value of a field of a length: the last one counts."""
    value = dict(fields).get(number, b"")
    return b"" if isinstance(value, int) else bytes(value)


def _fields(data: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Fields of a message: number, and value where it is a whole number or has a length.

    Raises:
        LookupError: it breaks off, or is none.
    """
    at = 0

    def number() -> int:
        nonlocal at
        value = 0
        for shift in range(0, 64, 7):
            value, at = value | (data[at] & 0x7F) << shift, at + 1
            if data[at - 1] < 0x80:
                return value
        raise LookupError

    while at < len(data):
        key = number() & 0xFFFFFFFF
        kind = key & 7
        size = number() if kind in (VARINT, BYTES) else 0
        start, at = at, at + {VARINT: 0, 1: 8, BYTES: size, 5: 4}[kind]
        yield key >> 3, data[start:at] if kind == BYTES else size
