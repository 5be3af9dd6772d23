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
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pint

from ....common.documents import read_yaml
from ....common.errors import nearest
from ..types import BEHIND, Array, LogError

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


def wrapped(values: Any, period: Any) -> Array:
    """What begins anew after a period, running on.

    Raises:
        LogError: the period is no positive number.
    """
    size = np.asarray(period, np.float64)
    if size.ndim or not 0.0 < float(size) < math.inf:
        raise LogError("wrapped(<column>, <period>) takes a positive number as its period, such as 86400.")
    return passing(lambda known: np.unwrap(known, period=float(size)))(values)


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


def complement(counts: Any, bits: int) -> Array:
    """Numbers of a register of so many bits that were read without their sign, in two's complement."""
    cells = np.asarray(counts, np.float64)
    return np.where(cells >= 2.0 ** (bits - 1), cells - 2.0**bits, cells)


def longest_jump(counts: Array) -> float:
    """The longest step from one known cell to the next."""
    known = counts[np.isfinite(counts)]
    return float(np.abs(np.diff(known)).max(initial=0.0))


def shows_sign(counts: Array, bit: int) -> bool:
    """Whether counts of a register (n,) go on without their long jumps where a bit is read as their sign."""
    return _register(counts, bit + 1) and longest_jump(sign_bit(counts, bit)) < STEADIER_SHARE * longest_jump(counts)


def _register(counts: Array, bits: int) -> bool:
    """Whether counts are whole numbers that need no more than so many bits."""
    known = counts[np.isfinite(counts)]
    return len(known) > 1 and not (known != np.round(known)).any() and 0.0 <= known.min() <= known.max() < 2.0**bits


def lost_sign(counts: Array) -> str:
    """The reading, with ``{}`` for the column, by which counts of a register (n,) go on without their long jumps: their
    sign was lost; empty where none was."""
    bits = next((bits for bits in (16, 32) if _register(counts, bits)), 0)
    if not bits or np.nanmax(counts) < 2.0 ** (bits - 1):
        return ""
    ways = {f"signed{bits}({{}})": complement(counts, bits), f"sign_bit({{}}, {bits - 1})": sign_bit(counts, bits - 1)}
    best = min(ways, key=lambda way: longest_jump(ways[way]))
    return best if longest_jump(ways[best]) < STEADIER_SHARE * longest_jump(counts) else ""


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
    "wrapped": (2, wrapped),
    "signed16": (1, lambda counts: complement(counts, 16)),
    "signed32": (1, lambda counts: complement(counts, 32)),
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


# --- units as foreign files write them, each understood to its last letter, and measured by pint ---------------------
#
# A unit has one spelling here: ``deg``, ``mA``, ``kgf.cm``, ``0.1 deg``, ``deg/min``. A prefix or a number that is
# dropped would make a wrong log, so what is not understood whole is no unit.

TABLE = read_yaml(Path(__file__).with_name("units.yaml"))


def _by_word(section: str) -> dict[str, str]:
    return {word: unit for unit, words in TABLE[section].items() for word in words.split()}


WORDS, ALONE, FORCES, ARMS = (_by_word(section) for section in ("words", "in_brackets", "forces", "arms"))
"""Units by the words that say them: anywhere, in brackets, and as force and arm of a torque."""
PREFIXES, PINT = _by_word("prefixes"), _by_word("pint")
UNIT_OR_NAME = ("rot", "rotation", "cycle", "cycles")
"""Words that, outside brackets, name a joint as often as they say turns."""
TEMPERATURES = {"degC": "{}", "0.1 degC": "{}*0.1", "degF": "({} - 32)/1.8", "K": "({} - 273.15)"}
"""Expression of a temperature by its unit."""
PREFIXED = ("rad", "deg", "turn", "m", "s", "A", "V", "N", "N.m", "rpm")
"""Units that stand behind a prefix."""
QUANTITIES = {"way": "meter", "speed": "meter/second", "rate": "1/second", "time": "second", "current": "ampere",
              "voltage": "volt", "angle": "radian", "force": "newton", "torque": "newton*meter"}  # fmt: skip
"""Quantities by a unit of each."""
_BASE = "[numcdk]?(?:rad|deg|turn|rpm|[msAVN])|arcmin|arcsec|min|[hd]|in|ft|kgf|gf|lbf|ozf"
SPELT = re.compile(rf"(?:{_BASE})(?:\.(?:{_BASE}))?(?:/(?:s|min|h))?")
"""Units in their spelling here."""
DIGITS = r"(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?"
_FORCE, _ARM = ("|".join(sorted(words, key=len, reverse=True)) for words in (FORCES, ARMS))
TORQUE = re.compile(
    rf"(?P<force>{_FORCE})[ .*·⋅_-]?(?P<arm>{_ARM})|(?P<arm2>in|ft|foot|inch)[ .*·⋅_-]?(?P<force2>lbs?|lbf|ozf?)"
)
NUMBER = re.compile(r"(10(?:\^|\*\*)[-+]?\d+|\d*[.,]?\d+(?:e[-+]?\d+)?|pi|π|1/\d+)\s*[*x·]?\s*(?=[^\d\s.,/^*])")
RATE = re.compile(r"(.+?)\s*(?:/|\bper\b|p(?=s\Z))\s*(?:(s|sec|second)|(min|minute)|(h|hour))\Z")
LONGEST_UNIT = 60
"""Letters of what may be a unit: the time of its patterns grows with the square of them."""
PREFIX = re.compile(rf"((?:{'|'.join(PREFIXES)})[ -]?|[numcdk])(.+)\Z")
LIKE = re.compile(r".+(deg|degs|degrees?|rads?|radians?|turns|revs|rotations|revolutions|rpm|°)\Z")


@dataclass(frozen=True)
class Measure:
    """What a unit measures.

    Attributes:
        quantity: ``angle``, ``way``, ``rate``, ``speed``, ``time``, ``current``, ``voltage``, ``force``, ``torque``.
        behind: expression behind a column that makes it rad, m, s, A, V, N, N.m, or one of these a second.
        factor: the same as a number.
    """

    quantity: str
    behind: str
    factor: float


@cache
def _registry() -> tuple[pint.UnitRegistry, dict[Any, str]]:
    """Pint's units, and quantities by their dimensions."""
    units = pint.UnitRegistry()
    return units, {units.Unit(unit).dimensionality: quantity for quantity, unit in QUANTITIES.items()}


@cache
def measure(unit: str) -> Measure | None:
    """What a unit in its spelling here measures; None for counts, shares, temperatures and what is no unit."""
    number, _, plain = unit.rpartition(" ")
    if not SPELT.fullmatch(plain) or not (number in ("", "pi") or re.fullmatch(DIGITS, number)):
        return None
    size = math.pi if number == "pi" else float(number or 1.0)
    known = re.sub(r"[A-Za-z]+", lambda word: PINT.get(word[0], word[0]), plain.replace(".", "*"))
    units, quantities = _registry()
    base = units.Quantity(1.0, known).to_base_units()
    quantity = quantities.get(base.dimensionality)
    if quantity is None:
        return None
    factor = float(base.magnitude)
    behind = BEHIND.get(plain, "" if factor == 1.0 else f"*{_written(factor)}")
    if number and plain not in BEHIND:
        behind, number = f"*{_written(size * factor)}", ""
    return Measure(quantity, f"*{number}{behind}" if number else behind, size * factor)


def _written(factor: float) -> str:
    """A factor with its digits, a power of ten as 1e-3."""
    power = round(math.log10(factor)) if factor > 0.0 else 0
    return f"1e{power}" if power <= -2 and math.isclose(factor, 10.0**power, rel_tol=1e-12) else f"{factor:.10g}"


def measures(unit: str, *quantities: str) -> Measure | None:
    """What a unit measures where that is one of some quantities, else None."""
    found = measure(unit)
    return found if found and found.quantity in quantities else None


def unit_of(text: str) -> str:
    """The unit that a text is, in brackets or without; empty where it is none that is understood whole."""
    if len(text) > LONGEST_UNIT:
        return ""
    plain = text.strip().strip("[]()").translate(str.maketrans("µμ", "uu")).lower()
    return _unit(" ".join(plain.split()))


def _unit(text: str) -> str:
    if found := ALONE.get(text) or WORDS.get(text):
        return found
    if match := NUMBER.match(text):
        unit = _unit(text[match.end() :].strip())
        over, _, under = match[1].replace(",", ".").replace("10^", "1e").replace("10**", "1e").partition("/")
        number = "pi" if over in ("pi", "π") else f"{float(over) / float(under or 1.0):.10g}"
        return f"{number} {unit}" if unit and " " not in unit and (measure(unit) or unit in TEMPERATURES) else ""
    if match := TORQUE.fullmatch(text):
        force, arm = FORCES[match["force"] or match["force2"]], ARMS[match["arm"] or match["arm2"]]
        return f"{force}.{arm}" if force != "gf" or arm == "cm" else ""  # g.m may be of an inertia
    if match := RATE.match(text):
        unit = _unit(match[1])
        rate = f"{unit}/{'s' if match[2] else 'min' if match[3] else 'h'}"
        known = measures(unit, "angle", "way") and measure(rate)
        return ("rpm" if rate == "turn/min" else rate) if known else ""
    if match := PREFIX.match(text):
        base = _unit(match[2])
        return PREFIXES.get(match[1].strip(" -"), match[1]) + base if base in PREFIXED else ""
    return ""


def like_a_unit(text: str) -> bool:
    """Whether a text that is no unit as a whole ends as one does, so that a unit may be meant."""
    words = [
        word for word in re.findall(r"[^\W\d_]+|°|%", text.lower()) if len(word) > 1 or re.search(r"[\d/*·^]", text)
    ]
    known = [word for word in words if WORDS.get(word, "tick") != "tick" or word in FORCES or _unit(word)]
    return any(LIKE.match(word) for word in words) or bool(known and not {WORDS.get(word) for word in known} & {"tick"})
