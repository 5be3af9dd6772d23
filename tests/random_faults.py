"""Schedules of faults drawn at random, and how long the calls of a policy take."""

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
        if fault["kind"] == "unplug" and "seconds" in fault and random.random() < 0.5:
            fault["name"] = f"/dev/again{len(faults)}"
        faults.append(fault)
    return faults


def pace(random: np.random.Generator, period: float) -> dict[str, Any]:
    """Time that each call of a policy takes [s]: mostly none, else more than a period, or long and once."""
    drawn = random.random()
    if drawn < 0.25:
        return {"seconds": float(random.uniform(1.0, 2.0)) * period}
    if drawn < 0.45:
        return {"blocks": (int(random.integers(1, 150)), float(random.uniform(0.05, 1.5)))}
    return {}
