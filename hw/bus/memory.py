"""Who is on a bus of servos, and what their registers hold."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress

from .dialects import READ, REBOOT, WRITE
from .packets import (
    BusError,
    ConfigurationError,
    CorruptReplyError,
    NoReplyError,
    NotWrittenError,
    RegisterError,
    ReplyError,
    WrongModelError,
)
from .registers import Register, ServoModel
from .transactions import Transactions

RESTART = 3.0  # [s] within which a servo answers after a restart; Feetech's take 0.8 s
PAUSE = 0.1  # [s] between two tries to reach it


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
        return self.read_register(servo, "model_number")  # a PING with its echo would pass for the reply to it

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
                found[servo] = self._find(servo)
            except NoReplyError:
                self.line.expect_nothing_more()
        return found

    def _find(self, servo: int) -> int:
        """Model number of a servo that answers at the first try, or cannot be understood."""
        register = self.model["model_number"]
        for left in range(self.line.retries, -1, -1):
            try:
                return register.read(self._ask(servo, register.address, register.bytes), register.address)
            except NoReplyError:
                raise
            except ReplyError:
                if not left:
                    raise CorruptReplyError(
                        f"id {servo} on {self.line.path} answers with broken packets; if two servos have this id, "
                        "connect them one at a time and give one another id.",
                        [servo],
                    ) from None
        raise AssertionError("unreachable")

    def unfit(self, servo: int, *, goals: bool = True, turning: bool = False) -> Iterator[BusError]:
        """What is set up so that the host cannot work with a servo: what a run refuses, and what a scan tells.

        Args:
            servo: id.
            goals: whether it gets goals; False: it only measures.
            turning: whether its goals are speeds: of a wheel.

        Raises:
            ReplyError: it does not answer.
        """
        model, mode = self.model, self.model.speed_mode if turning else None
        if turning and mode is None:
            yield ConfigurationError(
                f"servo {servo} is to turn a wheel, and a {model.name} has no mode for speeds.", [servo]
            )
            return
        if (number := self.ping(servo)) != model.model_number:
            yield WrongModelError(
                f"servo {servo} reports model number {number}, but a {model.name} has {model.model_number}; give the "
                "right servo model.",
                [servo],
            )
            return
        for needed in model.requires:
            if needed.goals and not goals:
                continue
            count = self.read_register(servo, needed.register)
            if mode is not None and needed.register == mode.register:
                if count != mode.value:
                    mend = model.setting(servo, {mode.register: mode.value}, self.line.path)
                    yield ConfigurationError(
                        f"servo {servo} has {count} in register '{mode.register}', and turns a wheel; write "
                        f"{mode.value}, velocity mode ({mend}).",
                        [servo],
                    )
                continue
            other = None if needed.above is None else self.read_register(servo, needed.above)
            if not needed.met(count, other):
                mend = model.setting(servo, needed.mended(count, model), self.line.path)
                yield ConfigurationError(
                    f"servo {servo} has {count} in register '{needed.register}'; {needed.remedy} ({mend}).", [servo]
                )

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
            NotWrittenError: it reads back otherwise, or the servo would forget it without power; then nothing is
                written.
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
            self._unlocked(servo, f"{name} {count}", lambda: self._write_checked(servo, register, data, count))

    def change_id(self, servo: int, new: int) -> None:
        """Give a servo another id.

        Raises:
            ConfigurationError: another servo has the new id.
            RegisterError: the id is outside 0..253.
            NotWrittenError: it does not answer under the new id, or would forget it without power.
        """
        data = self.model["id"].to_bytes(new)
        with self.line.lock:
            self.ping(servo)
            if new in self.scan([new]):
                raise ConfigurationError(f"id {new} is taken by another servo; choose a free one.", [servo, new])
            lock = self._unlock(servo, "its id")
            with suppress(ReplyError):  # documents do not say under which id it acknowledges
                self.line.transact([servo], WRITE, [*self.line.dialect.place(self.model["id"].address), *data], 0)
            if new not in self.scan([new]):
                raise NotWrittenError(f"servo {servo} does not answer as {new}; scan the bus.", [servo])
            if lock is not None:
                self._put(new, lock, b"\1")

    def restarted(self, servo: int, ids: Sequence[int] = ()) -> int | None:
        """Restart a servo without torque whose lock register tells whether it did, and wait until it answers.

        Args:
            servo: id.
            ids: under which it may answer afterwards; its own beside them.

        Returns:
            The id that it has now; None: it did not restart, or has no lock register or its torque is on.

        Raises:
            ReplyError: it does not answer any more.
        """
        with self.line.lock:
            name = self.model.role("lock")
            if name is None or self.read_register(servo, "torque_enable"):
                return None
            lock = self.model[name]
            self._put(servo, lock, b"\0")  # which a restart makes 1
            self.reboot(servo)
            port, end = self.line.port, self.line.port.now() + RESTART
            while True:
                port.sleep(PAUSE)
                found = [id for id in (servo, *ids) if id in self.scan([id])]
                if found:
                    break
                if port.now() > end:
                    raise NoReplyError(
                        f"servo {servo} does not answer {RESTART:g} s after its restart; switch its power off and on, "
                        "and scan the bus.",
                        [servo],
                    )
            if self.read_register(found[0], name) == 0:
                self._put(found[0], lock, b"\1")
                return None
            return found[0]

    def reboot(self, servo: int) -> None:
        """Restart a servo: its torque goes off, its faults are forgotten. It is silent for a moment.

        Raises:
            BusError: the port failed.
        """
        with suppress(ReplyError):  # who restarts may not answer
            self.line.transact([servo], REBOOT, [], 0)

    def _unlock(self, servo: int, what: str) -> Register | None:
        """Let writes to the EEPROM persist: the lock register, which is to be closed again; None: there is none.

        Raises:
            NotWrittenError: it stays locked, so that ``what`` would be forgotten without power.
        """
        name = self.model.role("lock")
        if name is None:
            return None
        lock = self.model[name]
        self._put(servo, lock, b"\0")
        if self.read_register(servo, name) != 0:
            raise NotWrittenError(
                f"servo {servo} keeps its register '{name}' at 1, so it would forget {what} when its power goes off; "
                "nothing is written: switch its power off and on and try again, or use the tool of the manufacturer.",
                [servo],
            )
        return lock

    def _unlocked(self, servo: int, what: str, write: Callable[[], None]) -> None:
        lock = self._unlock(servo, what)
        try:
            write()
        finally:
            if lock is not None:
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
        return self.line.retry(lambda: self._ask(servo, address, length))

    def _ask(self, servo: int, address: int, length: int) -> list[int]:
        asked = self.line.no_late_length(length)
        start = max(min(address, self.model.size() - asked), 0)  # more bytes, but none behind the table's end
        data = self.line.transact([servo], READ, self.line.dialect.block(start, asked), asked)[servo]
        return data[address - start :][:length]
