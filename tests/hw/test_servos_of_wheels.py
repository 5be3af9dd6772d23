"""Wheels on the bus: servos in their mode for speeds, through the SDK, the loop, its guard and its log."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from sealegs.commands import deploy
from sealegs.common.errors import SealegsError
from sealegs.gap.log import read_measured
from sealegs.hw.bus.packets import ConfigurationError
from sealegs.hw.bus.registers import load_model
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.virtual.server import Server

from tests.served_bus import STEP, served

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
