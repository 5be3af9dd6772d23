"""Virtual servos behave as the documents say that real ones do."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.commands import deploy
from sealegs.common.errors import SealegsError
from sealegs.envs.bench.robot import BENCH
from sealegs.envs.robots import get_robot
from sealegs.gap.log import read_measured
from sealegs.hw.bus.packets import ConfigurationError, Status
from sealegs.hw.bus.registers import load_model
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.virtual import protocol
from sealegs.hw.virtual.machine import Machine
from sealegs.hw.virtual.rig import Rig, mounts
from sealegs.hw.virtual.server import Server
from sealegs.hw.virtual.wire import Fault, Wire

from tests.served_bus import STEP, STS, ask, read, served, switch_on, wait, wired, write

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


@pytest.mark.parametrize("mode", [2, 3])
def test_a_mode_that_is_not_simulated_is_refused_in_a_sentence(mode: int):
    wire = wired()
    write(wire, "operating_mode", mode)
    assert read(wire, "operating_mode") == 0
    assert "servo 1 was asked for" in str(wire.rig.servos[0].refused)


def test_goal_speed_0_stops_where_the_servo_is_set_up_so():
    wire = wired()
    write(wire, "phase", 4)
    switch_on(wire)
    write(wire, "goal_position", 2400)
    wait(wire, 0.5)
    assert abs(read(wire, "present_position") - 2048) < 30
    write(wire, "goal_velocity", 1000)
    write(wire, "goal_position", 2400)
    wait(wire, 1.0)
    assert abs(read(wire, "present_position") - 2400) < 60


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


def test_the_homing_offset_moves_the_seam_with_the_zero():
    wire = wired("bench", {"joint": {"zero": 100}}, params={"mass": 0.01})
    write(wire, "homing_offset", -1948)  # 100 is shown as 2048, and the seam is opposite
    switch_on(wire)
    write(wire, "goal_position", 1848)  # 196 steps below the seam of the encoder
    wait(wire, 0.1)
    assert wire.rig.machine.data.qvel[0] < -1.0
    wait(wire, 0.6)
    assert read(wire, "present_position") == pytest.approx(1848, abs=15)


def test_registers_that_somebody_set_win_over_what_the_supply_needs():
    machine = Machine(get_robot("bench"), "sts3250", None, None)
    rig = Rig(machine, STS, mounts(machine.names, None, STS), registers={"": {"max_voltage": 90}})
    assert Rig(machine, STS, mounts(machine.names, None, STS)).servos[0].get("max_voltage") > 120
    assert rig.servos[0].get("max_voltage") == 90


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


def test_torque_that_is_switched_on_after_a_fault_is_over_drives_again():
    wire = wired()
    switch_on(wire)
    wire.faults.append(Fault("overheat", value=80.0, seconds=0.5))
    wait(wire, 0.1)
    write(wire, "torque_enable", 0)
    wait(wire, 0.1)  # still hot, and without torque
    write(wire, "torque_enable", 1)
    assert not wire.rig.torque(0), "a hot servo does not drive"
    write(wire, "torque_enable", 0)
    wait(wire, 0.5)
    write(wire, "torque_enable", 1)
    assert wire.rig.torque(0)


def test_a_fault_shows_in_the_status_register_as_soon_as_in_the_reading():
    wire = wired()
    wire.faults.append(Fault("overheat", value=80.0))
    assert read(wire, "status") & Status.OVERHEAT


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


# --- wheels on the bus: servos in their mode for speeds, through the SDK, the loop, its guard and its log ------------

STEPPED = "hw.virtual.time=stepped"
MOUNTED = {"right_wheel": {"direction": -1}}
IDS = [1, 2]


@pytest.fixture
def server() -> Iterator[Server]:
    """The rover behind a pseudo-terminal."""
    with served("rover", MOUNTED) as server:
        yield server


@pytest.fixture
def bus(server: Server) -> Iterator[ServoBus]:
    with ServoBus(server.port, timeout=0.5) as bus:
        yield bus


def turned(bus: ServoBus, cycles: int = 60) -> np.ndarray:
    """Speeds of the servos' shafts after some cycles of 10 ms [rad/s]."""
    return [bus.read_state(IDS) for _ in range(cycles)][-1].velocity


def test_a_wheel_turns_at_the_speed_that_it_is_told_either_way_and_on_over_the_seam(bus: ServoBus) -> None:
    bus.check(IDS, IDS)
    assert bus.torque_on(IDS)
    bus.write_goals(IDS, [3.0, -2.0])
    np.testing.assert_allclose(turned(bus), [3.0, -2.0], atol=0.15)
    assert bus.read_register(2, "goal_velocity") == -round(2.0 / STEP)  # with the sign bit on the line
    register = load_model("sts3215")["goal_velocity"]
    assert register.to_bytes(-1)[1] & 0x80
    bus.write_goals(IDS, [-1.0, 1.0])
    np.testing.assert_allclose(turned(bus), [-1.0, 1.0], atol=0.15)


def test_torque_comes_on_at_speed_0_and_goes_off_at_speed_0(bus: ServoBus) -> None:
    """Torque on with a speed in the register, as another program left it, would have driven the robot away."""
    bus.check(IDS, IDS)
    bus.write_register(1, "goal_velocity", 2000)
    assert bus.torque_on(IDS)
    assert bus.read_register(1, "goal_velocity") == 0
    assert abs(turned(bus)).max() < 0.1
    bus.write_goals(IDS, [3.0, 3.0])
    turned(bus)
    assert bus.torque_off(IDS) == {}
    assert [bus.read_register(servo, "goal_velocity") for servo in IDS] == [0, 0]
    assert [bus.read_register(servo, "torque_enable") for servo in IDS] == [0, 0]


def test_holding_stops_a_wheel_that_nobody_told_the_bus_of(server: Server) -> None:
    """The supervisor opens the bus anew, and knows of a wheel by the register of its servo."""
    with ServoBus(server.port, timeout=0.5) as bus:
        bus.check(IDS, IDS)
        bus.torque_on(IDS)
        bus.write_goals(IDS, [3.0, 3.0])
        turned(bus)
    with ServoBus(server.port, timeout=0.5) as other:
        other.hold(IDS)
        assert abs(turned(other)).max() < 0.1
        other.torque_off(IDS)


def test_a_servo_in_position_mode_is_refused_for_a_wheel_and_the_other_way_round(bus: ServoBus) -> None:
    with pytest.raises(ConfigurationError, match=r"has 1 in register 'operating_mode'; write 0, position mode"):
        bus.check(IDS)
    with pytest.raises(
        SealegsError, match=r"has 0 in register 'operating_mode', and turns a wheel; write 1, velocity mode"
    ):
        deploy.main(["robot=rover", "excitation=steps", "duration=1", STEPPED, "robot.registers.operating_mode=0"])


def test_a_run_logs_speeds_as_goals_and_positions_that_count_on(tmp_path: Path) -> None:
    goals = tmp_path / "goals.csv"
    goals.write_text("time,left_wheel.goal,right_wheel.goal\n0,0,0\n0.2,4,4\n3,0,0\n3.4,0,0\n")
    deploy.main(["robot=rover", f"excitation={goals}", f"out={tmp_path / 'logs'}", "name=run", STEPPED])
    (run,) = read_measured(tmp_path / "logs" / "run.csv").runs
    for name in ("left_wheel", "right_wheel"):
        log = run.joints[name]
        assert log.goal is None and log.goal_velocity is not None and log.goal_velocity.max() == 4.0
        assert log.position[-1] - log.position[0] > 9.0  # of a turn and a half
        assert np.abs(np.diff(log.position)).max() < 0.1
    assert run.base["imu.w"].size


def test_dynamixels_turn_wheels_in_their_velocity_mode(tmp_path: Path) -> None:
    rover = Path(deploy.__file__).parents[1] / "envs" / "rover" / "rover.xml"
    robot = tmp_path / "rover.yaml"
    robot.write_text(
        f"model: {rover}\nbase: free\nfloor: {{friction: 0.8}}\nheight: 0.04\ntimestep: 0.002\n"
        "integrator: implicitfast\njoints:\n  left_wheel: {chain: xl330_wheel, range: [-8, 8]}\n"
        "  right_wheel: {chain: xl330_wheel, range: [-8, 8], servo: {id: 2, direction: -1}}\n"
        "deploy: {servo: xl330_m288}\n"
    )
    goals = tmp_path / "goals.csv"
    goals.write_text("time,left_wheel.goal,right_wheel.goal\n0,0,0\n0.2,3,-3\n2,3,-3\n")
    deploy.main([f"robot={robot}", f"excitation={goals}", f"out={tmp_path / 'logs'}", "name=run", STEPPED])
    (run,) = read_measured(tmp_path / "logs" / "run.csv").runs
    for name, speed in (("left_wheel", 3.0), ("right_wheel", -3.0)):
        velocity = run.joints[name].velocity
        assert velocity is not None
        np.testing.assert_allclose(velocity[-20:], speed, atol=0.1)


def test_a_wheel_that_is_blocked_ends_the_run(tmp_path: Path) -> None:
    goals, hidden = tmp_path / "goals.csv", tmp_path / "hidden.yaml"
    goals.write_text("time,left_wheel.goal,right_wheel.goal\n0,0,0\n0.2,4,4\n3,4,4\n")
    hidden.write_text("left_wheel: {friction.coulomb: 4.0}\n")
    with pytest.raises(
        SealegsError, match=r"joint left_wheel .* turns 4 rad/s slower than it is told .* it is blocked"
    ):
        deploy.main([
            "robot=rover", f"excitation={goals}", f"out={tmp_path / 'logs'}", STEPPED,
            f"hw.virtual.hidden={hidden}", "robot.safety.current=9",
        ])  # fmt: skip
