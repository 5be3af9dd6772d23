"""The supervisor: whatever becomes of the loop or the wire, all servos come to rest, and the log says so."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.gap.log import read_measured
from sealegs.hw.bus.packets import BusError, NoReplyError
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.guard.supervisor import bring_to_rest
from sealegs.hw.run.measured_log import read_events
from sealegs.hw.virtual import VirtualBus

from tests.servo_runs import excitation, start
from tests.waiting import wait_until


def hopper_bus(folder: Path) -> VirtualBus:
    """The bus, linked into a folder: after an unplugging, the system may give the port's number to another process."""
    return VirtualBus(robot="hopper", link=folder / "servos")


@contextmanager
def left_clean(machine: VirtualBus) -> Iterator[VirtualBus]:
    """The machine; afterwards it is released and without faults."""
    yield machine
    machine.clear()
    with ServoBus(machine.port, timeout=0.5) as bus:
        assert bus.torque_off([1, 2]) == {}


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualBus]:
    with hopper_bus(tmp_path_factory.mktemp("bus")) as bus:
        yield bus


@pytest.fixture
def virtual(machine: VirtualBus) -> Iterator[VirtualBus]:
    with left_clean(machine):
        yield machine


def torque(virtual: VirtualBus) -> list[bool]:
    return [servo["torque"] for servo in virtual.status()["servos"].values()]


def running(virtual: VirtualBus, folder: Path, *arguments: str) -> subprocess.Popen[str]:
    """deploy.py on the bus, its log well under way."""
    chosen = ["hw=feetech", f"port={virtual.port}", "robot=hopper", "robot.sensors={}", "robot.safety.range_margin=3.0"]
    chosen += [f"calibration={folder / 'c.yaml'}", "robot.safety.late=1.0", "hw.timeout=0.5"]  # a busy host is no fault
    chosen += ["robot.safety.following_error=9", "robot.safety.silent=1.0"]
    (folder / "c.yaml").write_text(
        "robot: hopper\njoints:\n  hip: {id: 1, zero: 2048, direction: 1, range: [-1.2, 0.3]}\n"
        "  knee: {id: 2, zero: 2048, direction: 1, range: [-0.3, 1.2]}\n"
    )
    goals = excitation(folder / "hip.csv", "hip", amplitude=0.2)
    goals.write_text(goals.read_text().replace("hip.goal", "knee.goal"))
    process = start(*chosen, f"excitation={goals}", f"out={folder}", "name=run", *arguments)
    wait_until(
        lambda: (folder / "run.csv").is_file() and len((folder / "run.csv").read_bytes().splitlines()) > 30, process
    )
    assert all(torque(virtual))
    return process


def test_after_a_kill_the_servos_are_released_and_the_log_is_whole(virtual: VirtualBus, tmp_path: Path) -> None:
    process = running(virtual, tmp_path, "silence=20.0")
    rows, requests = stopped_at(process, virtual, tmp_path)
    os.kill(process.pid, signal.SIGCONT)
    time.sleep(0.5)
    _, later = stopped_at(process, virtual, tmp_path)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    wait_until(lambda: not any(torque(virtual)))
    wait_until(lambda: read_events(tmp_path / "run.csv")[-1]["event"] == "at rest")
    run = read_measured(tmp_path / "run.csv").runs[0]
    cycles = (later - requests) / 2  # a reading and goals in each; so many the machine has served
    assert cycles > 5
    assert cycles - (len(run.time) - rows) < 0.1 * run.meta["rate"], "all but the last 100 ms"
    assert (run.joints["hip"].goal is not None) and run.meta["registers"]["hip"]["p_gain"] == 32
    assert read_events(tmp_path / "run.csv")[-1]["by"] == "supervisor"
    with ServoBus(virtual.port, timeout=0.5) as bus:  # the port is free for the next one
        assert bus.ping(1) == 777


def stopped_at(process: subprocess.Popen[str], virtual: VirtualBus, folder: Path) -> tuple[int, int]:
    """Rows in the log and requests that the machine has served, of one moment: the loop is frozen meanwhile."""
    os.kill(process.pid, signal.SIGSTOP)
    time.sleep(0.1)
    return len((folder / "run.csv").read_bytes().splitlines()) - 1, virtual.status()["requests"]


@pytest.mark.long
def test_after_a_kill_the_servos_are_held_where_that_is_configured(virtual: VirtualBus, tmp_path: Path) -> None:
    process = running(virtual, tmp_path, "rest=hold")
    os.kill(process.pid, signal.SIGKILL)
    _, errors = process.communicate()
    wait_until(lambda: read_events(tmp_path / "run.csv")[-1]["event"] == "at rest")
    assert all(torque(virtual))
    goals = [servo["goal"] for servo in virtual.status()["servos"].values()]
    time.sleep(0.3)
    status = virtual.status()["servos"].values()
    assert [servo["goal"] for servo in status] == goals
    assert all(abs(servo["goal"] - servo["steps"]) < 60 for servo in status), "it stands at its goal"
    release = re.findall(r"`(kill \d+)` releases them", errors)
    assert [read_events(tmp_path / "run.csv")[-1]["release"]] == release, errors
    subprocess.run(release[0], shell=True, check=True)
    wait_until(lambda: not any(torque(virtual)))
    wait_until(lambda: read_events(tmp_path / "run.csv")[-1].get("why", "").endswith("was asked to end."))


@pytest.mark.long
def test_a_loop_that_hangs_loses_the_servos_and_cannot_wake_up_again(virtual: VirtualBus, tmp_path: Path) -> None:
    process = running(virtual, tmp_path, "silence=0.3")
    os.kill(process.pid, signal.SIGSTOP)
    wait_until(lambda: not any(torque(virtual)))
    assert process.wait(10.0) == -signal.SIGKILL
    process.communicate()
    events = {event["event"]: event for event in read_events(tmp_path / "run.csv")}
    assert "silent for 0.3 s" in events["supervisor"]["why"]


@pytest.mark.long
def test_ctrl_c_releases_the_servos_without_the_supervisor(virtual: VirtualBus, tmp_path: Path) -> None:
    process = running(virtual, tmp_path)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30.0)
    assert process.returncode == 130 and errors.strip().splitlines()[-1] == "Stopped; the servos are released."
    assert not any(torque(virtual))
    events = [event["event"] for event in read_events(tmp_path / "run.csv")]
    assert events[-2:] == ["at rest", "end"] and "supervisor" not in events


@pytest.mark.long
def test_ctrl_c_in_a_terminal_ends_the_loop_and_not_the_virtual_servos(tmp_path: Path) -> None:
    process = start("excitation=chirp", f"out={tmp_path}", "name=run", terminal=True)
    log = tmp_path / "run.csv"
    wait_until(lambda: log.is_file() and len(log.read_bytes().splitlines()) > 5, process)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all that runs in it
    _, errors = process.communicate(timeout=60.0)
    assert (process.returncode, errors.strip().splitlines()[-1]) == (130, "Stopped; the servos are released.")
    assert "UnpluggedError" not in log.with_name("run.events.jsonl").read_text()


class HalfABus:
    """A bus whose second servo never answers."""

    def __init__(self) -> None:
        self.told: list[int] = []

    def torque_off(self, ids: list[int], failing: Any = None) -> dict[int, BusError]:
        self.told += ids
        return {2: NoReplyError("servo 2 is silent.", [2])}

    def hold(self, ids: list[int]) -> None:
        self.told += ids
        if ids == [2]:
            raise NoReplyError("servo 2 is silent.", [2])


@pytest.mark.parametrize("rest", ["release", "hold"])
def test_every_servo_is_tried_even_when_one_fails(rest: Any) -> None:
    bus: Any = HalfABus()
    assert list(bring_to_rest(bus, [1, 2, 3], rest)) == [2]
    assert bus.told == [1, 2, 3]


@pytest.mark.long
def test_it_goes_on_trying_while_the_adapter_is_unplugged(virtual: VirtualBus, tmp_path: Path) -> None:
    process = running(virtual, tmp_path)
    virtual.fault("unplug", seconds=1.0)
    _, errors = process.communicate(timeout=40.0)
    lines = errors.strip().splitlines()
    assert process.returncode == 2  # a busy host may be called slow before
    assert any(line.startswith("TORQUE MAY BE ON at servo(s) 1, 2: CUT THE POWER") for line in lines)
    assert "adapter" in lines[-1] and "the servos are released" in lines[-1], "in the end it has them"
    assert not any(torque(virtual))
    assert any(event.get("by") == "supervisor" for event in read_events(tmp_path / "run.csv"))


@pytest.mark.long
def test_an_adapter_that_stays_away_leaves_torque_on_and_that_is_said(virtual: VirtualBus, tmp_path: Path) -> None:
    process = running(virtual, tmp_path)
    virtual.fault("unplug")
    _, errors = process.communicate(timeout=40.0)
    assert process.returncode == 2 and "TORQUE MAY BE ON at servo(s) 1, 2" in errors and "cut their power" in errors
    assert all(torque(virtual))


@pytest.mark.long
def test_the_supervisor_ends_with_its_loop_and_its_own_end_is_noticed() -> None:
    code = (
        "import os, signal, time\nfrom sealegs.hw.guard.supervisor import Charge, Supervisor\n"
        "s = Supervisor(Charge('/dev/null', 1000000, 'sts3215', 0.02, [1], 'release', 1.0, os.getpid()))\n"
        "print(s.beat()); s.dismiss(); print(s.alive)\n"
        "s = Supervisor(Charge('/dev/null', 1000000, 'sts3215', 0.02, [1], 'release', 1.0, os.getpid()))\n"
        "os.kill(s.pid, signal.SIGKILL)\n"
        "while s.alive: time.sleep(0.01)\n"
        "print(s.beat())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == ["True", "False", "False"], done.stderr


# --- loops that are killed or hang while the wire fails, too -------------------------------------------------------


SEEDS = 6
WIRE: list[dict[str, Any]] = [
    {},
    {"kind": "unplug", "seconds": 1.0},
    {"kind": "silence", "servos": [2], "seconds": 1.0},
    {"kind": "drop", "probability": 0.3, "seconds": 2.0},
    {"kind": "corrupt", "probability": 0.3, "seconds": 2.0},
    {"kind": "late", "probability": 0.3, "delay": 0.05, "seconds": 2.0},
]


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
