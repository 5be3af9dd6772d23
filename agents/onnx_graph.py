"""Nodes and constants of an ONNX file, in the order of execution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import onnx
from onnx import helper, numpy_helper

OPSET, IR_VERSION = 18, 8  # read by every onnxruntime since 1.14


class OnnxGraph:
    """A graph in the making; values go by their names."""

    def __init__(self) -> None:
        self._nodes: list[onnx.NodeProto] = []
        self._constants: dict[str, onnx.TensorProto] = {}
        self._known: dict[tuple[Any, ...], str] = {}

    def constant(self, values: Any) -> str:
        """Name of a constant; equal ones share it."""
        array = np.ascontiguousarray(values).reshape(np.shape(values))
        key = (array.dtype.str, array.shape, array.tobytes())
        if key not in self._known:
            name = f"constant_{len(self._known)}"
            self._constants[name] = numpy_helper.from_array(array, name)
            self._known[key] = name
        return self._known[key]

    def add(self, operator: str, *inputs: str, output: str | None = None, **attributes: Any) -> str:
        """Name of what a node gives."""
        output = output or f"{operator.lower()}_{len(self._nodes)}"
        self._nodes.append(helper.make_node(operator, list(inputs), [output], **attributes))
        return output

    def columns(self, value: str, low: int, high: int | None) -> str:
        """Name of the columns from ``low`` to ``high`` (None: the last) of a matrix."""
        ends = (low, np.iinfo(np.int64).max if high is None else high, 1)
        return self.add("Slice", value, *(self.constant(np.array([n], np.int64)) for n in ends))

    def document(
        self, inputs: Sequence[onnx.ValueInfoProto], outputs: Sequence[onnx.ValueInfoProto]
    ) -> onnx.ModelProto:
        """The file, with the nodes that its outputs need.

        Raises:
            onnx.checker.ValidationError: what an output needs is no input and comes from no node.
        """
        needed = {value.name for value in outputs}
        nodes = []
        for node in reversed(self._nodes):
            if needed & set(node.output):
                nodes.append(node)
                needed |= set(node.input)
        constants = [tensor for name, tensor in self._constants.items() if name in needed]
        graph = helper.make_graph(nodes[::-1], "policy", list(inputs), list(outputs), constants)
        opset = [helper.make_operatorsetid("", OPSET)]
        document = helper.make_model(graph, opset_imports=opset, ir_version=IR_VERSION, producer_name="sealegs")
        onnx.checker.check_model(document, full_check=True)
        return document
