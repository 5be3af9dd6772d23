"""Fits that are kept as they are made, so that none is made twice.

The ways of a search begin alike, and a diagnosis that was stopped goes on where it was. A fit is deterministic: asked
again with the same data it ends at the same values, and is read instead of made. One that differs in anything (start,
bounds, data, step) is not found and made anew, so that a journal can slow nothing down and change no result. On disk
each fit is a line. Fits of other code are not read: :mod:`sealegs.gap.output.partial` sees to that.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TextIO
from weakref import WeakKeyDictionary

import numpy as np

from ...common.documents import parse_json
from ..replay.parameters import Parameter
from ..replay.problem import Problem


class Journal:
    """The fits of one diagnosis.

    Attributes:
        path: of the file; None where they are kept in memory alone.
        reused: fits that were read.
        made: fits that were added.
    """

    def __init__(self, path: Path | None) -> None:
        """Open the journal at ``path`` or begin it; a line that a kill tore is dropped."""
        self.path = path
        self._known: dict[str, dict[str, Any]] = {}
        self.reused = self.made = 0
        self._file: TextIO | None = None
        if path is not None:
            self._read(path)
            self._file = path.open("a", encoding="utf-8")

    def __len__(self) -> int:
        return len(self._known)

    def recall(self, question: str) -> dict[str, Any] | None:
        """The answer to a question; None where there is none yet."""
        answer = self._known.get(question)
        self.reused += answer is not None
        return answer

    def record(self, question: str, answer: Mapping[str, Any]) -> None:
        """Keep the answer to a question that :meth:`recall` did not have."""
        self.made += 1
        self._known[question] = dict(answer)
        if self._file is not None:
            self._file.write(json.dumps({"key": question, **answer}) + "\n")
            self._file.flush()

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()

    def _read(self, path: Path) -> None:
        """Take what is there, and cut off what a kill tore; the file is never rewritten as a whole."""
        kept = 0
        for line in path.read_bytes().splitlines(keepends=True) if path.exists() else []:
            try:
                row = parse_json(line)
                self._known[row["key"]] = row
            except (ValueError, LookupError, TypeError):
                break
            if not line.endswith(b"\n"):
                break
            kept += len(line)
        if path.exists():
            os.truncate(path, kept)


_JOURNAL: ContextVar[Journal | None] = ContextVar("journal", default=None)


@contextlib.contextmanager
def keeping(path: Path | None) -> Iterator[Journal]:
    """Keep the fits that are made in this context at ``path``; None: in memory, until it ends."""
    journal = Journal(path)
    token = _JOURNAL.set(journal)
    try:
        yield journal
    finally:
        _JOURNAL.reset(token)
        journal.close()


def kept_at() -> Path | None:
    """Where the fits of this context are kept on disk; None where they are not."""
    journal = _JOURNAL.get()
    return None if journal is None else journal.path


def recalled(
    problem: Problem, parameters: Sequence[Parameter], start: Mapping[str, float], evaluations: int
) -> dict[str, Any] | None:
    """What a fit with these arguments found before: ``values``, ``cost``, ``at_bound``; None where it was not made."""
    journal = _JOURNAL.get()
    return None if journal is None else journal.recall(_question(problem, parameters, start, evaluations))


def recorded(
    problem: Problem,
    parameters: Sequence[Parameter],
    start: Mapping[str, float],
    evaluations: int,
    found: Mapping[str, Any],
) -> None:
    """Keep what a fit found, where anything is kept."""
    if (journal := _JOURNAL.get()) is not None:
        answer = {key: found[key] for key in ("values", "cost", "at_bound")}
        journal.record(_question(problem, parameters, start, evaluations), answer)


def _question(problem: Problem, parameters: Sequence[Parameter], start: Mapping[str, float], evaluations: int) -> str:
    """What tells one fit from another, as a hash."""
    digest = hashlib.sha256(_digest(problem))
    said = [[repr(parameter) for parameter in parameters], sorted(start.items()), evaluations]
    digest.update(json.dumps(said).encode())
    return digest.hexdigest()[:32]


_DIGESTS: WeakKeyDictionary[Problem, bytes] = WeakKeyDictionary()


def _digest(problem: Problem) -> bytes:
    """Hash of all that a problem is made of: data, commands, models, weights and step."""
    if problem not in _DIGESTS:
        digest = hashlib.sha256()
        _feed(digest, problem)
        _DIGESTS[problem] = digest.digest()
    return _DIGESTS[problem]


def _feed(digest: Any, value: Any) -> None:
    """Add a value to a hash: arrays by their bytes, dataclasses and collections by their parts."""
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif is_dataclass(value) and not isinstance(value, type):
        digest.update(type(value).__name__.encode())
        for item in fields(value):
            _feed(digest, getattr(value, item.name))
    elif isinstance(value, Mapping):
        for key, item in value.items():
            _feed(digest, key)
            _feed(digest, item)
    elif isinstance(value, Sequence) and not isinstance(value, str | bytes):
        digest.update(f"{len(value)}[".encode())
        for item in value:
            _feed(digest, item)
    elif type(value).__repr__ is object.__repr__:  # which tells where it lies in memory
        made_from: Any = object.__reduce_ex__(value, 2)
        _feed(digest, made_from[1:3])
    else:
        digest.update(f"{value!r};".encode())
