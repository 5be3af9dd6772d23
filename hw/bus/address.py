"""Who a servo is on a robot with several buses: its id there, and the bus."""

from __future__ import annotations

from collections.abc import Iterable

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
