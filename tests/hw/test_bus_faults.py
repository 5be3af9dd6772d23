"""Faults of wire, adapter and servos: each has its name, spoils no other reading, and keeps no servo from release."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealegs.evaluation.aligned import Aligned
from sealegs.gap.log import read_measured
from sealegs.hw.bus.dialects import Reply
from sealegs.hw.bus.packets import (
    CorruptReplyError,
    NoReplyError,
    OverheatFault,
    OverloadFault,
    ReplyError,
    ShortReplyError,
    StaleReplyError,
    StalledError,
    UnpluggedError,
    VoltageFault,
)
from sealegs.hw.bus.port import Echo
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.run.commands import Reference, read_replay
from sealegs.hw.run.simulated import recorded
from sealegs.hw.virtual.control import Control
from sealegs.hw.virtual.in_process import SimulatedPort
from sealegs.hw.virtual.server import Server
from sealegs.hw.virtual.wire import FaultError, Wire, fault_from, read_faults

from tests.served_bus import served, wired
from tests.simulated_runs import Simulation, sine

IDS = [1, 2]
TIMEOUT = 0.3  # [s]


class Rigged:
    """A bus whose servos can be spoilt."""

    def __init__(self, server: Server) -> None:
        self.server = server
        self.control = Control(server.control)
        self.bus = ServoBus(server.port, timeout=TIMEOUT, retries=2)

    def fault(self, kind: str, **values: Any) -> None:
        self.control.order("fault", kind=kind, **values)

    def torque(self) -> list[bool]:
        return [row["torque"] for row in self.control.order("status")["servos"].values()]


@pytest.fixture
def rigged() -> Iterator[Rigged]:
    with served() as server:
        found = Rigged(server)
        yield found
        found.bus.close()
        found.control.close()


def position(rigged: Rigged, joint: int) -> float:
    return rigged.server.wire.rig.machine.position(joint)


# --- replies -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "error"), [("drop", NoReplyError), ("short", ShortReplyError), ("corrupt", CorruptReplyError)]
)
def test_one_spoilt_reply_is_named_and_cured_by_another_try(rigged: Rigged, kind, error):
    rigged.fault(kind, servos=[2], count=1)
    state = rigged.bus.read_state(IDS)
    assert state.position == pytest.approx([position(rigged, 0), position(rigged, 1)], abs=1e-3)
    assert rigged.bus.counts == {error.__name__: 1}
    ((_, noted),) = rigged.bus.events
    assert isinstance(noted, error)
    assert noted.servos == (2,)


@pytest.mark.parametrize(("kind", "error"), [("drop", NoReplyError), ("short", ShortReplyError)])
def test_a_spoilt_reply_without_another_try_is_an_error(rigged: Rigged, kind, error):
    rigged.fault(kind, servos=[2], count=1)
    with pytest.raises(error, match="servo 2 on"):
        rigged.bus.read_state(IDS, retries=0)
    assert rigged.bus.read_state(IDS, retries=0).ids == (1, 2)


def test_a_reply_without_its_header_is_named_corrupt_and_not_missing(rigged: Rigged):
    exchange = rigged.server.wire.exchange

    def headless(request, now, baudrate):
        return [(at, b"\x7f" + packet[1:]) for at, packet in exchange(request, now, baudrate)]

    rigged.server.wire.exchange = headless
    with pytest.raises(CorruptReplyError, match="servo 1 on"):
        rigged.bus.read_state([1], retries=0)


@pytest.mark.long
def test_no_flipped_bit_is_ever_taken_for_a_reading(rigged: Rigged):
    rigged.bus.line.port.reply_timeout = 0.02
    rigged.fault("corrupt", probability=0.5)
    read = 0
    for _ in range(60):
        try:
            state = rigged.bus.read_state(IDS, retries=0)
        except ReplyError:
            continue
        read += 1
        assert state.position == pytest.approx([position(rigged, 0), position(rigged, 1)], abs=0.05)
    assert 0 < read < 40


@pytest.mark.long
def test_a_silent_servo_is_named_and_the_others_are_released(rigged: Rigged):
    rigged.bus.torque_on(IDS)
    rigged.fault("silence", servos=[2])
    with pytest.raises(NoReplyError, match=r"servo 2 on .* did not answer") as caught:
        rigged.bus.read_state(IDS, retries=0)
    assert caught.value.servos == (2,)
    failed = rigged.bus.torque_off(IDS)
    assert set(failed) == {2}
    assert isinstance(failed[2], NoReplyError)
    assert rigged.torque() == [False, True]
    rigged.control.order("clear")
    assert rigged.bus.torque_off(IDS) == {}
    assert rigged.torque() == [False, False]


def test_no_servo_waits_for_its_release_until_a_silent_one_has_been_given_up(rigged: Rigged):
    rigged.bus.torque_on(IDS)
    rigged.fault("silence", servos=[1])
    states: list[list[bool]] = []
    exchange = rigged.server.wire.exchange

    def listening(request, now, baudrate):
        answers = exchange(request, now, baudrate)
        states.append([rigged.server.wire.rig.torque(joint) for joint in (0, 1)])
        return answers

    rigged.server.wire.exchange = listening
    assert set(rigged.bus.torque_off(IDS)) == {1}
    assert states[0] == [True, False], "the first packet releases all that hear it"


def test_a_reply_that_is_lost_at_torque_off_keeps_no_torque_on(rigged: Rigged):
    rigged.bus.torque_on(IDS)
    rigged.fault("drop", probability=0.3)
    rigged.bus.torque_off(IDS)
    assert rigged.torque() == [False, False]


# --- late replies ------------------------------------------------------------------------------------------------


def test_a_late_reply_is_not_taken_for_the_next_answer(rigged: Rigged):
    rigged.fault("late", servos=[1], count=1, delay=0.05)
    with pytest.raises(NoReplyError):
        rigged.bus.line.transact([1], 2, [56, 2], 2)  # READ of the position, 2 bytes
    rigged.control.order("advance", seconds=0.1)  # it comes now, and waits in the host's buffer
    assert rigged.bus.read_register(1, "model_number") == 777


def test_a_late_reply_after_the_next_question_has_another_length(rigged: Rigged):
    rigged.fault("late", servos=[1], count=1, delay=0.005)
    with pytest.raises(NoReplyError):
        rigged.bus.read_state([1], retries=0)
    state = rigged.bus.read_state([1], retries=0)  # it comes behind this question, in front of its answer
    assert rigged.bus.counts["ShortReplyError"] == 1
    assert state.position[0] == pytest.approx(position(rigged, 0), abs=1e-3)


def test_a_late_register_does_not_pass_for_another_of_its_size(rigged: Rigged, monkeypatch: pytest.MonkeyPatch):
    rigged.bus.line.port.reply_timeout = 0.05
    rigged.fault("late", servos=[1], count=1, delay=0.02)
    with pytest.raises(NoReplyError):
        rigged.bus.line.transact([1], 2, [56, 2], 2)  # READ of the position, 2 bytes
    settle = rigged.bus.line.port.settle

    def late(*arguments: float, **keys: float) -> int:  # it comes after the line was found quiet
        found = settle(*arguments, **keys)
        rigged.control.order("advance", seconds=0.1)
        time.sleep(0.02)
        return found

    monkeypatch.setattr(rigged.bus.line.port, "settle", late)
    monkeypatch.setattr(rigged.bus.line.port, "clearPort", lambda: None)
    assert rigged.bus.read_register(1, "model_number") == 777
    assert rigged.bus.read_register(1, "model_number") == 777


def test_bytes_left_over_are_noted_as_stale(rigged: Rigged):
    rigged.bus.read_state(IDS)
    rigged.server.disturb(b"\xff\xff\x01\x04\x00\x00\x08\xf2")
    time.sleep(0.05)
    assert rigged.bus.read_register(1, "model_number") == 777
    assert rigged.bus.counts == {"StaleReplyError": 1}


# --- adapter -----------------------------------------------------------------------------------------------------


def test_an_unplugged_adapter_is_named_and_ends_the_bus(rigged: Rigged):
    rigged.bus.torque_on(IDS)
    rigged.fault("unplug")
    with pytest.raises(UnpluggedError, match="is gone"):
        rigged.bus.read_state(IDS)
    with pytest.raises(UnpluggedError):
        rigged.bus.write_goals(IDS, [0.0, 0.0])
    failed = rigged.bus.torque_off(IDS)
    assert {type(error) for error in failed.values()} == {UnpluggedError}
    assert rigged.torque() == [True, True]  # nobody can reach them: they hold what they were told last
    rigged.bus.close()
    port = rigged.control.order("clear")["port"]
    with ServoBus(port, timeout=TIMEOUT) as bus:
        assert bus.torque_off(IDS) == {}
    assert rigged.torque() == [False, False]


def test_an_echo_is_told_from_answers_from_whichever_request_on(rigged: Rigged):
    rigged.bus.torque_on(IDS)
    rigged.fault("echo")
    assert rigged.bus.ping(1) == 777 and rigged.bus.read_register(2, "torque_enable") == 1
    for _ in range(5):
        rigged.bus.write_goals(IDS, [0.0, 0.0])
        rigged.bus.read_state(IDS)
    assert rigged.bus.torque_off(IDS) == {} and rigged.torque() == [False, False]
    rigged.control.order("clear")
    assert rigged.bus.read_register(1, "model_number") == 777 and rigged.bus.counts == {}


@pytest.mark.parametrize("latency", [0.0, 0.016])
def test_a_request_that_comes_back_is_no_answer_of_a_servo_that_is_not_there(latency: float):
    wire = Wire(wired("hopper").rig, [fault_from({"kind": "echo"})])
    bus = ServoBus("held", timeout=TIMEOUT, opened=SimulatedPort(wire, 0.03, latency=latency))
    assert bus.scan([1, 2, 3]) == {1: 777, 2: 777}
    with pytest.raises(NoReplyError):
        bus.read_register(3, "present_position")
    assert bus.torque_on(IDS) and set(bus.torque_off([1, 3])) == {3} and bus.torque_off([2]) == {}


def test_an_echo_comes_in_pieces_and_behind_an_answer_that_is_late():
    echo = Echo()
    sent, answer = b"\xff\xff\x01\x04\x02\x28\x01\xcf", b"\xff\xff\x01\x03\x00\x01\xfa"
    echo.sent(sent)
    assert echo.without(sent[:3]) == b"" and echo.without(sent[3:] + answer[:2]) == answer[:2]
    echo.sent(sent)
    assert echo.without(sent[:3]) == b"" and echo.without(b"", last=True) == sent[:3], "and nothing more came"
    assert echo.without(answer + sent) == answer + sent, "which transactions tell apart"
    echo.sent(sent)
    echo.sent(answer)
    assert echo.without(answer) == b"", "the one before did not come back"


@pytest.mark.parametrize("protocol", ["feetech", "dynamixel"])
def test_an_echo_that_begins_and_ends_in_mid_run_is_no_fault_and_no_alarm(protocol: str):
    arguments = ["robot.servo=xl330_m288", "robot.actuator=xl330", "robot.params.mass=0.05"]
    simulation = Simulation("bench", *(arguments if protocol == "dynamixel" else []))
    simulation.wire.faults.append(fault_from({"kind": "echo", "at": 0.4, "seconds": 0.4}))
    simulation.wire.faults.append(fault_from({"kind": "echo", "at": 1.2}))
    outcome = simulation.run(1.0)
    assert outcome.ending == "finished" and not outcome.not_at_rest, outcome.fault
    assert outcome.bus == {} and simulation.said == [] and simulation.torque == [False]


# --- servos ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "value", "fault"),
    [("overheat", 80, OverheatFault), ("brown_out", 3.8, VoltageFault), ("overload", None, OverloadFault)],
)
def test_a_servos_own_fault_comes_with_the_reading(rigged: Rigged, kind, value, fault):
    rigged.fault(kind, servos=[2], value=value)
    state = rigged.bus.read_state(IDS)
    (found,) = state.faults()
    assert isinstance(found, fault)
    assert found.servos == (2,)
    assert str(found).startswith("servo 2 ")


def test_a_reply_of_a_servo_with_a_fault_is_a_reply(rigged: Rigged):
    rigged.fault("brown_out", value=3.8)
    assert rigged.bus.ping(1) == 777
    rigged.bus.torque_on(IDS)
    assert rigged.bus.torque_off(IDS) == {}
    assert rigged.bus.status[1] == 1


def test_an_overload_is_cleared_by_the_documented_sequence(rigged: Rigged):
    rigged.bus.torque_on(IDS)
    rigged.fault("overload", servos=[1])
    assert len(rigged.bus.read_state(IDS).faults()) == 1
    rigged.bus.recover(IDS)
    assert rigged.bus.read_state(IDS).faults() == []
    assert rigged.torque() == [True, True]


def test_servos_that_restart_after_a_brown_out_come_back_without_torque(rigged: Rigged):
    rigged.bus.torque_on(IDS)
    rigged.fault("brown_out", value=2.0, seconds=0.1)
    rigged.control.order("advance", seconds=0.2)
    with pytest.raises(NoReplyError):
        rigged.bus.read_state(IDS, retries=0)
    assert rigged.torque() == [False, False]
    rigged.control.order("advance", seconds=1.0)
    assert rigged.bus.read_register(1, "torque_enable") == 0


# --- files of faults ---------------------------------------------------------------------------------------------


def test_faults_of_a_file_come_at_their_time(tmp_path: Path):
    path = tmp_path / "faults.yaml"
    path.write_text("- {kind: drop, servos: 2, at: 1.0, seconds: 0.5}\n- {kind: overheat, value: 75}\n")
    drop, hot = read_faults(path)
    assert [drop.active(now) for now in (0.9, 1.0, 1.4, 1.6)] == [False, True, True, False]
    assert (drop.servos, hot.value, hot.active(99.0)) == ((2,), 75, True)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({"kind": "dorp"}, "did you mean 'drop'"),
        ({"kind": "drop", "servo": 1}, "did you mean 'servos'"),
        ({"kind": "drop", "at": "soon"}, "takes a number as 'at'"),
        ({"kind": "drop", "servos": ["x"]}, "cannot be read"),
        ("drop", "a mapping"),
    ],
)
def test_a_wrong_fault_is_refused_in_a_sentence(row, words):
    with pytest.raises(FaultError, match=words):
        fault_from(row)


SHORT = 0.1  # [s]


@pytest.fixture
def server() -> Iterator[Server]:
    with served() as found:
        yield found


def torque(server: Server) -> list[int]:
    return [servo.get("torque_enable") for servo in server.wire.rig.servos]


def test_an_exception_switches_off_what_the_bus_has_switched_on(server: Server) -> None:
    with ServoBus(server.port, timeout=SHORT) as other:
        other.torque_on([2])
    with pytest.raises(KeyboardInterrupt), ServoBus(server.port, timeout=SHORT) as bus:
        bus.torque_on([1])
        raise KeyboardInterrupt
    assert torque(server) == [0, 1], "2 was not its own"


def test_a_block_that_ends_as_planned_leaves_torque_as_it_is(server: Server) -> None:
    with ServoBus(server.port, timeout=SHORT) as bus:
        bus.torque_on([1])
        bus.write_register(2, "torque_enable", 1)
        bus.torque_off([2])
    assert torque(server) == [1, 0]


@pytest.mark.parametrize("dead", ["silent", "closed"])
def test_a_dead_bus_does_not_hide_the_exception(server: Server, dead: str) -> None:
    with pytest.raises(ValueError, match="a bug") as raised, ServoBus(server.port, timeout=SHORT) as bus:
        bus.torque_on([1])
        if dead == "silent":
            server.wire.faults.append(fault_from({"kind": "drop"}))
        else:
            bus.close()
        raise ValueError("a bug")
    assert "TORQUE MAY BE ON at servo(s) 1: CUT THE POWER" in raised.value.__notes__[0]


# --- what comes of a transaction of which a part was lost ----------------------------------------------------------


def test_a_short_reply_costs_no_other_servo_its_own() -> None:
    simulation = Simulation("hopper")
    ids = simulation.robot.all_ids
    simulation.fault("short", servos=[2], count=1)
    with pytest.raises(ShortReplyError) as caught:
        simulation.bus.read_state(ids, retries=0)
    assert caught.value.servos == (2,) and sorted(caught.value.replies) == [1, 3, 4, 5, 6]
    simulation = Simulation("hopper")
    simulation.fault("short", servos=[2], count=1)
    simulation.fault("silence", servos=[5], seconds=0.05)
    with pytest.raises(NoReplyError) as silent:
        simulation.bus.read_state(ids, retries=0)
    assert silent.value.servos == (5,) and sorted(silent.value.replies) == [1, 3, 4, 6]


def test_a_second_master_that_never_ends_does_not_keep_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = Simulation("hopper")
    bus, port = simulation.bus, simulation.port
    heard: list[float] = []

    def babble(_: object) -> tuple[Reply, bool]:
        assert len(heard) < 1000, "for ever"
        port.sleep(0.001)
        heard.append(port.now())
        return Reply(99, 0, [0], [99]), False

    monkeypatch.setattr(bus.line.dialect, "receive", babble)
    with pytest.raises(StaleReplyError, match="servo 99 on simulated"):
        bus.read_state([1, 2], retries=0)
    assert heard[-1] - heard[0] < 0.03


def test_an_adapter_that_takes_no_bytes_is_said_before_the_second_try_to_release(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulation = Simulation("hopper")
    said: list[float] = []

    def stalled(*_: object) -> float:
        simulation.port.sleep(0.5)
        raise StalledError("the adapter takes no more bytes.")

    monkeypatch.setattr(simulation.bus.line, "send_all", stalled)
    begun = simulation.port.now()
    failed = simulation.bus.torque_off([1, 2], lambda servos, error: said.append(simulation.port.now() - begun))
    assert sorted(failed) == [1, 2] and said == [pytest.approx(0.5)]


def test_a_servo_that_answers_twice_is_not_believed_and_costs_no_other_its_reply(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulation = Simulation("hopper")
    exchange = simulation.wire.exchange

    def doubled(*arguments: object) -> list[tuple[float, bytes]]:
        found = exchange(*arguments)  # type: ignore[arg-type]
        return [row for at, packet in found for row in [(at, packet)] * (1 + (packet[2] == 3))]

    monkeypatch.setattr(simulation.wire, "exchange", doubled)
    with pytest.raises(StaleReplyError) as caught:
        simulation.bus.read_state(simulation.robot.all_ids, retries=0)
    assert caught.value.servos == (3,) and sorted(caught.value.replies) == [1, 2, 4, 5, 6]


def test_the_torque_of_a_servo_that_did_not_answer_is_not_known() -> None:
    simulation = Simulation("hopper")
    bus, ids = simulation.bus, simulation.robot.all_ids
    bus.torque_on([1, 2])
    bus.read_cycle(ids, True)
    simulation.fault("silence", servos=[2])
    state = bus.read_cycle(ids, True, simulation.port.now() + 0.005)
    assert state.torque is not None and state.missing == (2,)
    assert state.torque.tolist()[:2] == [1, -1]


def test_a_silent_encoder_leaves_only_its_own_cells_of_a_log_without_a_value(tmp_path: Path) -> None:
    simulation = Simulation("hopper", commands=Reference, folder=tmp_path, limits={"range_margin": 3.0})
    silenced: list[float] = []

    def once() -> None:
        if simulation.log is not None and simulation.log.rows > 20 and not silenced:
            silenced.append(simulation.loop.elapsed)
            simulation.fault("silence", servos=[3, 6], seconds=0.03)

    simulation.loop.each_cycle = once
    assert simulation.run(0.6).ending == "finished"
    run = read_measured(tmp_path / "run.csv").runs[0]
    lost = np.isnan(run.base["base_z"])
    assert 1 <= lost.sum() <= 5 and np.diff(run.time).max() < 0.015, "no cycle is left out"
    for joint, same in (("hip", lost), ("knee", np.zeros_like(lost))):
        link = run.joints[joint].link_position
        assert link is not None and (np.isnan(link) == same).all()
    assert np.isfinite(run.base["base_x"]).all()
    goals = read_replay(tmp_path / "run.csv", simulation.robot)
    assert goals.duration == pytest.approx(run.time[-1] - run.time[0], abs=0.02)
    policy: Any = SimpleNamespace(history=[])
    compared = recorded(tmp_path / "run.csv", policy, simulation.robot)
    assert len(compared.time) == (~lost).sum() and np.isfinite(compared.base).all()


def test_the_second_encoder_of_one_joint_alone_is_logged_and_compared(tmp_path: Path) -> None:
    mounted = "robot.sensors={base_x: {id: 5, per_radian: 0.5}, base_z: {id: 6, per_radian: 0.5}, knee.link: {id: 4}}"
    simulation = Simulation("hopper", mounted, commands=sine(), folder=tmp_path, limits={"range_margin": 3.0})
    assert simulation.run(1.5).ending == "finished"
    joints = read_measured(tmp_path / "run.csv").runs[0].joints
    assert joints["hip"].link_position is None
    link, motor = joints["knee"].link_position, joints["knee"].position
    assert link is not None and 0.01 < np.abs(link - motor).max() < 0.5, "the spring between them gives"
    idle: Any = SimpleNamespace(history=[])
    run = recorded(tmp_path / "run.csv", idle, simulation.robot)
    assert (run.link[:, 0] == run.position[:, 0]).all() and (run.link[:, 1] == link).all()
    predicted = Aligned(simulation.robot).rehearse(run)[0]
    known = np.isfinite(predicted.position[:, 0])
    step = simulation.robot.resolution[0]
    assert np.abs(predicted.link - predicted.position)[known, 0].max() <= step
    assert np.abs(predicted.link - predicted.position)[known, 1].max() > 10 * step
