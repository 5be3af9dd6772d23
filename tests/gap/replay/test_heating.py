"""A temperature in whole degrees still says how warm a motor is, with the current that heats it."""

from __future__ import annotations

import numpy as np
import pytest
from sealegs.gap.checks.data_set import together
from sealegs.gap.log.finding import Finding
from sealegs.gap.replay.layout import between_steps, heated


def motor(seconds: float = 60.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, current and temperature of a winding that warms by 2 K, with numbers of its own (4 J/K, 9 K/W)."""
    time = np.arange(0.0, seconds, 0.01)
    current = 0.26 * np.sin(2.0 * time) * (1.0 + (np.sin(0.2 * time) > 0.0))
    warm = np.empty(len(time))
    level = 24.7
    for k, i in enumerate(current):
        warm[k] = level
        level += 0.01 * (3.0 * i * i - (level - 24.7) / 9.0) / 4.0
    return time, current, warm


def test_the_current_tells_what_rounding_hid():
    time, current, warm = motor()
    logged = np.round(warm)
    assert np.ptp(logged) <= 2.0
    found = heated(time, logged, current)
    error, before = (np.std(values - warm) for values in (found, between_steps(time, logged)))
    assert error < 0.12 and error < 0.6 * before


def test_what_the_current_does_not_explain_stays_as_it_was_logged():
    time, current, warm = motor()
    room = np.round(24.7 + 3.0 * (time > 30.0))
    assert heated(time, np.round(warm), None) is not None
    assert np.array_equal(heated(time, room, 0.0 * current), room)
    fine = np.round(warm, 2)
    assert np.array_equal(heated(time, fine, current), fine)


@pytest.mark.parametrize(("speed", "alike"), [(0.156, True), (6.41, True), (0.3, False)])
def test_a_unit_and_a_gear_are_both_told_where_both_fit(speed: float, alike: bool):
    findings = [
        Finding("unit.velocity", "error", "j", "j.velocity", "In another unit.", value=speed),
        Finding("torque.gear_side", "error", "j", "j.torque", "Of another side.", value=1.0 / 6.33),
    ]
    said = " ".join(finding.sentence for finding in together(findings))
    assert ("of the same log" in said) is alike
