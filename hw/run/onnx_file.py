"""What an ONNX file holds that a policy may not, read from its bytes before onnxruntime sees them.

The format is protobuf: messages of numbered fields. Only the fields that lead to tensors and attributes are followed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

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
