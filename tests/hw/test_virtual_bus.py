"""The virtual bus: its wire, the machine behind it, its process, and foreign clients that run on it unchanged."""

from __future__ import annotations

import importlib
import importlib.util
import os
import signal
import subprocess
import sys
import threading
import time
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import dynamixel_sdk
import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import FOLDER
from sealegs.configs.script import run
from sealegs.envs.bench.robot import BENCH
from sealegs.envs.robots import ROBOTS
from sealegs.hw.virtual import VirtualBus, protocol
from sealegs.hw.virtual.__main__ import main
from sealegs.hw.virtual.machine import Drive, Machine
from sealegs.hw.virtual.protocol import Request, status_packet, take_requests
from sealegs.hw.virtual.server import Server
from sealegs.hw.virtual.wire import Wire

from tests.served_bus import RATE, STEP, STS, ask, dynamixels, wired, write
from tests.waiting import wait_until

# --- packets -----------------------------------------------------------------------------------------------------


def test_requests_are_found_among_rubbish_and_broken_ones_are_dropped():
    good = bytes.fromhex("ffff01040238 02be".replace(" ", ""))
    broken = good[:-1] + b"\x00"
    stream = bytearray(b"\x12\xff" + broken + b"\xff" + good + good[:4])
    (found,) = take_requests(stream)
    assert (found.target, found.instruction, found.parameters) == (1, protocol.READ, bytes((56, 2)))
    assert bytes(stream) == good[:4]  # the rest of it is still to come


def test_a_reply_ends_when_its_bytes_have_gone_over_the_wire():
    wire = wired()
    ((first, packet),) = wire.exchange(Request(1, protocol.READ, bytes((56, 15)), 8), 1.0, RATE)
    assert len(packet) == 21
    assert first == pytest.approx(1.0 + 8e-5 + 20e-6 + 21e-5, abs=1e-9)
    ((second, _),) = wire.exchange(Request(1, protocol.PING, b"", 6), 1.0, RATE)  # the line is not free before
    assert second == pytest.approx(first + 6e-5 + 20e-6 + 6e-5, abs=1e-9)


def test_the_return_delay_is_kept():
    wire = wired()
    ((before, _),) = wire.exchange(Request(1, protocol.PING, b"", 6), 0.0, RATE)
    write(wire, "return_delay", 250)
    at = wire.free_at
    ((after, _),) = wire.exchange(Request(1, protocol.PING, b"", 6), at, RATE)
    assert (after - at) - before == pytest.approx(500e-6, abs=1e-9)


def test_a_sync_read_is_answered_in_the_order_of_its_list():
    wire = wired("hopper")
    packets = ask(wire, 254, protocol.SYNC_READ, 56, 15, 2, 7, 1)
    assert [packet[2] for packet in packets] == [2, 1]


def test_servos_of_another_baud_rate_or_id_keep_silent():
    wire = wired()
    assert ask(wire, 9, protocol.PING) == []
    assert wire.exchange(Request(1, protocol.PING, b"", 6), 0.1, 500_000) == []


def test_two_servos_with_one_id_answer_into_each_other():
    wire = wired("hopper", {"hip": {"id": 4}, "knee": {"id": 4, "zero": 1500}})
    (packet,) = ask(wire, 4, protocol.READ, 56, 15)
    assert packet[-1] != protocol.checksum(packet[2:-1])
    wire.uneven = 0.0
    (same,) = ask(wire, 4, protocol.PING)  # equal contents at the same moment: nothing is noticed
    assert same == status_packet(4, 0)


# --- machine -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_can_stand_behind_the_bus(name):
    wire = wired(name)
    ids = [servo.id for servo in wire.rig.servos]
    packets = ask(wire, 254, protocol.SYNC_READ, 56, 15, *ids)
    assert [packet[2] for packet in packets] == ids
    for packet, servo in zip(packets, wire.rig.servos, strict=True):
        low, high = wire.rig.machine.limits[wire.rig.machine.names[servo.joint]]
        middle = round(2048 + 0.5 * (low + high) / STEP)
        assert STS["present_position"].read(packet[5:-1], 56) == pytest.approx(middle, abs=1)


@pytest.mark.parametrize("actuator", ["ideal", "regression", "net", "xl330"])
def test_every_chain_can_drive_a_servo_and_let_it_go(actuator):
    machine = Machine(BENCH, actuator)
    machine.set_drive(0, Drive())
    machine.set_goal(0, 0.5)
    machine.advance(1.0)
    assert machine.position(0) > 0.2
    machine.set_drive(0, Drive(connected=False))
    machine.advance(6.0)
    assert abs(machine.position(0)) < 0.2  # it hangs again


def test_time_may_come_in_any_pieces():
    whole, pieces = Machine(BENCH), Machine(BENCH)
    for machine in (whole, pieces):
        machine.set_goal(0, 0.4)
    whole.advance(0.3)
    for time_ in np.sort(np.random.default_rng(0).uniform(0.0, 0.3, 200)):
        pieces.advance(time_)
    pieces.advance(0.3)
    assert pieces.time == pytest.approx(whole.time, abs=1e-6)
    assert pieces.position(0) == pytest.approx(whole.position(0), abs=5e-4)


def test_an_unstable_machine_ends_in_a_sentence():
    machine = Machine(BENCH)
    machine.set_goal(0, 1.0)
    machine.data.qvel[0] = 1e12
    with pytest.raises(SealegsError, match="became unstable"):
        machine.advance(0.1)


@pytest.mark.parametrize("actuator", ["mabel_left_leg_angle", "mabel_net_leg_shape"])
def test_a_machine_that_cannot_stand_is_refused_before_it_has_a_port(actuator: str, capfd: pytest.CaptureFixture[str]):
    with pytest.raises(SealegsError, match="unstable while it stands still"):
        Machine(BENCH, actuator)
    assert capfd.readouterr().err == ""


def test_trying_a_machine_leaves_it_as_it_was():
    machine = Machine(BENCH)
    assert machine.time == 0.0 and machine.position(0) == pytest.approx(0.0, abs=1e-9)


def test_hidden_effects_change_what_is_driven_and_nothing_else(tmp_path: Path):
    changes = tmp_path / "hidden.yaml"
    changes.write_text("delay.seconds: 0.025\nbacklash.width: 0.02\nrobot.mass: 0.3\n")
    machine = wired("bench", hidden=str(changes)).rig.machine
    chain = machine.drivetrain.chains["joint"]
    assert (chain.value("delay.seconds"), chain.value("backlash.width")) == (0.025, 0.02)
    believed = BENCH.drivetrain()
    assert machine.model.body("pendulum").mass[0] == pytest.approx(believed.model.body("pendulum").mass[0] - 0.2)
    extended = tmp_path / "extended.yaml"
    extended.write_text(load_chain("xl330").to_yaml())
    chain = wired("bench", hidden=str(extended)).rig.machine.drivetrain.chains["joint"]
    assert chain.value("dc_motor.resistance") == 3.4


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("delay.second: 0.1", "no parameter 'second'"),
        ("dealy.seconds: 0.1", "no stage 'dealy'"),
        ("robot.mas: 0.1", "did you mean 'mass'"),
        ("jiont: {delay.seconds: 0.1}", "did you mean 'joint'"),
        ("3", "neither a chain nor changes"),
        ("[:", "is not valid YAML in line 1"),
    ],
)
def test_a_wrong_file_of_hidden_effects_is_refused_in_a_sentence(tmp_path: Path, text, words):
    (tmp_path / "hidden.yaml").write_text(text)
    with pytest.raises(SealegsError, match=words) as refusal:
        wired("bench", hidden=str(tmp_path / "hidden.yaml"))
    assert "\n" not in str(refusal.value)


# --- process -----------------------------------------------------------------------------------------------------


def start(*arguments: str, **keywords) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "sealegs.hw.virtual", *arguments],
        cwd=FOLDER.parent,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        **keywords,
    )


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("robot=benhc", "did you mean 'bench'"),
        ("time=fast", "real or stepped"),
        ("servos.hip.id=3", "no joint 'hip'"),
        ("fault=x", "no key 'fault'"),
        ("faults=/nowhere.yaml", "cannot be read"),
    ],
)
def test_wrong_arguments_are_refused_in_a_sentence(argument, words, capsys):
    assert run(main, "virtual", "", [argument]) == 2
    errors = capsys.readouterr().err
    assert words in errors
    assert errors.count("\n") == 1


@pytest.mark.long
def test_ctrl_c_ends_it_with_one_sentence_and_no_trace(tmp_path: Path):
    link = tmp_path / "servos"
    process = start(f"link={link}")
    assert process.stdout is not None
    assert process.stdout.readline() == f"port: {link}\n"
    control = Path(process.stdout.readline().removeprefix("control: ").strip())
    assert link.is_symlink() and control.exists()
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 130
    assert errors.count("\n") == 1
    assert not link.is_symlink() and not control.exists()


@pytest.mark.long
def test_the_servos_outlive_a_killed_parent_for_a_while():
    code = "import os\nfrom sealegs.hw.virtual import VirtualBus\nbus = VirtualBus(linger=0.5)\n"
    code += "print(bus.pid, flush=True)\n"
    code += "os.kill(os.getpid(), 9)"
    parent = subprocess.run(
        [sys.executable, "-c", code], cwd=FOLDER.parent, capture_output=True, text=True, timeout=300
    )
    pid = int(parent.stdout)
    os.kill(pid, 0)  # raises where the process is gone
    try:
        wait_until(lambda: not alive(pid))
    finally:
        if alive(pid):
            os.kill(pid, signal.SIGKILL)


def alive(pid: int) -> bool:
    """Whether there is a process of that number."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.fixture(scope="module")
def hopper() -> Iterator[VirtualBus]:
    with VirtualBus(robot="hopper", time="stepped") as virtual:
        yield virtual


def test_the_state_behind_the_port_is_published(hopper: VirtualBus):
    status = hopper.status()
    assert [row["joint"] for row in status["servos"].values()] == ["hip", "knee"]
    before = status["time"]
    hopper.advance(0.25)
    assert hopper.status()["time"] == pytest.approx(before + 0.25)
    with pytest.raises(SealegsError, match="did you mean 'silence'"):
        hopper.fault("silense")


@pytest.mark.long
def test_a_third_party_client_works_unchanged(hopper: VirtualBus):
    rustypot = pytest.importorskip("rustypot", reason="needs the Feetech client rustypot: pip install rustypot")
    client = rustypot.Sts3215PyController(serial_port=hopper.port, baudrate=RATE, timeout=1.0)
    assert [servo for servo in (1, 2, 3) if client.ping(servo)] == [1, 2]
    assert client.read_model(1) == [777]
    client.write_lock(1, False)
    client.write_p_coefficient(1, 24)
    client.write_lock(1, True)
    assert client.read_p_coefficient(1) == [24]
    client.sync_write_goal_position([1, 2], [0.4, -0.2])
    client.sync_write_torque_enable([1, 2], [True, True])
    for _ in range(60):
        positions = client.sync_read_present_position([1, 2])
    assert positions == pytest.approx([0.4, -0.2], abs=0.1)
    assert {row["torque"] for row in hopper.status()["servos"].values()} == {True}


def test_the_manufacturers_sdk_drives_it_bare(hopper: VirtualBus):
    import scservo_sdk as sdk

    port = sdk.PortHandler(hopper.port)
    assert port.openPort() and port.setBaudRate(RATE)
    packets = sdk.PacketHandler(0)
    assert port.ser is not None
    discard = port.ser.reset_input_buffer

    def succeeds(call: Callable[[], bool]) -> bool:
        """The SDK waits for 34 ms only, which a busy machine may take; and it discards no late replies."""
        for _ in range(20):
            if call():
                return True
            time.sleep(0.1)
            discard()
        return False

    assert succeeds(lambda: packets.ping(port, 1) == (777, sdk.COMM_SUCCESS, 0))
    reader = sdk.GroupSyncRead(port, packets, 56, 15)
    assert reader.addParam(1) and reader.addParam(2)
    assert succeeds(lambda: reader.txRxPacket() == sdk.COMM_SUCCESS)
    assert reader.getData(2, 62, 1) == 74
    port.closePort()


WITHOUT = "needs LeRobot's buses: make setup, or pip install --no-deps -c constraints.txt lerobot deepdiff orderly-set"
TRIES = 20  # of each request: the SDKs wait for 50 ms at most, which a machine that runs tests may take


@pytest.fixture(scope="module")
def lerobot() -> Iterator[None]:
    """LeRobot's package. Of its module of helpers, which needs much else, a bus takes two for the terminal."""
    if not all(importlib.util.find_spec(name) for name in ("lerobot", "deepdiff")):
        pytest.skip(WITHOUT)
    terminal = types.ModuleType("lerobot.utils.utils")
    terminal.__dict__.update(enter_pressed=lambda: True, move_cursor_up=lambda lines: None)
    replaced = "lerobot.utils.utils" not in sys.modules
    if replaced:
        sys.modules["lerobot.utils.utils"] = terminal
    before = sys.getswitchinterval(), dynamixel_sdk.port_handler.LATENCY_TIMER
    sys.setswitchinterval(2e-4)  # its SDKs wait in a busy loop
    dynamixel_sdk.port_handler.LATENCY_TIMER = 250  # [ms] half of what it waits for
    yield
    sys.setswitchinterval(before[0])
    dynamixel_sdk.port_handler.LATENCY_TIMER = before[1]
    if replaced:
        del sys.modules["lerobot.utils.utils"]


def patiently(call: Callable[[], Any]) -> Any:
    """What a call gives that tries no request twice."""
    for _ in range(TRIES):
        try:
            return call()
        except (RuntimeError, ConnectionError):
            time.sleep(0.05)
    return call()


def connected(kind: str, wire: Wire) -> Iterator[tuple[Any, Server]]:
    motors_of, name = importlib.import_module("lerobot.motors"), f"lerobot.motors.{kind}"
    made: Any = getattr(importlib.import_module(name), f"{kind.capitalize()}MotorsBus")
    model, unit = {"feetech": "sts3215", "dynamixel": "xl330-m288"}[kind], motors_of.MotorNormMode.DEGREES
    motors = {name: motors_of.Motor(k, model, unit) for k, name in enumerate(("hip", "knee"), start=1)}
    with Server(wire, stepped=True) as server:
        thread = threading.Thread(target=server.run, daemon=True)
        thread.start()
        bus = made(server.port, motors)

        def connect() -> None:
            if bus.is_connected:
                bus.port_handler.closePort()
            bus.connect()

        patiently(connect)
        bus.set_baudrate(1_000_000)
        yield bus, server
        if bus.is_connected:
            bus.port_handler.closePort()
        server.stop()
        thread.join(5.0)


@pytest.fixture(scope="module", params=["feetech", "dynamixel"])
def bus(request: pytest.FixtureRequest, lerobot: None) -> Iterator[tuple[Any, Server]]:
    feetech = request.param == "feetech"
    # the protocol is what is tested: a motor of the XL330 does not hold this leg
    wire = wired("hopper") if feetech else dynamixels("hopper", chain="sts3215")
    yield from connected(request.param, wire)


@pytest.mark.long
def test_it_finds_the_servos(bus: tuple[Any, Server]) -> None:
    client, _ = bus
    assert client.is_connected
    found = client.broadcast_ping(num_retry=TRIES)
    assert found is not None and list(found) == [1, 2] and set(found.values()) <= {777, 1200}


def test_it_sets_them_up_and_writes_a_calibration_that_reads_back(bus: tuple[Any, Server]) -> None:
    client, _ = bus
    calibration = importlib.import_module("lerobot.motors").MotorCalibration
    client.disable_torque(num_retry=TRIES)
    patiently(client.configure_motors)
    wanted = {name: calibration(k, 0, 0, 500 + k, 3500) for k, name in enumerate(client.motors, start=1)}
    patiently(lambda: client.write_calibration(wanted))
    assert patiently(client.read_calibration) == wanted and patiently(lambda: client.is_calibrated)


def test_it_moves_them_and_reads_where_they_are(bus: tuple[Any, Server]) -> None:
    client, server = bus
    client.enable_torque(num_retry=TRIES)
    goals = {"hip": 2048 - 300, "knee": 2048 + 300}
    client.sync_write("Goal_Position", goals, normalize=False, num_retry=TRIES)
    for _ in range(60):
        seen = client.sync_read("Present_Position", normalize=False, num_retry=TRIES)
    assert seen == pytest.approx(goals, abs=60)
    assert [server.wire.rig.torque(k) for k in range(2)] == [True, True]
    client.disable_torque(num_retry=TRIES)
    client.sync_read("Present_Position", normalize=False, num_retry=TRIES)  # time passes while bytes are on the wire
    assert [server.wire.rig.torque(k) for k in range(2)] == [False, False]
