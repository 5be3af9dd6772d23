"""A latency of the bus is found at first sight, also where it is longer than a sample and the duty is logged."""

from __future__ import annotations

from pathlib import Path

import pytest
from sealegs.gap.finder.diagnosis import first_look
from sealegs.gap.prepare.request import Request

from testbed.everyday import drawn
from testbed.logs import hidden_everyday


@pytest.mark.long
@pytest.mark.parametrize("seed", [716, 1106])
def test_a_latency_that_is_longer_than_a_sample_is_one_of_all_joints(seed: int, tmp_path: Path) -> None:
    """24 ms at one of two joints were told as 12: each sample of duty and current leaves a fit a minimum."""
    case = drawn(seed % 100, seed)
    data, truth = hidden_everyday(case, tmp_path)
    (late,) = [effect["values"][0] for effect in truth["effects"] if effect["name"] == "latency"]
    found = first_look(data, Request()).latency
    assert found is not None and len(found.joints) == len(case.machine.joints)
    assert found.value == pytest.approx(late, abs=1e-3) and found.low <= late <= found.high
