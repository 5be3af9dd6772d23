"""The protocol that control loop, supervisor and tools need of servos, of any make and on any number of buses."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, MutableMapping, Sequence
from typing import Protocol

import numpy as np

from .clock import Clock
from .packets import BusError
from .registers import ServoModel
from .servo_state import ServoState

LINE = 256  # more than there are ids on a bus


class Address(int):
    """A servo on one of several buses: a number that no other servo has, and that reads as ``arm:1``.

    Servos on the first bus are plain ids.

    Attributes:
        bus: name of its bus.
        id: there.
    """

    bus: str
    id: int

    def __new__(cls, line: int, bus: str, id: int) -> Address:
        """The servo ``id`` on bus number ``line`` (from 1), which is called ``bus``."""
        address = super().__new__(cls, LINE * line + id)
        address.bus, address.id = bus, id
        return address

    def __str__(self) -> str:
        return f"{self.bus}:{self.id}"

    __repr__ = __str__


def local(servo: int) -> int:
    """Its id on its own bus."""
    return servo.id if isinstance(servo, Address) else servo


def named(servos: Iterable[int]) -> list[int | str]:
    """Servos as a log names them."""
    return [str(servo) if isinstance(servo, Address) else servo for servo in servos]


Pace = float | Sequence[float] | np.ndarray | None
"""A limit of a move: of all servos or of each (n,); None: the register keeps its value."""
Failing = Callable[[Sequence[int], BusError], None]
"""Told which servos could not be brought to rest, and why."""


class Adapter(Protocol):
    """One adapter, as far as its speed is measured."""

    port: str
    model: ServoModel

    @property
    def clock(self) -> Clock:
        """That its replies are waited for by."""
        ...

    def read_state(self, ids: Sequence[int], retries: int | None = None, whole: bool = False) -> ServoState:
        """One reading."""
        ...


class Bus(Protocol):
    """Servos by their ids, in SI units; one bus, or several as one.

    Failures are :class:`~sealegs.hw.bus.packets.BusError`. A protocol is a :class:`~sealegs.hw.bus.dialects.Dialect`
    (how packets are framed) and a table of registers (what they mean); :class:`~sealegs.hw.bus.servo_bus.ServoBus` puts
    both together, :class:`~sealegs.hw.bus.buses.BusGroup` several of them.

    Attributes:
        port: path, or paths.
    """

    port: str

    @property
    def threads(self) -> Sequence[int]:
        """Threads beside the caller's that read the servos, as the system numbers them."""
        ...

    @property
    def clock(self) -> Clock:
        """That replies are waited for by."""
        ...

    @property
    def counts(self) -> Mapping[str, int]:
        """Failures so far by the name of their class."""
        ...

    @property
    def marks(self) -> Mapping[int, int | None]:
        """What each servo got with its torque in the register that tells a restart."""
        ...

    def adapters(self, ids: Sequence[int]) -> Sequence[tuple[Adapter, list[int]]]:
        """Each adapter, and the ids there of the servos among ``ids``."""
        ...

    def check(self, ids: Sequence[int], turning: Collection[int] = ()) -> None:
        """Make sure that servos are there and set up; those of ``turning`` are told speeds."""
        ...

    def ping(self, servo: int) -> int:
        """Model number of a servo."""
        ...

    def read_state(self, ids: Sequence[int], retries: int | None = None, whole: bool = False) -> ServoState:
        """One reading of all servos."""
        ...

    def read_cycle(self, ids: Sequence[int], whole: bool = False, until: float | None = None) -> ServoState:
        """One reading within a control cycle."""
        ...

    def write_goals(
        self,
        ids: Sequence[int],
        position: Sequence[float] | np.ndarray,
        velocity: Pace = None,
        acceleration: Pace = None,
    ) -> float:
        """Send goals [rad], or [rad/s] of servos that are told speeds; clock behind it [s]."""
        ...

    def torque_on(self, ids: Sequence[int], wanted: Callable[[], bool] = ...) -> bool:
        """Switch torque on where each servo stands, as long as it is ``wanted``; whether it is on."""
        ...

    def hold(self, ids: Sequence[int]) -> None:
        """Make each servo's position its goal."""
        ...

    def torque_off(self, ids: Sequence[int], failing: Failing | None = None) -> Mapping[int, BusError]:
        """Switch torque off on every servo that can be reached; why, for each that cannot. Never raises."""
        ...

    def read_register(self, servo: int, name: str) -> int:
        """A register's count."""
        ...

    def write_register(self, servo: int, name: str, count: int) -> None:
        """Write a register, and make sure that it arrived."""
        ...

    def identity(self, servo: int) -> MutableMapping[str, int]:
        """Every register of a servo but its readings."""
        ...

    def close(self) -> None:
        """Close the ports. Torque stays as it is."""
        ...
