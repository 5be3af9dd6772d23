"""Sensors and further adapters of a robot's file: one loop for all, and a fault on one adapter releases all."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.commands import deploy
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import compose
from sealegs.configs.script import run as run_script
from sealegs.gap.log import read_measured
from sealegs.hw.bus.interface import Address
from sealegs.hw.machine.joints import CalibrationError, Sensor
from sealegs.hw.machine.own_robot import own_robot
from sealegs.hw.machine.robot import build_robot
from sealegs.hw.run import connection
from sealegs.hw.run.commands import Reference
from sealegs.hw.run.measured_log import read_events

from tests.servo_runs import PATIENT, config
from tests.simulated_runs import QUIET, Simulation, sine

BUSES = "robot.buses={knee: {servo: xl330_m288, joints: [knee]}}"
KNEE = Address(1, "knee", 1)


def both_buses(*faults: dict[str, Any]) -> Simulation:
    """A hopper with its hip on a Feetech bus and its knee on one of Dynamixels."""
    return Simulation("hopper", BUSES, "robot.actuator=sts3215", commands=sine(0.1), limits=QUIET, faults=faults)


def test_joints_are_on_the_buses_that_the_robots_file_names() -> None:
    both = both_buses()
    assert both.robot.ids == [1, KNEE] and [str(servo) for servo in both.robot.ids] == ["1", "knee:1"]
    state = both.bus.read_state(both.robot.all_ids, whole=True)
    for k, servo in enumerate(both.rig.servos[:2]):
        assert state.position[k] == pytest.approx((servo.sensors.steps - 2048) * servo.model.step, abs=1e-9)
    assert state.ids == tuple(both.robot.all_ids) and state.torque is not None and state.torque[:2].tolist() == [0, 0]


@pytest.mark.long
@pytest.mark.parametrize("hw", ["feetech", "virtual", "dynamixel"])
def test_dynamixels_on_a_further_bus_have_their_watchdog_whatever_the_first_bus_has(
    hw: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    both = both_buses()
    parts = both.bus.parts
    for part in parts.values():
        part.watchdog = None
    monkeypatch.setattr(connection, "openings", lambda *_: {name: lambda p=part: p for name, part in parts.items()})
    settings = config("robot=hopper", BUSES, f"hw={hw}", patient=False)["hw"]
    bus = connection.opened_bus(settings, {}, both.robot, 0.01)
    with contextlib.closing(bus):
        assert bus.torque_on(both.robot.ids)
        assert bus.read_register(KNEE, "bus_watchdog") == 10, "0.2 s, in 20 ms"


def test_no_watchdog_stops_the_servos_of_one_bus_while_another_bus_gets_its_torque() -> None:
    both = both_buses()
    knee_alone: list[bool] = []

    def slowly() -> bool:  # as 18 servos on an adapter that holds bytes take their time
        if both.torque == [False, True]:
            knee_alone.append(True)
            both.bus.clock.sleep(0.3)
        return True

    assert both.bus.torque_on([KNEE, 1], slowly) and knee_alone and both.torque == [True, True]
    assert both.bus.read_register(KNEE, "bus_watchdog") == 10


@pytest.mark.long
def test_one_loop_runs_both_and_releases_both() -> None:
    both = both_buses()
    before = [servo.sensors.steps for servo in both.rig.servos[:2]]
    outcome = both.run(3.0)
    assert outcome.ending == "finished" and both.torque == [False, False] and outcome.not_at_rest == {}, outcome.fault
    assert {servo for _, servo, on in both.rig.history if on} == {1}, "each has the id 1 on its own bus"
    assert len(both.rig.history) == 4 and before != [servo.sensors.steps for servo in both.rig.servos[:2]]


FAULTS = {"silence": "NoReplyError", "unplug": "UnpluggedError", "overheat": "OverheatFault", "limp": "torque"}
QUICK = [("silence", "knee"), ("unplug", ""), ("limp", "knee")]
REST = [(kind, bus) for kind in FAULTS for bus in ("", "knee") if (kind, bus) not in QUICK]


@pytest.mark.parametrize(("kind", "bus"), [*QUICK, *(pytest.param(*row, marks=pytest.mark.long) for row in REST)])
def test_a_fault_on_one_adapter_releases_the_servos_on_both(kind: str, bus: str) -> None:
    servo = KNEE if bus else 1
    where = {} if kind == "unplug" else {"servos": [1]}
    both = both_buses({"kind": kind, "bus": bus, "at": 3.0, **where})
    outcome = both.run(6.0)
    assert outcome.fault is not None and outcome.fault.name == FAULTS[kind], outcome.fault
    if kind != "unplug":
        assert outcome.fault.servos == (servo,) and str(servo) in outcome.fault.sentence
    reached = [both.torque[k] for k, item in enumerate(both.robot.joints) if item.line.name != bus]
    assert reached == [False], "the other adapter's servo is released"
    last = max(time for time, _, on in both.rig.history if not on)
    assert 3.0 < last < 3.5
    lost = kind in ("silence", "unplug")
    assert list(outcome.not_at_rest) == ([servo] if lost else [])
    assert any(f"TORQUE MAY BE ON at servo(s) {servo}" in line for _, line in both.said) == lost


def test_a_bus_that_is_wrong_is_refused_in_a_sentence() -> None:
    for words, said in (
        ("{knee: {servo: xl330_m288, joints: [ankle]}}", "no joint 'ankle'"),
        ("{knee: {joints: [knee]}}", r"robot\.buses\.knee\.servo is missing"),
        ("{knee: {servo: sts3215, joints: [knee], baudrate: fast}}", r"knee\.baudrate takes a whole number or null"),
        ("{knee: {servo: sts3215, joints: 3}}", r"knee\.joints takes a list, not 3"),
        ("{knee: {servo: sts3215, joints: null}}", r"knee\.joints takes a list"),
        ("{knee: {servo: sts3215, joints: [knee], bauds: 5}}", r"knee\.bauds is unknown"),
        ("[knee]", r"robot\.buses takes a mapping"),
        ("{a: {servo: sts3215, joints: [knee]}, b: {servo: sts3215, joints: [knee]}}", "name it once"),
    ):
        with pytest.raises(SealegsError, match=said):
            build_robot(config("robot=hopper", f"robot.buses={words}", patient=False)["robot"])


@pytest.mark.long
def test_deploy_runs_a_robot_on_two_virtual_adapters(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hip_and_knee = tmp_path / "still.csv"
    rows = np.array([[0.0, -0.6, 0.6], [2.0, -0.6, 0.6]])
    np.savetxt(hip_and_knee, rows, "%.3f", ",", header="time,hip.goal,knee.goal", comments="")
    limits = [f"robot.safety.{name}={value:g}" for name, value in QUIET.items()]
    words = ["robot=hopper", BUSES, "robot.actuator=sts3215", f"excitation={hip_and_knee}", f"out={tmp_path / 'logs'}"]
    words += [*PATIENT, *limits, "hw.virtual.time=stepped", "silence=20", "name=run", "duration=1"]
    assert run_script(deploy.main, "deploy", "", words) == 0, capsys.readouterr().err
    run = read_measured(tmp_path / "logs" / "run.csv").runs[0]
    assert set(run.joints) == {"hip", "knee"} and len(run.time) > 50
    events = read_events(tmp_path / "logs" / "run.csv")
    assert next(event for event in events if event["event"] == "torque on")["servos"] == [1, "knee:1"]


def hopper(row: Any) -> tuple[Sensor, ...]:
    """Sensors of a hopper whose file has one at the hip, with these keys."""
    return build_robot({**compose("deploy", {"robot": "hopper"})["robot"], "sensors": {"hip.link": row}}).sensors


def test_keys_of_a_sensor_count() -> None:
    (sensor,) = hopper({"id": 9, "zero": 100, "per_radian": -0.5})
    assert (sensor.id, sensor.zero, sensor.per_radian) == (9, 100, -0.5)


def test_a_direction_of_a_sensor_is_refused_with_the_sign_to_write_in_its_place() -> None:
    """An encoder that counts the other way was read as if it did not, and a policy saw its spring bend backwards."""
    with pytest.raises(CalibrationError, match=r"robot\.sensors\.hip\.link\.direction is unknown: .*per_radian: -1"):
        hopper({"id": 9, "direction": -1})


def test_a_mistyped_key_of_a_sensor_is_refused_with_the_nearest_one() -> None:
    with pytest.raises(CalibrationError, match=r"hip\.link\.zro is unknown \(did you mean 'zero'\?\); there are id, "):
        hopper({"id": 9, "zro": 5})


def test_a_sensor_without_its_id_is_refused_as_before() -> None:
    for row in ({}, {"zero": 5}, 9, None):
        with pytest.raises(CalibrationError, match="it needs an id, and takes zero, per_radian"):
            hopper(row)


@pytest.mark.parametrize(
    ("sensors", "says"),
    [
        ({"hipp.link": {"id": 3}}, r"hipp\.link measures nothing of this robot \(did you mean 'hip\.link'\?\)"),
        ({"bse_x": {"id": 3}}, r"did you mean 'base_x'"),
        ({"hip.link": {"id": 300}}, r"hip\.link\.id is 300; ids are 0 to 252"),
        ({"hip.link": {"id": 3.9}}, r"hip\.link\.id takes a whole number, not 3\.9"),
        ({"hip.link": {"id": 3, "zero": 1.5}}, r"hip\.link\.zero takes a whole number"),
        ({"hip.link": {"id": 3, "per_radian": 0}}, r"per_radian is 0"),
    ],
)
def test_a_sensor_of_nothing_or_nowhere_is_refused(sensors: dict[str, Any], says: str) -> None:
    with pytest.raises(CalibrationError, match=says):
        build_robot({**compose("deploy", {"robot": "hopper"})["robot"], "sensors": sensors})


def test_the_reference_controller_needs_encoders_behind_the_springs() -> None:
    config = compose("deploy", {"robot": "hopper"})["robot"]
    Reference(build_robot(config))
    for sensors, missing in (({}, "hip.link, knee.link"), ({"hip.link": {"id": 3}}, "knee.link")):
        with pytest.raises(SealegsError, match=f"robot.sensors lacks {missing};"):
            Reference(build_robot({**config, "sensors": sensors}))


@pytest.mark.parametrize("key", ["sensors", "gears", "registers", "params"])
def test_a_list_in_place_of_a_table_is_refused(key: str) -> None:
    with pytest.raises(SealegsError, match=f"robot.{key} takes a mapping, not "):
        build_robot({**compose("deploy", {"robot": "hopper"})["robot"], key: [1]})


def test_limits_of_an_own_robot_that_are_a_list_are_refused(tmp_path: Path) -> None:
    (tmp_path / "my.xml").write_text(
        '<mujoco><worldbody><body><joint name="elbow" range="-1 1"/><geom size="0.1" mass="1"/></body></worldbody>'
        '<actuator><position joint="elbow" kp="10"/></actuator></mujoco>'
    )
    (tmp_path / "my.yaml").write_text("model: my.xml\njoints: {elbow: {chain: sts3215}}\ndeploy: {safety: [1]}\n")
    with pytest.raises(SealegsError, match=r"my\.yaml: deploy\.safety takes a mapping, not \[1\]"):
        own_robot(str(tmp_path / "my.yaml"))
