"""The error class of :mod:`sealegs.common.errors`, where the project's code looks for it."""

from .errors import LIKE, SealegsError, closest, nearest

__all__ = ["LIKE", "SealegsError", "closest", "nearest"]
