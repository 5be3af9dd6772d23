"""LeRobot's own motor buses, unchanged, on the virtual servos of Feetech and on virtual Dynamixels."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import threading
import time
import types
from collections.abc import Callable, Iterator
from typing import Any

import dynamixel_sdk
import pytest
from sealegs.hw.virtual.server import Server
from sealegs.hw.virtual.wire import Wire

from tests import served_bus, simulated_dynamixels

WITHOUT = "needs LeRobot's buses: make setup, or pip install --no-deps -c constraints.txt lerobot deepdiff orderly-set"
TRIES = 20  # of each request: the SDKs wait for 50 ms at most, which a machine that runs tests may take


@pytest.fixture(scope="module", autouse=True)
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
    wire = served_bus.wired("hopper") if feetech else simulated_dynamixels.wired("hopper", chain="sts3215")
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
