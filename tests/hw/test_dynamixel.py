"""Dynamixels: the virtual ones as the manufacturer's SDK sees them, and the bus of the project on them."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dynamixel_sdk as sdk
import numpy as np
import pytest
from sealegs.commands import deploy
from sealegs.configs.script import run
from sealegs.gap.log import read_measured
from sealegs.hw.bus.dialects import READ, SYNC_READ
from sealegs.hw.bus.packets import (
    ConfigurationError,
    NoReplyError,
    OverheatFault,
    OverloadFault,
    RefusedError,
    WrongModelError,
)
from sealegs.hw.bus.registers import load_model
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.machine import scan
from sealegs.hw.machine.joints import Joint
from sealegs.hw.run.connection import check_joint
from sealegs.hw.virtual import protocol2
from sealegs.hw.virtual.protocol import Request
from sealegs.hw.virtual.server import Server
from sealegs.hw.virtual.wire import Wire

from tests.served_bus import RATE, XL330, bus_on, dynamixels
from tests.waiting import wait_until

IDS = [1, 2]


@pytest.fixture(scope="module", autouse=True)
def patience() -> Iterator[None]:
    """A machine that runs tests may be late; the SDK waits for twice its latency timer [ms] and in a busy loop."""
    before = sdk.port_handler.LATENCY_TIMER, sys.getswitchinterval()
    sdk.port_handler.LATENCY_TIMER = 250
    sys.setswitchinterval(2e-4)
    yield
    sdk.port_handler.LATENCY_TIMER = before[0]
    sys.setswitchinterval(before[1])


@pytest.fixture(scope="module")
def server(patience: None) -> Iterator[Server]:
    """Two Dynamixels on the hopper's joints, in stepped time."""
    with Server(dynamixels("hopper"), stepped=True) as server:
        thread = threading.Thread(target=server.run, daemon=True)
        thread.start()
        yield server
        server.stop()
        thread.join(5.0)


class Sdk:
    """The manufacturer's SDK as its examples use it."""

    def __init__(self, port: str) -> None:
        self.port = sdk.PortHandler(port)
        self.packets = sdk.PacketHandler(2.0)
        assert self.port.openPort() and self.port.setBaudRate(RATE)

    def read(self, servo: int, name: str) -> int:
        register = XL330[name]
        data, result, error = self.packets.readTxRx(self.port, servo, register.address, register.bytes)
        assert (result, error) == (sdk.COMM_SUCCESS, 0)
        return register.read(list(data), register.address)

    def write(self, servo: int, name: str, count: int) -> int:
        """The error byte of the reply."""
        register = XL330[name]
        data = list(register.word(count).to_bytes(register.bytes, "little"))
        result, error = self.packets.writeTxRx(self.port, servo, register.address, register.bytes, data)
        assert result == sdk.COMM_SUCCESS
        return error


@pytest.fixture
def client(server: Server) -> Iterator[Sdk]:
    client = Sdk(server.port)
    yield client
    for servo in IDS:
        client.write(servo, "torque_enable", 0)
        client.write(servo, "bus_watchdog", 0)
    client.port.closePort()


# --- the manufacturer's SDK on the virtual servos ----------------------------------------------------------------


def test_the_sdk_finds_and_reads_the_servos(client: Sdk) -> None:
    assert client.packets.ping(client.port, 1) == (1200, sdk.COMM_SUCCESS, 0)
    assert client.packets.ping(client.port, 9)[1] == sdk.COMM_RX_TIMEOUT
    assert client.read(2, "present_input_voltage") == 74 and client.read(2, "operating_mode") == 3


@pytest.mark.parametrize("fast", [False, True])
def test_the_sdk_reads_several_servos_at_once(client: Sdk, fast: bool) -> None:
    group = sdk.GroupSyncRead(client.port, client.packets, 124, 23)
    for servo in IDS:
        assert group.addParam(servo)
    assert (group.fastSyncRead() if fast else group.txRxPacket()) == sdk.COMM_SUCCESS
    for servo in IDS:
        assert group.getData(servo, 132, 4) == pytest.approx(client.read(servo, "present_position"), abs=20)
        assert group.getData(servo, 144, 2) == 74


def test_the_sdk_commands_several_servos_at_once(server: Server, client: Sdk) -> None:
    for servo in IDS:
        assert client.write(servo, "torque_enable", 1) == 0
    group = sdk.GroupSyncWrite(client.port, client.packets, 116, 4)
    goals = {servo: client.read(servo, "present_position") + 30 for servo in IDS}
    for servo, goal in goals.items():
        group.addParam(servo, list(goal.to_bytes(4, "little")))
    assert group.txPacket() == sdk.COMM_SUCCESS
    assert {servo: client.read(servo, "goal_position") for servo in IDS} == goals


def test_what_a_servo_refuses_comes_back_as_the_number_of_the_error(client: Sdk) -> None:
    assert client.write(1, "goal_position", 5000) == protocol2.LIMIT
    assert client.write(1, "present_position", 1) == protocol2.ACCESS
    assert client.write(1, "torque_enable", 2) == protocol2.RANGE
    client.write(1, "torque_enable", 1)
    assert client.write(1, "operating_mode", 4) == protocol2.ACCESS, "memory that persists, while torque is on"


def test_the_bus_watchdog_stops_a_servo_and_refuses_goals_until_it_is_cleared(server: Server, client: Sdk) -> None:
    client.write(1, "torque_enable", 1)
    here = client.read(1, "present_position")
    assert client.write(1, "bus_watchdog", 5) == 0
    server.wire.rig.advance(server.wire.rig.time + 0.5)
    server.wire.free_at = server.wire.rig.time
    assert client.read(1, "bus_watchdog") == -1 and client.read(1, "torque_enable") == 1
    assert client.write(1, "goal_position", here) == protocol2.RANGE
    assert client.write(1, "bus_watchdog", 0) == 0 and client.write(1, "goal_position", here) == 0


# --- packets -----------------------------------------------------------------------------------------------------


def test_the_crc_is_that_of_the_sdk_and_headers_within_data_are_stuffed() -> None:
    data = bytes(np.random.default_rng(0).integers(0, 256, 60, dtype=np.uint8))
    theirs: Any = sdk.PacketHandler(2.0)
    assert protocol2.crc(data) == theirs.updateCRC(0, list(data), len(data))
    tricky = b"\x01\xff\xff\xfd\xff\xff\xfd\x02"
    packet = protocol2.packet(3, bytes((READ,)) + tricky)
    stream = bytearray(b"\xff\xff" + packet[:-1] + b"\x00" + packet + packet[:4])
    (found,) = protocol2.take_requests(stream)
    assert found.parameters == tricky and bytes(stream) == packet[:4]


def test_who_waits_for_a_silent_servo_does_not_answer() -> None:
    wire = dynamixels("hopper", [{"kind": "silence", "servos": [1]}])
    request = Request(254, SYNC_READ, bytes((132, 0, 4, 0, 1, 2)), 16)
    assert wire.exchange(request, 0.0, RATE) == []


# --- the bus of the project --------------------------------------------------------------------------------------


def test_the_bus_finds_checks_and_reads_dynamixels_in_si_units() -> None:
    bus = bus_on(dynamixels())
    assert bus.scan(range(4)) == {1: 1200}
    bus.check([1])
    bus.torque_on([1])
    bus.write_goals([1], [0.4])
    currents = []
    for _ in range(60):
        currents.append(bus.read_cycle([1], until=bus.clock.now() + 0.005).current[0])
        bus.clock.sleep(0.01)
    state = bus.read_state([1], whole=True)
    true = bus.clock.wire.rig.servos[0].sensors  # pyright: ignore[reportAttributeAccessIssue]
    assert state.voltage[0] == pytest.approx(7.4, abs=0.06)
    assert state.current[0] == pytest.approx(true.current, abs=1e-3) and max(currents) > 0.1
    assert state.duty[0] == pytest.approx(true.duty, abs=2e-3)
    assert state.position[0] == pytest.approx((true.steps - 2048) * XL330.step, abs=1e-9)
    assert state.torque is not None and state.torque[0] == 1


def test_current_of_the_xl330_is_signed() -> None:
    bus = bus_on(dynamixels())
    bus.torque_on([1])
    seen = []
    for goal in (0.5, -0.5):
        bus.write_goals([1], [goal])
        bus.clock.sleep(0.05)
        seen.append(bus.read_state([1]).current[0])
    assert seen[0] > 0.1 and seen[1] < -0.1


def test_a_servo_set_up_otherwise_or_of_another_model_is_refused() -> None:
    bus = bus_on(dynamixels())
    bus.write_register(1, "operating_mode", 4)
    with pytest.raises(ConfigurationError, match="write 3, position mode"):
        bus.check([1])
    bus.write_register(1, "operating_mode", 3)
    bus.write_register(1, "startup_configuration", 1)
    with pytest.raises(ConfigurationError, match="clear bit 0, so that a restart does not switch torque on"):
        bus.check([1])
    bus_on(dynamixels(model="xm430_w350", chain="xm430_w350"), "xm430_w350").check([1])
    with pytest.raises(WrongModelError):
        bus_on(dynamixels(), "xm430_w350").check([1])


def test_a_refusal_is_an_error_with_its_reason() -> None:
    bus = bus_on(dynamixels())
    bus.torque_on([1])
    with pytest.raises(RefusedError, match="not while torque is on"):
        bus.write_register(1, "operating_mode", 4)
    bus.torque_off([1])
    bus.write_register(1, "operating_mode", 4)


def test_switching_torque_on_moves_nothing_and_sets_the_watchdog() -> None:
    bus = bus_on(dynamixels(), watchdog=0.2)
    before = bus.read_state([1]).raw["present_position"][0]
    bus.torque_on([1])
    assert bus.read_register(1, "bus_watchdog") == 10 and bus.read_register(1, "led") == 1
    assert bus.read_register(1, "goal_position") == pytest.approx(before, abs=1)
    bus.clock.sleep(0.3)
    assert bus.read_register(1, "bus_watchdog") == -1
    bus.hold([1])
    assert bus.read_register(1, "bus_watchdog") == 0, "who is held is not asked often"
    assert bus.torque_off([1]) == {}


@pytest.mark.parametrize(("kind", "fault"), [("overheat", OverheatFault), ("overload", OverloadFault)])
def test_a_fault_comes_with_the_reading_and_only_a_restart_frees_the_servo(kind: str, fault: type) -> None:
    wire = dynamixels()
    bus = bus_on(wire)
    bus.torque_on([1])
    from sealegs.hw.virtual.wire import fault_from

    wire.faults.append(fault_from({"kind": kind, "seconds": 0.02}, bus.clock.now()))
    bus.clock.sleep(0.05)
    (found,) = bus.read_cycle([1]).faults()
    assert isinstance(found, fault) and "reboot=true" in str(found)
    assert bus.read_register(1, "torque_enable") == 0, "it has shut down"
    with pytest.raises(RefusedError):
        bus.torque_on([1])
    bus.reboot(1)
    bus.clock.sleep(1.0)
    assert bus.read_cycle([1]).faults() == []
    bus.torque_on([1])


def test_replies_behind_a_silent_servo_are_asked_for_again() -> None:
    wire = dynamixels("hopper", [{"kind": "silence", "servos": [1], "at": 0.5, "seconds": 0.5}])
    bus = bus_on(wire)
    bus.read_cycle(IDS)
    while bus.clock.now() < 0.5:
        bus.read_cycle(IDS, until=bus.clock.now() + 0.01)
    state = bus.read_cycle(IDS, until=bus.clock.now() + 0.01)
    assert state.missing == (1,) and isinstance(state.problem, NoReplyError)


def test_a_register_tells_its_unit() -> None:
    xm430 = load_model("xm430_w350")
    assert xm430.si("present_current") == pytest.approx(2.69e-3) and XL330.si("present_current") == 1e-3
    assert XL330.si("present_velocity") == pytest.approx(0.229 * 2.0 * np.pi / 60.0)
    assert XL330["present_position"].decode(0xFFFFFFFF) == -1 and XL330["present_current"].decode(0xFFFF) == -1


def test_an_id_is_changed_without_a_lock() -> None:
    bus = bus_on(dynamixels())
    bus.change_id(1, 7)
    assert bus.scan(range(9)) == {7: 1200}


def test_the_late_wire_is_not_taken_for_the_next_answer() -> None:
    wire: Wire = dynamixels(faults=[{"kind": "late", "count": 1, "delay": 0.021, "at": 0.2}])
    bus: ServoBus = bus_on(wire)
    bus.clock.sleep(0.2)
    assert bus.read_register(1, "position_p_gain") == 400 and bus.read_register(1, "velocity_p_gain") == 180


# --- commands ----------------------------------------------------------------------------------------------------


def test_scan_shows_dynamixels_and_sets_their_registers(server: Server, capsys: pytest.CaptureFixture[str]) -> None:
    words = [f"port={server.port}", "servo=xl330_m288", f"baudrate={RATE}", "last=3"]
    assert run(scan.main, "scan", "", words) == 0
    out = capsys.readouterr().out
    assert out.count("xl330_m288 (1200)") == 2 and "7.4 V" in out and "off" in out
    assert run(scan.main, "scan", "", [*words, "id=2", "set=position_p_gain:300"]) == 0
    assert "Servo 2: position_p_gain 300 (before: 400)" in capsys.readouterr().out
    assert run(scan.main, "scan", "", [*words, "id=2"]) == 0
    out = capsys.readouterr().out
    assert "position_p_gain" in out and "(from the factory 400)" in out and "temperature_limit" in out
    assert run(scan.main, "scan", "", [*words, "id=2", "reboot=true"]) == 0
    wait_until(lambda: server.wire.servos[1].get("position_p_gain") == 400)  # memory that does not persist
    server.wire.servos[1].silent_until = 0.0


@pytest.mark.long
def test_deploy_and_its_log_know_a_robot_with_a_dynamixel(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [
        "robot.servo=xl330_m288",
        "robot.actuator=xl330",
        "robot.params.mass=0.05",
        "robot.params.length=0.05",
        "hw.virtual.time=stepped",
        "hw.timeout=0.5",
    ]
    words += ["excitation=steps", "duration=3", f"out={tmp_path}", "name=run", "live=false", "silence=20"]
    words += ["robot.safety.silent=1.0", "robot.safety.late=1.0", "robot.safety.following_error=9.0"]
    assert run(deploy.main, "deploy", "", words) == 0, capsys.readouterr().err
    log = read_measured(tmp_path / "run.csv").runs[0]
    joint = log.joints["joint"]
    assert joint.current is not None and joint.current.min() < -0.05 < 0.05 < joint.current.max()
    assert log.actuators["joint"] == "xl330" and len(log.time) > 250


def test_a_range_beyond_the_limits_of_a_dynamixel_is_refused_to_the_step() -> None:
    with bus_on(dynamixels()) as bus:
        bus.write_register(1, "max_position_limit", 2600)
        reach = {step: (step - XL330.centre) * XL330.step for step in (2600, 2601)}
        check_joint(bus, Joint("joint", 1, XL330.centre, 1, -0.5, reach[2600]))
        with pytest.raises(ConfigurationError, match=r"between the steps 0 and 2600, but .* to 2601"):
            check_joint(bus, Joint("joint", 1, XL330.centre, 1, -0.5, reach[2601]))


def test_a_range_to_the_end_of_a_dynamixels_turn_is_within_its_limits() -> None:
    with bus_on(dynamixels()) as bus:
        check_joint(bus, Joint("joint", 1, XL330.centre, 1, -2048.4 * XL330.step, 2047.5 * XL330.step))
