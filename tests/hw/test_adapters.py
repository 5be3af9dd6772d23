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

import pytest
from sealegs.hw.bus.adapters import UsbAdapter, Whereabouts, advice, plugged
from sealegs.hw.bus.packets import PortError
from sealegs.hw.bus.port import BusPort
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.guard.hold_watch import claims
from sealegs.hw.guard.supervisor import Charge, Line, Opening
from sealegs.hw.guard.take_over import Aftermath, bring_all_to_rest
from sealegs.hw.run.measured_log import read_events
from sealegs.hw.virtual import VirtualBus, protocol
from sealegs.hw.virtual.server import Server

from tests.served_bus import served
from tests.servo_runs import PATIENT, REPOSITORY, excitation
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
