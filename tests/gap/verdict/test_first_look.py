"""A first look turns all usual numbers together, says what it found as provisional, and tells a latency once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from sealegs.common.errors import SealegsError
from sealegs.gap.finder.diagnosis import diagnose, first_look
from sealegs.gap.output.extension import changes
from sealegs.gap.output.look import lines_of
from sealegs.gap.prepare.request import Request
from sealegs.gap.robot.search import ROBOT

from testbed import hidden_bench
from testbed.everyday import drawn
from testbed.logs import hidden_everyday

LATE = 0.0223  # [s] of the machine below


def test_a_first_look_tells_what_moves_a_joint_most() -> None:
    data, _ = hidden_bench({"drive.delay": 0.012, "friction.coulomb": "clear"}, seed=3, duration=5.0)
    found = first_look(data, Request())
    assert found.latency is None  # one joint shares nothing
    lines = list(lines_of(found))
    assert "provisional" in lines[0]
    told = [line.split()[0] for line in lines if line.startswith("  ")]
    assert told[0] == "drive.delay" and "friction.coulomb" in told
    assert any("delay.seconds = 0.017" in line for line in lines)


@pytest.mark.long
def test_a_first_look_is_at_the_joints_that_were_asked_for(tmp_path: Path) -> None:
    """It ignored joints=."""
    data, _ = hidden_everyday(replace(drawn(1, 101), duration=7.0, runs=3), tmp_path)
    found = first_look(data, Request(), ["tilt"])
    assert list(found.joints) == ["tilt"] and found.latency is None
    with pytest.raises(SealegsError, match="no joint 'lift'"):
        first_look(data, Request(), ["lift"])


@pytest.mark.long
def test_a_latency_of_the_bus_is_told_once_and_is_in_the_chain_of_each_joint(tmp_path: Path) -> None:
    """A late bus, 10 mrad of friction at one joint: the search named a delay at each, with another number."""
    data, _ = hidden_everyday(replace(drawn(1, 101), duration=7.0, runs=3), tmp_path)
    found = {one.joint: one for one in diagnose(data, causes=["drive.delay", "friction.coulomb"])}
    told = found[ROBOT].causes[0]
    value = told.parameters["delay.seconds"]
    assert told.name == "drive.delay" and told.confidence > 0.9 and value.low <= LATE <= value.high
    for joint in ("pan", "tilt"):
        assert "drive.delay" not in [cause.name for cause in found[joint].causes]
        row = next(row for row in changes(found[joint]) if row["path"] == "delay.seconds")
        assert row["why"] == "drive.delay" and row["to"] == pytest.approx(LATE, abs=1e-3)
    assert found["pan"].verdict == "explained" and "latency of all joints" in found["pan"].sentence
