"""NumPy functions written down as ONNX: called with :class:`Traced` arrays, which note what is done with them.

So the gait that a policy corrects is the task's own code in the file as well, whoever wrote that task. A traced array
carries sample values beside its name in the graph. What the functions decide by values (``if``), and NumPy functions
that are not listed here, are refused by name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import onnx
from numpy.lib.mixins import NDArrayOperatorsMixin
from onnx import TensorProto, helper, numpy_helper

from ..common.errors import SealegsError

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


ROWS = 61
"""Rows of the sample values: a number that stands for the number of robots in shapes, and for nothing else."""
ENDS = np.iinfo(np.int64).max

_DIRECT = {
    "add": "Add", "subtract": "Sub", "multiply": "Mul", "divide": "Div", "power": "Pow", "negative": "Neg",
    "absolute": "Abs", "sqrt": "Sqrt", "exp": "Exp", "log": "Log", "sin": "Sin", "cos": "Cos", "tanh": "Tanh",
    "floor": "Floor", "ceil": "Ceil", "sign": "Sign", "minimum": "Min", "maximum": "Max", "greater": "Greater",
    "less": "Less", "greater_equal": "GreaterOrEqual", "less_equal": "LessOrEqual", "equal": "Equal",
    "logical_and": "And", "logical_or": "Or", "logical_not": "Not", "bitwise_and": "And", "bitwise_or": "Or",
    "invert": "Not",
}  # fmt: skip
_LOGICAL = ("And", "Or", "Not")
_REDUCED = {"sum": "ReduceSum", "mean": "ReduceMean", "min": "ReduceMin", "max": "ReduceMax"}


class TracingError(SealegsError):
    """A function that does what an ONNX file cannot say."""


class MixingError(TracingError):
    """What the file knows and what is measured, put together where only one of them was expected."""


def traced(value: Any) -> Traced:
    """What a NumPy function gives for traced arrays, which its annotations cannot say."""
    assert isinstance(value, Traced)
    return value


class Traced(NDArrayOperatorsMixin):
    """An array of ``ROWS`` rows in a graph.

    Attributes:
        graph: that it is part of.
        name: in it.
        value: samples.
        batched: whether it has a row for each robot; a constant has one row for all.
        measured: whether it comes, in whole or in part, from what the host measures, which the graph does not know.
    """

    def __init__(
        self,
        graph: OnnxGraph,
        name: str,
        value: np.ndarray,
        batched: bool = True,
        view: bool = False,
        measured: bool = False,
    ) -> None:
        self.graph, self.name, self.value, self.batched = graph, name, np.asarray(value), batched
        self._view, self.measured = view, measured

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the samples; the first is :data:`ROWS`."""
        return self.value.shape

    @property
    def ndim(self) -> int:
        """Number of dimensions."""
        return self.value.ndim

    @property
    def dtype(self) -> np.dtype:
        """Float64 or bool."""
        return self.value.dtype

    @property
    def T(self) -> Traced:
        """Transposed."""
        return self._made("Transpose", self.value.T, self.name, perm=list(range(self.ndim))[::-1])

    def __len__(self) -> int:
        return len(self.value)

    def __iter__(self) -> Iterator[Traced]:
        return (self[k] for k in range(len(self.value)))

    def __bool__(self) -> bool:
        raise TracingError("it decides by a value (if, and, or); np.where says it for all rows.")

    __float__ = __int__ = __index__ = __bool__

    def __array__(self, *_: Any, **__: Any) -> np.ndarray:
        raise TracingError("it turns an array into a plain one (np.asarray, np.array).")

    # --- operators ---------------------------------------------------------------------------------------------

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, out: Any = None, **keywords: Any) -> Any:
        if method != "__call__" or keywords:
            raise TracingError(f"it calls {ufunc.__name__}.{method}.")
        result = self._called(ufunc.__name__, [self.lift(item) for item in inputs])
        if out is None:
            return result
        (target,) = out
        if not isinstance(target, Traced) or target._view:
            raise TracingError("it changes part of an array in place; assign to the part of the whole array instead.")
        target.name, target.value, target.batched = result.name, result.value, result.batched
        target.measured |= result.measured
        return target

    def __array_function__(self, function: Callable, _types: Any, args: Any, keywords: Any) -> Any:
        name = function.__name__
        handler = getattr(self, f"_np_{name}", None)
        if handler is None:
            raise TracingError(f"it calls np.{name}, which has no counterpart.")
        return handler(*args, **keywords)

    def _called(self, name: str, items: list[Traced]) -> Traced:
        first, *others = items
        with np.errstate(all="ignore"):
            value = getattr(np, name)(*(item.value for item in items))
        if name == "square":
            return self._made("Mul", value, first.name, first.name, of=items)
        if name == "remainder":
            return first - np.floor(first / others[0]) * others[0]
        if name == "hypot":
            return traced(np.sqrt(first * first + others[0] * others[0]))
        if name == "not_equal":
            return traced(np.logical_not(traced(np.equal(first, others[0]))))
        if name == "arctan2":
            return self._angle(first, others[0])
        if name == "tan":
            return traced(np.sin(first) / np.cos(first))
        if name == "arctan":
            return self._arctan(first)
        if name == "arcsin":  # well conditioned at the ends too
            return traced(2.0 * np.arctan(first / (1.0 + np.sqrt(1.0 - first * first))))
        if name == "arccos":
            return traced(0.5 * np.pi - np.arcsin(first))
        if name not in _DIRECT:
            raise TracingError(f"it calls np.{name}, which has no counterpart.")
        operator = _DIRECT[name]
        kind = np.dtype(bool) if operator in _LOGICAL else np.dtype(float)
        return self._made(operator, value, *(item.cast(kind).name for item in items), of=items)

    def _arctan(self, x: Traced) -> Traced:
        """In double precision, which onnxruntime lacks for it: in single precision, and one step of Newton's."""
        steep = np.abs(x) > 1.0
        flat = traced(np.where(steep, 1.0 / x, x))
        single = self.graph.add("Atan", self.graph.add("Cast", flat.name, to=TensorProto.FLOAT))
        rough = self._made("Cast", np.arctan(flat.value), single, of=[x], to=TensorProto.DOUBLE)
        sine, cosine = np.sin(rough), np.cos(rough)
        angle = rough + (flat * cosine - sine) / (cosine + flat * sine)
        return traced(np.where(steep, 0.5 * np.pi * np.sign(x) - angle, angle))

    def _angle(self, y: Traced, x: Traced) -> Traced:
        """np.arctan2 but for the sign of zeros."""
        turned = np.arctan(y / x) + np.where(x < 0.0, np.where(y < 0.0, -np.pi, np.pi), 0.0)
        upright = np.where(y < 0.0, -0.5 * np.pi, np.where(y > 0.0, 0.5 * np.pi, 0.0))
        return traced(np.where(x == 0.0, upright, turned))

    # --- functions ---------------------------------------------------------------------------------------------

    def _np_where(self, condition: Any, one: Any, other: Any) -> Traced:
        items = [self.lift(item) for item in (condition, one, other)]
        value = np.where(*(item.value for item in items))
        chosen, *both = items
        return self._made(
            "Where", value, chosen.cast(np.dtype(bool)).name, *(b.cast(value.dtype).name for b in both), of=items
        )

    def _np_clip(self, values: Any, low: Any, high: Any) -> Traced:
        return traced(np.minimum(np.maximum(self.lift(values), low), high))

    def _np_stack(self, arrays: Sequence[Any], axis: int = 0) -> Traced:
        items = [self.lift(item) for item in arrays]
        at = axis % (items[0].ndim + 1)
        return self._np_concatenate([item.unsqueezed(at) for item in items], at)

    def _np_concatenate(self, arrays: Sequence[Any], axis: int = 0) -> Traced:
        items = [self.lift(item).cast(np.dtype(float)) for item in arrays]
        value = np.concatenate([item.value for item in items], axis)
        joined = self._made("Concat", value, *(item.full().name for item in items), axis=axis % value.ndim)
        joined.measured |= any(item.measured for item in items)
        return joined

    def _np_zeros_like(self, values: Any) -> Traced:
        return self.lift(np.zeros(values.shape))

    def _np_ones_like(self, values: Any) -> Traced:
        return self.lift(np.ones(values.shape))

    def _np_full_like(self, values: Any, filling: Any) -> Traced:
        return self.lift(filling) + np.zeros(values.shape)

    def _np_broadcast_to(self, values: Any, shape: Any) -> Traced:
        return self.lift(values) + np.zeros(shape)

    def _np_reshape(self, values: Any, shape: Any) -> Traced:
        return self.lift(values).reshape(shape)

    def _np_shape(self, values: Any) -> tuple[int, ...]:
        return self.lift(values).shape

    def _np_sum(self, values: Any, axis: int) -> Traced:
        return self.lift(values).sum(axis)

    def _np_amin(self, values: Any, axis: int) -> Traced:
        return self.lift(values).min(axis)

    def _np_amax(self, values: Any, axis: int) -> Traced:
        return self.lift(values).max(axis)

    _np_min, _np_max = _np_amin, _np_amax

    # --- methods -----------------------------------------------------------------------------------------------

    def sum(self, axis: int) -> Traced:
        """As NumPy's."""
        return self._reduced("sum", axis)

    def mean(self, axis: int) -> Traced:
        """As NumPy's."""
        return self._reduced("mean", axis)

    def min(self, axis: int) -> Traced:
        """As NumPy's."""
        return self._reduced("min", axis)

    def max(self, axis: int) -> Traced:
        """As NumPy's."""
        return self._reduced("max", axis)

    def any(self, axis: int) -> Traced:
        """As NumPy's."""
        return self.cast(np.dtype(float)).max(axis) > 0.5

    def all(self, axis: int) -> Traced:
        """As NumPy's."""
        return self.cast(np.dtype(float)).min(axis) > 0.5

    def copy(self) -> Traced:
        """Another array of the same values."""
        return Traced(self.graph, self.name, self.value, self.batched, measured=self.measured)

    def astype(self, kind: Any) -> Traced:
        """As NumPy's, to float or bool."""
        return self.cast(np.dtype(bool) if np.dtype(kind) == bool else np.dtype(float)).copy()

    def reshape(self, *shape: Any) -> Traced:
        """As NumPy's; rows stay rows."""
        value = self.value.reshape(*shape)
        if value.shape[:1] != (ROWS,):
            raise TracingError("it reshapes rows of different robots into one.")
        wanted = self.graph.constant(np.array([-1, *value.shape[1:]], np.int64))
        return self._made("Reshape", value, self.full().name, wanted)

    def _reduced(self, name: str, axis: int) -> Traced:
        at = axis % self.ndim
        value = getattr(self.value, name)(axis=at)
        if at == 0 and len(self.value) == ROWS:
            raise TracingError(f"it takes the {name} over different robots.")
        item = self.cast(np.dtype(float))
        axes = self.graph.constant(np.array([at], np.int64))
        return self._made(_REDUCED[name], value, item.name, axes, of=[self], keepdims=0)

    def __getitem__(self, index: Any) -> Traced:
        items = index if isinstance(index, tuple) else (index,)
        at, result, squeezed = 0, self, []
        added: list[int] = []
        if Ellipsis in items:
            k = items.index(Ellipsis)
            missing = self.ndim - sum(item is not None and item is not Ellipsis for item in items)
            items = (*items[:k], *[slice(None)] * missing, *items[k + 1 :])
        place = 0  # in the result, before integers are dropped
        for item in items:
            if item is None:
                added.append(place - len(squeezed))
                place += 1
                continue
            if isinstance(item, slice):
                if item != slice(None):
                    result = result._sliced(at, item)
            elif isinstance(item, int | np.integer):
                size = self.shape[at]
                start = int(item) % size
                result = result._sliced(at, slice(start, start + 1))
                squeezed.append(at)
            else:
                raise TracingError(f"it takes elements by {type(item).__name__}; whole numbers and slices can be.")
            at += 1
            place += 1
        if squeezed:
            axes = self.graph.constant(np.array(squeezed, np.int64))
            result = result._made("Squeeze", result.value.squeeze(tuple(squeezed)), result.name, axes, of=[self])
        for k in added:
            result = result.unsqueezed(k)
        return Traced(self.graph, result.name, result.value, result.batched, view=True, measured=self.measured)

    def __setitem__(self, index: Any, values: Any) -> None:
        whole = index == slice(None)
        columns: tuple[Any, ...] = index if isinstance(index, tuple) else ()
        if self._view or not (whole or (len(columns) == 2 and columns[0] == slice(None))):
            raise TracingError("it changes part of an array in a way that is no column of the whole array.")
        value = self.value.copy()
        new = self.lift(values)
        value[index] = new.value
        if whole:
            result = new + np.zeros(self.shape)
        else:
            column = columns[1]
            start, stop, _ = (column if isinstance(column, slice) else slice(column, column + 1)).indices(self.shape[1])
            inner = new.unsqueezed(1) if new.ndim == 1 and not isinstance(column, slice) else new
            inner = inner + np.zeros((ROWS, stop - start))
            result = self._np_concatenate([self[:, :start], inner, self[:, stop:]], 1)
        self.name, self.value, self.batched = result.name, value, result.batched
        self.measured |= result.measured

    # --- making ------------------------------------------------------------------------------------------------

    def lift(self, item: Any) -> Traced:
        """A traced array from one, or from a constant; rows of a constant must be alike."""
        if isinstance(item, Traced):
            return item
        value = np.asarray(item)
        if value.dtype == object:
            raise TracingError("it puts arrays into a plain one (np.array).")
        if value.dtype != bool:
            value = value.astype(float)
        kept = value
        if value.shape[:1] == (ROWS,):
            if not (value[:1] == value).all():
                raise MixingError("it mixes what the file knows with what is measured, in one value.")
            kept = value[:1]
        return Traced(self.graph, self.graph.constant(kept), value, batched=False)

    def cast(self, kind: np.dtype) -> Traced:
        """As float or bool."""
        if self.dtype == kind:
            return self
        to = TensorProto.BOOL if kind.kind == "b" else TensorProto.DOUBLE
        return self._made("Cast", self.value.astype(kind), self.name, of=[self], to=to)

    def unsqueezed(self, at: int) -> Traced:
        """With one more dimension."""
        axes = self.graph.constant(np.array([at], np.int64))
        return self._made("Unsqueeze", np.expand_dims(self.value, at), self.name, axes, of=[self])

    def full(self) -> Traced:
        """With a row for each robot, where it stands for one."""
        if self.batched or self.shape[:1] != (ROWS,):
            return self
        shape = self.graph.constant(np.array(self.shape[1:], np.int64))
        rows = self.graph.add("Concat", "rows", shape, axis=0)
        return Traced(self.graph, self.graph.add("Expand", self.name, rows), self.value, measured=self.measured)

    def _sliced(self, at: int, item: slice) -> Traced:
        start, stop, step = item.indices(self.shape[at])
        if step <= 0 or (at == 0 and self.shape[0] == ROWS):
            raise TracingError("it takes rows of single robots, or goes backwards.")
        numbers = [self.graph.constant(np.array([n], np.int64)) for n in (start, stop, at, step)]
        index = (slice(None),) * at + (item,)
        return self._made("Slice", self.value[index], self.name, *numbers, of=[self])

    def _made(
        self, operator: str, value: np.ndarray, *names: str, of: Sequence[Traced] | None = None, **attributes: Any
    ) -> Traced:
        batched = True if of is None else any(item.batched for item in of)
        measured = any(item.measured for item in of or (self,))
        return Traced(self.graph, self.graph.add(operator, *names, **attributes), value, batched, measured=measured)
