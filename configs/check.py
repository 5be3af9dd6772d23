"""Check of a config value against the type of the parameter that it is meant for; pydantic does the checking.

A type may carry bounds, ``Annotated[int, Ge(1)]``, and what is wrong is told in one sentence with the key in it.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import operator
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Lt

from ..common.errors import SealegsError, nearest

if TYPE_CHECKING:
    from pydantic import TypeAdapter
    from pydantic_core import ErrorDetails

Natural = Annotated[int, Ge(0)]
Count = Annotated[int, Ge(1)]
NotNegative = Annotated[float, Ge(0)]
Positive = Annotated[float, Gt(0)]
Pixels = Annotated[int, Ge(16)]
Share = Annotated[float, Gt(0), Lt(1)]

_WORDS = {int: "a whole number", float: "a number", bool: "true or false", str: "a word", type(None): "null"}
_BOUNDS = {
    "greater_than_equal": ("at least", "ge"),
    "greater_than": ("more than", "gt"),
    "less_than_equal": ("at most", "le"),
    "less_than": ("less than", "lt"),
}
"""Pydantic's word for what is wrong: ours, and the name under which it keeps the bound."""


def or_null(kind: Any) -> Any:
    """The type ``kind``, or null."""
    return kind | None


def checked(key: str, value: Any, annotation: Any, sentence: str = "") -> Any:
    """``value`` as the type of ``annotation``: 5 becomes 5.0 for a float, 1e6 becomes 1000000 for an int.

    A float must be finite. Of a union the first type that fits counts.

    Args:
        key: dotted name of the value, for the message.
        value: as YAML or the command line gave it.
        annotation: a type, a union of types, or one of these with bounds of ``annotated_types``.
        sentence: to answer with, where the words for the type would not tell enough.

    Raises:
        SealegsError: the value is of another type, or beyond a bound.
    """
    from pydantic import ValidationError  # here, because `--help` needs none of it

    try:
        return _adapter(annotation, repr(annotation)).validate_python(value)
    except ValidationError as error:
        details = error.errors(include_url=False)
    if sentence:
        raise SealegsError(sentence)
    if bound := _bound(details):
        raise SealegsError(f"{key} must be {bound}, not {value}.")
    words = list(dict.fromkeys(_describe(option) for option in _options(annotation)))
    raise SealegsError(f"{key} takes {' or '.join(words)}, not {value!r}.")


Kind = TypeVar("Kind")


def checked_fields(where: str, document: Any, kind: type[Kind]) -> Kind:
    """The dataclass ``kind`` from a mapping of YAML; a key that is left out keeps its default.

    Args:
        where: dotted name of the mapping, for messages; empty at the top of a file.
        document: the mapping.
        kind: a dataclass whose fields are the keys.

    Raises:
        SealegsError: it is no mapping, has an unknown key, lacks one, or a value is of another type.
    """
    fields = dataclasses.fields(kind)  # type: ignore[arg-type]
    known, types = [item.name for item in fields], get_type_hints(kind, include_extras=True)
    prefix = f"{where}." if where else ""
    values = checked(where or "it", document, dict[str, Any], f"{where or 'it'} is a mapping of {', '.join(known)}.")
    for key in values:
        if key not in known:
            raise SealegsError(f"{prefix}{key} is unknown{nearest(str(key), known)}; there are {', '.join(known)}.")
    for item in fields:
        if item.default is item.default_factory is dataclasses.MISSING and item.name not in values:
            raise SealegsError(f"{prefix}{item.name} is missing.")
    return kind(**{key: checked(f"{prefix}{key}", value, types[key]) for key, value in values.items()})


def checked_seed(value: Any, key: str = "seed") -> int:
    """``value`` as the seed of a random generator.

    Raises:
        SealegsError: it is no whole number from 0.
    """
    return checked(key, value, Natural)


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
    """Types of a union, or the one type; bounds are left out."""
    if get_origin(annotation) is Annotated:
        return _options(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        return tuple(option for inner in get_args(annotation) for option in _options(inner))
    return (annotation,)


# --- pydantic ------------------------------------------------------------------------------------------------------


@functools.cache
def _adapter(annotation: Any, spelled: str) -> TypeAdapter[Any]:
    """``spelled`` tells unions of another order apart, which compare as equal."""
    del spelled
    from pydantic import ConfigDict, TypeAdapter

    return TypeAdapter(_schema(annotation), config=ConfigDict(arbitrary_types_allowed=True))


def _schema(annotation: Any) -> Any:
    """The type as pydantic must see it to convert without loss what YAML writes, and nothing else."""
    from pydantic import AllowInfNan, BeforeValidator, Field, InstanceOf, Strict

    origin, inner = get_origin(annotation) or annotation, get_args(annotation)
    if origin is Annotated:
        return Annotated[_schema(inner[0]), *inner[1:]]
    if origin in (Union, types.UnionType):
        some: Any = tuple(_schema(option) for option in inner if option is not type(None))
        several = functools.reduce(operator.or_, some)
        first = Annotated[several, Field(union_mode="left_to_right")] if len(some) > 1 else several
        return or_null(first) if len(some) < len(inner) else first
    if origin is float:
        return Annotated[float, Strict(), AllowInfNan(False)]
    if origin is int:
        return Annotated[int, Strict(), BeforeValidator(_whole)]
    if origin in (bool, str):
        return Annotated[origin, Strict()]
    if origin is tuple:
        items = tuple(item if item is Ellipsis else _schema(item) for item in inner)
        return Annotated[tuple[items] if items else tuple, BeforeValidator(_listed)]
    if origin in (list, Sequence):
        return Annotated[list[_schema(inner[0])] if inner else list, Strict()]
    if origin in (dict, Mapping):
        return Annotated[dict, Strict()]
    if origin in (Any, None, type(None), Literal):
        return annotation
    return InstanceOf[origin] if isinstance(origin, type) else _Never


class _Never:
    """Of types that no value in a YAML file has, such as a function: nothing is an instance."""


def _whole(value: Any) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _listed(value: Any) -> Any:
    if not isinstance(value, list):
        raise ValueError("not a list")
    return value


def _bound(details: Sequence[ErrorDetails]) -> str:
    """The bound that a value of the right type broke, in words; empty where the type is wrong."""
    for detail in details:
        if detail["type"] in _BOUNDS:
            words, name = _BOUNDS[detail["type"]]
            return f"{words} {detail.get('ctx', {})[name]:g}"
    return ""


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
