"""What is said of many joints alike, in one sentence."""

from __future__ import annotations

import re
from collections.abc import Sequence

MANY = 3  # joints, from which on one sentence speaks of all
OF_A_JOINT = re.compile(r"^((?:Warning: )?)joint (.+?): (.*)$", re.DOTALL)
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\w)")


def together(said: Sequence[str]) -> list[str]:
    """Sentences; those that differ in the joint and in numbers alone are one, with numbers from least to largest."""
    groups: dict[tuple[str, str], list[tuple[str, list[str]]]] = {}
    keys: list[tuple[str, str]] = []
    for sentence in said:
        match = OF_A_JOINT.match(sentence)
        key = (match[1], NUMBER.sub("{}", match[3].replace("{", "{{").replace("}", "}}"))) if match else ("", sentence)
        keys.append(key)
        groups.setdefault(key, []).append((match[2], NUMBER.findall(match[3])) if match else ("", []))
    found, told = [], set()
    for key, sentence in zip(keys, said, strict=True):
        rows = groups[key]
        if len(rows) < MANY or not rows[0][0]:
            found.append(sentence)
        elif key not in told:
            told.add(key)
            spans = [_span(column) for column in zip(*(numbers for _, numbers in rows), strict=True)]
            names = ", ".join(name for name, _ in rows)
            found.append(f"{key[0]}joints {names}: {key[1].format(*spans)}")
    return found


def _span(numbers: Sequence[str]) -> str:
    low, high = min(numbers, key=float), max(numbers, key=float)
    return low if float(low) == float(high) else f"{low} to {high}"
