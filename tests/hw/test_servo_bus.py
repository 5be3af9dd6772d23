"""The bus reads, commands and sets up servos, and says in a sentence what it cannot do."""

from __future__ import annotations

import math
import os
import pty
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from sealegs.hw.bus.packets import (
    ClosedError,
    ConfigurationError,
    CorruptReplyError,
    NoReplyError,
    PortBusyError,
    PortError,
    RegisterError,
    StalledError,
    WrongModelError,
)
from sealegs.hw.bus.registers import load_model, model_names
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.machine.robot import Joint
from sealegs.hw.run.connection import check_joint
from sealegs.hw.virtual.in_process import SimulatedPort
from sealegs.hw.virtual.server import Server
from sealegs.hw.virtual.wire import UNEVEN, Wire, collided, fault_from

from benchmarks.bus import bare_cycle
from tests.served_bus import served, wired

STEP = 2.0 * math.pi / 4096
IDS = [1, 2]
TIMEOUT = 0.3  # [s]; other programs may hold the machine for longer than a servo would take


@pytest.fixture
def server() -> Iterator[Server]:
    with served() as found:
        yield found


@pytest.fixture
def bus(server: Server) -> Iterator[ServoBus]:
    with ServoBus(server.port, timeout=TIMEOUT) as found:
        yield found


# --- registers ---------------------------------------------------------------------------------------------------


def test_signs_are_a_bit_of_their_own_and_not_twos_complement():
    model = load_model("sts3215")
    assert model["goal_position"].to_bytes(-5) == bytes((5, 0x80))
    assert model["homing_offset"].encode(-2047) == 0b1111_1111_1111
    assert model["present_load"].decode(1 << 10 | 300) == -300
    assert model["present_temperature"].decode(200) == 200
    for register in model.registers.values():
        if register.area != "read" and register.low < 0:
            for count in (register.low, -1, 0, register.high):
                assert register.decode(register.encode(count)) == count


@pytest.mark.parametrize("name", model_names())
def test_registers_of_a_table_do_not_overlap(name):
    model = load_model(name)
    taken: dict[int, str] = {}
    for register in model.registers.values():
        for at in range(register.address, register.address + register.bytes):
            assert at not in taken, f"{register.name} and {taken[at]}"
            taken[at] = register.name
        assert register.area in ("eeprom", "ram", "read")
        assert register.area == "read" or register.low <= register.default <= register.high


def test_an_unknown_model_or_register_is_refused_with_the_nearest_name():
    with pytest.raises(RegisterError, match="did you mean 'sts3215'"):
        load_model("sts3216")
    with pytest.raises(RegisterError, match="did you mean 'goal_position'"):
        load_model("sts3215")["goal_postion"]


# --- who is there ------------------------------------------------------------------------------------------------


def test_scan_finds_the_servos_and_check_is_content(bus: ServoBus):
    assert bus.ping(2) == 777
    assert bus.scan([1, 2]) == {1: 777, 2: 777}
    bus.check(IDS)
    assert bus.identity(1)["model_number"] == 777
    assert bus.identity(2)["id"] == 2


def test_a_missing_servo_is_named(server: Server):
    with ServoBus(server.port, timeout=0.05, retries=0) as bus:
        assert list(bus.scan([2, 3])) == [2]
        with pytest.raises(NoReplyError, match=r"servo 3 on .* did not answer within 50 ms") as caught:
            bus.read_state([1, 3, 2])
        assert caught.value.servos == (3,)
        assert bus.read_state(IDS).ids == (1, 2)


def test_another_model_is_refused(server: Server):
    with (
        ServoBus(server.port, model="sts3250", timeout=TIMEOUT) as bus,
        pytest.raises(WrongModelError, match="777, but a sts3250 has 2825"),
    ):
        bus.check(IDS)


@pytest.mark.parametrize(
    ("register", "count", "words"),
    [
        ("operating_mode", 1, "position mode"),
        ("phase", 28, "within one turn"),
        ("phase", 8, "speeds are counted in step/s"),
        ("phase", 4, "goal speed 0 is no limit"),
        ("angle_resolution", 2, "all its steps"),
    ],
)
def test_a_servo_set_up_otherwise_is_refused(bus: ServoBus, register, count, words):
    bus.write_register(2, register, count)
    with pytest.raises(ConfigurationError, match=words) as caught:
        bus.check(IDS)
    assert caught.value.servos == (2,)


def test_two_servos_with_one_id_are_noticed():
    with (
        served(servos={"hip": {"id": 5}, "knee": {"id": 5, "zero": 1500}}) as server,
        ServoBus(server.port, timeout=0.05, retries=1) as bus,
        pytest.raises(CorruptReplyError, match="no two servos have one id"),
    ):
        bus.read_state([5])


def twins(uneven: float = UNEVEN, **delays: int) -> tuple[Wire, ServoBus]:
    """Two servos of one id that stand at the same step, and a bus that knows one."""
    wire = wired("hopper", {"hip": {"id": 5}, "knee": {"id": 5, "zero": 2048 - 796}})
    wire.uneven, wire.rig.held = uneven, "torque"
    for servo, delay in zip(wire.servos, delays.values(), strict=False):
        servo.set_up("return_delay", delay)
    return wire, ServoBus("simulated", opened=SimulatedPort(wire))


@pytest.mark.parametrize("delays", [{}, {"first": 0, "second": 250}, {"first": 0, "second": 20}])
def test_two_servos_of_one_id_that_say_the_same_are_noticed_before_torque_comes_on(delays: dict[str, int]):
    wire, bus = twins(**delays)
    assert len({servo.sensors.steps for servo in wire.servos}) == 1
    with pytest.raises((ConfigurationError, CorruptReplyError), match=r"one id|the id 5"):
        bus.check([5])
    assert not wire.rig.history, "torque was never on"


def test_two_servos_that_answer_as_one_are_noticed_once_they_move():
    wire, bus = twins(uneven=0.0)
    bus.check([5])  # nobody can tell
    bus.torque_on([5])
    with pytest.raises(CorruptReplyError, match="no two servos have one id"):
        for _ in range(50):
            bus.write_goals([5], [0.4])
            bus.clock.sleep(0.01)
            bus.read_state([5], retries=0)
    assert bus.torque_off([5]) == {} and not any(wire.rig.torque(joint) for joint in (0, 1))


@pytest.mark.parametrize("kind", ["corrupt", "drop"])
@pytest.mark.parametrize("seed", range(5))
def test_a_servo_on_a_bad_line_is_not_taken_for_two(kind: str, seed: int):
    wire = wired("hopper")
    wire = Wire(wire.rig, [fault_from({"kind": kind, "probability": 0.03})], seed)
    ServoBus("simulated", opened=SimulatedPort(wire)).check(IDS)


def test_what_several_servos_send_at_once_is_read_as_a_receiver_would():
    one, other = b"\xff\xff\x05\x02\x00\xf8", b"\xff\xff\x05\x02\x20\xd8"
    assert collided([(0.0, one)]) == one == collided([(0.0, one), (0.2, one)])
    assert collided([(0.0, one), (0.0, other)]) == b"\xff\xff\x05\x02\x00\xd8", "both pull the line low"
    assert collided([(0.0, one), (70.0, other)]) == one + other, "one behind the other"
    assert collided([(0.0, one), (3.0, one)]) != one


# --- cycle -------------------------------------------------------------------------------------------------------


def test_a_reading_has_counts_and_si_units(server: Server, bus: ServoBus):
    state = bus.read_state([2, 1])
    machine = server.wire.rig.machine
    assert state.ids == (2, 1)
    assert state.position == pytest.approx([machine.position(1), machine.position(0)], abs=0.6 * STEP)
    assert state.raw["present_position"].tolist() == np.rint(2048 + state.position / STEP).tolist()
    assert state.voltage.tolist() == [7.4, 7.4]
    assert state.temperature.tolist() == [25.0, 25.0]
    assert (state.status.tolist(), state.faults()) == ([0, 0], [])
    assert 0.0 < state.after - state.before < 10.0


def test_current_duty_and_velocity_have_their_units_and_signs():
    with served("bench") as server, ServoBus(server.port, timeout=TIMEOUT) as bus:
        bus.torque_on([1])
        bus.write_goals([1], [-0.6])
        for _ in range(5):
            state = bus.read_state([1])
        machine = server.wire.rig.machine
        assert state.velocity[0] == pytest.approx(machine.data.qvel[0], abs=1.2)
        assert state.velocity[0] < -0.5
        assert state.duty[0] == pytest.approx(machine.duty(0), abs=0.1)
        for _ in range(100):
            state = bus.read_state([1])
        assert state.current[0] == pytest.approx(machine.current(0), abs=0.01)
        assert state.current[0] < -0.05
        assert state.target[0] == pytest.approx(-0.6, abs=STEP)


def test_goals_reach_all_servos_and_stay_within_the_turn(server: Server, bus: ServoBus):
    bus.write_goals(IDS, [0.5, -9.0])
    assert [bus.read_register(servo, "goal_position") for servo in IDS] == [round(2048 + 0.5 / STEP), 0]
    bus.write_goals(IDS, [0.1, 0.2], velocity=np.array([1.0, 2.0]), acceleration=10.0)
    assert bus.read_register(2, "goal_velocity") == round(2.0 / STEP)
    assert bus.read_register(1, "acceleration") == round(10.0 / (100 * STEP))
    assert bus.read_register(1, "goal_position") == round(2048 + 0.1 / STEP)


def test_a_limit_below_one_count_is_the_smallest_that_there_is(bus: ServoBus):
    bus.write_goals(IDS, [0.1, 0.2], velocity=[1e-5, 0.0], acceleration=0.01)
    assert [bus.read_register(servo, "goal_velocity") for servo in IDS] == [1, 0]
    assert [bus.read_register(servo, "acceleration") for servo in IDS] == [1, 1]


@pytest.mark.parametrize("wrong", [-0.5, math.nan, math.inf, [1.0, -1.0], [1.0, 1.0, 1.0]])
def test_a_limit_that_is_none_is_refused(bus: ServoBus, wrong):
    for role, limits in (("speed", {"velocity": wrong}), ("ramp", {"acceleration": wrong})):
        with pytest.raises(RegisterError, match=f"the {role} of a move is"):
            bus.write_goals(IDS, [0.1, 0.2], **limits)


@pytest.mark.parametrize(
    ("ids", "goals", "words"),
    [
        ([1, 2], [0.0, math.nan], "not a finite number"),
        ([1, 2], [0.0], "1 goals for 2 servos"),
        ([1, 1], [0.0, 0.0], "addressed twice"),
        ([1, 300], [0.0, 0.0], "0 to 253"),
        ([], [], "no servo is addressed"),
    ],
)
def test_wrong_goals_are_refused(bus: ServoBus, ids, goals, words):
    with pytest.raises(RegisterError, match=words):
        bus.write_goals(ids, goals)


def test_stepped_time_goes_a_period_on_with_every_reading(server: Server, bus: ServoBus):
    bus.read_state(IDS)
    before = server.wire.rig.time
    for _ in range(20):
        bus.write_goals(IDS, [0.0, 0.0])
        bus.read_state(IDS)
    assert server.wire.rig.time - before == pytest.approx(0.2, abs=1e-3)


def test_stepped_time_repeats_itself_exactly():
    runs = []
    for _ in range(2):
        with served() as server, ServoBus(server.port, timeout=TIMEOUT) as bus:
            bus.torque_on(IDS)
            states = []
            for k in range(30):
                bus.write_goals(IDS, [0.3 * math.sin(0.4 * k), -0.2])
                states.append(bus.read_state(IDS).raw)
            runs.append([[row[name].tolist() for name in sorted(row)] for row in states])
    assert runs[0] == runs[1]


def test_several_threads_may_use_one_bus(bus: ServoBus):
    wrong: list[str] = []

    def work(servo: int) -> None:
        for _ in range(20):
            if bus.read_register(servo, "id") != servo or bus.read_state([servo]).ids != (servo,):
                wrong.append(f"servo {servo}")

    threads = [threading.Thread(target=work, args=(servo,)) for servo in IDS]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
    assert not bus.counts


# --- torque ------------------------------------------------------------------------------------------------------


def test_switching_torque_on_moves_nothing(server: Server, bus: ServoBus):
    bus.write_goals(IDS, [1.0, -1.0])  # where the servos would jump to
    before = bus.read_state(IDS).position
    bus.torque_on(IDS)
    assert [server.wire.rig.torque(joint) for joint in (0, 1)] == [True, True]
    assert bus.read_state(IDS).target == pytest.approx(before, abs=20 * STEP)  # the hopper falls meanwhile


def test_a_speed_limit_that_another_program_left_does_not_outlive_torque_on(server: Server, bus: ServoBus):
    for name, count in (("goal_velocity", 50), ("acceleration", 3)):
        bus.write_register(1, name, count)
    bus.torque_on(IDS)
    assert [bus.read_register(1, name) for name in ("goal_velocity", "acceleration")] == [0, 0]


# --- set-up ------------------------------------------------------------------------------------------------------


def test_eeprom_registers_are_unlocked_written_and_locked_again(server: Server, bus: ServoBus):
    bus.write_register(1, "p_gain", 20)
    bus.write_register(1, "homing_offset", -100)
    assert bus.read_register(1, "lock") == 1
    servo = server.wire.rig.servos[0]
    servo.boot(server.wire.rig.time, 0.0)
    assert (bus.read_register(1, "p_gain"), bus.read_register(1, "homing_offset")) == (20, -100)
    assert bus.read_value(1, "min_voltage") == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("name", "count", "words"),
    [
        ("present_position", 3, "read-only"),
        ("p_gain", 300, "0 to 254, not 300"),
        ("p_gain", 1.5, "whole numbers"),
        ("id", 3, "use change_id"),
        ("baud_rate", 1, "tool of the manufacturer"),
    ],
)
def test_a_register_that_cannot_be_written_so_is_refused(bus: ServoBus, name, count, words):
    with pytest.raises(RegisterError, match=words):
        bus.write_register(1, name, count)


def test_a_servo_that_acknowledges_no_writes_can_be_told_to(server: Server):
    with ServoBus(server.port, timeout=0.05, retries=0) as bus:
        bus.write_register(2, "response_level", 0)
        with pytest.raises(ConfigurationError, match="acknowledges writes"):
            bus.check(IDS)
        bus.write_register(2, "response_level", 1)
        bus.check(IDS)


def test_a_servo_gets_another_id_unless_it_is_taken(server: Server):
    with ServoBus(server.port, timeout=0.1, retries=1) as bus:
        with pytest.raises(ConfigurationError, match="id 2 is taken"):
            bus.change_id(1, 2)
        bus.change_id(1, 9)
        assert list(bus.scan([1, 2, 9])) == [2, 9]
        server.wire.rig.servos[0].boot(server.wire.rig.time, 0.0)
        assert bus.ping(9) == 777


def test_a_servo_that_was_calibrated_otherwise_or_stops_short_is_refused(bus: ServoBus):
    joint = Joint("hip", 1, 2048, 1, -1.2, 0.3, 0)
    check_joint(bus, joint)
    for name, count, words in (
        ("homing_offset", -35, "homing_offset -35, and 0 when joint hip was calibrated"),
        ("min_angle", 1500, "between the steps 1500 and 4095, but joint hip goes from 1266 to 2244"),
        ("max_angle", 2000, "between the steps 0 and 2000"),
    ):
        before = bus.read_register(1, name)
        bus.write_register(1, name, count)
        with pytest.raises(ConfigurationError, match=words):
            check_joint(bus, joint)
        bus.write_register(1, name, before)
    bus.write_register(1, "max_angle", 0)
    with pytest.raises(ConfigurationError, match="makes the servo count turns"):
        check_joint(bus, joint)


# --- ports -------------------------------------------------------------------------------------------------------


def test_ports_that_are_none_are_refused(tmp_path: Path):
    with pytest.raises(PortError, match="there is no port"):
        ServoBus(str(tmp_path / "ttyUSB0"))
    (tmp_path / "file").write_text("")
    with pytest.raises(PortError, match="cannot be opened as a serial port"):
        ServoBus(str(tmp_path / "file"))
    with pytest.raises(PortError, match="baud rate 12345"):
        ServoBus(str(tmp_path / "file"), baudrate=12345)


def test_two_programs_cannot_share_a_port(server: Server, bus: ServoBus):
    with pytest.raises(PortBusyError, match="another program has"):
        ServoBus(server.port)
    assert bus.ping(1) == 777


def test_an_adapter_that_takes_no_more_bytes_is_named():
    master, slave = pty.openpty()
    try:
        with ServoBus(os.ttyname(slave)) as bus, pytest.raises(StalledError, match="takes no more bytes"):
            for _ in range(5000):
                bus.write_goals(IDS, [0.0, 0.0])
    finally:
        os.close(master)
        os.close(slave)


@pytest.mark.long
def test_waiting_for_a_reply_costs_no_processor_time(server: Server):
    with ServoBus(server.port, timeout=1.0, retries=0) as bus:
        begin = time.thread_time()
        with pytest.raises(NoReplyError):
            bus.read_register(7, "id")
        assert time.thread_time() - begin < 0.2


def test_a_closed_bus_says_so(server: Server):
    bus = ServoBus(server.port, timeout=TIMEOUT)
    bus.close()
    bus.close()
    with pytest.raises(ClosedError, match="was closed"):
        bus.read_state(IDS)


def test_the_benchmark_compares_the_same_transactions(server: Server, bus: ServoBus):
    heard: list[tuple[int, int, bytes]] = []
    exchange = server.wire.exchange

    def listening(request, now, baudrate):
        heard.append((request.target, request.instruction, request.parameters))
        return exchange(request, now, baudrate)

    server.wire.exchange = listening
    bare, close = bare_cycle(server.port, IDS)
    for _ in range(20):  # the SDK waits for 34 ms only, which a busy machine may take
        heard.clear()
        if bare([2100, 1900]):
            break
    close()
    bus.write_goal_steps(IDS, [2100, 1900])
    bus.read_state(IDS)
    assert len(heard) == 4
    assert heard[:2] == heard[2:]
