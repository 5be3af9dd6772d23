"""Check of a config value against the type of the parameter that it is meant for."""

from __future__ import annotations

import inspect
import math
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal, Union, get_args, get_origin

from ..actuators.errors import SealegsError

_WORDS = {int: "a whole number", float: "a number", bool: "true or false", str: "a word", type(None): "null"}


def checked(key: str, value: Any, annotation: Any) -> Any:
    """``value`` as the type of ``annotation``: 5 becomes 5.0 for a float, 1e6 becomes 1000000 for an int.

    A float must be finite.

    Raises:
        SealegsError: the value is of another type.
    """
    for option in _options(annotation):
        fits, converted = _convert(value, option)
        if fits:
            return converted
    words = list(dict.fromkeys(_describe(option) for option in _options(annotation)))
    raise SealegsError(f"{key} takes {' or '.join(words)}, not {value!r}.")


def checked_seed(value: Any, key: str = "seed") -> int:
    """``value`` as the seed of a random generator.

    Raises:
        SealegsError: it is no whole number from 0.
    """
    seed = checked(key, value, int)
    if seed < 0:
        raise SealegsError(f"{key} must be at least 0, not {seed}.")
    return seed


def arguments(function: Callable[..., Any], taken: Iterable[str] = ()) -> dict[str, Any]:
    """Names and types of those arguments of ``function`` that a YAML file can give, less those ``taken``."""
    types_by_name: dict[str, Any] = {}
    for name, parameter in inspect.signature(function).parameters.items():
        annotation = Any if parameter.annotation is parameter.empty else parameter.annotation
        if isinstance(annotation, str):  # the module postpones its annotations
            annotation = eval(annotation, getattr(inspect.unwrap(function), "__globals__", {}))
        if name not in taken and parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY):
            types_by_name[name] = annotation
    return {name: annotation for name, annotation in types_by_name.items() if _settable(annotation)}


def _settable(annotation: Any) -> bool:
    """Whether a YAML file can express some value of the type, other than null."""
    return any(option is Any or _describe(option) not in ("null", "an object") for option in _options(annotation))


def _options(annotation: Any) -> tuple[Any, ...]:
    return get_args(annotation) if get_origin(annotation) in (Union, types.UnionType) else (annotation,)


def _convert(value: Any, option: Any) -> tuple[bool, Any]:
    """Whether ``value`` is, or losslessly becomes, of the plain type ``option``; and the value that results."""
    origin = get_origin(option) or option
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if origin is Any:
        return True, value
    if origin is Literal:
        return value in get_args(option), value
    if origin is float:
        fits = number and math.isfinite(value)
        return fits, float(value) if fits else value
    if origin is int:
        whole = number and float(value).is_integer()
        return whole, int(value) if whole else value
    if origin in (bool, str):
        return isinstance(value, origin), value
    if origin in (None, type(None)):
        return value is None, value
    if origin in (list, tuple, Sequence):
        inner = [argument for argument in get_args(option) if argument is not Ellipsis]
        if not isinstance(value, list) or (len(inner) == 1 and not all(_convert(item, inner[0])[0] for item in value)):
            return False, value
        return True, tuple(value) if origin is tuple else value
    if origin in (dict, Mapping):
        return isinstance(value, dict), value
    return isinstance(origin, type) and isinstance(value, origin), value


def _describe(option: Any) -> str:
    origin = get_origin(option) or option
    if origin is None:
        origin = type(None)
    if origin is Literal:
        return " or ".join(repr(choice) for choice in get_args(option))
    if origin in (list, tuple, Sequence):
        return "a list"
    if origin in (dict, Mapping):
        return "a mapping"
    if origin is Callable:
        return "a schedule such as lin_3e-4"
    return _WORDS.get(origin, "an object")
