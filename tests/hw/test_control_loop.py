"""The control loop on a virtual bus: its rate, its log, and every fault named in time while a policy runs."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealegs.common.errors import SealegsError
from sealegs.gap.log import LogError, read_measured
from sealegs.hw.bus.clock import Metronome
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.guard.deadman import DeadMan
from sealegs.hw.guard.safety import Limits, Safety
from sealegs.hw.guard.stop import Stop
from sealegs.hw.guard.supervisor import bring_to_rest
from sealegs.hw.machine.robot import ServoRobot, build_robot
from sealegs.hw.run.commands import PolicyCommands, Trajectory
from sealegs.hw.run.connection import opened_port
from sealegs.hw.run.loop import ControlLoop, Outcome
from sealegs.hw.run.measured_log import SYNC, MeasuredLog, make_sidecar, read_events, recover
from sealegs.hw.run.policy import Policy
from sealegs.hw.virtual import VirtualBus
from sealegs.hw.virtual.faults import fault_from
from sealegs.hw.virtual.in_process import bus_in_process
from sealegs.hw.virtual.simulated_port import SimulatedPort
from sealegs.hw.virtual.wire import Wire

from tests.servo_runs import config, gentle_policy
from tests.waiting import GIVE_UP, wait_until

TIMEOUT = 1.0
"""For a reply [s]: what shares the processors with this test must not look like a fault."""
PERIOD = 0.02
SIGNALS = ("goal", "position", "velocity", "duty", "voltage", "current", "temperature")


class Within:
    """The hopper's virtual bus in this process, in simulated time: what is tested does not hang on the processors."""

    def __init__(self) -> None:
        robot = build_robot(config("robot=hopper")["robot"])
        _, self.rig = bus_in_process(robot)
        self.wire = Wire(self.rig, [])
        self.port = SimulatedPort(self.wire, TIMEOUT)

    def bus(self) -> ServoBus:
        return ServoBus("simulated", timeout=TIMEOUT, opened=self.port.reopened())

    def fault(self, kind: str, **values: Any) -> float:
        with self.port.clock.lock:
            self.wire.faults.append(fault_from({"kind": kind, **values}, self.port.now()))
            return self.port.now()

    def status(self) -> dict[str, Any]:
        servos = {
            str(servo.id): {"torque": self.rig.torque(servo.joint), "since": self.rig.since[servo.joint]}
            for servo in self.rig.servos
        }
        return {"servos": servos, "history": self.rig.history, "time": self.port.now()}


def opened(virtual: Within | VirtualBus) -> ServoBus:
    return virtual.bus() if isinstance(virtual, Within) else ServoBus(virtual.port, timeout=TIMEOUT)


class Run:
    """A policy on the hopper of a virtual bus, in a thread; what goes wrong is planted meanwhile."""

    def __init__(self, virtual: Within | VirtualBus, policy: Path, folder: Path, rest: Any = "release") -> None:
        settings = config(
            "robot=hopper",
            "robot.safety.range_margin=3.0",
            "robot.safety.speed=200.0",
            "robot.safety.following_error=9",
        )["robot"]
        self.robot = build_robot(settings)
        loaded = Policy(policy)
        self.robot.check_contract(loaded.contract)
        rate = loaded.contract.control_rate
        self.bus = opened(virtual)
        sidecar = make_sidecar("hopper", {}, self.robot.belief, {})
        signals = (*SIGNALS, "link_position")
        self.log = MeasuredLog(folder, "run", sidecar, self.robot.names, signals, self.robot.base_names)
        # in real time another program may hold the machine for longer
        patience = {"silent": 0.05} if isinstance(virtual, Within) else {"silent": 1.0, "loss": 0.9}
        limits = Limits.from_config({**settings["safety"], "late": 1.0, **patience})
        safety = Safety(self.robot, limits, 1.0 / rate)
        commands = PolicyCommands(loaded, self.robot)
        self.stop = Stop()
        self.loop = ControlLoop(self.bus, self.robot, safety, commands, rate, log=self.log, rest=rest, stop=self.stop)
        self.outcome: Outcome | None = None
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def _run(self) -> None:
        try:
            self.outcome = self.loop.run(3000.0)
        finally:
            self.log.close()

    def under_way(self) -> None:
        """Wait until the policy has been in command for some cycles."""
        wait_until(lambda: self.log.rows >= 10, self.thread, lambda: read_events(self.log.path))

    def ended(self) -> Outcome:
        """Wait for the end."""
        self.thread.join(GIVE_UP)
        assert self.outcome is not None, read_events(self.log.path)
        return self.outcome


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return gentle_policy(tmp_path_factory.mktemp("policy") / "policy.onnx", "SeaLegs/Hopper-v0")


def hopper(**keys: Any) -> VirtualBus:
    robot = build_robot(config("robot=hopper")["robot"])
    return VirtualBus(robot="hopper", sensors={sensor.name: sensor.per_radian for sensor in robot.sensors}, **keys)


@pytest.fixture(scope="module")
def real_machine() -> Iterator[VirtualBus]:
    with hopper() as bus:
        yield bus


@pytest.fixture
def virtual() -> Within:
    return Within()


def torque(virtual: Within | VirtualBus) -> dict[int, bool]:
    servos = virtual.status()["servos"]
    return {int(number): servo["torque"] for number, servo in servos.items() if int(number) <= 2}


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
    kind: str, values: dict[str, Any], names: set[str], unreachable: set[int],
    virtual: Within, policy: Path, tmp_path: Path,
) -> None:  # fmt: skip
    run = Run(virtual, policy, tmp_path)
    run.under_way()
    planted = virtual.fault(kind, **values)
    outcome = run.ended()
    assert outcome.ending == "fault" and outcome.fault is not None and outcome.fault.name in names
    if values.get("servos"):
        assert set(values["servos"]) <= set(outcome.fault.servos)
    events = read_events(run.log.path)
    log = read_measured(run.log.path).runs[0]
    assert sum(event["event"] == "missed" for event in events) <= 3, "50 ms, of cycles of 20 ms"
    shown = (log.host["hip_status"] != 0) | (log.host["knee_status"] != 0)
    assert shown.sum() <= 1, "a fault that a servo reports ends the run in the cycle that shows it"
    assert len(log.time) == run.log.rows, "the log is complete up to the last cycle that had a reading"
    assert any(event["event"] == "fault" and event["name"] == outcome.fault.name for event in events)
    status = virtual.status()["servos"]
    reachable = [status[str(servo)] for servo in {1, 2} - unreachable]
    assert not any(servo["torque"] for servo in reachable)
    assert all(servo["since"] - planted < 0.1 for servo in reachable), "on the machine's clock, which no host stalls"
    if kind == "silence":
        assert set(outcome.not_at_rest) == {2}, "and it is said which servo could not be reached"


@pytest.mark.parametrize(("kind", "servo"), [("overheat", 1), pytest.param("silence", 2, marks=pytest.mark.long)])
@pytest.mark.long
def test_in_real_time_a_fault_is_named_and_the_servos_in_reach_are_released(
    kind: str, servo: int, real_machine: VirtualBus, policy: Path, tmp_path: Path
) -> None:
    """How fast is told in stepped time above, and measured by ``python -m benchmarks.control_loop``."""
    real_machine.clear()
    run = Run(real_machine, policy, tmp_path)
    run.under_way()
    real_machine.fault(kind, servos=[servo])
    outcome = run.ended()
    assert outcome.fault is not None and outcome.fault.servos == (servo,)
    assert not real_machine.status()["servos"]["1"]["torque"]


@pytest.mark.long
def test_a_single_lost_reply_is_counted_cured_and_does_not_stop_the_robot(
    virtual: Within, policy: Path, tmp_path: Path
) -> None:
    run = Run(virtual, policy, tmp_path)
    run.under_way()
    rows = run.log.rows
    virtual.fault("drop", servos=[2], count=1)
    wait_until(lambda: run.log.rows >= rows + 20, run.thread)
    run.stop.ask("enough")
    outcome = run.ended()
    assert outcome.ending == "stopped" and outcome.bus["NoReplyError"] == 1
    assert not any(event["event"] == "missed" for event in read_events(run.log.path))


def test_a_stopped_loop_holds_where_that_is_configured(virtual: Within, policy: Path, tmp_path: Path) -> None:
    run = Run(virtual, policy, tmp_path, "hold")
    run.under_way()
    run.stop.ask("enough")
    assert run.ended().ending == "stopped" and torque(virtual) == {1: True, 2: True}


class Guard:
    """A supervisor that lives as long as it is told to."""

    def __init__(self, lives: Callable[[], bool]) -> None:
        self.beat, self.asking, self.starting, self.heard = lives, lives, lives, list[str]()

    def resting(self) -> bool:
        self.heard.append("resting")
        return self.beat()

    def dismiss(self) -> None:
        self.heard.append("dismiss")


def still(virtual: Within, trajectory: type[Trajectory] = Trajectory, **keys: Any) -> Outcome:
    """Holding the hopper where it begins, without a log."""
    robot = build_robot(config("robot=hopper", "robot.sensors={}", "robot.safety.range_margin=3.0")["robot"])
    settings = config(
        "robot=hopper", "robot.safety.range_margin=3.0", "robot.safety.late=1.0", "robot.safety.following_error=9"
    )["robot"]["safety"]
    commands = trajectory("still", np.array([0.0, 1.0]), np.tile([-0.61, 0.61], (2, 1)))
    safety = Safety(robot, Limits.from_config({**settings, "speed": 200.0}), PERIOD)
    return ControlLoop(virtual.bus(), robot, safety, commands, 1.0 / PERIOD, **keys).run(1.0)


def switched_on(virtual: Within, since: float) -> bool:
    return any(on and time_ >= since for time_, _, on in virtual.status()["history"])


@pytest.mark.long
def test_no_torque_stays_on_without_a_supervisor(virtual: Within) -> None:
    asked = list[float]()

    class Counted(Trajectory):
        def goals(self, time: float, reading: Any) -> np.ndarray:
            asked.append(time)
            return super().goals(time, reading)

    guard = Guard(lambda: len(asked) < 5)  # however many cycles the way to the start takes
    outcome = still(virtual, Counted, supervisor=guard)
    assert outcome.fault is not None and outcome.fault.name == "supervisor" and outcome.timing.cycles > 0
    assert torque(virtual) == {1: False, 2: False} and guard.heard == ["resting", "dismiss"]
    fault = still(virtual, supervisor=Guard(lambda: False)).fault  # on the way to the start
    assert fault is not None and "supervisor that guards the servos has ended" in fault.sentence
    assert torque(virtual) == {1: False, 2: False}


def test_a_stop_that_was_asked_for_before_the_start_switches_no_torque_on(virtual: Within) -> None:
    stop, before = Stop(), virtual.status()["time"]
    stop.ask("Ctrl-C")
    assert still(virtual, stop=stop).ending == "stopped"
    assert not switched_on(virtual, before)


def test_the_dead_mans_switch_counts_on_the_way_to_the_start_too(virtual: Within) -> None:
    before = virtual.status()["time"]
    outcome = still(virtual, each_cycle=lambda: "let go")
    assert (
        (outcome.ending, outcome.reason) == ("stopped", "let go")
        and outcome.timing.cycles == 0
        and switched_on(virtual, before)
    )


def test_an_exception_in_the_loop_releases_the_servos(virtual: Within, tmp_path: Path) -> None:
    robot = build_robot(config("robot=hopper", "robot.sensors={}", "robot.safety.range_margin=3.0")["robot"])
    settings = config(
        "robot=hopper", "robot.safety.range_margin=3.0", "robot.safety.late=1.0", "robot.safety.following_error=9"
    )["robot"]["safety"]

    class Broken(Trajectory):
        def goals(self, time: float, reading: Any) -> np.ndarray:
            raise ZeroDivisionError("a bug")

    commands = Broken("broken", np.array([0.0, 1.0]), np.tile([-0.61, 0.61], (2, 1)))
    safety = Safety(robot, Limits.from_config({**settings, "speed": 200.0}), PERIOD)
    with pytest.raises(ZeroDivisionError):
        ControlLoop(virtual.bus(), robot, safety, commands, 1.0 / PERIOD).run(5.0)
    assert torque(virtual) == {1: False, 2: False}
    with virtual.bus() as again:  # the port was closed
        assert again.ping(1) == 777


def test_what_a_virtual_bus_hides_is_not_what_the_host_believes() -> None:
    robot = build_robot(config()["robot"])
    hw = {"virtual": {}, "baudrate": 1_000_000, "timeout": TIMEOUT}
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
    machine = Within()
    metronome = Metronome(100.0, clock=machine.port)
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
    log = MeasuredLog(
        folder, name, make_sidecar("bench", {"mass": 0.3}, {"a": "sts3215"}, {"rate": 10}), ["a"], SIGNALS, ()
    )
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


def test_rest_is_release_or_hold(virtual: Within) -> None:
    with virtual.bus() as bus:
        bus.torque_on([1, 2])
        assert bring_to_rest(bus, [1, 2], "hold") == {} and torque(virtual) == {1: True, 2: True}
        assert bring_to_rest(bus, [1, 2], "release") == {} and torque(virtual) == {1: False, 2: False}
    assert isinstance(build_robot(config()["robot"]), ServoRobot)
