"""A robot on two adapters, one of Feetech's and one of Dynamixels: one loop, and a fault on one releases all."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.commands import deploy
from sealegs.common.errors import SealegsError
from sealegs.configs.script import run as run_script
from sealegs.envs.robots import get_robot
from sealegs.gap.log import read_measured
from sealegs.hw.bus.address import Address
from sealegs.hw.bus.buses import BusGroup
from sealegs.hw.bus.registers import ready_at
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.guard.safety import Limits, Safety
from sealegs.hw.machine.robot import build_robot
from sealegs.hw.run import connection
from sealegs.hw.run.loop import ControlLoop
from sealegs.hw.run.measured_log import read_events
from sealegs.hw.run.outcome import Outcome
from sealegs.hw.virtual.faults import fault_from
from sealegs.hw.virtual.machine import Machine
from sealegs.hw.virtual.rig import Rig, mounts
from sealegs.hw.virtual.simulated_port import SimulatedClock, SimulatedPort
from sealegs.hw.virtual.wire import Wire

from tests.servo_runs import PATIENT, config
from tests.simulated_runs import sine

BUSES = "robot.buses={knee: {servo: xl330_m288, joints: [knee]}}"
QUIET = {"range_margin": 9.0, "speed": 200.0, "following_error": 9.0, "current": 9.0}
KNEE = Address(1, "knee", 1)


class Both:
    """A hopper in simulated time, its hip on a Feetech bus and its knee on one of Dynamixels."""

    def __init__(self, faults: list[dict[str, Any]] | None = None, **keys: Any) -> None:
        settings = config("robot=hopper", BUSES, "robot.actuator=sts3215", patient=False)["robot"]
        self.robot = build_robot(settings)
        machine = Machine(
            get_robot("hopper"), "sts3215", None, {}, {s.name: abs(s.per_radian) for s in self.robot.sensors}
        )
        others = {line.name: line.model(self.robot.servo) for line in self.robot.lines if line.name}
        placed = {
            item.name: {"id": item.id, "zero": item.zero, "bus": item.line.name}
            for item in (*self.robot.joints, *self.robot.sensors)
        }
        mounted = mounts(machine.encoders, placed, self.robot.servo, others)
        registers = {name: ready_at(model, 1_000_000) for name, model in others.items()}
        self.rig = Rig(machine, self.robot.servo, mounted, "torque", others=others, registers=registers)
        rows = [fault_from(row) for row in faults or []]
        again = [fault_from(row) for row in faults or []]
        self.wires = {"": Wire(self.rig, rows), "knee": Wire(self.rig, again, bus="knee")}
        clock = SimulatedClock(self.rig.time)
        ports = {name: SimulatedPort(wire, clock=clock) for name, wire in self.wires.items()}
        models = {"": self.robot.servo, **others}
        parts = {
            name: ServoBus("simulated", model=models[name].name, opened=port, watchdog=0.2)
            for name, port in ports.items()
        }
        self.bus = BusGroup(parts, parallel=False)
        self.said: list[str] = []
        values = Limits.from_config({**settings["safety"], **QUIET})
        self.loop = ControlLoop(
            self.bus,
            self.robot,
            Safety(self.robot, values, 0.01),
            sine(0.1)(self.robot),
            100.0,
            alarm=self.said.append,
            **keys,
        )

    def run(self, seconds: float = 2.0) -> Outcome:
        return self.loop.run(seconds)

    @property
    def torque(self) -> list[bool]:
        return [self.rig.torque(k) for k in range(2)]


def test_joints_are_on_the_buses_that_the_robots_file_names() -> None:
    both = Both()
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
    both = Both()
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
    both = Both()
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
    both = Both()
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
    both = Both([{"kind": kind, "bus": bus, "at": 3.0, **where}])
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
    assert any(f"TORQUE MAY BE ON at servo(s) {servo}" in line for line in both.said) == lost


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
