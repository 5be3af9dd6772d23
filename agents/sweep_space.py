"""What a sweep draws from: values of the command line in Hydra's grammar of sweeps, as distributions of Optuna.

Hydra's own sweeper for Optuna needs an Optuna below 3 and begins anew after a kill, so the translation stands here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import ChoiceSweep, IntervalSweep, QuotedString, RangeSweep
from hydra.errors import HydraException

from ..common.errors import SealegsError
from ..common.extras import needed_for
from .config import WORDS

with needed_for("sealegs sweep"):
    from optuna.distributions import (
        BaseDistribution,
        CategoricalDistribution,
        FloatDistribution,
        IntDistribution,
    )

Space = Mapping[str, BaseDistribution]
"""What each swept key is drawn from."""
GRAMMAR = "give a,b,c, range(1,5), interval(0.9,0.99) or tag(log,interval(1e-4,1e-2))"


def read_space(arguments: Sequence[str]) -> tuple[dict[str, BaseDistribution], list[str]]:
    """Keys that are swept, and the arguments with one value.

    Raises:
        SealegsError: a sweep that has no values, or is of files.
    """
    space: dict[str, BaseDistribution] = {}
    fixed = []
    for argument in arguments:
        key, _, value = argument.partition("=")
        found = _swept(key.strip(), value.strip())
        if found is None:
            fixed.append(argument)
        else:
            space[key.strip()] = found
    return space, fixed


def _swept(key: str, value: str) -> BaseDistribution | None:
    """The distribution that a value stands for; None: it is one value, right or wrong."""
    try:
        parsed = OverridesParser.create().parse_override(f"{key}={value}")
        if not parsed.is_sweep_override():
            return None
        found: Any = parsed.value()
        if isinstance(found, ChoiceSweep | RangeSweep):
            found.shuffle = False  # a sweep that goes on draws from the same
        texts = list(parsed.sweep_string_iterator()) if isinstance(found, ChoiceSweep | RangeSweep) else []
    except (HydraException, ValueError, RecursionError):
        return None  # train says what is wrong with it
    if isinstance(found, ChoiceSweep) and texts:
        if key in WORDS:  # which a training takes as they are
            texts = [_word(*pair) for pair in zip(found.list, texts, strict=True)]
        return CategoricalDistribution(list(dict.fromkeys(texts)))
    if isinstance(found, RangeSweep) and texts:
        whole = all(isinstance(number, int) for number in (found.start, found.stop, found.step))
        numbers = sorted(map(int if whole else float, texts))
        step = abs(found.step)
        kind: Any = IntDistribution if whole else FloatDistribution
        return kind(numbers[0], numbers[-1], step=step)
    if isinstance(found, IntervalSweep) and found.start is not None and found.end is not None:
        whole = isinstance(found.start, int) and isinstance(found.end, int)
        kind = IntDistribution if whole else FloatDistribution
        logarithmic = "log" in found.tags
        if found.start < found.end and not (logarithmic and found.start <= 0):
            return kind(found.start, found.end, log=logarithmic)
    raise SealegsError(f"{key}={value} is no sweep that can be drawn from: {GRAMMAR}, from low to high.")


def refuse_unread(arguments: Sequence[str]) -> None:
    """Refuse a value that was perhaps meant to be several.

    Raises:
        SealegsError: one cannot be read.
    """
    for argument in arguments:
        key, _, value = (part.strip() for part in argument.partition("="))
        if key in WORDS or value[:1] in ("[", "{"):  # which are read otherwise
            continue
        try:
            OverridesParser.create().parse_override(f"{key}={value}")
        except (HydraException, ValueError, RecursionError):
            raise SealegsError(f"{key}={value} cannot be read: {GRAMMAR}, or one value.") from None


def _word(item: Any, text: str) -> str:
    return item.text if isinstance(item, QuotedString) else item if isinstance(item, str) else text


def choices(key: str, value: str) -> list[str]:
    """The words that a value of the command line stands for: those that are swept, or the one."""
    found = _swept(key, value)
    if isinstance(found, CategoricalDistribution):
        return [str(word) for word in found.choices]
    quoted = len(value) > 1 and value[0] == value[-1] and value[0] in "'\""
    return [value[1:-1] if quoted else value]


def combinations(space: Space, most: int | None = None) -> list[dict[str, Any]] | None:
    """Each combination of values once; None where there are more than ``most``, or no end of them."""
    values = [_values(distribution) for distribution in space.values()]
    if any(row is None for row in values):
        return None
    if most is not None and math.prod(len(row) for row in values if row is not None) > most:
        return None
    rows = itertools.product(*(row for row in values if row is not None))
    return [dict(zip(space, row, strict=True)) for row in rows]


def _values(distribution: BaseDistribution) -> list[Any] | None:
    if isinstance(distribution, CategoricalDistribution):
        return list(distribution.choices)
    if isinstance(distribution, IntDistribution) and not distribution.log and distribution.step is not None:
        return list(range(distribution.low, distribution.high + 1, distribution.step))
    if isinstance(distribution, FloatDistribution) and distribution.step is not None:
        count = round((distribution.high - distribution.low) / distribution.step)
        return [distribution.low + k * distribution.step for k in range(count + 1)]
    return None


def first_values(space: Space) -> dict[str, Any]:
    """One value of each key."""
    return {key: next(_some(distribution)) for key, distribution in space.items()}


def each_value(space: Space) -> Iterator[dict[str, Any]]:
    """Each value of each key once, with the first one of the other keys; of an interval some of its values."""
    first = first_values(space)
    yield first
    for key, distribution in space.items():
        for value in itertools.islice(_some(distribution), 1, None):
            yield {**first, key: value}


def _some(distribution: Any) -> Iterator[Any]:
    """All values of a list; both ends of an interval, and one between that is no whole number where it may be none."""
    if isinstance(distribution, CategoricalDistribution):
        yield from distribution.choices
    else:
        yield distribution.low
        yield distribution.high
        if isinstance(distribution, FloatDistribution) and distribution.step is None:
            yield distribution.low + (distribution.high - distribution.low) / math.pi


def as_arguments(values: Mapping[str, Any]) -> list[str]:
    """Arguments of the command line with these values."""
    return [f"{key}={_text(value)}" for key, value in values.items()]


def _text(value: Any) -> str:
    return f"{value:.10g}" if isinstance(value, float) and math.isfinite(value) else str(value)
