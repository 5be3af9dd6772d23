"""Ways to frame packets on the line, by the name of the protocol."""

from __future__ import annotations

from ..packets import RegisterError
from .dialect import BROADCAST, READ, REBOOT, SYNC_READ, SYNC_WRITE, WRITE, Dialect, Reply

__all__ = ["BROADCAST", "READ", "REBOOT", "SYNC_READ", "SYNC_WRITE", "WRITE", "Dialect", "Reply", "dialect_of"]


def dialect_of(protocol: str) -> Dialect:
    """The dialect of a protocol.

    Raises:
        RegisterError: there is none of that name.
        SealegsError: its SDK is not installed.
    """
    if protocol == "feetech":
        from .feetech import FeetechDialect

        return FeetechDialect()
    if protocol == "dynamixel":
        from .dynamixel import DynamixelDialect

        return DynamixelDialect()
    raise RegisterError(f"there is no protocol '{protocol}'; a register table names feetech or dynamixel.")
