"""Several buses as one: each servo has an address, one reading reads all, a fault on one adapter concerns all."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Collection, Mapping, MutableMapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from .clock import Clock
from .interface import Address, Failing, Pace, local
from .packets import BusError, ReplyError
from .servo_bus import ServoBus
from .servo_state import ServoState

T = TypeVar("T")
PER_SERVO = tuple(field.name for field in fields(ServoState) if field.type == "np.ndarray")
WATCHED = {"torque": -1, "mark": -1, "watchdog": 0}
"""What stands for a servo of which it was not read."""


class BusGroup:
    """The buses of one robot.

    Attributes:
        port: paths of all ports.
        parts: the buses by name; "" is the first.
        threads: those that read the buses, as the system numbers them.
    """

    def __init__(
        self, parts: Mapping[str, ServoBus], numbers: Mapping[str, int] | None = None, parallel: bool = True
    ) -> None:
        """Put buses together; :meth:`close` closes them all.

        Args:
            parts: by name, the first one under "".
            numbers: of the buses, as in addresses; None: in their order.
            parallel: read them at the same time, each in a thread of its own.
        """
        self.parts = dict(parts)
        self.port = " and ".join(part.port for part in self.parts.values())
        self._numbers = dict(numbers or {name: number for number, name in enumerate(self.parts)})
        self._latest: dict[str, ServoState] = {}
        self.threads: list[int] = []
        self._pool = self._readers(len(self.parts)) if parallel and len(self.parts) > 1 else None

    def _readers(self, count: int) -> ThreadPoolExecutor:
        """A pool whose threads are all there, so that they can get the loop's priority."""
        pool = ThreadPoolExecutor(count, initializer=lambda: self.threads.append(threading.get_native_id()))
        together = threading.Barrier(count)
        for started in [pool.submit(together.wait) for _ in range(count)]:
            started.result()
        return pool

    def close(self) -> None:
        """Close the ports. Torque stays as it is."""
        if self._pool is not None:
            self._pool.shutdown(wait=False)
        for part in self.parts.values():
            part.close()

    @property
    def clock(self) -> Clock:
        """Of the first bus."""
        return next(iter(self.parts.values())).clock

    @property
    def counts(self) -> Counter[str]:
        """Failures so far by the name of their class, of all buses."""
        return sum((part.counts for part in self.parts.values()), Counter())

    @property
    def marks(self) -> dict[int, int | None]:
        """What each servo got with its torque in the register that tells a restart, by address."""
        return {
            self._address(name, servo): mark for name, part in self.parts.items() for servo, mark in part.marks.items()
        }

    # --- who is where ------------------------------------------------------------------------------------------

    def _address(self, name: str, servo: int) -> int:
        return Address(self._numbers[name], name, servo) if name else servo

    def _part(self, servo: int) -> tuple[ServoBus, int]:
        return self.parts[servo.bus if isinstance(servo, Address) else ""], local(servo)

    def _shares(self, ids: Sequence[int]) -> dict[str, list[int]]:
        """Places in ``ids`` of the servos of each bus, by its name."""
        shares: dict[str, list[int]] = {}
        for place, servo in enumerate(ids):
            shares.setdefault(servo.bus if isinstance(servo, Address) else "", []).append(place)
        return shares

    def adapters(self, ids: Sequence[int]) -> list[tuple[ServoBus, list[int]]]:
        """Each bus, and the ids there of the servos among ``ids``."""
        return [(self.parts[name], [local(ids[k]) for k in at]) for name, at in self._shares(ids).items()]

    def _named(self, name: str, error: BusError) -> BusError:
        """An error of one bus, its servos by their addresses."""
        if name:
            error.servos = tuple(self._address(name, servo) for servo in error.servos)
            error.args = (f"bus {name}: {error}",)
        return error

    def _each(self, ids: Sequence[int], ask: Callable[[ServoBus, list[int]], T]) -> dict[str, T | BusError]:
        """What ``ask`` gives for each bus with servos among ``ids``, or why it failed."""

        def one(name: str, at: list[int]) -> T | BusError:
            try:
                return ask(self.parts[name], [local(ids[k]) for k in at])
            except BusError as error:
                return self._named(name, error)

        shares = self._shares(ids)
        if self._pool is None or len(shares) < 2:
            return {name: one(name, at) for name, at in shares.items()}
        waiting = {name: self._pool.submit(one, name, at) for name, at in shares.items()}
        return {name: item.result() for name, item in waiting.items()}

    def _all(self, ids: Sequence[int], ask: Callable[[ServoBus, list[int]], T]) -> dict[str, T]:
        """As :meth:`_each`; the first failure is raised."""
        found: dict[str, T] = {}
        for name, item in self._each(ids, ask).items():
            if isinstance(item, BusError):
                raise item
            found[name] = item
        return found

    # --- cycle -------------------------------------------------------------------------------------------------

    def read_state(self, ids: Sequence[int], retries: int | None = None, whole: bool = False) -> ServoState:
        """One reading of all servos.

        Raises:
            BusError: of the first bus that failed.
        """
        states = self._all(ids, lambda bus, own: bus.read_state(own, retries, whole))
        self._latest |= states
        return self._joined(ids, states)

    def read_cycle(self, ids: Sequence[int], whole: bool = False, until: float | None = None) -> ServoState:
        """One reading within a control cycle; of a bus on which nobody answers, the one before.

        Raises:
            ReplyError: nobody answers on any bus, or one has not answered before.
            PortError: a port failed.
        """
        begun = self.clock.now()
        answers = self._each(ids, lambda bus, own: bus.read_cycle(own, whole, until))
        states: dict[str, ServoState] = {}
        silent: list[BusError] = []
        for name, item in answers.items():
            if isinstance(item, ServoState):
                states[name] = self._latest[name] = item
                continue
            before = self._latest.get(name)
            if not isinstance(item, ReplyError) or before is None:
                raise item
            silent.append(item)
            own = tuple(local(ids[k]) for k in self._shares(ids)[name])
            states[name] = replace(before, missing=own, problem=item, before=begun, after=self.clock.now())
        if len(silent) == len(answers):
            silent[0].servos = tuple(ids)
            raise silent[0]
        return self._joined(ids, states)

    def _joined(self, ids: Sequence[int], states: Mapping[str, ServoState]) -> ServoState:
        shares = self._shares(ids)
        order = np.argsort(np.concatenate([shares[name] for name in states]))

        def column(take: Callable[[ServoState], np.ndarray]) -> np.ndarray:
            return np.concatenate([take(state) for state in states.values()])[order]

        def watched(state: ServoState, name: str) -> np.ndarray:
            found = getattr(state, name)
            return np.full(len(state.ids), WATCHED[name]) if found is None else found

        parts = list(states.values())
        raw = set.intersection(*(set(state.raw) for state in parts))
        asked = any(state.torque is not None for state in parts)
        problems = [(name, state.problem) for name, state in states.items() if state.problem is not None]
        missing = {name: state.missing for name, state in states.items()}
        latched = {name: state.latched for name, state in states.items()}
        if problems:
            problems[0][1].servos = tuple(self._addresses(missing))
        values: dict[str, Any] = {name: column(lambda state, name=name: getattr(state, name)) for name in PER_SERVO}
        if asked:
            values |= {name: column(lambda state, name=name: watched(state, name)) for name in WATCHED}
        return ServoState(
            ids=tuple(ids),
            before=min(state.before for state in parts),
            after=max(state.after for state in parts),
            raw={key: column(lambda state, key=key: state.raw[key]) for key in raw},
            latched=tuple(self._addresses(latched)),
            missing=tuple(self._addresses(missing)),
            problem=problems[0][1] if problems else None,
            **values,
        )

    def _addresses(self, servos: Mapping[str, Sequence[int]]) -> list[int]:
        return [self._address(name, local(servo)) for name, own in servos.items() for servo in own]

    def write_goals(
        self,
        ids: Sequence[int],
        position: Sequence[float] | np.ndarray,
        velocity: Pace = None,
        acceleration: Pace = None,
    ) -> float:
        """Send goals, a packet on each bus; clock as the last one went out [s].

        Raises:
            BusError: of the first bus that failed; the others have their goals.
        """
        count, sent = len(ids), 0.0
        failed: BusError | None = None
        goals = np.asarray(position, float)
        speed, ramp = (None if item is None else np.broadcast_to(item, (count,)) for item in (velocity, acceleration))
        for name, at in self._shares(ids).items():
            own = [local(ids[k]) for k in at]
            pace = [None if item is None else item[at] for item in (speed, ramp)]
            try:
                sent = max(sent, self.parts[name].write_goals(own, goals[at], *pace))
            except BusError as error:
                failed = failed or self._named(name, error)
        if failed is not None:
            raise failed
        return sent

    # --- torque ------------------------------------------------------------------------------------------------

    def torque_on(self, ids: Sequence[int], wanted: Callable[[], bool] = lambda: True) -> bool:
        """Switch torque on where each servo stands, one bus after the other.

        Bus watchdogs come last: those of one bus would stop its servos while another bus is switched on.

        Args:
            ids: addresses.
            wanted: asked before each servo: whether torque is still wanted.

        Returns:
            Whether torque is on; where it was no longer wanted, it is off on all of them, on every bus.

        Raises:
            BusError: a servo failed; torque is then off on all of them, on every bus.
        """
        try:
            for name, at in self._shares(ids).items():
                own = [local(ids[k]) for k in at]
                if not self._told(name, lambda part, servos: part.switch_on(servos, wanted), own):
                    break
            else:
                self._all(ids, lambda part, servos: part.watch(servos))
                return True
        except BusError:
            self.torque_off(ids)
            raise
        self.torque_off(ids)
        return False

    def hold(self, ids: Sequence[int]) -> None:
        """Make each servo's position its goal.

        Raises:
            BusError: a servo failed.
        """
        for name, at in self._shares(ids).items():
            self._told(name, lambda part, own: part.hold(own), [local(ids[k]) for k in at])

    def torque_off(self, ids: Sequence[int], failing: Failing | None = None) -> dict[int, BusError]:
        """Switch torque off on every servo that can be reached; never raises.

        All buses are told first, so that no servo waits for those of another adapter; then each is asked.

        Args:
            ids: addresses.
            failing: called with servos and reason as soon as their release has failed.

        Returns:
            Why, for each servo of which it is not sure that its torque is off.
        """
        shares = self._shares(ids)
        for name, at in shares.items():
            self.parts[name].tell_off([local(ids[k]) for k in at])
        failed: dict[int, BusError] = {}
        for name, at in shares.items():

            def told(servos: Sequence[int], error: BusError, name: str = name) -> None:
                if failing is not None:
                    failing([self._address(name, servo) for servo in servos], error)

            found = self.parts[name].torque_off([local(ids[k]) for k in at], told)
            failed |= {self._address(name, servo): error for servo, error in found.items()}
        return failed

    # --- one servo ---------------------------------------------------------------------------------------------

    def _told(self, name: str, ask: Callable[[ServoBus, list[int]], T], own: list[int]) -> T:
        try:
            return ask(self.parts[name], own)
        except BusError as error:
            raise self._named(name, error) from None

    def check(self, ids: Sequence[int], turning: Collection[int] = ()) -> None:
        """Make sure that servos are there, of their bus's model, and set up so that the bus can work with them.

        Those of ``turning`` are told speeds, from now on.

        Raises:
            BusError: one is not.
        """
        for name, at in self._shares(ids).items():
            turns = [local(ids[k]) for k in at if ids[k] in turning]
            self._told(name, lambda part, own, turns=turns: part.check(own, turns), [local(ids[k]) for k in at])

    def ping(self, servo: int) -> int:
        """Model number of a servo."""
        part, own = self._part(servo)
        return part.ping(own)

    def read_register(self, servo: int, name: str) -> int:
        """A register's count."""
        part, own = self._part(servo)
        return part.read_register(own, name)

    def write_register(self, servo: int, name: str, count: int) -> None:
        """Write a register, and make sure that it arrived."""
        part, own = self._part(servo)
        part.write_register(own, name, count)

    def identity(self, servo: int) -> MutableMapping[str, int]:
        """Every register of a servo but its readings, by name."""
        part, own = self._part(servo)
        return part.identity(own)
