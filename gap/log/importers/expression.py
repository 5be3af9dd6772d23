"""Arithmetic over the columns of a foreign log: ``(pos_ticks - 2048)*2*pi/4096``. No Python is run.

A column is named as it stands, or in backquotes where its name is no plain word: `` `Joint 1 (deg)`*pi/180 ``. Numbers
of the file and of the mapping (``gtau``) are names too. Python's parser reads it; few kinds of nodes are let through.
"""

from __future__ import annotations

import ast
import math
import re
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ....common.errors import nearest
from ..types import Array, LogError

PLAIN = re.compile(r"[A-Za-z_][\w.\[\]]*")
"""Names that need no backquotes: words, with the dots and indices of flattened fields."""
NAMES = re.compile(rf"`([^`]+)`|(?<![\w.])({PLAIN.pattern})(\s*\()?")
COUNTER_BITS = (8, 16, 24, 32)  # [bit]
STEADIER_SHARE = 0.4
"""Share of the longest jump of its counts that a register with a sign has at most once that is read."""
HINT = "; put a column with spaces or signs in its name in backquotes"
LONGEST_EXPRESSION, DEEPEST_NESTING = 20_000, 50
"""Letters of an expression, and brackets or signs within each other, at most."""


def passing(function: Callable[[Array], Array]) -> Callable[[Any], Array]:
    """A function that goes along a column, over its cells without a value: they stay empty, and the rest is right."""

    def along(values: Any) -> Array:
        out = np.array(values, np.float64, ndmin=1)
        known = np.isfinite(out)
        out[known] = function(out[known])
        return out

    return along


def _without_overflows(counts: Array) -> Array:
    size = next((2.0**bits for bits in COUNTER_BITS if counts.max(initial=0.0) < 2**bits), 0.0)
    return counts + size * np.cumsum(np.diff(counts, prepend=counts[:1]) < -0.5 * size)


without_overflows = passing(_without_overflows)
"""A counter of 8 to 32 bits that runs on where it started from 0 again."""


def hold(values: Any) -> Array:
    """A column with the last known value in each empty cell; those before the first known one stay empty."""
    cells = np.array(values, np.float64, ndmin=1)
    last = np.maximum.accumulate(np.where(np.isfinite(cells), np.arange(len(cells)), -1))
    return np.where(last >= 0, cells[last], np.nan)


def later(values: Any) -> Array:
    """1 where a clock is later than at every row before, else 0: repeated stamps get 0 but for their first row."""
    cells = np.array(values, np.float64, ndmin=1)
    latest = np.maximum.accumulate(np.where(np.isfinite(cells), cells, -np.inf))
    return (cells > np.concatenate([[-np.inf], latest[:-1]])).astype(float)


def sign_bit(counts: Any, bit: Any) -> Array:
    """Whole numbers of a register whose bit of that number, from 0, is their sign, the bits below it their size."""
    cells, sign = np.asarray(counts, np.float64), np.power(2.0, np.asarray(bit, np.float64))
    return np.where(cells >= sign, sign - cells, cells)


def shows_sign(counts: Array, bit: int) -> bool:
    """Whether counts of a register (n,) go on without their long jumps where a bit is read as their sign."""
    known = counts[np.isfinite(counts)]
    if len(known) < 2 or (known != np.round(known)).any() or known.min() < 0.0 or known.max() >= 2.0 ** (bit + 1):
        return False
    plain, signed = (float(np.abs(np.diff(values)).max()) for values in (known, sign_bit(known, bit)))
    return signed < STEADIER_SHARE * plain


CONSTANTS = {"pi": math.pi}
ROW = "row"
"""Name for the number of a sample, from 0."""
FUNCTIONS: dict[str, tuple[int, Callable[..., Any]]] = {
    "abs": (1, np.abs),
    "sqrt": (1, np.sqrt),
    "sin": (1, np.sin),
    "cos": (1, np.cos),
    "sign": (1, np.sign),
    "unwrap": (1, passing(np.unwrap)),
    "cumsum": (1, passing(np.cumsum)),
    "counter": (1, without_overflows),
    "signed16": (1, lambda counts: np.where(np.asarray(counts) > 32767, np.asarray(counts) - 65536, counts)),
    "sign_bit": (2, sign_bit),
    "min": (2, np.minimum),
    "max": (2, np.maximum),
    "hypot": (2, np.hypot),
    "hold": (1, hold),
    "later": (1, later),
    "known": (1, lambda values: np.isfinite(values).astype(float)),
}
"""Functions by name: how many arguments they take, and what they do."""
OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: lambda base, power: np.power(np.asarray(base, float), power),
    ast.USub: np.negative,
    ast.UAdd: np.positive,
}


def quoted(name: str) -> str:
    """A column's name as an expression has it."""
    return name if PLAIN.fullmatch(name) and name not in FUNCTIONS else f"`{name}`"


def names_in(text: str) -> list[str]:
    """Names of columns and numbers that an expression takes, each once.

    Raises:
        LogError: it is no expression.
    """
    return list(dict.fromkeys(_parsed(text)[1].values()))


def evaluate(text: str, values: Mapping[str, Any], where: str) -> Any:
    """Value of an expression, a number or an array.

    Args:
        text: of the expression.
        values: columns (n,) and numbers by name.
        where: for the message: file and what the expression is for.

    Raises:
        LogError: it is no expression, or takes a name that there is none of.
    """
    try:
        tree, names = _parsed(str(text))
        with np.errstate(all="ignore"):
            return _value(tree, {short: _named(name, values, text) for short, name in names.items()}, text)
    except LogError as error:
        raise LogError(f"{where}: {error}") from None
    except RecursionError:
        raise LogError(f"{where}: '{text[:40]}...' has too many terms; write it shorter.") from None


def column(text: str, values: Mapping[str, Any], where: str, length: int) -> Array:
    """An expression as a column (n,), a constant one where it takes no column."""
    found = evaluate(text, values, where)
    if isinstance(found, str):
        raise LogError(f"{where}: '{text}' is the word '{found}', and a column takes numbers.")
    value = np.asarray(found, np.float64)
    if value.ndim > 1 or (value.ndim == 1 and len(value) != length):
        raise LogError(f"{where}: '{text}' does not have one number for each of the {length} samples.")
    return np.array(np.broadcast_to(value, (length,)))


def _parsed(text: str) -> tuple[ast.expr, dict[str, str]]:
    """The tree of an expression, in which each name is a short one, and the names by these."""
    names: dict[str, str] = {}

    def shortened(match: re.Match[str]) -> str:
        if match[3]:  # of a function
            if match[2] not in FUNCTIONS:
                raise LogError(f"'{text}' calls '{match[2]}'; there are {', '.join(FUNCTIONS)}.")
            return match[0]
        short = f"_{len(names)}"
        names[short] = match[1] or match[2]
        return f" {short} "

    plain = NAMES.sub(shortened, text)
    nested = np.cumsum([(sign in "([") - (sign in ")]") for sign in plain] or [0])
    if (
        len(text) > LONGEST_EXPRESSION
        or nested.max() > DEEPEST_NESTING
        or re.search(rf"(?:[-+~]\s*|\*\*\s*){{{DEEPEST_NESTING},}}", plain)
    ):
        raise LogError(f"'{text[:40]}...' is nested too deeply, or too long; write it shorter.")
    try:
        with warnings.catch_warnings(action="ignore"):
            tree = ast.parse(plain.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise LogError(f"'{text}' is no arithmetic over columns{HINT}.") from None
    for node in ast.walk(tree):
        if not _is_arithmetic(node, names):
            raise LogError(f"'{text}' is more than arithmetic over columns{HINT}.")
        if isinstance(node, ast.Call) and len(node.args) != (count := FUNCTIONS[_called(node)][0]):
            said = f"{count} value{'s' * (count > 1)}, not {len(node.args)}"
            raise LogError(f"'{text}': {_called(node)} takes {said}.")
    return tree, names


def _called(node: ast.Call) -> str:
    return node.func.id if isinstance(node.func, ast.Name) else ""


def _is_arithmetic(node: ast.AST, names: Mapping[str, str]) -> bool:
    if isinstance(node, ast.Call):
        return _called(node) in FUNCTIONS and not node.keywords
    if isinstance(node, ast.Constant):
        return type(node.value) in (int, float)
    if isinstance(node, ast.Name):
        return node.id in names or node.id in FUNCTIONS
    return isinstance(node, ast.BinOp | ast.UnaryOp | ast.expr_context) or type(node) in OPERATORS


def _value(node: Any, values: Mapping[str, Any], text: str) -> Any:
    if isinstance(node, ast.Constant):
        number: Any = node.value
        return float(number) if abs(number) < 1e300 else math.inf
    if isinstance(node, ast.Name):
        return values[node.id]
    if isinstance(node, ast.Call):
        operator, parts = FUNCTIONS[_called(node)][1], node.args
    else:
        operator, parts = OPERATORS[type(node.op)], [node.operand] if isinstance(node, ast.UnaryOp) else (
            [node.left, node.right]
        )  # fmt: skip
    numbers = [_value(part, values, text) for part in parts]
    if word := next((number for number in numbers if isinstance(number, str)), ""):
        raise LogError(f"'{text}' reckons with '{word}', which is a word and no number.")
    return operator(*numbers)


def _named(name: str, values: Mapping[str, Any], text: str) -> Any:
    if name in values or name in CONSTANTS:
        return values.get(name, CONSTANTS.get(name))
    raise LogError(f"'{text}' takes '{name}', which is no column and no number{nearest(name, values)}.")
