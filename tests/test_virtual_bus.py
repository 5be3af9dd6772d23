"""Virtual servos behave as the documents say that real ones do, on a machine that is the simulation and no more."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest

from actuators import load_chain
from actuators.errors import SealegsError
from configs.compose import FOLDER
from configs.script import run
from envs.bench.robot import BENCH
from envs.robots import ROBOTS, get_robot
from hw.packets import Status
from hw.registers import load_model
from hw.virtual import VirtualBus, protocol
from hw.virtual.__main__ import main
from hw.virtual.faults import Fault
from hw.virtual.machine import Drive, Machine
from hw.virtual.protocol import Request, status_packet, take_requests
from hw.virtual.rig import Rig, mounts
from hw.virtual.wire import Wire

STS = load_model("sts3215")
STEP = 2.0 * math.pi / 4096
RATE = 1_000_000


def wired(robot: str = "bench", servos=None, hidden=None, actuator=None, params=None) -> Wire:
    machine = Machine(get_robot(robot), actuator, hidden, params)
    return Wire(Rig(machine, STS, mounts(machine.names, servos, STS)))


def ask(wire: Wire, target: int, instruction: int, *parameters: int) -> list[bytes]:
    """Replies to one request, sent as soon as the line is free."""
    request = Request(target, instruction, bytes(parameters), 6 + len(parameters))
    return [packet for _, packet in wire.exchange(request, wire.rig.time, RATE)]


def write(wire: Wire, name: str, count: int, servo: int = 1) -> list[bytes]:
    register = STS[name]
    return ask(wire, servo, protocol.WRITE, register.address, *register.to_bytes(count))


def read(wire: Wire, name: str, servo: int = 1) -> int:
    register = STS[name]
    (packet,) = ask(wire, servo, protocol.READ, register.address, register.bytes)
    return register.read(packet[5:-1], register.address)


def switch_on(wire: Wire, servo: int = 1) -> None:
    write(wire, "goal_position", read(wire, "present_position", servo), servo)
    write(wire, "torque_enable", 1, servo)


def wait(wire: Wire, seconds: float) -> None:
    end = wire.rig.time + seconds
    while wire.rig.time < end - 1e-6:
        wire.apply_faults(wire.rig.time)
        wire.rig.advance(min(wire.rig.time + 0.01, end))
        wire.rig.apply()


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
    (same,) = ask(wire, 4, protocol.PING)  # equal contents: nothing is noticed
    assert same == status_packet(4, 0)


# --- registers ---------------------------------------------------------------------------------------------------


def test_eeprom_registers_survive_power_off_only_if_they_were_unlocked():
    wire = wired()
    write(wire, "p_gain", 16)
    assert read(wire, "p_gain") == 16
    assert ask(wire, 1, protocol.REBOOT) == []
    assert ask(wire, 1, protocol.PING) == []  # it boots
    wait(wire, 0.9)
    assert read(wire, "p_gain") == 32
    write(wire, "lock", 0)
    write(wire, "p_gain", 16)
    ask(wire, 1, protocol.REBOOT)
    wait(wire, 0.9)
    assert (read(wire, "p_gain"), read(wire, "lock")) == (16, 1)


def test_read_only_registers_keep_their_value():
    wire = wired()
    ask(wire, 1, protocol.WRITE, STS["model_number"].address, 1, 1)
    ask(wire, 1, protocol.WRITE, STS["present_voltage"].address, 1)
    assert (read(wire, "model_number"), read(wire, "present_voltage")) == (777, 74)


def test_a_buffered_write_waits_for_its_action():
    wire = wired()
    ask(wire, 1, protocol.REG_WRITE, STS["goal_velocity"].address, 7, 0)
    assert (read(wire, "goal_velocity"), read(wire, "write_pending")) == (0, 1)
    assert ask(wire, 254, protocol.ACTION) == []
    assert (read(wire, "goal_velocity"), read(wire, "write_pending")) == (7, 0)


def test_response_level_zero_silences_writes():
    wire = wired()
    assert write(wire, "goal_velocity", 3)
    write(wire, "response_level", 0)
    assert write(wire, "goal_velocity", 4) == []
    assert read(wire, "goal_velocity") == 4


def test_the_id_changes_at_once():
    wire = wired()
    write(wire, "id", 12)
    assert read(wire, "id", 12) == 12
    assert ask(wire, 1, protocol.PING) == []


def test_here_is_the_centre_sets_the_homing_offset():
    wire = wired("bench", {"joint": {"zero": 1000}})
    assert read(wire, "present_position") == 1000
    write(wire, "torque_enable", 128)
    assert (read(wire, "present_position"), read(wire, "homing_offset")) == (2048, -1048)
    assert read(wire, "torque_enable") == 0
    write(wire, "torque_enable", 1)
    write(wire, "goal_position", 2148)
    wait(wire, 1.0)
    assert wire.rig.machine.position(0) == pytest.approx(100 * STEP, abs=0.03)


# --- motion ------------------------------------------------------------------------------------------------------


def test_the_machine_moves_as_the_drivetrain_it_is_made_of():
    wire = wired()
    write(wire, "goal_position", 2500)
    write(wire, "torque_enable", 1)
    started = wire.rig.time
    wire.rig.advance(started + 0.2)
    plain = BENCH.drivetrain()
    data = mujoco.MjData(plain.model)
    mujoco.mj_forward(plain.model, data)
    data.ctrl[0] = (2500 - 2048) * STEP
    mujoco.mj_step(plain.model, data, 200)
    assert wire.rig.machine.position(0) == pytest.approx(
        data.qpos[0], abs=5e-4
    )  # a third of an encoder step; its steps fall elsewhere


def test_readings_are_what_the_encoder_and_the_motor_of_the_chain_give():
    wire = wired()
    switch_on(wire)
    write(wire, "goal_position", 2600)
    wait(wire, 0.05)
    machine = wire.rig.machine
    (packet,) = ask(wire, 1, protocol.READ, 56, 15)
    block = packet[5:-1]
    found = {name: STS[name].read(block, 56) for name in ("present_position", "present_load", "present_current")}
    assert found["present_position"] == round(2048 + machine.position(0) / STEP)
    assert found["present_load"] == round(1000 * machine.duty(0))
    assert found["present_current"] == round(machine.current(0) / 0.0065)
    assert machine.duty(0) > 0.5


def test_velocity_is_the_encoders_difference_over_a_window():
    wire = wired()
    switch_on(wire)
    ask(wire, 1, protocol.WRITE, 41, 0, *STS["goal_position"].to_bytes(2900), 0, 0, *STS["goal_velocity"].to_bytes(500))
    wait(wire, 0.6)
    assert read(wire, "present_velocity") == pytest.approx(500, abs=60)
    assert read(wire, "moving") == 1


def test_torque_on_drives_to_the_goal_as_it_stands():
    wire = wired()
    write(wire, "goal_position", 2300)
    wait(wire, 0.5)
    assert read(wire, "present_position") == pytest.approx(2048, abs=3)
    write(wire, "torque_enable", 1)
    wait(wire, 0.5)
    assert read(wire, "present_position") == pytest.approx(2300, abs=20)


def test_without_torque_the_pendulum_swings_and_damping_slows_it():
    speeds = {}
    for mode in (0, 2):
        wire = wired()
        write(wire, "torque_enable", 1)
        write(wire, "goal_position", 2048 + 1000)
        wait(wire, 1.5)
        write(wire, "torque_enable", mode)
        wait(wire, 0.25)
        speeds[mode] = abs(wire.rig.machine.data.qvel[0])
        assert read(wire, "present_load") == 0
    assert speeds[2] < 0.5 * speeds[0]


def test_goals_stay_within_the_angle_limits():
    wire = wired()
    write(wire, "max_angle", 2200)
    switch_on(wire)
    write(wire, "goal_position", 3000)
    wait(wire, 0.5)
    assert read(wire, "present_position") == pytest.approx(2200, abs=15)


def test_the_torque_limit_bounds_the_duty():
    wire = wired()
    write(wire, "torque_limit", 300)
    switch_on(wire)
    write(wire, "goal_position", 3000)
    wait(wire, 0.02)
    assert read(wire, "present_load") == pytest.approx(0.97 * 300, abs=2)


def test_gain_and_startup_force_scale_those_of_the_chain(tmp_path: Path):
    (tmp_path / "hidden.yaml").write_text("minimum_duty.value: 0.03\n")
    wire = wired("bench", hidden=str(tmp_path / "hidden.yaml"))
    switch_on(wire)
    write(wire, "p_gain", 16)
    write(wire, "goal_position", 2148)
    wait(wire, 0.012)
    error = 100 - (read(wire, "present_position") - 2048)
    assert read(wire, "present_load") == pytest.approx(0.5 * 5.3 * 1000 * error * STEP, abs=4)
    write(wire, "startup_force", 160)
    write(wire, "goal_position", read(wire, "present_position") + 2)
    wait(wire, 0.02)
    assert abs(read(wire, "present_load")) == pytest.approx(300, abs=5)


def test_a_move_keeps_the_speed_in_force_when_its_goal_was_written():
    wire = wired()
    switch_on(wire)
    write(wire, "goal_velocity", 400)
    write(wire, "goal_position", 3048)
    wait(wire, 0.5)
    write(wire, "goal_velocity", 4000)
    wait(wire, 0.5)
    assert read(wire, "target_position") == pytest.approx(2048 + 400, abs=15)
    wait(wire, 1.6)
    assert read(wire, "target_position") == 3048


def test_acceleration_makes_a_trapezoid():
    wire = wired()
    switch_on(wire)
    ask(
        wire,
        1,
        protocol.WRITE,
        41,
        20,
        *STS["goal_position"].to_bytes(3048),
        0,
        0,
        *STS["goal_velocity"].to_bytes(1000),
    )
    wait(wire, 0.25)
    assert read(wire, "target_position") == pytest.approx(2048 + 0.5 * 2000 * 0.25**2, abs=6)
    wait(wire, 1.3)  # 0.5 s up, 0.5 s at 1000 step/s, 0.5 s down: 1.5 s
    assert read(wire, "target_position") == pytest.approx(3048, abs=2)


def test_the_loop_does_not_take_the_short_way_over_the_seam():
    wire = wired("bench", {"joint": {"zero": 100}}, params={"mass": 0.01})
    write(wire, "torque_enable", 1)
    write(wire, "goal_position", 4000)  # 196 steps down, 3900 up
    wait(wire, 0.1)
    assert wire.rig.machine.data.qvel[0] > 1.0


def test_a_servo_mounted_the_other_way_turns_the_other_way():
    wire = wired("bench", {"joint": {"zero": 1900, "direction": -1, "id": 7}})
    write(wire, "torque_enable", 1, 7)
    write(wire, "goal_position", 2100, 7)
    wait(wire, 0.6)
    assert wire.rig.machine.position(0) == pytest.approx(-200 * STEP, abs=0.03)
    assert read(wire, "present_position", 7) == pytest.approx(2100, abs=20)


# --- protection --------------------------------------------------------------------------------------------------


def blocked() -> Wire:
    """A servo that cannot lift its load."""
    wire = wired("bench", params={"mass": 8.0})
    write(wire, "torque_enable", 1)
    write(wire, "goal_position", 2048 + 1024)
    return wire


def test_overload_latches_and_limits_until_torque_is_switched_off():
    wire = blocked()
    wait(wire, 1.5)
    assert read(wire, "status") == 0
    wait(wire, 1.5)
    (packet,) = ask(wire, 1, protocol.PING)
    assert packet[4] == Status.OVERLOAD
    assert abs(read(wire, "present_load")) == pytest.approx(0.97 * 200, abs=3)
    (packet,) = write(wire, "torque_enable", 0)
    wait(wire, 0.3)
    assert read(wire, "status") == 0


def test_overheat_releases_the_output_and_shows_in_every_reply():
    wire = wired()
    write(wire, "torque_enable", 1)
    wire.faults.append(Fault("overheat", value=80.0, seconds=1.0))
    wait(wire, 0.05)
    (packet,) = ask(wire, 1, protocol.PING)
    assert packet[4] == Status.OVERHEAT
    assert read(wire, "present_temperature") == 80
    assert not wire.rig.torque(0)
    wait(wire, 1.2)
    assert read(wire, "present_temperature") == 25


def test_a_brown_out_restarts_the_servos_without_torque():
    wire = wired()
    write(wire, "torque_enable", 1)
    wire.faults.append(Fault("brown_out", value=3.8, seconds=0.2))
    wait(wire, 0.1)
    (packet,) = ask(wire, 1, protocol.PING)
    assert packet[4] == Status.VOLTAGE
    assert read(wire, "present_voltage") == 38
    assert wire.rig.torque(0)
    wait(wire, 0.2)
    wire.faults.append(Fault("brown_out", at=wire.rig.time, value=2.5, seconds=0.1))
    wait(wire, 0.5)
    assert ask(wire, 1, protocol.PING) == []
    assert not wire.rig.torque(0)
    wait(wire, 0.5)
    assert (read(wire, "torque_enable"), read(wire, "status")) == (0, 0)


def test_current_heats_the_servo():
    wire = blocked()
    write(wire, "overload_torque", 0)
    write(wire, "protection_time", 254)
    wait(wire, 2.0)
    assert wire.rig.servos[0].temperature > 25.3


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
        ("[:", "cannot be read"),
    ],
)
def test_a_wrong_file_of_hidden_effects_is_refused_in_a_sentence(tmp_path: Path, text, words):
    (tmp_path / "hidden.yaml").write_text(text)
    with pytest.raises(SealegsError, match=words):
        wired("bench", hidden=str(tmp_path / "hidden.yaml"))


# --- process -----------------------------------------------------------------------------------------------------


def start(*arguments: str, **keywords) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "hw.virtual", *arguments],
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


def test_the_servos_outlive_a_killed_parent_for_a_while():
    code = "import os\nfrom hw.virtual import VirtualBus\nbus = VirtualBus(linger=0.5)\nprint(bus.pid, flush=True)\n"
    code += "os.kill(os.getpid(), 9)"
    parent = subprocess.run([sys.executable, "-c", code], cwd=FOLDER.parent, capture_output=True, text=True, timeout=60)
    pid = int(parent.stdout)
    os.kill(pid, 0)  # raises where the process is gone
    end = time.monotonic() + 20.0
    while time.monotonic() < end:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return
        time.sleep(0.2)
    os.kill(pid, signal.SIGKILL)
    pytest.fail("the virtual bus did not end")


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
