"""Who is on a bus of servos, and what their registers hold."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress

from .dialects import PING, READ, REBOOT, WRITE
from .packets import (
    ConfigurationError,
    CorruptReplyError,
    NoReplyError,
    NotWrittenError,
    RegisterError,
    ReplyError,
)
from .registers import Register, ServoModel
from .transactions import Transactions


class ServoMemory:
    """Servos of one model, one at a time.

    Attributes:
        line: transactions on the port.
        model: register table in use.
    """

    def __init__(self, line: Transactions, model: ServoModel) -> None:
        self.line, self.model = line, model

    # --- who is there ------------------------------------------------------------------------------------------

    def ping(self, servo: int) -> int:
        """Model number of a servo.

        Raises:
            ReplyError: it does not answer.
        """
        self.line.retry(lambda: self.line.transact([servo], PING, [], self.line.dialect.ping_data))
        return self.read_register(servo, "model_number")

    def scan(self, ids: Iterable[int] | None = None) -> dict[int, int]:
        """Model number by id of the servos that answer; each id without a servo costs one timeout.

        Args:
            ids: to try; None: all that a servo can have.

        Raises:
            CorruptReplyError: an id answers, but never cleanly; two servos may share it.
        """
        found = {}
        for servo in range(self.model["id"].high + 1) if ids is None else ids:
            try:
                self._find(servo)
            except NoReplyError:
                self.line.expect_nothing_more()
                continue
            found[servo] = self.read_register(servo, "model_number")
        return found

    def _find(self, servo: int) -> None:
        for left in range(self.line.retries, -1, -1):
            try:
                self.line.transact([servo], PING, [], self.line.dialect.ping_data)
                return
            except NoReplyError:
                raise
            except ReplyError:
                if not left:
                    raise CorruptReplyError(
                        f"id {servo} on {self.line.path} answers with broken packets; if two servos have this id, "
                        "connect them one at a time and give one another id.",
                        [servo],
                    ) from None

    # --- registers ---------------------------------------------------------------------------------------------

    def read_register(self, servo: int, name: str) -> int:
        """A register's count, with its sign.

        Raises:
            RegisterError: there is no such register.
            ReplyError: no usable answer after the last try.
        """
        register = self.model[name]
        data = self._read(servo, register.address, register.bytes)
        return register.read(data, register.address)

    def read_value(self, servo: int, name: str) -> float:
        """A register's value in its unit."""
        return self.read_register(servo, name) * self.model[name].scale

    def read_role(self, servo: int, role: str, otherwise: int = 0) -> int:
        """The count of the register that has a role; ``otherwise`` where the servo has none."""
        name = self.model.role(role)
        return otherwise if name is None else self.read_register(servo, name)

    def identity(self, servo: int) -> dict[str, int]:
        """Every register of a servo but its readings, by name: what a log keeps of the firmware and its settings."""
        readings = {*self.model.readings.values(), "velocity_trajectory", "realtime_tick"} - {"status", "moving"}
        names = [name for name in self.model.registers if name not in readings]
        data: dict[int, int] = {}
        for start in range(0, self.model.size(), 48):
            length = min(48, self.model.size() - start)
            reply = self._read(servo, start, length)
            data.update(enumerate(reply, start))
        memory = [data[at] for at in range(self.model.size())]
        return {name: self.model[name].read(memory) for name in names}

    def write_register(self, servo: int, name: str, count: int) -> None:
        """Write a register, and make sure that it arrived. What belongs to the EEPROM is unlocked, and locked again.

        Raises:
            RegisterError: there is no such register, it is read-only, or cannot take the count.
            RefusedError: the servo does not take it, such as a register of the EEPROM while torque is on.
            NotWrittenError: it reads back otherwise.
            ReplyError: no usable answer after the last try.
        """
        register = self.model[name]
        if register.area == "read":
            raise RegisterError(f"register '{name}' is read-only.", [servo])
        if name in ("id", "baud_rate"):
            raise RegisterError(
                f"register '{name}' changes how the servo is reached; "
                f"{'use change_id' if name == 'id' else 'change it with the tool of the manufacturer'}.",
                [servo],
            )
        data = register.to_bytes(count)
        with self.line.lock:
            if register.area != "eeprom":
                self._write_checked(servo, register, data, count)
                return
            self._unlocked(servo, lambda: self._write_checked(servo, register, data, count))

    def change_id(self, servo: int, new: int) -> None:
        """Give a servo another id.

        Raises:
            ConfigurationError: another servo has the new id.
            RegisterError: the id is outside 0..253.
            NotWrittenError: it does not answer under the new id.
        """
        data = self.model["id"].to_bytes(new)
        with self.line.lock:
            self.ping(servo)
            if new in self.scan([new]):
                raise ConfigurationError(f"id {new} is taken by another servo; choose a free one.", [servo, new])
            lock = self.model.role("lock")
            if lock is not None:
                self._put(servo, self.model[lock], b"\0")
            with suppress(ReplyError):  # documents do not say under which id it acknowledges
                self.line.transact([servo], WRITE, [*self.line.dialect.place(self.model["id"].address), *data], 0)
            if new not in self.scan([new]):
                raise NotWrittenError(f"servo {servo} does not answer as {new}; scan the bus.", [servo])
            if lock is not None:
                self._put(new, self.model[lock], b"\1")

    def reboot(self, servo: int) -> None:
        """Restart a servo: its torque goes off, its faults are forgotten. It is silent for a moment.

        Raises:
            BusError: the port failed.
        """
        with suppress(ReplyError):  # who restarts may not answer
            self.line.transact([servo], REBOOT, [], 0)

    def _unlocked(self, servo: int, write: Callable[[], None]) -> None:
        name = self.model.role("lock")
        if name is None:
            write()
            return
        lock = self.model[name]
        self._put(servo, lock, b"\0")
        try:
            write()
        finally:
            self._put(servo, lock, b"\1")

    def _write_checked(self, servo: int, register: Register, data: bytes, count: int) -> None:
        def write() -> None:
            self._put(servo, register, data)
            if register.name == "torque_enable" and count == 128:
                return  # an order, not a value
            if (found := self.read_register(servo, register.name)) != count:
                raise NotWrittenError(
                    f"servo {servo} has {found} in register '{register.name}' after {count} was written; try again.",
                    [servo],
                )

        self._repeat_unwritten(write)

    def _repeat_unwritten(self, write: Callable[[], None]) -> None:
        for left in range(self.line.retries, -1, -1):
            try:
                return write()
            except NotWrittenError as error:
                self.line.note(error)
                if not left:
                    raise

    def _put(self, servo: int, register: Register, data: bytes) -> None:
        try:
            place = self.line.dialect.place(register.address)
            self.line.retry(lambda: self.line.transact([servo], WRITE, [*place, *data], 0))
        except NoReplyError:  # the acknowledgement may be lost, or switched off (response_level 0)
            if bytes(self._read(servo, register.address, register.bytes)) != data:
                raise

    def _read(self, servo: int, address: int, length: int) -> list[int]:
        def read() -> list[int]:
            asked = self.line.no_late_length(length)
            start = max(min(address, self.model.size() - asked), 0)  # more bytes, but none behind the table's end
            data = self.line.transact([servo], READ, self.line.dialect.block(start, asked), asked)[servo]
            return data[address - start :][:length]

        return self.line.retry(read)
