"""``sealegs scan``: finds what is there, whatever is wrong with it, and sets it up."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
from sealegs.actuators.errors import SealegsError
from sealegs.configs.script import run
from sealegs.hw import scan
from sealegs.hw.bus import ServoBus
from sealegs.hw.registers import load_model
from sealegs.hw.virtual.faults import fault_from
from sealegs.hw.virtual.server import Server

from tests.served_bus import served


@pytest.fixture
def server() -> Iterator[Server]:
    with served() as found:
        yield found


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
        ("p_gain", "register:count"),
    ):
        status, _, error = scanned(server, capsys, "id=2", f"set={wrong}")
        assert status == 2 and says in error
    assert scanned(server, capsys, "set=p_gain:16")[0] == 2
    assert threading.active_count() < 10


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
