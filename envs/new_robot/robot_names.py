"""Names of joints in a YAML, and those that logs cannot take, or the command line only in quotes."""

from __future__ import annotations

import json
import re
from collections.abc import Collection

import yaml

SLASHES = "/\\"
"""What no log can have in the name of a joint, since files of a diagnosis are named for it."""
SPECIAL = "!\"#&'(),:;<=>[]^`{}~"
"""What the command line takes for something else where it stands without quotes."""
WORDS = ("true", "false", "null", "nan", "inf")


def in_yaml(word: str) -> str:
    """A word as it stands in a YAML: in quotes where it would be read as anything else."""
    if any(ord(letter) < 32 for letter in word):
        return json.dumps(word)
    plain = yaml.safe_dump([word], default_flow_style=True, width=float("inf"), allow_unicode=True)[1:-2]
    return f"'{plain}'" if plain == word and _is_number(word) else plain


def name_note(name: str, single: bool, reserved: Collection[str]) -> str:
    """What a joint's name keeps from working, and the way out, as a phrase; empty where all works.

    Args:
        name: of the driven coordinate.
        single: whether it is one joint of the model, and no belt.
        reserved: words that columns of logs are.
    """
    other = f"my_{name}"
    if name in reserved:
        why = f"logs have columns '{name}.*' that belong to no joint, so a log of this robot cannot be read"
    elif any(letter in name for letter in SLASHES):
        why = "its name has a slash, so a log of this robot cannot be read: a diagnosis names files for joints"
        other = _without_signs(name)
    elif any(letter in SPECIAL or ord(letter) > 126 or ord(letter) < 32 for letter in name):
        why = "its name has a sign that needs quotes on the command line"
        other = _without_signs(name)
    elif _is_number(name) or name.lower() in WORDS:
        why = "its name reads as a value, so that it needs quotes on the command line"
        other = f"joint_{_without_signs(name)}"
    else:
        return ""
    if not single:
        return f"{why}; give it another name here, such as {other}"
    return f"{why}; give the joint another name here and name the model's: {other}: {{joint: {in_yaml(name)}, ...}}"


def _without_signs(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_") or "joint"


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
