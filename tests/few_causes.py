"""A catalogue of a few causes, so that a diagnosis takes seconds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sealegs.gap.causes.catalogue import Cause, catalogue


def few(*names: str, of: Callable[[Any], list[Cause]] = catalogue) -> Callable[[Any], list[Cause]]:
    """The catalogue ``of``, with the causes of these names only; to be put in its place."""
    return lambda nominal: [cause for cause in of(nominal) if cause.name in names]
