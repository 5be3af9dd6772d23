"""Servos of other makes in runs: Dynamixels, calibrated and diagnosed too, and those of the SCS series."""

from __future__ import annotations

import functools
import io
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from sealegs.common.errors import SealegsError
from sealegs.configs.script import run
from sealegs.envs.bench.robot import BENCH
from sealegs.envs.robots import get_robot
from sealegs.gap.diagnose import diagnose
from sealegs.gap.log import read_measured
from sealegs.hw.bus.dialects import READ, SYNC_READ
from sealegs.hw.bus.packets import CorruptReplyError, NoReplyError, NotWrittenError
from sealegs.hw.bus.registers import load_model
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.machine import calibration, scan
from sealegs.hw.machine.calibration_file import read_joints
from sealegs.hw.machine.robot import ServoRobot
from sealegs.hw.machine.scan import rows
from sealegs.hw.run.commands import Trajectory
from sealegs.hw.virtual.in_process import SimulatedPort
from sealegs.hw.virtual.machine import Machine
from sealegs.hw.virtual.rig import Rig, mounts
from sealegs.hw.virtual.server import Server
from sealegs.hw.virtual.wire import Wire, fault_from

from tests.served_bus import RATE, dynamixels, served, switch_on, wired
from tests.simulated_runs import LEGS, QUIET, XL330, Simulation, sine, when_torque_came_on
from tests.waiting import wait_until

AWAY = sine(offset=0.9)
"""A start that the robot must first be brought to."""
LOOSE = {"speed": 99.0, "range_margin": 9.0, "following_error": 9.0}


@pytest.mark.long
def test_a_joint_with_a_dynamixel_is_calibrated_by_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """``sealegs calibrate`` on the virtual bus; the servo's own motor stands in for the hand."""
    monkeypatch.setattr("sealegs.hw.machine.calibration.MOVED", 0.03)
    buses: list[ServoBus] = []
    readings: list[int] = []
    scan, read = ServoBus.scan, ServoBus.read_register

    def near(self: ServoBus) -> dict[int, int]:  # the others are known to be absent, and cost time
        buses.append(self)
        return scan(self, range(4))

    def counted(self: ServoBus, servo: int, name: str) -> int:
        readings.append(value := read(self, servo, name))
        return value

    patient = functools.partial(ServoBus, timeout=1.0)  # other programs may hold the machine for longer than a servo
    monkeypatch.setattr("sealegs.hw.bus.servo_bus.ServoBus", patient)
    monkeypatch.setattr(ServoBus, "scan", near)
    monkeypatch.setattr(ServoBus, "read_register", counted)

    def push(angle: float) -> None:
        bus = buses[-1]
        bus.torque_on([1])
        bus.write_goals([1], [angle])
        for _ in range(120):  # the machine moves while bytes are on the wire
            bus.read_state([1])

    def sweep() -> None:
        for angle in (-0.8, 0.8):
            push(angle)
            seen = len(readings)
            wait_until(lambda seen=seen: len(readings) >= seen + 2)  # whoever watches has seen it there

    script = [lambda: push(0.0), lambda: push(0.5), sweep]  # 0 rad, its positive direction, from stop to stop

    class Person(io.StringIO):
        def readline(self, size: int = -1, /) -> str:
            script.pop(0)()
            return "\n"

    monkeypatch.setattr("sys.stdin", Person())
    out = tmp_path / "bench.yaml"
    with Server(dynamixels("bench"), stepped=True) as server:
        thread = threading.Thread(target=server.run, daemon=True)
        thread.start()
        words = ["robot=bench", "robot.servo=xl330_m288", f"port={server.port}", f"baudrate={RATE}", f"out={out}"]
        status = run(calibration.main, "calibrate", "", words)
        server.stop()
        thread.join(5.0)
    assert status == 0, capsys.readouterr().err
    (joint,) = read_joints(out, BENCH, load_model("xl330_m288"))
    assert (joint.id, joint.direction, joint.homing_offset) == (1, 1, 0) and abs(joint.zero - 2048) < 20
    # told to go to 0.8 rad, the weak servo swings its load about as far, a little more or less each time
    assert -1.2 < joint.low < -0.3 and 0.3 < joint.high < 1.2
    assert yaml.safe_load(out.read_text())["servo"] == "xl330_m288"


def motion(seed: int) -> Trajectory:
    """A sum of sines, then steps [rad]."""
    random, at = np.random.default_rng(seed), np.arange(0.0, 12.0, 0.01)
    waves = [
        random.uniform(0.1, 0.35) * np.sin(2.0 * np.pi * hertz * at + random.uniform(0.0, 6.0))
        for hertz in (0.2, 0.5, 1.1, 2.3)
    ]
    goal = np.sum(waves, axis=0)
    goal[at > 7.0] = 0.4 * np.sign(np.sin(np.pi * at[at > 7.0]))
    return Trajectory("motion", at, goal[:, None])


@pytest.mark.long
def test_friction_hidden_in_a_virtual_dynamixel_is_named_from_its_log(tmp_path: Path) -> None:
    hidden = tmp_path / "hidden.yaml"
    hidden.write_text("friction.coulomb: 0.05\n")  # the chain believes 0.02
    logs = tmp_path / "logs"
    logs.mkdir()
    for k in range(3):
        folder = tmp_path / str(k)

        def moved(robot: ServoRobot, seed: int = k) -> Trajectory:
            return motion(seed)

        simulation = Simulation("bench", *XL330, commands=moved, folder=folder, hidden=str(hidden), limits=LOOSE)
        assert simulation.run(10.0).ending == "finished"
        for file in folder.iterdir():
            shutil.copy(file, logs / file.name.replace("run", f"run{k}"))
    data = read_measured(logs)
    found = diagnose(data, causes=["friction.coulomb", "friction.viscous", "drive.delay"]).joint("joint")
    assert found.verdict == "explained", found
    causes = {cause.name: cause for cause in found.causes}
    assert causes["friction.coulomb"].parameters["friction.coulomb"].value == pytest.approx(0.05, rel=0.1)
    late = causes.pop("drive.delay", None)  # of the goals' bytes on the wire
    assert late is None or late.parameters["delay.seconds"].value < 1.5e-3
    assert set(causes) == {"friction.coulomb"}


# --- in runs -------------------------------------------------------------------------------------------------------


def dynamixel(**keys: Any) -> Simulation:
    return Simulation("bench", *XL330, **keys)


def test_a_servo_that_nobody_asks_any_more_stops_by_itself() -> None:
    simulation = dynamixel(commands=AWAY, faults=[{"kind": "unplug", "at": 0.5}])
    simulation.guard.patience = 0.1
    simulation.run()
    simulation.port.sleep(1.0)
    (servo,) = simulation.rig.servos
    assert simulation.torque == [True] and servo.get("bus_watchdog") == -1
    here = servo.sensors.steps
    simulation.port.sleep(1.0)
    assert abs(servo.sensors.steps - here) < 5, "it stands where its watchdog stopped it"


def test_a_stall_of_the_computer_that_the_watchdog_ended_is_named_within_100_ms() -> None:
    simulation = dynamixel(limits={"following_error": 9.0, "goal_speed": 99.0})
    stalls = iter([0.4])

    def stall() -> None:
        if simulation.loop.elapsed > 2.0:
            simulation.port.sleep(next(stalls, 0.0))

    simulation.loop.each_cycle = stall
    outcome = simulation.run(6.0)
    assert outcome.fault is not None and outcome.fault.name == "watchdog" and simulation.torque == [False]
    assert simulation.rig.history[-1][0] - when_torque_came_on(simulation) < 4.0


def test_a_slow_loop_is_not_stopped_by_the_servos_own_watchdog() -> None:
    limits = {"range_margin": 9.0, "speed": 99.0, "following_error": 9.0}
    simulation = dynamixel(rate=4.0, commands=sine(0.1, 0.2), limits=limits)
    outcome = simulation.run(4.0)
    assert outcome.ending == "finished", outcome.fault
    assert simulation.rig.servos[0].get("bus_watchdog") == 38, "three periods of 0.25 s, in 20 ms"


@pytest.mark.long
def test_a_servo_whose_restart_gives_it_torque_again_is_named_within_100_ms() -> None:
    restart = {"kind": "restart", "value": 0.015, "servos": [2], "at": 2.0}
    simulation = Simulation("hopper", *LEGS, commands=sine(0.1), limits=QUIET, faults=[restart])
    simulation.rig.servos[1].set_up("startup_configuration", 1)
    outcome = simulation.run(5.0)
    assert outcome.fault is not None and (outcome.fault.name, outcome.fault.servos) == ("restart", (2,)), outcome.fault
    assert "'torque_enable' is 1 again" in outcome.fault.sentence
    off = {servo: time for time, servo, on in simulation.rig.history if not on}
    assert off[1] - 2.0 < 0.1 and not any(simulation.torque)


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "errors", "overruns"),
    [("drop", ("NoReplyError", "CorruptReplyError"), 0.01), ("garble", ("CorruptReplyError",), 0.02)],
)
def test_one_lost_reply_or_garbled_request_in_a_hundred_is_survived(
    kind: str, errors: tuple[str, ...], overruns: float
) -> None:
    fault = {"kind": kind, "probability": 0.01}
    simulation = Simulation("hopper", *LEGS, commands=sine(0.1), faults=[fault], limits=QUIET)
    outcome = simulation.run(10.0)
    assert outcome.ending == "finished" and outcome.not_at_rest == {}, outcome.fault
    assert sum(outcome.bus.get(error, 0) for error in errors) > 30 and "RefusedError" not in outcome.bus
    assert outcome.timing.overrun_share < overruns and simulation.torque == [False, False] and simulation.said == []


def test_a_garbled_request_costs_no_other_servo_its_reply_and_leaves_no_torque() -> None:
    simulation = Simulation("hopper", *LEGS)
    simulation.bus.torque_on([1, 2])
    simulation.fault("garble", servos=[1], count=1)
    with pytest.raises(CorruptReplyError, match="reached servo 1 on simulated with a wrong checksum") as caught:
        simulation.bus.read_state(simulation.robot.all_ids, retries=0)
    assert caught.value.servos == (1,) and sorted(caught.value.replies) == simulation.robot.all_ids[1:]
    simulation.fault("garble", count=6)
    assert simulation.bus.torque_off([1, 2]) == {} and simulation.torque == [False, False]


@pytest.mark.long
def test_a_silent_servo_is_named_alone_though_others_wait_for_its_packet() -> None:
    silence = {"kind": "silence", "servos": [1], "at": 2.0}
    simulation = Simulation("hopper", *LEGS, commands=sine(0.1), faults=[silence], limits=QUIET)
    outcome = simulation.run(5.0)
    assert outcome.fault is not None and (outcome.fault.name, outcome.fault.servos) == ("NoReplyError", (1,))
    off = {servo: time for time, servo, on in simulation.rig.history if not on}
    assert off[2] - 2.0 < 0.3, "the others are released"
    assert list(outcome.not_at_rest) == [1] and any("TORQUE MAY BE ON" in line for _, line in simulation.said)


def test_a_shutdown_of_the_servo_is_named_with_what_frees_it() -> None:
    simulation = dynamixel(faults=[{"kind": "overload", "at": 2.0}])
    outcome = simulation.run(5.0)
    assert outcome.fault is not None and outcome.fault.name == "OverloadFault" and simulation.torque == [False]
    assert "sealegs scan id=1 reboot=true" in outcome.fault.sentence and outcome.not_at_rest == {}


# --- the SCS series, which cannot be read several at a time --------------------------------------------------------


SCS = load_model("scs0009")
SCS_BENCH = ("robot.servo=scs0009", "robot.actuator=sts3032", "robot.params.mass=0.03", "robot.params.length=0.05")
SCS_LEGS = ("robot.servo=scs0009", "robot.actuator=sts3215")  # the protocol is what is tested


@pytest.fixture
def scs_bus() -> ServoBus:
    machine = Machine(get_robot("hopper"), "sts3215")
    wire = Wire(Rig(machine, SCS, mounts(machine.names, None, SCS)))
    return ServoBus("simulated", model="scs0009", opened=SimulatedPort(wire))


def test_nobody_answers_a_sync_read(scs_bus: ServoBus) -> None:
    with pytest.raises(NoReplyError):
        scs_bus.line.transact([1, 2], SYNC_READ, [56, 15, 1, 2], 15)
    assert len(scs_bus.line.transact([2], READ, [56, 15], 15)[2]) == 15


def test_servos_are_read_one_by_one_and_found_by_a_scan(scs_bus: ServoBus) -> None:
    state = scs_bus.read_state([1, 2])
    assert state.ids == (1, 2) and state.missing == () and abs(state.position).max() < 3.0
    lines: list[str] = []
    assert rows(scs_bus, range(4), lines.append) == 2
    assert len(lines) == 3 and all("scs0009" in line for line in lines[1:]), lines


def test_nothing_is_required_of_registers_whose_meaning_is_assumed(scs_bus: ServoBus) -> None:
    assert "phase" not in [needed.register for needed in SCS.requires]
    scs_bus.check([1, 2])


def test_a_run_on_them_ends_released() -> None:
    simulation = Simulation("bench", *SCS_BENCH, commands=sine(0.5), limits=QUIET)
    outcome = simulation.run(2.0)
    assert outcome.ending == "finished" and simulation.torque == [False] and not outcome.bus, outcome


@pytest.mark.long
def test_a_silent_one_is_named_and_the_replies_of_the_others_are_used() -> None:
    silence = {"kind": "silence", "servos": [2], "at": 2.0}
    simulation = Simulation("hopper", *SCS_LEGS, rate=50.0, commands=sine(0.1), faults=[silence], limits=QUIET)
    seen: list[tuple[int, ...]] = []

    def noted() -> None:
        assert simulation.loop.reading is not None and simulation.loop.reading.state is not None
        seen.append(simulation.loop.reading.state.missing)

    simulation.loop.each_cycle = noted
    outcome = simulation.run(3.0)
    assert outcome.fault is not None and (outcome.fault.name, outcome.fault.servos) == ("NoReplyError", (2,))
    assert set(seen) == {(), (2,)}, "all others are still read until it is named"


# --- ``sealegs scan``: finds what is there, whatever is wrong with it, and sets it up --------------------------------


@pytest.fixture
def server() -> Iterator[Server]:
    with served(stepped=False) as found:  # a restart takes time
        yield found


def simulated(*faults: str) -> tuple[ServoBus, Wire]:
    """The hopper's two servos without a process, and what is wrong with the first."""
    wire = wired("hopper")
    wire.faults += [fault_from({"kind": kind, "servos": [1]}) for kind in faults]
    return ServoBus("simulated", opened=SimulatedPort(wire)), wire


def scanned(server: Server, capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    status = run(scan.main, "scan", "", [f"port={server.port}", *arguments])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_a_servo_that_answers_badly_keeps_no_other_from_being_found(server: Server) -> None:
    server.wire.faults.append(fault_from({"kind": "corrupt", "servos": [1]}))
    said: list[str] = []
    with ServoBus(server.port, timeout=0.1) as bus:
        assert scan.rows(bus, [1, 2], said.append) == 2
    assert any("id 1" in line and "broken packets" in line for line in said)
    assert any(line.split()[:2] == ["2", "sts3215"] for line in said)


def test_servos_at_another_baud_rate_are_found(server: Server, capsys: pytest.CaptureFixture[str]) -> None:
    server.wire.rig.servos[1].put("baud_rate", 1)
    status, said, _ = scanned(server, capsys, "last=3")
    rows = [line.split() for line in said.splitlines()]
    assert status == 0 and [(row[0], row[-1]) for row in rows[1:] if row[0] in "12"] == [
        ("1", "1000000"),
        ("2", "500000"),
    ]
    status, said, error = scanned(server, capsys, "last=3", "baudrate=250000")
    assert status == 2 and "at 250000 bit/s" in error


def test_registers_are_shown_and_set(server: Server, capsys: pytest.CaptureFixture[str]) -> None:
    status, said, _ = scanned(server, capsys, "id=2", "baudrate=1000000")
    assert status == 0 and "max_torque               1000  1 duty" in said
    status, said, _ = scanned(server, capsys, "id=2", "set=max_torque:500,p_gain:16")
    assert status == 0 and "max_torque 500 (before: 1000)" in said and "p_gain 16 (before: 32)" in said
    assert [server.wire.rig.servos[k].get("max_torque") for k in (0, 1)] == [1000, 500]
    for wrong, says in (
        ("max_torque:5000", "from 0 to 1000"),
        ("max_torqe:5", "did you mean"),
        ("p_gain", "register:count, such as set=p_gain:32"),
    ):
        status, _, error = scanned(server, capsys, "id=2", f"set={wrong}")
        assert status == 2 and says in error
    assert scanned(server, capsys, "set=p_gain:16")[0] == 2
    assert threading.active_count() < 10


def test_a_scan_says_all_that_deploy_would_refuse_or_mention_of_a_servo() -> None:
    bus, wire = simulated()
    for name in ("min_angle", "max_angle"):
        wire.servos[0].set_up(name, 0)
    wire.servos[0].set_up("operating_mode", 1)
    wire.servos[1].set_up("p_gain", 16)
    said: list[str] = []
    scan.rows(bus, [1, 2], said.append)
    about = [line.strip() for line in said]
    assert any("makes the servo count turns" in line and "set=min_angle:0,max_angle:4095" in line for line in about)
    assert any("position mode" in line and "set=operating_mode:0" in line for line in about)
    assert any("servo 2 moves otherwise than from the factory" in line and "p_gain 16 (32)" in line for line in about)


def test_what_a_servo_is_told_is_seen_to_outlast_its_power() -> None:
    bus, wire = simulated()
    said: list[str] = []
    scan.put(bus, 1, "torque_limit:300,max_torque:500", said.append)
    assert said[-2:] == [
        "Servo 1 was restarted and has kept max_torque 500.",
        "Servo 1: torque_limit 300 (before: 500).",
    ]
    scan.give_id(bus, 1, 4, said.append)
    assert said[-1] == "Servo 4 was restarted and has kept its id." and wire.servos[0].get("lock") == 1
    assert bus.read_register(4, "max_torque") == 500


@pytest.mark.parametrize("write", ["max_torque", "new_id"])
@pytest.mark.parametrize(
    ("fault", "says"),
    [("locked", "keeps its register 'lock' at 1.*nothing is written"), ("forgetful", "has forgotten .* in a restart")],
)
def test_what_a_servo_would_forget_without_power_is_no_success(write: str, fault: str, says: str) -> None:
    bus, _ = simulated(fault)
    with pytest.raises(NotWrittenError, match=says):
        if write == "new_id":
            scan.give_id(bus, 1, 4, lambda _: None)
        else:
            scan.put(bus, 1, "max_torque:500", lambda _: None)
    bus.clock.sleep(1.0)
    assert bus.read_register(1, "max_torque") == 1000


def test_a_servo_with_torque_is_not_restarted_and_may_forget() -> None:
    bus, wire = simulated()
    switch_on(wire, 1)
    said: list[str] = []
    scan.put(bus, 1, "max_torque:500", said.append)
    assert wire.servos[0].get("torque_enable") == 1
    assert "max_torque 500 may be lost at power-off" in said[-1] and "id=1" in said[-1]


def test_a_missing_servo_comes_with_those_that_answer(server: Server, capsys: pytest.CaptureFixture[str]) -> None:
    status, _, error = scanned(server, capsys, "id=9", "last=4", "baudrate=1000000")
    assert status == 2 and "no servo 9 answers" in error and "servos 1, 2 do, at 1000000 bit/s" in error
    with (
        ServoBus(server.port, timeout=0.1, retries=0) as bus,
        pytest.raises(NoReplyError, match="servos 1, 2 do answer"),
    ):
        bus.check([1, 2, 3])


def test_a_scan_sets_nothing_that_moves_a_servo(server: Server, capsys: pytest.CaptureFixture[str]) -> None:
    servo = server.wire.rig.servos[1]
    before = servo.get("goal_position")
    for wanted in ("torque_enable:1", "torque_enable:2", "goal_position:3000", "goal_velocity:50", "acceleration:9"):
        status, _, error = scanned(server, capsys, "id=2", "baudrate=1000000", f"set=p_gain:16,{wanted}")
        assert status == 2 and f"set={wanted}" in error and "sealegs deploy" in error
    assert servo.get("p_gain") == 32 and servo.get("torque_enable") == 0 and servo.get("goal_position") == before
    status, said, _ = scanned(server, capsys, "id=2", "baudrate=1000000", "set=torque_enable:0")
    assert status == 0 and "torque_enable 0" in said


@pytest.mark.parametrize("model", ["scs0009", "xl330_m288"])
def test_registers_that_move_a_servo_are_known_of_every_make(model: str) -> None:
    with served() as server, ServoBus(server.port, timeout=0.1) as bus:
        bus.model = load_model(model)
        moving = [name for name in bus.model.registers if name.startswith("goal_")] + [*bus.model.move, "torque_enable"]
        for name in moving:
            with pytest.raises(SealegsError, match=f"set={name}:1 could move"):
                scan.put(bus, 1, f"{name}:1")
