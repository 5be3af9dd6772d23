"""What a bus of servos can do wrong, each under its own name; and the bits of a servo's status byte.

Every message is one sentence that says what is wrong, on which servo or port, and what to do.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from enum import IntFlag

from ...common.errors import SealegsError


class BusError(SealegsError):
    """Something that went wrong between host and servos.

    Attributes:
        servos: ids concerned; empty where it is the whole bus.
    """

    def __init__(self, message: str, servos: Iterable[int] = ()) -> None:
        super().__init__(message)
        self.servos = tuple(servos)


class RegisterError(BusError):
    """A register that the servo does not have, or that cannot take the value."""


# --- the port ------------------------------------------------------------------------------------------------------


class PortError(BusError):
    """The port cannot be opened or set up."""


class PortBusyError(PortError):
    """Another program has the port."""


class UnpluggedError(PortError):
    """The adapter is gone: unplugged, or its driver gave up."""


class ClosedError(PortError):
    """The bus was closed before."""


class StalledError(PortError):
    """The adapter takes no more bytes."""


# --- replies -------------------------------------------------------------------------------------------------------


class ReplyError(BusError):
    """A transaction without a usable answer; another try may succeed.

    Attributes:
        replies: data bytes of the servos whose replies came all the same, by id.
    """

    replies: Mapping[int, list[int]] = {}


class NoReplyError(ReplyError):
    """No byte came from a servo within the timeout."""


class CorruptReplyError(ReplyError):
    """A packet with a wrong checksum, to the host or by its own word to a servo: noise, or two servos with one id."""


class ShortReplyError(ReplyError):
    """A sound packet of another length than was asked for: the answer to some other question."""


class StaleReplyError(ReplyError):
    """Replies came after their time; what was read meanwhile may answer an older question."""


# --- servos --------------------------------------------------------------------------------------------------------


class WrongModelError(BusError):
    """A servo is of another model than the register table in use."""


class ConfigurationError(BusError):
    """A servo's registers are set so that the host cannot work with it."""


class NotWrittenError(BusError):
    """A register reads back other than it was written."""


class RefusedError(BusError):
    """A servo did not do what was asked, and said why."""


class ServoFaultError(BusError):
    """A servo reports a fault of its own in its status byte."""


class VoltageFault(ServoFaultError):
    """Supply voltage below or above the limits in the servo: flat battery, thin wires, wrong supply."""


class EncoderFault(ServoFaultError):
    """The servo cannot read its position sensor."""


class OverheatFault(ServoFaultError):
    """The servo is hotter than its limit."""


class OvercurrentFault(ServoFaultError):
    """The motor current was above its limit for too long."""


class OverloadFault(ServoFaultError):
    """The servo pushed with nearly all its torque for too long and limits itself until its torque is switched off."""


class ElectricalFault(ServoFaultError):
    """The circuit had a shock, or too little power for its motor."""


class Status(IntFlag):
    """Faults of servos, as states and logs have them; they say how a servo is, not what became of a request.

    These are the bits of Feetech's register 65 and of the error byte of its replies.
    """

    VOLTAGE = 1
    ENCODER = 2
    OVERHEAT = 4
    OVERCURRENT = 8
    ELECTRICAL = 16
    OVERLOAD = 32


HARDWARE_ERRORS = {
    1: Status.VOLTAGE,
    4: Status.OVERHEAT,
    8: Status.ENCODER,
    16: Status.ELECTRICAL,
    32: Status.OVERLOAD,
}
"""Bits of Dynamixel's register Hardware Error Status."""


def status_of(hardware_error: int) -> int:
    """The faults in a Dynamixel's Hardware Error Status, as bits of :class:`Status`."""
    return sum(int(bit) for number, bit in HARDWARE_ERRORS.items() if hardware_error & number)


FAULTS: dict[Status, tuple[type[ServoFaultError], str]] = {
    Status.VOLTAGE: (VoltageFault, "has a supply voltage outside its limits; check battery, supply and wires"),
    Status.ENCODER: (EncoderFault, "cannot read its position sensor; replace the servo"),
    Status.OVERHEAT: (OverheatFault, "is hotter than its limit; switch its torque off and let it cool"),
    Status.OVERCURRENT: (OvercurrentFault, "drew more current than its limit for too long; find out what blocks it"),
    Status.OVERLOAD: (
        OverloadFault,
        "is overloaded and limits its torque; find out what blocks it, then switch its torque off for 0.3 s",
    ),
    Status.ELECTRICAL: (ElectricalFault, "had an electrical shock or too little power; check supply and wires"),
}
REBOOT = "; it gives no torque until it is restarted (sealegs scan id={0} reboot=true)"


def faults(servos: Sequence[int], status: Sequence[int], latched: Sequence[int] = ()) -> list[ServoFaultError]:
    """The faults that servos report, an exception each, not raised.

    Args:
        servos: ids (n,).
        status: their status bytes (n,).
        latched: ids of the servos that only a restart frees from a fault.
    """
    found = []
    for servo, byte in zip(servos, status, strict=True):
        for bit, (kind, text) in FAULTS.items():
            if int(byte) & bit:
                if servo in latched:
                    text = f"{text.partition(', then')[0]}{REBOOT.format(servo)}"
                found.append(kind(f"servo {servo} {text}.", [servo]))
    return found


def in_words(ids: Sequence[int]) -> str:
    """Servos as they stand in a sentence."""
    return f"servo {ids[0]}" if len(ids) == 1 else f"servos {', '.join(map(str, ids))}"
