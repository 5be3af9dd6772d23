"""``sealegs scan``: finds what is there, whatever is wrong with it, and sets it up."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
from sealegs.common.errors import SealegsError
from sealegs.configs.script import run
from sealegs.hw.bus.packets import NoReplyError, NotWrittenError
from sealegs.hw.bus.registers import load_model
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.machine import scan
from sealegs.hw.virtual.faults import fault_from
from sealegs.hw.virtual.in_process import SimulatedPort
from sealegs.hw.virtual.server import Server
from sealegs.hw.virtual.wire import Wire

from tests.served_bus import served, switch_on, wired


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
