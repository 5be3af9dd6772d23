"""Other values of chosen numbers, each put in place for as long as a monkeypatch lasts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, MutableMapping
from dataclasses import replace
from typing import Any, cast

import pytest
from sealegs.envs.engine.numbers import Number

Change = Callable[[pytest.MonkeyPatch], None]


def attribute(owner: Any, name: str, value: Any) -> Change:
    """Another value of what a module or class holds under a name."""
    return lambda patch: patch.setattr(owner, name, value)


def item(owner: Mapping[str, Any], key: str, value: Any) -> Change:
    """Another value of one item of a mapping."""
    return lambda patch: patch.setitem(cast("MutableMapping[str, Any]", owner), key, value)


def assumed_numbers(numbers: Mapping[str, Number], factor: float = 1.1) -> dict[str, Change]:
    """Every assumed number of a robot, by its name, times ``factor``."""
    return {
        name: item(numbers, name, replace(number, value=factor * number.value))
        for name, number in numbers.items()
        if number.assumed
    }
