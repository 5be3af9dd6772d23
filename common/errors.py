"""The one error class of the project, the hint that its messages carry, and the word of a warning."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class SealegsError(ValueError):
    """Something a person can put right: one sentence that says what is wrong, where, and what to do.

    Scripts print the sentence and leave with exit status 2; a traceback means a bug.
    """


WARNING = "Warning: "
"""Beginning of a sentence that a person should not pass over."""
LIKE = 0.5
"""Likeness, from 0 to 1, from which an option may be meant by another word."""


def nearest(name: str, options: Iterable[str], like: float = LIKE) -> str:
    """`` (did you mean 'x'?)`` for the option closest to ``name``, or an empty string."""
    close = closest(name, options, like)
    return f" (did you mean '{close}'?)" if close is not None else ""


def closest(name: str, options: Iterable[str], like: float = LIKE) -> str | None:
    """The option closest to ``name``, or None where none is so close."""
    close = difflib.get_close_matches(str(name), [str(option) for option in options], n=1, cutoff=like)
    return close[0] if close else None
