"""Chains for recordings of one servo whose files say how its drive was set: gain, supply, limit of the current."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ....actuators.chain import LIBRARY, load_chain
from ....actuators.published import DRIVES, as_recorded
from .recording import Recording

Chain = str | list[dict[str, Any]]


def of_one_servo(recording: Recording, joints: Sequence[str]) -> bool:
    """Whether it is of one servo with a pendulum on its shaft, whose gain the file may say."""
    return recording.kind in ("bam", "table") and {"mass", "length"} <= recording.facts.keys() and len(joints) == 1


def shipped_chain(facts: Mapping[str, float | str]) -> Chain | None:
    """The shipped chain of a recording's motor, set as it says; None where there is none or it says no gain.

    Args:
        facts: numbers and words of the recording.
    """
    motor = facts.get("motor")
    if not isinstance(motor, str) or motor not in DRIVES or not (LIBRARY / f"{motor}.yaml").is_file():
        return None
    return as_recorded(DRIVES[motor], load_chain(motor).to_list(), facts) if "kp" in facts else None
