"""Servos that are held after a run: looked at now and then, released where one reports a fault, and never forgotten."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
import uuid
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...common.atomic import write_text
from ..bus.adapters import Whereabouts
from ..bus.packets import PortBusyError, PortError
from ..bus.servo_bus import ServoBus
from ..bus.servo_state import ServoState
from .supervisor import Bearable, Charge, Line
from .take_over import Aftermath, sentence

LOOK = 0.5  # [s] between two looks
SOON = 0.05  # [s] between two tries to release
LONGEST = 0.08  # [s] that a look may keep the port from other programs, which wait a little longer for it
SILENT = 2.0  # [s] without an answer, and
ASKED = 3  # times in a row, after which a servo is named


@dataclass
class Held:
    """One servo that is held.

    Attributes:
        servo: its id on its bus.
        name: as the host addresses it.
        since: when it was first asked in vain [s]; None: it answers.
        failed: how often in a row.
        torque: as it was read last; None: never.
        off: in how many looks in a row it had no torque.
        named: whether a person was told that it is silent, or has lost its torque.
        strained: since when its current has been beyond what it may bear [s]; None: it is not.
    """

    servo: int
    name: str
    since: float | None = None
    failed: int = 0
    torque: bool | None = None
    off: int = 0
    named: bool = False
    strained: float | None = None


class HoldWatch:
    """Looks at held servos until their torque is off, or a later run has them in its charge."""

    def __init__(
        self,
        lines: Sequence[Line],
        after: Aftermath,
        claims: Mapping[str, InCharge] | None = None,
        bearable: Bearable | None = None,
    ) -> None:
        """Watch.

        Args:
            lines: with the servos.
            after: how to tell.
            claims: of this process on them, by name of the bus; None: nobody else can have any.
            bearable: beyond which all are released; None: at faults that a servo reports only.
        """
        self._claims, self._bearable = claims or {}, bearable
        self._lines = [(line, [Held(servo, line.named([servo])[0]) for servo in line.ids]) for line in lines]
        self._after = after
        self._why: str | None = None  # they are to be released
        self._released: set[str] = set()
        self._unreleased: list[str] = []
        self._busy = False

    def watch(self) -> None:
        """Look until nothing is held any more, a person ends it, or a virtual machine has ended."""
        while not self.look():
            self._after.clock.sleep(LOOK if self._why is None else SOON)

    def look(self) -> bool:
        """Ask the servos, or release them where that is due; whether the watch is over."""
        if self._taken_over():
            return True
        if self._why is None and self._after.asked():
            self._why = f"process {self._after.pid}, which watched them, was asked to end."
        if self._why is None and self._after.pressed():
            self._why = "the emergency stop was pressed."
        if self._why is None and self._ask_all():
            return True
        return self._why is not None and self._release()

    def _taken_over(self) -> bool:
        """Leave to a later run what is its own; whether nothing is left."""
        taken = [line.name for line, _ in self._lines if line.name in self._claims and self._claims[line.name].lost]
        for line, held in self._lines:
            if line.name in taken:
                self._after.note("watched by a later run", by="supervisor", servos=[one.name for one in held])
        self._lines = [(line, held) for line, held in self._lines if line.name not in taken]
        return not self._lines

    # --- watching ----------------------------------------------------------------------------------------------

    def _ask_all(self) -> bool:
        gone = 0
        for line, held in self._lines:
            try:
                with line.opening() as bus:
                    self._busy = False
                    for one in self._in_turn(bus, held):
                        self._ask(bus, one)
            except PortBusyError as error:  # whoever has the port is in charge of its servos
                if not self._busy:
                    self._after.note("not watched", reason=str(error))
                self._busy = True
            except Exception as error:  # whatever it is: the next look may be better
                gone += isinstance(error, PortError)
                for one in held:
                    self._silent(one, error)
        if gone == len(self._lines) and not self._after.lasting:
            self._after.note("gone", by="supervisor", reason="the virtual machine has ended")
            self._after.say("The virtual machine has ended with its run, and with it the servos that were held.")
            return True
        everyone = [one for _, held in self._lines for one in held]
        if all(one.torque is False for one in everyone):
            self._after.note("torque off", by="somebody else")
            return True
        for one in everyone:
            if one.off == 2:  # one look may have come into the middle of somebody's release
                line = f"servo {one.name} was held and has lost its torque; the others are held on."
                self._tell("torque lost", one, line)
                one.off += 1
        return False

    def _in_turn(self, bus: ServoBus, held: list[Held]) -> Iterator[Held]:
        """Each servo, as far as there is time; the next look begins with those that were left out."""
        begun = bus.clock.now()
        for _ in range(len(held)):
            if bus.clock.now() - begun > LONGEST or self._after.pressed():
                return
            held.append(held.pop(0))
            yield held[-1]

    def _ask(self, bus: ServoBus, one: Held) -> None:
        try:
            state = bus.read_state([one.servo], retries=0, whole=True)
        except PortError:
            raise
        except Exception as error:  # a servo that is silent keeps no other one from being watched
            self._silent(one, error)
            return
        torque = torque_of(state)
        if torque is None:
            return
        if one.since is not None and one.named:
            self._tell("watched again", one, f"servo {one.name} answers again.")
            one.named = False
        one.since, one.failed = None, 0
        one.torque, one.off = torque, 0 if torque else one.off + 1
        if (fault := next(iter(state.faults()), None)) is not None:
            self._why = str(fault)
        elif (strain := self._strain(one, state)) is not None:
            self._why = f"servo {one.name} {strain}"

    def _strain(self, one: Held, state: ServoState) -> str | None:
        """What the servo may not bear for long, if anything."""
        if (most := self._bearable) is None:
            return None
        temperature, current = float(state.temperature[0]), abs(float(state.current[0]))
        one.strained = None if current <= most.current else state.after if one.strained is None else one.strained
        if temperature > most.temperature:
            return f"is at {temperature:.0f} degC; its limit is {most.temperature:g} degC."
        if one.strained is not None and (lasted := state.after - one.strained) > most.current_time:
            return f"drew more than {most.current:g} A for {lasted:.1f} s; {most.current_time:g} s are tolerated."
        return None

    def _silent(self, one: Held, error: Exception) -> None:
        now = self._after.clock.now()
        one.since = now if one.since is None else one.since
        one.failed += 1
        if one.torque is not False and not one.named and one.failed >= ASKED and now - one.since >= SILENT:
            one.named = True
            self._tell(
                "not watched",
                one,
                f"TORQUE MAY BE ON at servo(s) {one.name}, held and no longer watched: {sentence(error).rstrip('.')}. "
                f"Cut the power, or mend that; process {self._after.pid} goes on looking.",
            )

    def _tell(self, kind: str, one: Held, line: str) -> None:
        self._after.note(kind, by="supervisor", servos=[one.name], sentence=line)
        self._after.say(line)

    # --- releasing ---------------------------------------------------------------------------------------------

    def _release(self) -> bool:
        reason, left, gone = "", list[str](), 0
        for line, held in self._lines:
            names = {one.servo: one.name for one in held if one.name not in self._released}
            if not names:
                continue
            failed: Sequence[int] = list(names)
            try:
                with line.opening() as bus:
                    answers = bus.torque_off(list(names))
                failed = list(answers)
                reason = reason or next((str(error) for error in answers.values()), "")
            except Exception as error:
                reason = reason or sentence(error)
                gone += isinstance(error, PortError) and not isinstance(error, PortBusyError)
            self._released |= {name for servo, name in names.items() if servo not in failed}
            left += [names[servo] for servo in failed]
        if not left:
            self._after.note("at rest", by="supervisor", rest="release", why=self._why)
            self._after.say(f"The servos that were held are released: {self._why}")
            return True
        if left != self._unreleased:
            self._unreleased = left
            self._after.note("not at rest", by="supervisor", servos=left, reason=reason, why=self._why)
            self._after.say(
                f"TORQUE MAY BE ON at servo(s) {', '.join(left)}: CUT THE POWER. They are to be released "
                f"({str(self._why).rstrip('.')}), and cannot be reached: {reason.rstrip('.')}. "
                f"Process {self._after.pid} goes on trying."
            )
        return (not self._after.lasting and gone == len(self._lines)) or self._after.asked() > 1


def torque_of(state: ServoState) -> bool | None:
    """Whether the one servo of a reading has torque; None: that was not read."""
    if state.torque is None or int(state.torque[0]) < 0:
        return None
    return int(state.torque[0]) != 0


# --- who watches servos: of several processes that could, the one whose run switched their torque on last ------------
#
# Held servos are watched on after their run. The next run on them gets a supervisor of its own: two would take turns
# at the port, and the older one could release what the newer one was told to hold. So each leaves its mark in a file.


class InCharge:
    """The claim of one process on the servos of one bus.

    It holds among the processes of one user, on the same servos behind the same adapter, or the same name of a port
    where the system does not know the adapter. Elsewhere, or without a place for files, several watch as if each were
    alone.
    """

    def __init__(self, adapter: str, ids: Sequence[int], folder: Path | None = None) -> None:
        """Claim nothing yet; ``folder``: for the file, None: that of temporary ones."""
        servos = f"{adapter} {sorted(ids)} {os.getuid()}"
        place = Path(tempfile.gettempdir()) if folder is None else folder
        self._path = place / f".sealegs-{hashlib.sha256(servos.encode()).hexdigest()[:16]}"
        self._mark = uuid.uuid4().hex
        self._claimed = False

    def claim(self) -> None:
        """From now on these servos are this process's."""
        with contextlib.suppress(OSError):
            write_text(self._path, self._mark, replace=True)
            self._claimed = True

    @property
    def lost(self) -> bool:
        """Whether another process has claimed them since."""
        if not self._claimed:
            return False
        try:
            return self._path.read_text(encoding="utf-8") != self._mark
        except (OSError, UnicodeDecodeError):  # temporary files are cleared away now and then
            return False


def claims(charge: Charge) -> dict[str, InCharge]:
    """A claim on the servos of each bus, by its name; none on a virtual machine, which ends with its run."""
    if not charge.lasting:
        return {}
    rows = [("", charge.port, charge.ids), *((row["bus"], row["port"], row["ids"]) for row in charge.others)]
    homes = {name: charge.homes.get(name, Whereabouts(port)) for name, port, _ in rows}
    return {name: InCharge(homes[name].name, ids) for name, _, ids in rows if ids}
