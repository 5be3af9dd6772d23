"""The control loop: every fault is named in time, its rate is kept, and its log is whole whatever happens."""

from __future__ import annotations

import os
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealegs.common.errors import SealegsError
from sealegs.gap.log import LogError, read_measured
from sealegs.hw.bus.clock import Metronome
from sealegs.hw.guard.stop import DeadMan
from sealegs.hw.machine.robot import build_robot
from sealegs.hw.run import measured_log
from sealegs.hw.run.connection import opened_port
from sealegs.hw.run.measured_log import SYNC, MeasuredLog, make_sidecar, read_events, recover
from sealegs.hw.virtual.wire import fault_from

from tests.servo_runs import config
from tests.simulated_runs import Simulation, sine
from tests.waiting import wait_until


@pytest.mark.parametrize(
    ("kind", "values", "names", "unreachable"),
    [
        ("silence", {"servos": [2]}, {"NoReplyError"}, {2}),
        ("overheat", {"servos": [1]}, {"OverheatFault"}, set()),
        ("unplug", {}, {"UnpluggedError"}, {1, 2}),
        *(
            pytest.param(*row, marks=pytest.mark.long)
            for row in (
                ("drop", {"servos": [2]}, {"NoReplyError"}, set()),
                ("short", {"servos": [1]}, {"ShortReplyError"}, set()),
                ("late", {"servos": [2], "delay": 0.5}, {"NoReplyError", "StaleReplyError"}, set()),
                ("brown_out", {"value": 3.8}, {"VoltageFault"}, set()),
                ("overload", {"servos": [2]}, {"OverloadFault"}, set()),
                ("corrupt", {"servos": [2]}, {"CorruptReplyError"}, set()),
            )
        ),
    ],
)
def test_a_fault_is_named_in_three_cycles_and_what_can_be_reached_is_released(
    kind: str, values: dict[str, Any], names: set[str], unreachable: set[int], tmp_path: Path
) -> None:
    planted = 2.0
    limits = {"range_margin": 3.0, "speed": 200.0, "following_error": 9.0, "late": 1.0, "silent": 0.05}
    simulation = Simulation("hopper", commands=sine(0.1), rate=50.0, folder=tmp_path, limits=limits)
    simulation.wire.faults.append(fault_from({"kind": kind, "at": planted, **values}))
    outcome = simulation.run(5.0)
    assert outcome.ending == "fault" and outcome.fault is not None and outcome.fault.name in names
    assert set(values.get("servos", ())) <= set(outcome.fault.servos)
    events = read_events(tmp_path / "run.csv")
    log = read_measured(tmp_path / "run.csv").runs[0]
    assert sum(event["event"] == "missed" for event in events) <= 3, "50 ms, of cycles of 20 ms"
    shown = (log.host["hip_status"] != 0) | (log.host["knee_status"] != 0)
    assert shown.sum() <= 1, "a fault that a servo reports ends the run in the cycle that shows it"
    assert simulation.log is not None and len(log.time) == simulation.log.rows, "complete up to the last reading"
    assert any(event["event"] == "fault" and event["name"] == outcome.fault.name for event in events)
    assert [servo for servo, on in zip((1, 2), simulation.torque, strict=True) if on] == sorted(unreachable)
    assert all(off - planted < 0.1 for off, _, on in simulation.rig.history if not on)
    if kind == "silence":
        assert set(outcome.not_at_rest) == {2}, "and it is said which servo could not be reached"


def test_a_stop_that_was_asked_for_before_the_start_switches_no_torque_on() -> None:
    simulation = Simulation()
    simulation.stop.ask("Ctrl-C")
    assert simulation.run().ending == "stopped" and not simulation.switched_on


def test_the_dead_mans_switch_counts_on_the_way_to_the_start_too() -> None:
    simulation = Simulation(commands=sine(offset=0.9), each_cycle=lambda: "let go")
    outcome = simulation.run()
    assert (outcome.ending, outcome.reason, outcome.timing.cycles) == ("stopped", "let go", 0)
    assert simulation.switched_on


def test_what_a_virtual_bus_hides_is_not_what_the_host_believes() -> None:
    robot = build_robot(config()["robot"])
    hw = {"virtual": {}, "baudrate": 1_000_000, "timeout": 1.0}
    with pytest.raises(SealegsError, match="hw=feetech"), opened_port(hw, "/dev/null", robot, None):
        pass
    with (
        pytest.raises(SealegsError, match="port=<path> is missing"),
        opened_port({**hw, "virtual": None}, None, robot, None),
    ):
        pass


# --- rate ----------------------------------------------------------------------------------------------------------


class Clock:
    """A clock that only sleeping and working move."""

    def __init__(self) -> None:
        self.time, self.slept = 100.0, 0.0

    def monotonic(self) -> float:
        return self.time

    def process_time(self) -> float:
        return self.time - self.slept

    def sleep(self, seconds: float) -> None:
        self.time += seconds
        self.slept += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    fake = Clock()
    monkeypatch.setattr("sealegs.hw.bus.clock.time", fake)
    return fake


def test_the_metronome_keeps_its_rate_and_sleeps_in_between(clock: Clock) -> None:
    metronome = Metronome(100.0)
    began = metronome.wait()
    for _ in range(50):
        clock.time += 0.004  # the work of a cycle
        metronome.done(0.001, 0.002)
        last = metronome.wait()
    assert last - began == pytest.approx(0.5), "fifty periods, on the grid"
    timing = metronome.timing()
    assert timing.cycles == 50 and timing.overruns == 0 and timing.read_mean == pytest.approx(0.001)
    assert timing.cpu_share == pytest.approx(0.4) and timing.busy_share == pytest.approx(0.4)


def test_an_overrun_is_counted_and_not_hurried_after(clock: Clock) -> None:
    metronome = Metronome(100.0)
    began = metronome.wait()
    clock.time += 0.035
    metronome.wait()
    timing = metronome.timing()
    assert timing.overruns == 1 and timing.skipped == 2
    assert metronome.wait() - began == pytest.approx(0.04), "the next one is back on the grid"


def test_real_sleep_leaves_the_processor_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []

    def monotonic() -> float:
        asked.append(time.monotonic())
        return asked[-1]

    counted = SimpleNamespace(monotonic=monotonic, sleep=time.sleep, process_time=time.process_time)
    monkeypatch.setattr("sealegs.hw.bus.clock.time", counted)
    metronome = Metronome(100.0)
    metronome.wait()
    for _ in range(30):
        metronome.done(0.001, 0.002)
        metronome.wait()
    assert asked[-1] - asked[0] > 0.29, "thirty periods passed"
    assert len(asked) <= 4 * 31, "a busy wait asks for the time thousands of times"


def test_stepped_time_waits_for_nothing(clock: Clock) -> None:
    metronome = Metronome(100.0, clock=Simulation().port)
    times = [metronome.wait() for _ in range(3)]
    assert " ms" not in metronome.timing().sentence(), "a clock that nobody kept says nothing about speed"
    assert np.diff(times) == pytest.approx([0.01, 0.01]) and metronome.now() == times[-1] and clock.slept == 0.0


@pytest.mark.parametrize("rate", [0.0, -1.0, 1e5, float("nan")])
def test_a_rate_that_is_none_is_refused(rate: float) -> None:
    with pytest.raises(SealegsError, match="rate"):
        Metronome(rate)


def test_the_dead_mans_switch_is_let_go_when_the_key_is_not_pressed_again() -> None:
    keys, pressed = os.pipe()
    now = [0.0]
    switch = DeadMan(keys, lambda: now[0])
    now[0] = 4.0
    os.write(pressed, b" ")
    assert switch.armed() is None
    now[0] = 4.5
    os.write(pressed, b"x ")
    assert switch() is None
    now[0] = 5.1
    assert switch() is None
    now[0] = 5.3
    assert switch() == "the dead-man's switch was let go"
    os.close(pressed)
    assert switch() == "the terminal was closed"
    os.close(keys)


# --- log -----------------------------------------------------------------------------------------------------------


def small_log(folder: Path, rows: int, name: str = "run") -> MeasuredLog:
    log = MeasuredLog(folder, name, make_sidecar("bench", {"mass": 0.3}, {"a": "sts3215"}, {"rate": 10}), ["a"], ())
    for k in range(rows):
        log.write(0.1 * k, np.full((1, 7), 0.01 * k), (), (0.1 * k, 0.1 * k, float("nan")), [0])
    return log


def test_a_log_is_readable_while_it_is_written(tmp_path: Path) -> None:
    log = small_log(tmp_path, 40)
    run = read_measured(log.path).runs[0]
    assert len(run.time) == 40 and run.robot_params == {"mass": 0.3} and run.meta["rate"] == 10
    assert set(run.host) == {"read_sent", "read_done", "goal_sent", "a_status"}
    log.close()


def test_rows_and_events_are_brought_to_the_disk_while_the_robot_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced, fsync = list[str](), os.fsync

    def noted(file: int) -> None:
        synced.append(os.readlink(f"/proc/self/fd/{file}") if os.path.isdir("/proc/self/fd") else "run.csv")
        fsync(file)

    log = small_log(tmp_path, 3)
    monkeypatch.setattr("sealegs.hw.run.measured_log.os.fsync", noted)
    wait_until(lambda: sum(path.endswith("run.csv") for path in synced) >= 3)
    monkeypatch.undo()
    log.close()
    assert SYNC <= 0.1 and (any(path.endswith("events.jsonl") for path in synced) or not os.path.isdir("/proc/self/fd"))


@pytest.mark.parametrize("torn", [1, 30, 55])
def test_after_a_power_cut_every_whole_line_is_recovered(torn: int, tmp_path: Path) -> None:
    log = small_log(tmp_path, 40)
    log.close()
    log.path.write_bytes(log.path.read_bytes()[:-torn] + b"\0" * 12)
    target, _ = recover(log.path)
    assert len(read_measured(target).runs[0].time) >= 38
    for gone in (None, target):  # one of its two files is enough
        if gone is not None:
            gone.unlink()
        with pytest.raises(LogError, match="never overwritten"):
            recover(log.path)


def test_a_log_never_overwrites(tmp_path: Path) -> None:
    small_log(tmp_path, 3).close()
    before = (tmp_path / "run.csv").read_bytes()
    with pytest.raises(LogError, match="never overwritten"):
        small_log(tmp_path, 5)
    assert (tmp_path / "run.csv").read_bytes() == before
    with pytest.raises(LogError, match="plain file name"):
        small_log(tmp_path, 1, "../run")


def test_a_log_without_a_row_leaves_only_its_events(tmp_path: Path) -> None:
    log = small_log(tmp_path, 0)
    log.event(0.0, "exception", error="no servo")
    log.close()
    assert [path.name for path in tmp_path.iterdir()] == ["run.events.jsonl"]
    again = small_log(tmp_path, 2)
    again.event(0.0, "started")
    again.close()
    assert [event["event"] for event in read_events(again.path)] == ["exception", "started"]
    assert len(read_measured(again.path).runs[0].time) == 2


def test_a_full_disk_is_told_and_what_was_written_is_safe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = small_log(tmp_path, 5)

    def full(*_: Any) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("sealegs.hw.run.measured_log.os.write", full)
        with pytest.raises(LogError, match="No space left"):
            log.write(1.0, np.zeros((1, 7)), (), (0.0, 0.0, 0.0), [0])
        log.event(1.0, "end")
    log.close()
    assert len(read_measured(log.path).runs[0].time) == 5


OTHERS = "of another run"


@pytest.mark.parametrize("theirs", [("run.yaml", "run.csv"), ("run.yaml",), ("run.csv",)])
def test_files_that_another_run_made_meanwhile_are_not_deleted(
    theirs: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second run that began in the same second deleted table and sidecar of the first."""
    write = measured_log.write_text

    def meanwhile(path: Path, text: str) -> None:
        for name in theirs:
            (tmp_path / name).write_text(OTHERS)
        write(path, text)

    monkeypatch.setattr(measured_log, "write_text", meanwhile)
    with pytest.raises(LogError, match=r"run\.\w+: exists already and a recording is never overwritten; choose"):
        MeasuredLog(tmp_path, "run", make_sidecar("bench", {}, {"a": "sts3215"}, {}), ["a"], ())
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == dict.fromkeys(theirs, OTHERS)
