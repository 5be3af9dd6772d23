"""Which adapter is which: the name of a port may change while it is in use; a serial number and a socket do not.

An adapter that was away may come back as /dev/ttyUSB1, and another one as /dev/ttyUSB0. It is known by its serial
number, or by the socket that it is plugged into. One that has neither is looked for among those of its kind that have
come since, and is not written to before its servos have answered.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from serial.tools import list_ports

LINKS = Path("/dev/serial")
"""Where Linux keeps names of ports that last: ``by-id`` and ``by-path``."""


@dataclass(frozen=True)
class UsbAdapter:
    """One that is plugged in, as the system describes it.

    Attributes:
        device: path of its port.
        kind: numbers of its maker and model, and which of several ports it is.
        serial: its serial number; None: it has none.
        location: the socket; None: the system does not say.
    """

    device: str
    kind: str
    serial: str | None = None
    location: str | None = None

    def like(self, other: UsbAdapter) -> bool:
        """Whether kind and serial number are the same."""
        return (self.kind, self.serial) == (other.kind, other.serial)

    @property
    def place(self) -> str:
        """Its socket; the name of its port where the system does not say."""
        return self.location or self.device


Listing = Callable[[], Iterable[UsbAdapter]]


def plugged() -> list[UsbAdapter]:
    """The USB adapters that the system knows at the moment."""
    found: list[UsbAdapter] = []
    try:
        for port in list_ports.comports():
            if port.vid is not None:
                socket, _, which = (port.location or "").partition(":")
                kind = f"{port.vid:04x}:{port.pid or 0:04x}:{which}"
                found.append(UsbAdapter(port.device, kind, port.serial_number or None, socket or None))
    except (OSError, TypeError, ValueError):  # one that went away while it was looked at
        pass
    return found


@dataclass(frozen=True)
class Whereabouts:
    """Where an adapter was as its servos were found, and what else was plugged in.

    Attributes:
        path: as a person named it.
        adapter: as the system described it; None: the system does not know it, and its path is all there is.
        others: that were there.
    """

    path: str
    adapter: UsbAdapter | None = None
    others: tuple[UsbAdapter, ...] = ()

    @classmethod
    def of(cls, path: str, listed: Listing = plugged) -> Whereabouts:
        """Of the adapter that has this path now."""
        there, device = list(listed()), os.path.realpath(path)
        own = next((one for one in there if os.path.realpath(one.device) == device), None)
        return cls(path, own, tuple(one for one in there if one is not own))

    @classmethod
    def read(cls, row: Mapping[str, Any]) -> Whereabouts:
        """From its mapping."""
        own = row["adapter"] and UsbAdapter(**row["adapter"])
        return cls(row["path"], own, tuple(UsbAdapter(**other) for other in row["others"]))

    @property
    def name(self) -> str:
        """The same for every path of one adapter."""
        one = self.adapter
        if one is None or (one.serial or one.location) is None:
            return os.path.abspath(self.path)
        return f"{one.kind} {one.serial or one.location}"

    def now(self, listed: Listing = plugged) -> tuple[list[str], bool]:
        """Paths of the ports that may be the adapter's now, and whether there is no doubt."""
        own = self.adapter
        if own is None:
            return [self.path], True
        there = list(listed())
        if not there:  # none is left, or the system has ceased to tell
            return [self.path], False
        alike = [one for one in there if one.like(own)]
        here = [one for one in alike if one.place == own.place]
        twins = {one.place for one in self.others if one.like(own)}
        new = [one for one in alike if one.place not in twins]
        found, sure = (here, True) if here else (new, own.serial is not None and not twins and len(new) == 1)
        return [self._path_of(one) for one in found], sure

    def _path_of(self, found: UsbAdapter) -> str:
        same = os.path.realpath(self.path) == os.path.realpath(found.device)
        return self.path if same else found.device


def lasting_name(path: str, listed: Listing = plugged, folder: Path = LINKS) -> str | None:
    """A path that stays with an adapter, or else with its socket; None: ``path`` does, or there is none."""
    device = os.path.realpath(path)
    own = Whereabouts.of(path, listed).adapter
    if own is None or os.path.islink(path):
        return None
    links = sorted((folder / ("by-path" if own.serial is None else "by-id")).glob("*"))
    return next((str(link) for link in links if os.path.realpath(link) == device), None)


def advice(path: str, key: str = "port", listed: Listing = plugged, folder: Path = LINKS) -> str | None:
    """A sentence on a port's lasting name where a person gave another; ``key``: of the command line."""
    name = lasting_name(path, listed, folder)
    if name is None:
        return None
    what = "adapter" if "by-id" in name else "socket"
    return f"{path} may be another adapter's name after the next plugging in; this {what}'s is {key}={name}"
