"""Emergency stops and dead-man's switches, as torque comes on and in mid-cycle; who gets the loop's priority."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.common.errors import SealegsError
from sealegs.gap.log import LogError
from sealegs.hw.bus.buses import BusGroup
from sealegs.hw.bus.packets import UnpluggedError
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.guard.safety import Fault, Limits, Safety
from sealegs.hw.guard.stop import LET_GO, DeadMan, Stop, emergency_stop
from sealegs.hw.machine.robot import build_robot
from sealegs.hw.run import pace as module
from sealegs.hw.run.loop import ControlLoop
from sealegs.hw.run.measured_log import read_events
from sealegs.hw.run.pace import realtime
from sealegs.hw.virtual import VirtualBus

from tests.hw.test_adapters import both_buses
from tests.servo_runs import config
from tests.simulated_runs import Simulation, sine
from tests.waiting import GIVE_UP, wait_until

SLOW = 0.016  # [s] that an FTDI adapter holds bytes


@pytest.fixture
def button() -> Iterator[tuple[int, Callable[[], object]]]:
    reader, writer = os.pipe()
    yield reader, lambda: os.write(writer, b"!")
    os.close(reader)
    os.close(writer)


def pressed_as_torque_comes_on(
    simulation: Simulation, button: tuple[int, Callable[[], object]], count: int, monkeypatch: pytest.MonkeyPatch
) -> float:
    """Run, and press the button as soon as ``count`` servos have torque; when that was [s]."""
    at: list[float] = []
    read = simulation.port.readPort

    def pressing(length: int) -> bytes:
        if not at and sum(simulation.torque) == count:
            at.append(simulation.port.now())
            button[1]()
            wait_until(lambda: simulation.stop.emergency)
        return read(length)

    monkeypatch.setattr(simulation.port, "readPort", pressing)
    with emergency_stop(button[0], simulation.stop, lambda: simulation.bus.torque_off(simulation.robot.ids)):
        outcome = simulation.run(1.0)
    assert outcome.ending == "stopped" and outcome.reason == "the emergency stop was pressed"
    assert simulation.torque == [False] * len(simulation.robot.ids) and outcome.not_at_rest == {}
    return at[0]


@pytest.mark.parametrize("count", [1, 2, 4])
def test_an_emergency_stop_while_torque_comes_on_lets_no_further_servo_have_it(
    count: int, button: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = Simulation("row", latency=SLOW)
    at = pressed_as_torque_comes_on(simulation, button, count, monkeypatch)
    on = [time for time, _, on in simulation.rig.history if on]
    assert len(on) == count and max(on) - at < 1e-3, "what is on the wire then arrives"
    off = [time for time, _, on in simulation.rig.history if not on]
    assert max(off) - at < 4 * SLOW, "the servo whose turn it is, and the packet to all"
    assert "held" not in simulation.guard.heard


def test_an_emergency_stop_ends_the_preparation_of_servos_though_its_thread_never_gets_the_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Four packets that prepare the second servo went out before the loop asked: 97 ms on a slow adapter."""
    simulation, at = Simulation("row", latency=SLOW), list[float]()
    read = simulation.port.readPort

    def pressing(length: int) -> bytes:
        if not at and sum(simulation.torque) == 1:
            at.append(simulation.port.now())
            simulation.stop.press("the emergency stop was pressed")
        return read(length)

    monkeypatch.setattr(simulation.port, "readPort", pressing)
    assert simulation.run(1.0).ending == "stopped"
    assert simulation.rig.history[-1][0] - at[0] < 4 * SLOW and not any(simulation.torque)


def test_an_emergency_stop_releases_servos_that_were_to_be_held(button: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = Simulation("row", rest="hold")
    pressed_as_torque_comes_on(simulation, button, 2, monkeypatch)
    assert simulation.guard.heard[0] == "release only" and simulation.guard.heard[-1] == "dismiss"


def test_ctrl_c_while_torque_comes_on_ends_that_too() -> None:
    simulation = Simulation("row", latency=SLOW)

    def asked() -> None:
        if sum(simulation.torque) == 2:
            simulation.stop.ask("Ctrl-C")

    simulation.guard.at_each["starting"] = asked
    assert simulation.run(1.0).ending == "stopped"
    assert len([on for _, _, on in simulation.rig.history if on]) == 2 and not any(simulation.torque)


def test_on_two_adapters_no_further_servo_gets_torque_either() -> None:
    both = both_buses()
    wishes = iter([True] * 6 + [False])  # the first bus asks at its beginning, and three times for its servo
    assert not both.bus.torque_on(both.robot.ids, lambda: next(wishes, False))
    assert both.torque == [False, False] and len([on for _, _, on in both.rig.history if on]) == 1


def test_the_supervisor_watches_before_the_first_servo_gets_torque() -> None:
    simulation = Simulation("row")
    heard: list[list[bool]] = []
    simulation.guard.at_each["starting"] = lambda: heard.append(simulation.torque)
    assert simulation.run(0.5).ending == "finished"
    assert heard[0] == [False] * 4
    assert [sum(row) for row in heard] == [0, *(count for count in range(4) for _ in range(3))], "thrice for each servo"


def test_without_a_supervisor_that_listens_no_torque_comes_on() -> None:
    simulation = Simulation("row")
    simulation.guard.lives = False
    outcome = simulation.run(0.5)
    assert outcome.fault is not None and outcome.fault.name == "supervisor" and not simulation.switched_on


@pytest.mark.parametrize(
    ("silent", "count"), [(False, 1), *(pytest.param(silent, 10, marks=pytest.mark.long) for silent in (False, True))]
)
def test_every_emergency_stop_of_a_running_loop_takes_less_than_20_ms(
    silent: bool, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pressed at any byte of a cycle, counted on the clock of the machine; with a servo silent, its wait included."""
    took: list[float] = []
    for moment in range(count):
        reader, writer = os.pipe()
        simulation = Simulation("row", limits={"silent": 9.0, "loss": 1.0, "following_error": 9.0})
        took.append(stop_at(simulation, moment, silent, (reader, writer), monkeypatch))
        os.close(reader)
        os.close(writer)
    assert max(took) < 0.02, took


def stop_at(
    simulation: Simulation, moment: int, silent: bool, pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> float:
    """Press at the ``moment``-th look for bytes half a second after the start; until all torque is off [s]."""
    port = simulation.port
    read, sleep, looks, at = port.readPort, port.sleep, [0], list[float]()
    done = threading.Event()

    def looked(length: int) -> bytes:
        looks[0] += simulation.loop.state == "running" and simulation.loop.elapsed > 0.5
        if not at and looks[0] > moment:
            at.append(port.now())
            os.write(pipe[1], b"!")
            wait_until(lambda: simulation.stop.emergency)
        return read(length)

    def slept(seconds: float) -> None:
        if at:  # the loop's thread leaves the line to the other one, as it does on a clock that does not wait
            assert done.wait(10.0)
        sleep(seconds)

    def let_go() -> None:
        simulation.bus.torque_off(simulation.robot.ids)
        done.set()

    monkeypatch.setattr(port, "readPort", looked)
    monkeypatch.setattr(port, "sleep", slept)
    if silent:
        simulation.loop.each_cycle = lambda: (
            simulation.fault("silence", servos=[2])
            if simulation.loop.elapsed > 0.45 and simulation.loop.state == "running" and not simulation.wire.faults
            else None
        )
    with emergency_stop(pipe[0], simulation.stop, let_go):
        outcome = simulation.run(2.0)
    assert at and outcome.reason == "the emergency stop was pressed", outcome
    first = [joint for joint in range(4) if not (silent and joint == 1)]
    assert not any(simulation.torque[joint] for joint in first)
    return max(time for time, servo, on in simulation.rig.history if not on) - at[0]


# --- what ends a run is what is told --------------------------------------------------------------------------


@pytest.mark.parametrize("fault", ["overheat", "unplug", "goal"])
def test_a_log_that_fails_with_the_fault_does_not_take_its_place(
    fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = Simulation(folder=tmp_path, limits={"following_error": 9.0})

    def full(*_: Any) -> None:
        if simulation.loop.elapsed > 0.5:
            raise LogError("the log cannot be written: No space left on device")

    def unplugged(*_: Any) -> None:
        raise UnpluggedError("the adapter at /dev/ttyUSB0 is gone; plug it in.")

    def broken() -> None:
        if simulation.loop.elapsed > 0.5:
            if fault == "goal":
                monkeypatch.setattr(simulation.loop.safety, "admit", lambda *_: Fault("goal", "a goal is no number"))
            elif fault == "unplug":
                write = simulation.bus.write_goals
                monkeypatch.setattr(
                    simulation.bus, "write_goals", lambda *a: (simulation.fault("unplug"), write(*a))[1]
                )
            else:
                simulation.fault("overheat")

    simulation.loop.each_cycle = broken
    monkeypatch.setattr("sealegs.hw.run.loop.write_cycle", full)
    outcome = simulation.run(2.0)
    name = {"overheat": "OverheatFault", "unplug": "UnpluggedError", "goal": "goal"}[fault]
    assert outcome.fault is not None and outcome.fault.name == name
    events = {event["event"]: event for event in read_events(tmp_path / "run.csv")}
    assert events["fault"]["name"] == name and "No space" in events["log"]["sentence"]


# --- priority -------------------------------------------------------------------------------------------------


def test_the_threads_that_a_cycle_waits_for_get_its_priority(monkeypatch: pytest.MonkeyPatch, button: Any) -> None:
    given: list[tuple[int, int]] = []
    monkeypatch.setattr(
        module.os, "sched_setscheduler", lambda thread, policy, parameters: given.append((thread, policy))
    )
    both = both_buses()
    group = BusGroup(both.bus.parts)  # reads its buses at the same time
    before = threading.active_count()
    with (
        emergency_stop(button[0], Simulation().stop, lambda: None) as pressed,
        realtime(10, [*group.threads, *pressed]),
    ):
        fifo = {thread for thread, policy in given if policy & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO}
        group.read_state(both.robot.all_ids)
        tasks = {int(task) for task in os.listdir("/proc/self/task")}
        assert threading.active_count() == before + 1, "no thread is started later, without it"
    assert len(group.threads) == 2 and len(pressed) == 1
    assert fifo == {0, *group.threads, *pressed} and {*group.threads, *pressed} <= tasks
    assert len(given) == 2 * len(fifo), "given back"
    group.close()


def test_a_priority_that_is_refused_for_one_thread_is_given_back_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[int, int] = {}

    def scheduler(thread: int, policy: int, parameters: Any) -> None:
        if thread == 4711 and policy & os.SCHED_FIFO:
            raise PermissionError
        given[thread] = policy

    monkeypatch.setattr(module.os, "sched_getscheduler", lambda thread: os.SCHED_OTHER)
    monkeypatch.setattr(module.os, "sched_getparam", lambda thread: os.sched_param(0))
    monkeypatch.setattr(module.os, "sched_setscheduler", scheduler)
    with pytest.raises(SealegsError, match="rtprio"), realtime(10, [4711]):
        pass
    assert given[0] == os.SCHED_OTHER


@pytest.mark.long
@pytest.mark.parametrize("closed", [False, True])
def test_an_emergency_stop_acts_in_the_middle_of_a_cycle(closed: bool) -> None:
    button, pressed = os.pipe()
    with VirtualBus(robot="bench") as virtual:
        bus = ServoBus(virtual.port, timeout=0.5)
        robot = build_robot(config()["robot"])
        limits = Limits.from_config({**config()["robot"]["safety"], "following_error": 9.0})
        stop = Stop()
        loop = ControlLoop(
            bus, robot, Safety(robot, limits, 2.0), sine(0.1)(robot), 0.5, stop=stop, rest="hold", overruns="log"
        )
        released: list[int] = []  # the cycle in which torque went off

        def release() -> object:
            failed = bus.torque_off(robot.ids)
            released.append(loop.counts[0])
            return failed

        with emergency_stop(button, stop, release):
            thread = threading.Thread(target=loop.run, args=(1000.0,))
            thread.start()
            wait_until(lambda: loop.counts[0] >= 1, thread)
            cycle = loop.counts[0]
            os.close(pressed) if closed else os.write(pressed, b"!")
            wait_until(lambda: not virtual.status()["servos"]["1"]["torque"])
            thread.join(GIVE_UP)
        assert released[0] == cycle, "a cycle has two seconds"
        assert loop.outcome is not None and (loop.outcome.ending, loop.outcome.rest) == ("stopped", "release")
        assert loop.outcome.reason == "the emergency stop was pressed" and loop.outcome.not_at_rest == {}
    os.close(button)
    if not closed:
        os.close(pressed)


def test_real_time_priority_is_given_back_or_refused_in_a_sentence() -> None:
    before = os.sched_getscheduler(0)
    with pytest.raises(SealegsError, match="between 1 and 99"), realtime(0):
        pass
    try:
        with realtime(1):
            assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
    except SealegsError as error:
        assert "rtprio" in str(error)
    assert os.sched_getscheduler(0) == before
    with realtime(None):
        assert os.sched_getscheduler(0) == before


# --- how torque comes on --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("latency", [0.001, 0.016])
def test_a_joint_that_a_hand_moves_while_torque_comes_on_does_not_jump_back(latency: float) -> None:
    simulation = Simulation("row", latency=latency, limits={"speed": 200.0})
    machine, last = simulation.rig.machine, simulation.rig.servos[3]
    goals = list[float]()

    def moved() -> None:
        if sum(simulation.torque) == 2:  # the third servo is next, the last one after it
            machine.drivetrain.set_position(machine.names[3], machine.data.qpos, np.asarray(0.4))

    def noted() -> None:
        goals.append(float(last.goal_steps() - last.sensors.steps) * last.model.step)

    simulation.guard.at_each["starting"] = moved
    simulation.loop.each_cycle = noted
    assert simulation.run(0.1).fault is None
    assert abs(goals[0]) < 0.1, "it begins where the hand left it, but for what it swings"


# --- a dead-man's switch --------------------------------------------------------------------------------------


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    reader, writer = os.pipe()
    yield reader, writer
    os.close(reader)
    os.close(writer)


def test_without_anybody_at_the_dead_mans_switch_no_torque_comes_on(pipe: tuple[int, int]) -> None:
    times = iter(np.arange(0.0, 100.0, 0.5))
    switch = DeadMan(pipe[0], lambda: float(next(times)))
    simulation = Simulation("row", armed=switch.armed, each_cycle=switch)
    outcome = simulation.run(1.0)
    assert outcome.ending == "stopped" and outcome.reason == "space was not pressed within 5 s"
    assert not simulation.switched_on


def test_a_wait_for_the_dead_mans_switch_is_ended_by_a_person(pipe: tuple[int, int]) -> None:
    switch = DeadMan(pipe[0], lambda: 0.0)
    asked = iter([False, False, True])
    assert switch.armed(lambda: next(asked)) is None and next(asked, None) is None


def test_a_dead_mans_switch_let_go_while_torque_comes_on_lets_no_further_servo_have_it(pipe: tuple[int, int]) -> None:
    on: list[Simulation] = []
    switch = DeadMan(pipe[0], lambda: 1.0 if on and sum(on[0].torque) == 2 else 0.0)
    os.write(pipe[1], b" ")
    on.append(Simulation("row", armed=switch.armed, each_cycle=switch))
    assert on[0].run(1.0).reason == LET_GO
    assert len([True for _, _, torque in on[0].rig.history if torque]) == 2 and not any(on[0].torque)
