"""An adapter that comes back under another name is found again, and nobody else's is taken for it."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.commands import deploy
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import compose
from sealegs.configs.script import run as run_script
from sealegs.gap.log import read_measured
from sealegs.hw.bus.adapters import UsbAdapter, Whereabouts, advice, plugged
from sealegs.hw.bus.interface import Address
from sealegs.hw.bus.packets import PortError
from sealegs.hw.bus.port import BusPort
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.guard.hold_watch import claims
from sealegs.hw.guard.supervisor import Charge, Line, Opening
from sealegs.hw.guard.take_over import Aftermath, bring_all_to_rest
from sealegs.hw.machine.joints import CalibrationError, Sensor
from sealegs.hw.machine.own_robot import own_robot
from sealegs.hw.machine.robot import build_robot
from sealegs.hw.run import connection
from sealegs.hw.run.commands import Reference
from sealegs.hw.run.measured_log import read_events
from sealegs.hw.virtual import VirtualBus, protocol
from sealegs.hw.virtual.server import Server

from tests.served_bus import served
from tests.servo_runs import PATIENT, REPOSITORY, config, excitation
from tests.simulated_runs import QUIET, Simulation, sine
from tests.waiting import wait_until

IDS = [1, 2]
KIND = "1a86:7523:"


class Sockets:
    """Adapters with a hopper each, plugged into sockets and named by links, as a system would do it.

    Attributes:
        folder: of the names.
        listed: what the system says is plugged in.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.listed = folder, list[UsbAdapter]()

    def plug(self, server: Server, name: str, serial: str | None = None, socket: str | None = None) -> str:
        """Give an adapter a name; its path."""
        path = self.folder / name
        path.unlink(missing_ok=True)
        path.symlink_to(server.port)
        self.listed = [one for one in self.listed if one.device != str(path)]
        self.listed.append(UsbAdapter(str(path), KIND, serial, socket))
        return str(path)

    def pull(self, name: str) -> None:
        (self.folder / name).unlink()
        self.listed = [one for one in self.listed if one.device != str(self.folder / name)]

    def home(self, path: str) -> Whereabouts:
        return Whereabouts.of(path, lambda: self.listed)

    def opening(self, home: Whereabouts) -> Opening:
        return Opening(home.path, 1_000_000, "sts3215", 0.1, home, IDS, lambda: self.listed)

    def released(self, home: Whereabouts) -> bool:
        """Whether a supervisor's tries release the servos; it gives up after some."""
        opening, tries = self.opening(home), list[Exception]()

        def opened() -> ServoBus:
            try:
                return opening()
            except PortError as error:
                tries.append(error)
                raise

        clock = BusPort.__new__(BusPort)
        after = Aftermath(lambda *_, **__: None, lambda _: None, clock, lambda: True, lambda: int(len(tries) > 2), 4711)
        return bring_all_to_rest([Line("", opened, IDS)], "release", after, "it died") is not None


@pytest.fixture
def sockets(tmp_path: Path) -> Sockets:
    return Sockets(tmp_path)


@pytest.fixture
def robots() -> Iterator[tuple[Server, Server]]:
    """Two hoppers of the same servos, each on its own adapter, with torque."""
    with contextlib.ExitStack() as stack:
        found = [stack.enter_context(served()) for _ in range(2)]
        for server in found:
            with ServoBus(server.port, timeout=0.1) as bus:
                bus.torque_on(IDS)
        yield found[0], found[1]


def torque(server: Server) -> list[bool]:
    return [server.wire.rig.torque(joint) for joint in (0, 1)]


@pytest.mark.parametrize(("serials", "places"), [(("A1", "B2"), ("1-1", "1-2")), ((None, None), ("1-1", "1-2"))])
def test_an_adapter_is_found_under_another_ones_old_name(
    serials: tuple[str, str], places: tuple[str, str], sockets: Sockets, robots: tuple[Server, Server]
) -> None:
    home = sockets.home(sockets.plug(robots[0], "ttyUSB0", serials[0], places[0]))
    sockets.plug(robots[1], "ttyUSB1", serials[1], places[1])
    sockets.plug(robots[1], "ttyUSB0", serials[1], places[1])
    sockets.plug(robots[0], "ttyUSB1", serials[0], places[0])
    assert sockets.released(home) and torque(robots[0]) == [False, False] and torque(robots[1]) == [True, True]


def test_an_adapter_with_a_serial_number_is_found_in_another_socket(
    sockets: Sockets, robots: tuple[Server, Server]
) -> None:
    home = sockets.home(sockets.plug(robots[0], "ttyUSB0", "A1", "1-1"))
    sockets.pull("ttyUSB0")
    sockets.plug(robots[1], "ttyUSB0", "B2", "1-1")
    assert not sockets.released(home) and torque(robots[1]) == [True, True], "another one in its socket, by its name"
    sockets.plug(robots[0], "ttyUSB7", "A1", "2-4")
    assert sockets.released(home) and torque(robots[0]) == [False, False] and torque(robots[1]) == [True, True]


def test_of_adapters_without_a_number_those_that_came_since_are_asked_and_not_written_to_before(
    sockets: Sockets, robots: tuple[Server, Server], monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, neighbour = robots
    home = sockets.home(sockets.plug(ours, "ttyUSB0", None, "1-1"))
    sockets.plug(neighbour, "ttyUSB1", None, "1-2")
    home = sockets.home(home.path)
    sockets.pull("ttyUSB0")
    with served("bench") as stranger:
        heard: list[int] = []
        exchange = stranger.wire.exchange
        monkeypatch.setattr(
            stranger.wire,
            "exchange",
            lambda request, *rest: (heard.append(request.instruction), exchange(request, *rest))[1],
        )
        before = neighbour.wire.heard
        sockets.plug(stranger, "ttyUSB2", None, "1-3")
        assert not sockets.released(home) and set(heard) == {protocol.READ}, "it has no servo 2"
        sockets.plug(ours, "ttyUSB3", None, "1-4")
        assert sockets.released(home) and torque(ours) == [False, False]
        assert neighbour.wire.heard == before and set(heard) == {protocol.READ}, "nobody else was written to"


def test_two_adapters_that_could_be_ours_are_both_left_alone(sockets: Sockets, robots: tuple[Server, Server]) -> None:
    home = sockets.home(sockets.plug(robots[0], "ttyUSB0", None, "1-1"))
    sockets.pull("ttyUSB0")
    for k, server in enumerate(robots):
        sockets.plug(server, f"ttyUSB{k + 2}", None, f"1-{k + 2}")
    with pytest.raises(PortError, match="several that came since have servos 1, 2; unplug the others"):
        sockets.opening(home)()
    assert torque(robots[0]) == torque(robots[1]) == [True, True]


def test_equal_serial_numbers_are_none() -> None:
    ours, other = UsbAdapter("/dev/ttyUSB0", KIND, "0001", "1-1"), UsbAdapter("/dev/ttyUSB1", KIND, "0001", "1-2")
    home = Whereabouts("/dev/ttyUSB0", ours, (other,))
    assert home.now(lambda: home.others) == ([], False), "the other one is not ours"
    back = UsbAdapter("/dev/ttyUSB0", KIND, "0001", "1-3")
    assert home.now(lambda: [*home.others, back]) == (["/dev/ttyUSB0"], False)
    assert home.now(lambda: [UsbAdapter("/dev/ttyUSB4", KIND, "0001", "1-1")]) == (["/dev/ttyUSB4"], True)
    port = Whereabouts("/dev/ttyUSB0", UsbAdapter("/dev/ttyUSB0", "0403:6011:1.0", "0001", "1-1"))
    assert port.now(lambda: [UsbAdapter("/dev/ttyUSB1", "0403:6011:1.1", "0001", "1-1")])[0] == [], "its second port"


def test_a_link_is_followed_anew_where_the_system_knows_no_more(
    sockets: Sockets, robots: tuple[Server, Server]
) -> None:
    path = sockets.plug(robots[0], "servos")
    home = Whereabouts.of(path, list)
    sockets.plug(robots[1], "servos")
    with Opening(path, 1_000_000, "sts3215", 0.1, home, IDS, list)() as bus:
        assert bus.torque_off(IDS) == {}
    assert torque(robots[0]) == [True, True] and torque(robots[1]) == [False, False]


def test_who_watches_servos_knows_them_by_any_name_of_their_adapter() -> None:
    one = UsbAdapter("/dev/ttyUSB0", KIND, "A1", "1-1")
    marks = []
    for path in ("/dev/ttyUSB0", "/dev/serial/by-id/usb-A1", "/dev/ttyUSB1"):
        row = Charge(path, 1, "sts3215", 0.02, IDS, "hold", 1.0, os.getpid(), homes={"": Whereabouts(path, one)})
        assert Charge.read(row.written()) == row
        marks.append(claims(row)[""])
    for mark in marks:
        mark.claim()
    assert [mark.lost for mark in marks] == [True, True, False]


def test_the_name_that_lasts_is_told_to_who_gave_another(tmp_path: Path) -> None:
    device = tmp_path / "ttyUSB0"
    device.touch()
    for kind, name in (("by-id", "usb-FTDI_A1-if00"), ("by-path", "pci-1-1")):
        (tmp_path / kind).mkdir()
        (tmp_path / kind / name).symlink_to(device)

    def said(path: Path, serial: str | None) -> str:
        return advice(str(path), "port", lambda: [UsbAdapter(str(device), KIND, serial, "1-1")], tmp_path) or ""

    assert said(device, "A1").endswith(f"this adapter's is port={tmp_path}/by-id/usb-FTDI_A1-if00")
    assert said(device, None).endswith(f"this socket's is port={tmp_path}/by-path/pci-1-1")
    assert said(tmp_path / "by-id" / "usb-FTDI_A1-if00", "A1") == "" == said(tmp_path / "other", "A1")


def test_what_the_system_says_of_its_ports_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    from serial.tools import list_ports
    from serial.tools.list_ports_common import ListPortInfo

    two, none = ListPortInfo("/dev/ttyUSB3"), ListPortInfo("/dev/ttyS0")
    two.vid, two.pid, two.serial_number, two.location = 0x0403, 0x6011, "FT1", "1-4.2:1.1"
    monkeypatch.setattr(list_ports, "comports", lambda: [none, two])
    assert plugged() == [UsbAdapter("/dev/ttyUSB3", "0403:6011:1.1", "FT1", "1-4.2")]

    def vanished() -> Any:
        raise TypeError("int() argument must be a string, not 'NoneType'")

    monkeypatch.setattr(list_ports, "comports", vanished)
    assert plugged() == []


SYSTEM = """
import json, os
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

def comports():
    found = []
    for device, serial, location in json.load(open({file!r})):
        if os.path.exists(device):
            port = ListPortInfo(device)
            port.vid, port.pid, port.serial_number, port.location = 1, 2, serial, location
            found.append(port)
    return found

list_ports.comports = comports
"""
"""A module of the interpreter's start that stands for the system's list of adapters."""


@pytest.mark.long
@pytest.mark.parametrize("how", ["loop", "kill", "hold"])
def test_a_run_whose_adapter_comes_back_under_another_name_ends_released(how: str, tmp_path: Path) -> None:
    names = [tmp_path / "ttyUSB0", tmp_path / "ttyUSB1"]
    (tmp_path / "listed.json").write_text(json.dumps([[str(name), "A1", None] for name in names]))
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "sitecustomize.py").write_text(SYSTEM.format(file=str(tmp_path / "listed.json")))
    (tmp_path / "c.yaml").write_text(
        "robot: bench\njoints:\n  joint: {id: 1, zero: 2048, direction: 1, range: [-1.5, 1.5]}\n"
    )
    with VirtualBus(robot="bench", link=names[0]) as virtual:
        chosen = ["hw=feetech", f"port={names[0]}", "robot=bench", f"calibration={tmp_path / 'c.yaml'}", "name=run"]
        chosen += ["robot.safety.late=1.0", "robot.safety.following_error=9", "patience=60", f"out={tmp_path}"]
        chosen += [f"excitation={excitation(tmp_path / 'sine.csv')}", f"rest={'hold' if how == 'hold' else 'release'}"]
        process = subprocess.Popen(
            [sys.executable, "deploy.py", *PATIENT, *chosen],
            cwd=REPOSITORY, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": str(tmp_path / "site")},
        )  # fmt: skip
        log = tmp_path / "run.csv"
        wait_until(lambda: log.is_file() and len(log.read_bytes().splitlines()) > 30, process)
        if how != "loop":
            os.kill(process.pid, signal.SIGSTOP)
        virtual.fault("unplug", seconds=0.6, name=str(names[1]))
        if how != "loop":
            os.kill(process.pid, signal.SIGKILL)
        _, errors = process.communicate(timeout=120.0)
        assert not names[0].is_symlink() and names[1].is_symlink()
        if how == "hold":
            wait_until(lambda: read_events(log)[-1]["event"] == "at rest")
            (release,) = re.findall(r"`(kill \d+)` releases them", errors)
            subprocess.run(release, shell=True, check=True)
        wait_until(lambda: not virtual.status()["servos"]["1"]["torque"])
        assert "TORQUE MAY BE ON" in errors
        if how == "loop":
            assert process.returncode == 2 and "the servos are released" in errors.strip().splitlines()[-1], errors


# --- sensors and further adapters of a robot's file: one loop for all, and a fault on one adapter releases all -------

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
