"""Loops that are killed or that hang while the wire fails, too: the real supervisor brings the servos to rest."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.gap.log import read_measured
from sealegs.hw.run.measured_log import read_events
from sealegs.hw.virtual import VirtualBus

from tests.hopper_bus import hopper_bus, left_clean
from tests.hw.test_supervisor import running, torque
from tests.waiting import wait_until

SEEDS = 6
WIRE: list[dict[str, Any]] = [
    {},
    {"kind": "unplug", "seconds": 1.0},
    {"kind": "silence", "servos": [2], "seconds": 1.0},
    {"kind": "drop", "probability": 0.3, "seconds": 2.0},
    {"kind": "corrupt", "probability": 0.3, "seconds": 2.0},
    {"kind": "late", "probability": 0.3, "delay": 0.05, "seconds": 2.0},
]


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualBus]:
    with hopper_bus(tmp_path_factory.mktemp("bus")) as bus:
        yield bus


@pytest.fixture
def virtual(machine: VirtualBus) -> Iterator[VirtualBus]:
    with left_clean(machine):
        yield machine


def last(folder: Path) -> dict[str, Any]:
    return read_events(folder / "run.csv")[-1]


@pytest.mark.long
@pytest.mark.parametrize("seed", range(SEEDS))
def test_a_loop_that_is_killed_or_hangs_while_the_wire_fails_leaves_no_torque_unsaid(
    seed: int, virtual: VirtualBus, tmp_path: Path
) -> None:
    random = np.random.default_rng(seed)
    rest = "hold" if seed % 3 == 2 else "release"
    process = running(virtual, tmp_path, "silence=2.0", "patience=1.0", f"rest={rest}")
    if wire := WIRE[seed % len(WIRE)]:
        virtual.fault(**wire)
    time.sleep(float(random.uniform(0.0, 0.2)))
    before = time.monotonic()
    process.send_signal(signal.SIGKILL if random.random() < 0.5 else signal.SIGSTOP)
    wait_until(lambda: last(tmp_path).get("by") == "supervisor" and last(tmp_path)["event"] == "at rest")
    assert torque(virtual) == [rest == "hold"] * 2
    if rest == "hold":  # who watches them lives, and releases them where asked to
        taken = next(event for event in read_events(tmp_path / "run.csv") if event["event"] == "supervisor")
        os.kill(taken["process"], signal.SIGTERM)
        wait_until(lambda: not any(torque(virtual)))
    handed_over = any(event["event"] == "fault" for event in read_events(tmp_path / "run.csv"))
    if handed_over:  # it found the wire broken before the signal came: stopped, it commands nothing any more
        process.send_signal(signal.SIGCONT)
    _, said = process.communicate()
    assert handed_over or process.returncode == -signal.SIGKILL, "it cannot wake up again"
    events = read_events(tmp_path / "run.csv")
    failed = [event for event in events if event["event"] == "not at rest" and event["by"] == "supervisor"]
    assert bool(failed) == ("TORQUE MAY BE ON" in said), said
    if process.returncode == -signal.SIGKILL:  # else the loop woke up and said so itself
        assert f"the supervisor has {'held' if rest == 'hold' else 'released'} servo(s) 1, 2" in said
    else:
        assert f"the servos are {'held' if rest == 'hold' else 'released'}" in said
    taken = next(event for event in events if event["event"] == "supervisor")
    assert (handed_over or taken["monotonic"] > before) and len(read_measured(tmp_path / "run.csv").runs[0].time) > 20


@pytest.mark.long
def test_an_adapter_that_stays_away_after_a_kill_is_said_and_tried_until_it_is_back(
    virtual: VirtualBus, tmp_path: Path
) -> None:
    process = running(virtual, tmp_path, "patience=0.5")
    virtual.fault("unplug")
    process.kill()
    _, said = process.communicate()  # the supervisor lets go of the pipe, and goes on
    assert "TORQUE MAY BE ON at servo(s) 1, 2: CUT THE POWER" in said and all(torque(virtual))
    virtual.clear()
    wait_until(lambda: not any(torque(virtual)))
    wait_until(lambda: last(tmp_path)["event"] == "at rest")
