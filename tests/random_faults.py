"""Schedules of faults drawn at random."""

from __future__ import annotations

from typing import Any

import numpy as np
from sealegs.hw.virtual.faults import KINDS

SPAN = 2.5  # [s] of the machine's clock, the way to the start included


def schedule(random: np.random.Generator, servos: list[int]) -> list[dict[str, Any]]:
    """One to three faults, some for good, some of all servos, some that spoil only a part of the replies."""
    faults = []
    for _ in range(random.integers(1, 4)):
        fault: dict[str, Any] = {"kind": str(random.choice(list(KINDS))), "at": float(random.uniform(0.0, SPAN))}
        if random.random() < 0.6:
            fault["seconds"] = float(random.uniform(0.005, 1.0))
        if random.random() < 0.7:
            fault["servos"] = [int(random.choice(servos))]
        if random.random() < 0.5:
            fault["probability"] = float(random.uniform(0.005, 1.0))
        if fault["kind"] == "late":
            fault["delay"] = float(random.uniform(0.001, 0.1))
        if fault["kind"] == "brown_out":
            fault["value"] = float(random.uniform(1.0, 7.0))
        if fault["kind"] == "restart":
            fault["value"] = float(random.uniform(0.0, 1.0))
        faults.append(fault)
    return faults
