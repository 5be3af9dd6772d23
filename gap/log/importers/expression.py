"""Arithmetic over the columns of a foreign log: ``(pos_ticks - 2048)*2*pi/4096``. No Python is run.

A column is named as it stands, or in backquotes where its name is no plain word: `` `Joint 1 (deg)`*pi/180 ``. Numbers
of the file and of the mapping (``gtau``) are names too.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ....common.errors import nearest
from ..types import Array, LogError

PLAIN = re.compile(r"[A-Za-z_][\w.\[\]/]*\Z")
"""Names that need no backquotes: words, with the dots and indices of flattened fields."""
TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|`(?P<quoted>[^`]+)`|(?P<name>[A-Za-z_][\w.\[\]]*)"
    r"|(?P<sign>\*\*|[-+*/(),]))"
)
COUNTERS = (8, 16, 24, 32)  # [bit]
SIGN_BITS = (10, 15)
"""Bits that servos keep a sign in: of a load or a duty, of a speed or a current."""
STEADIER = 0.4
"""Share of the longest jump of its counts that a register with a sign has at most once that is read."""


def passing(function: Callable[[Array], Array]) -> Callable[[Any], Array]:
    """A function that goes along a column, over its cells without a value: they stay empty, and the rest is right."""

    def along(values: Any) -> Array:
        out = np.array(values, np.float64, ndmin=1)
        known = np.isfinite(out)
        out[known] = function(out[known])
        return out

    return along


def _without_overflows(counts: Array) -> Array:
    size = next((2.0**bits for bits in COUNTERS if counts.max(initial=0.0) < 2**bits), 0.0)
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


def signed_reading(name: str, values: Array) -> str:
    """Expression that reads a register with its sign, where its counts go on without long jumps then; else empty.

    Args:
        name: of the column.
        values: of it (n,), whole numbers from 0 on.
    """
    counts = values[np.isfinite(values)]
    if len(counts) < 2 or (counts != np.round(counts)).any() or counts.min() < 0.0 or counts.max() >= 2.0**16:
        return ""
    bits = [bit for bit in SIGN_BITS if counts.max() < 2.0 ** (bit + 1)]
    column = quoted(name)
    ways = [f"sign_bit({column}, {bit})" for bit in bits] + [f"signed16({column})"] * int(counts.max() >= 2.0**15)

    def jump(text: str) -> float:
        return float(np.abs(np.diff(evaluate(text, {name: counts}, name))).max())

    best = min(ways, key=jump, default="")
    return best if best and jump(best) < STEADIER * jump(column) else ""


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
DEEPEST = 50


def quoted(name: str) -> str:
    """A column's name as an expression has it."""
    return name if TOKEN.fullmatch(name) and PLAIN.match(name) and name not in FUNCTIONS else f"`{name}`"


def names_in(text: str) -> list[str]:
    """Names of columns and numbers that an expression takes, each once.

    Raises:
        LogError: it is no expression.
    """
    reader = _Reader(text, None)
    with np.errstate(all="ignore"):
        reader.whole()
    return list(dict.fromkeys(reader.used))


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
        with np.errstate(all="ignore"):
            return _Reader(str(text), values).whole()
    except LogError as error:
        raise LogError(f"{where}: {error}") from None


def column(text: str, values: Mapping[str, Any], where: str, length: int) -> Array:
    """An expression as a column (n,), a constant one where it takes no column."""
    found = evaluate(text, values, where)
    if isinstance(found, str):
        raise LogError(f"{where}: '{text}' is the word '{found}', and a column takes numbers.")
    value = np.asarray(found, np.float64)
    if value.ndim > 1 or (value.ndim == 1 and len(value) != length):
        raise LogError(f"{where}: '{text}' does not have one number for each of the {length} samples.")
    return np.array(np.broadcast_to(value, (length,)))


@dataclass
class _Reader:
    """Recursive descent: sum, product, sign, power, atom. With ``values`` None it only collects names."""

    text: str
    values: Mapping[str, Any] | None
    used: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.tokens: list[tuple[str, str]] = []
        self.at = 0
        self.depth = 0
        position, text = 0, self.text.rstrip()
        while position < len(text):
            match = TOKEN.match(text, position)
            if match is None or match.end() == position:
                raise LogError(f"'{self.text}' cannot be read from '{text[position:].strip()[:20]}' on{_hint(text)}.")
            self.tokens.append((str(match.lastgroup), match.group(str(match.lastgroup))))
            position = match.end()

    def whole(self) -> Any:
        value = self.sum()
        if self.at < len(self.tokens):
            raise LogError(f"'{self.text}' has '{self.tokens[self.at][1]}' where it should end{_hint(self.text)}.")
        return value

    def sum(self) -> Any:
        value = self.product()
        while sign := self.take("+", "-"):
            other = self.product()
            value = value + other if sign == "+" else value - other
        return value

    def product(self) -> Any:
        value = self.signed()
        while sign := self.take("*", "/"):
            other = self.signed()
            value = value * other if sign == "*" else np.divide(value, other)
        return value

    def signed(self) -> Any:
        sign = self.take("-", "+")
        if not sign:
            return self.power()
        value = self.within(self.signed)
        return -value if sign == "-" else value

    def power(self) -> Any:
        value = self.atom()
        return np.power(np.asarray(value, float), self.within(self.signed)) if self.take("**") else value

    def atom(self) -> Any:
        kind, word = self.tokens[self.at] if self.at < len(self.tokens) else ("end", "")
        self.at += 1
        if kind == "number":
            return float(word)
        if kind == "quoted" or (kind == "name" and self.peek() != "("):
            return self.named(word)
        if kind == "name":
            return self.called(word)
        if word == "(":
            value = self.within(self.sum)
            self.expect(")")
            return value
        raise LogError(f"'{self.text}' lacks a number or a column{f' before {word!r}' if word else ' at its end'}.")

    def named(self, word: str) -> Any:
        if self.values is None:
            self.used.append(word)
            return 1.0
        if word in self.values:
            value = self.values[word]
            if isinstance(value, str) and len(self.tokens) > 1:
                raise LogError(f"'{self.text}' reckons with '{word}', which is the word '{value}' and no number.")
            return value
        if word in CONSTANTS:
            return CONSTANTS[word]
        raise LogError(f"'{self.text}' takes '{word}', which is no column and no number{nearest(word, self.values)}.")

    def called(self, word: str) -> Any:
        if word not in FUNCTIONS:
            raise LogError(f"'{self.text}' calls '{word}'; there are {', '.join(FUNCTIONS)}.")
        count, function = FUNCTIONS[word]
        self.expect("(")
        arguments = [self.within(self.sum)]
        while self.take(","):
            arguments.append(self.within(self.sum))
        self.expect(")")
        if len(arguments) != count:
            raise LogError(f"'{self.text}': {word} takes {count} value{'s' * (count > 1)}, not {len(arguments)}.")
        return 1.0 if self.values is None else function(*arguments)

    def within(self, part: Callable[[], Any]) -> Any:
        self.depth += 1
        if self.depth > DEEPEST:
            raise LogError(f"'{self.text[:40]}...' is nested too deeply; write it shorter.")
        value = part()
        self.depth -= 1
        return value

    def peek(self) -> str:
        return self.tokens[self.at][1] if self.at < len(self.tokens) and self.tokens[self.at][0] == "sign" else ""

    def take(self, *signs: str) -> str:
        sign = self.peek()
        if sign not in signs:
            return ""
        self.at += 1
        return sign

    def expect(self, sign: str) -> None:
        if not self.take(sign):
            raise LogError(f"'{self.text}' lacks a '{sign}'{_hint(self.text)}.")


def _hint(text: str) -> str:
    return "" if "`" in text else "; put a column with spaces or signs in its name in backquotes"
