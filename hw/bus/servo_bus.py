"""A bus of servos: readings, goals and torque."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Collection, Sequence

import numpy as np

from .interface import Failing, Pace
from .packets import BusError, ConfigurationError, NoReplyError, NotWrittenError, RegisterError, ReplyError, in_words
from .port import BusPort
from .readings import ServoReadings
from .registers import load_model
from .transactions import Transactions

LOOKS = 24  # at a servo, in which another one of its id shows,
DOUBTFUL = 8  # where so many answers are broken or double; one in twenty, on a bad line, are that once in 30 000 runs
AGAIN = 0.002  # [s] within which a second answer follows the first
RECOVERY = 0.3  # [s] of torque off that clears an overload, as in huggingface/lerobot


class ServoBus(ServoReadings):
    """Servos of one model on one port. Every method is safe to call from several threads.

    Angles are those of the output shaft: 0 rad is the centre of the encoder's turn (step 2048), positive is the
    direction of growing steps. The calibration, not the bus, knows the zero and direction of joints.

    Attributes:
        port: path of the port.
        model: register table in use.
        line: transactions on the port.
        counts: failures so far by the name of their class, including those that a retry cured.
        events: the latest failures, oldest first, as (host's monotonic time [s], error).
        status: latest error byte of each servo by id.
        marks: value, by id, that the register which reveals a restart got when torque came on; None: there is no such
            register.
        watchdog: time without a request after which the servos stop by themselves [s], if they can; None: never.
        turning: ids of the servos that are told speeds.
        threads: further threads that read the bus; here none.
    """

    threads: Sequence[int] = ()

    def __init__(
        self,
        port: str,
        baudrate: int = 1_000_000,
        model: str = "sts3215",
        timeout: float = 0.02,
        retries: int = 2,
        opened: BusPort | None = None,
        watchdog: float | None = None,
    ) -> None:
        """Open the port; close it with :meth:`close`, or use the bus in a ``with``.

        A ``with`` that an exception ends, Ctrl-C included, switches off what this bus has switched on: nobody else
        would. One that ends as planned leaves torque as it is, so that servos can be held.

        Args:
            port: path, such as /dev/ttyUSB0.
            baudrate: of the bus [bit/s].
            model: name of a table in ``hw/bus/registers``.
            timeout: time that a reply may take beyond that of its bytes [s]; some USB adapters hold bytes for 16 ms.
            retries: number of retries of a transaction whose reply was missing or unusable.
            opened: port that is open already, such as a simulated one.
            watchdog: time without a request after which the servos stop by themselves [s], if they can; None: never.

        Raises:
            PortError: the port is missing, not a serial port, or (:class:`PortBusyError`) in use.
            RegisterError: there is no table of that name.
        """
        table = load_model(model)
        super().__init__(Transactions(port, baudrate, timeout, retries, opened, table.protocol), table)
        self.port = port
        self.counts: Counter[str] = self.line.counts
        self.events: deque[tuple[float, BusError]] = self.line.events
        self.marks: dict[int, int | None] = {}
        self.watchdog = watchdog
        self.turning: set[int] = set()
        self._switched_on: set[int] = set()

    def __enter__(self) -> ServoBus:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        try:
            if error is not None and self._switched_on:
                self._release_after(error)
        finally:
            self.close()

    def _release_after(self, error: BaseException) -> None:
        """Switch torque off; what fails is a note on ``error``, which must not be hidden."""
        try:
            failed: dict[int, Exception] = {**self.torque_off(sorted(self._switched_on))}
        except Exception as problem:  # such as a port that the block has closed
            failed = dict.fromkeys(sorted(self._switched_on), problem)
        if failed:
            names, reason = ", ".join(map(str, failed)), next(iter(failed.values()))
            error.add_note(f"TORQUE MAY BE ON at servo(s) {names}: CUT THE POWER. They cannot be released: {reason}")

    def close(self) -> None:
        """Close the port. Torque stays as it is."""
        self.line.close()

    def adapters(self, ids: Sequence[int]) -> list[tuple[ServoBus, list[int]]]:
        """This bus, with the ids."""
        return [(self, list(ids))]

    @property
    def retries(self) -> int:
        """Number of retries of a transaction whose reply was missing or unusable."""
        return self.line.retries

    # --- checks ------------------------------------------------------------------------------------------------

    def check(self, ids: Sequence[int], turning: Collection[int] = ()) -> None:
        """Make sure that servos answer, are of the bus's model, and have settings that the bus can work with.

        Args:
            ids: of the servos.
            turning: those that are told speeds, from now on.

        Raises:
            NoReplyError: one does not answer; the message says who does.
            WrongModelError: one is of another model.
            ConfigurationError: one does not acknowledge writes, is not in position mode, or counts turns; or two
                servos seem to have one id.
        """
        for servo in ids:
            try:
                for error in self.unfit(servo, goals=False, turning=servo in turning):
                    raise error
            except NoReplyError as error:
                error.args = (f"{str(error).rstrip('.')}; {self._who_answers(ids)}.",)
                raise

        for servo in ids:
            self._require_alone(servo)
        self.turning |= set(turning)

    def _require_alone(self, servo: int) -> None:
        """Make sure that one servo answers under an id, by reading it often.

        Two of them answer at nearly the same time, and what comes is broken unless they begin within half a bit and say
        the same; or the one answers behind the other. Readings of voltage, temperature and position differ now and then
        even between servos that stand alike. Nothing is written, and a reply that is lost says nothing.

        Raises:
            ConfigurationError: more of them seem to.
        """
        spoilt = 0
        with self.line.lock:
            for _ in range(LOOKS):
                try:
                    self._read_one(servo, *self._block.span(False), None)
                    spoilt += self.line.port.settle(quiet=AGAIN) > 0
                except NoReplyError:
                    continue
                except ReplyError:
                    spoilt += 1
        if spoilt >= DOUBTFUL:
            raise ConfigurationError(
                f"two servos seem to have the id {servo} on {self.port}: of {LOOKS} answers {spoilt} are broken or "
                "double; connect them one at a time and give one another id (sealegs scan id=<id> new_id=<id>), or "
                "mend the wiring.",
                [servo],
            )

    def _who_answers(self, ids: Sequence[int]) -> str:
        found = list(self.scan(ids))
        return f"{in_words(found)} {'does' if len(found) == 1 else 'do'} answer" if found else "no other answers either"

    # --- goals -------------------------------------------------------------------------------------------------

    def write_goals(
        self,
        ids: Sequence[int],
        position: Sequence[float] | np.ndarray,
        velocity: Pace = None,
        acceleration: Pace = None,
    ) -> float:
        """Send goals to all servos in one packet, which no servo acknowledges.

        Args:
            ids: ids of the servos (n,).
            position: goals (n,) [rad], clipped to the turn of the encoder; of servos that are told speeds [rad/s].
            velocity: largest speed of the move (n,) [rad/s], one count of the register at least; 0: no limit; None:
                the register keeps its value, or gets 0 if ``acceleration`` is given.
            acceleration: acceleration of the move (n,) [rad/s2], 0: no limit; None: likewise.

        Returns:
            Host's monotonic clock when the packet went out [s].

        Raises:
            RegisterError: a goal is not finite, the numbers of goals and servos differ, or a limit is negative or not
                finite.
            UnpluggedError: the adapter is gone.
        """
        if len(position) != len(ids):
            raise RegisterError(f"there are {len(position)} goals for {len(ids)} servos.")
        turns = np.array([servo in self.turning for servo in ids], bool)
        if not turns.any():
            return self.write_goal_steps(ids, self.to_steps(position), velocity, acceleration)
        goals, sent = np.asarray(position, float), 0.0
        if not turns.all():
            pace = [
                item if item is None or np.ndim(item) == 0 else np.asarray(item)[~turns]
                for item in (velocity, acceleration)
            ]
            held = [servo for servo, turn in zip(ids, turns, strict=True) if not turn]
            sent = self.write_goal_steps(held, self.to_steps(goals[~turns]), *pace)
        turned = [servo for servo, turn in zip(ids, turns, strict=True) if turn]
        return max(sent, self.write_speeds(turned, goals[turns]))

    def write_speeds(self, ids: Sequence[int], speed: np.ndarray) -> float:
        """Send speeds to servos that turn wheels (n,) [rad/s], in one packet, which no servo acknowledges.

        Returns:
            Host's monotonic clock when the packet went out [s].

        Raises:
            RegisterError: a speed is not finite, or the servos take none.
            UnpluggedError: the adapter is gone.
        """
        if self.model.speed_mode is None:
            raise RegisterError(f"a {self.model.name} has no mode for speeds.")
        if not np.isfinite(speed).all():
            raise RegisterError(f"a speed is not a finite number: {speed.tolist()}.")
        register = self.model[self.model.speed_mode.goal]
        counts = np.clip(np.rint(speed / self.model.si(register.name)), register.low, register.high)
        return self.line.send_all(register.address, ids, [register.to_bytes(int(count)) for count in counts])

    def _turns(self, servo: int) -> bool:
        """Whether a servo is in the mode for speeds, as far as the bus was told, or as its register says."""
        mode = self.model.speed_mode
        return servo in self.turning or (mode is not None and self.read_register(servo, mode.register) == mode.value)

    def write_goal_steps(
        self, ids: Sequence[int], steps: Sequence[int] | np.ndarray, velocity: Pace = None, acceleration: Pace = None
    ) -> float:
        """As :meth:`write_goals`, with goals in steps of the encoder (n,)."""
        goal = self.model["goal_position"]
        if velocity is None and acceleration is None:
            rows = [goal.to_bytes(int(step)) for step in steps]
            return self.line.send_all(goal.address, ids, rows)
        columns = {"goal_position": np.asarray(steps, np.int64)}
        for role, wanted in (("speed", velocity), ("ramp", acceleration)):
            name, limits = self.model.role(role), np.asarray(0.0 if wanted is None else wanted, float)
            if not (np.isfinite(limits) & (limits >= 0.0)).all() or limits.shape not in ((), (len(ids),)):
                raise RegisterError(
                    f"the {role} of a move is {limits.tolist()}; give a number from 0, no limit, or one for each servo."
                )
            if name is not None:
                counts = np.rint(limits / self.model.si(name))
                counts = np.where(limits > 0.0, np.maximum(counts, 1.0), 0.0)  # count 0 would be no limit
                columns[name] = np.broadcast_to(np.minimum(counts, self.model[name].high), (len(ids),))
            elif wanted is not None and np.any(np.asarray(wanted) > 0.0):
                raise RegisterError(f"the {self.model.name} has no register for the {role} of a move.")
        move = [self.model[name] for name in self.model.move]
        rows = [
            b"".join(item.to_bytes(int(columns[item.name][k]) if item.name in columns else 0) for item in move)
            for k in range(len(ids))
        ]
        return self.line.send_all(move[0].address, ids, rows)

    def to_steps(self, position: Sequence[float] | np.ndarray) -> np.ndarray:
        """Steps of the encoder nearest to positions [rad], within its turn.

        Raises:
            RegisterError: a position is not finite.
        """
        angles = np.asarray(position, np.float64)
        if not np.isfinite(angles).all():
            raise RegisterError(f"a goal is not a finite number: {angles.tolist()}.")
        steps = np.rint(angles * (self.model.resolution / (2.0 * np.pi))) + self.model.centre
        return np.clip(steps, 0, self.model.steps - 1).astype(int)

    # --- torque ------------------------------------------------------------------------------------------------

    def write_register(self, servo: int, name: str, count: int) -> None:
        if name == "torque_enable" and count != 0:
            self._switched_on.add(servo)  # before it is written: a try that fails may have switched it on
        super().write_register(servo, name, count)

    def torque_on(self, ids: Sequence[int], wanted: Callable[[], bool] = lambda: True) -> bool:
        """Switch torque on where each servo stands: its position becomes its goal first, or it would jump.

        A register of each servo is marked, so that a restart can be noticed (:attr:`marks`). If :attr:`watchdog` is
        set, servos with a bus watchdog then stop by themselves when requests cease.

        Args:
            ids: ids of the servos.
            wanted: whether torque is still wanted; called before each servo, while no other thread can use the line. A
                thread that makes it return False and then calls :meth:`torque_off` leaves no servo with torque.

        Returns:
            Whether torque is on; if it was no longer wanted, it is off on all servos.

        Raises:
            BusError: a servo failed; torque is then off on all of them.
        """
        try:
            if self.switch_on(ids, wanted):
                self.watch(ids)
                return True
        except BusError:
            self.torque_off(ids)
            raise
        self.torque_off(ids)
        return False

    def switch_on(self, ids: Sequence[int], wanted: Callable[[], bool] = lambda: True) -> bool:
        """As :meth:`torque_on`, without watchdogs. If it fails or is no longer wanted, torque stays as it is then.

        Raises:
            BusError: a servo failed.
        """
        if not wanted():
            return False
        self.hold(ids)
        return all(self._switch_on(servo, wanted) for servo in ids)

    def watch(self, ids: Sequence[int]) -> None:
        """Set the bus watchdogs of servos that have one to :attr:`watchdog`.

        Raises:
            BusError: a servo failed.
        """
        self._watch(ids, self.watchdog)

    def _switch_on(self, servo: int, wanted: Callable[[], bool]) -> bool:
        # Each step takes several packets, between which this thread may get the line again before the one that waits.
        if not wanted():
            return False
        self._mark(servo)
        if not wanted():
            return False
        self.hold([servo])  # again: the servos before it may have moved its joint, or a hand has
        with self.line.lock:
            if not wanted():
                return False
            self.write_register(servo, "torque_enable", 1)
            return True

    def _mark(self, servo: int) -> None:
        """Make sure that a register is another one than after power-on: a torque limit a thousandth less, or an LED."""
        name, full = self.model.role("mark"), self.model.role("mark_full")
        if name is None:
            self.marks[servo] = None
            return
        mark = 1
        if full is not None:
            mark, largest = self.read_register(servo, name), self.read_register(servo, full)
            if mark != largest or mark <= 0:
                self.marks[servo] = mark
                return
            mark -= 1
        self.write_register(servo, name, mark)
        self.marks[servo] = mark

    def _watch(self, ids: Sequence[int], seconds: float | None) -> None:
        """Let servos that can stop by themselves after so long without a request [s]; None: never."""
        name = self.model.role("watchdog")
        if name is None:
            return
        register = self.model[name]
        count = 0 if seconds is None else min(max(math.ceil(seconds / register.scale - 1e-9), 1), register.high)
        for servo in ids:
            self.write_register(servo, name, count)

    def hold(self, ids: Sequence[int]) -> None:
        """Make each servo's position its goal, and make sure that the goal arrived.

        Goal speed and acceleration become 0, which is no limit: values that another program left would slow every later
        goal. A bus watchdog is switched off: it would refuse the goal, and held servos get requests too rarely for it.

        Raises:
            NotWrittenError: a servo has another goal.
            BusError: a servo failed.
        """
        self._watch(ids, None)
        if turning := [servo for servo in ids if self._turns(servo)]:
            self._stand(turning)
        if not (ids := [servo for servo in ids if servo not in turning]):
            return
        goals = np.clip(self.read_state(ids).raw["present_position"], 0, self.model.steps - 1)
        register = self.model["goal_position"]

        def write() -> None:
            self.write_goal_steps(ids, goals, velocity=0.0)
            for servo, goal in zip(ids, goals, strict=True):
                if self.read_register(servo, register.name) != goal:
                    raise NotWrittenError(f"servo {servo} did not take its position as its goal; try again.", [servo])

        self._repeat_unwritten(write)

    def _stand(self, ids: Sequence[int]) -> None:
        """Make 0 the speed of servos that turn wheels, and make sure that it arrived.

        Raises:
            NotWrittenError: a servo has another one.
            BusError: a servo failed.
        """
        assert self.model.speed_mode is not None
        name = self.model.speed_mode.goal

        def write() -> None:
            self.write_speeds(ids, np.zeros(len(ids)))
            for servo in ids:
                if self.read_register(servo, name) != 0:
                    raise NotWrittenError(f"servo {servo} did not take 0 as its speed; try again.", [servo])

        self._repeat_unwritten(write)

    def torque_off(self, ids: Sequence[int], failing: Failing | None = None) -> dict[int, BusError]:
        """Switch torque off on every servo that can be reached; never raises.

        One packet to all servos is sent twice. Then the torque of each is read, and switched off again if needed.

        Args:
            ids: ids of the servos.
            failing: called with servos and reason as soon as their release has failed, before the others are tried.

        Returns:
            For each servo whose torque may still be on, the reason.
        """
        register, failed = self.model["torque_enable"], dict[int, BusError]()
        with self.line.lock:
            for _ in range(2):
                if (lost := self.tell_off(ids)) is not None and not failed:
                    failed = dict.fromkeys(ids, lost)
                    if failing is not None:
                        failing(ids, lost)
            if failed:
                return failed
            for servo in ids:
                try:
                    if self.read_register(servo, register.name) != 0:
                        self.write_register(servo, register.name, 0)
                except BusError as error:
                    failed[servo] = error
                    if failing is not None:
                        failing([servo], error)
        self._switched_on -= set(ids) - set(failed)
        return failed

    def tell_off(self, ids: Sequence[int]) -> BusError | None:
        """Tell all servos in one packet, which none acknowledges, to switch torque off; the error if sending failed.

        Wheels are told to stand first: a program that switches torque on again must not find a speed.
        """
        try:
            if turning := [servo for servo in ids if servo in self.turning]:
                self.write_speeds(turning, np.zeros(len(turning)))
            self.line.send_all(self.model["torque_enable"].address, ids, [b"\0"] * len(ids))
        except BusError as error:
            return error
        return None

    def recover(self, ids: Sequence[int]) -> None:
        """Clear an overload: torque off for a while, then on where the servos stand.

        Raises:
            BusError: a servo failed; torque is then off on all of them.
        """
        for error in self.torque_off(ids).values():
            raise error
        self.clock.sleep(RECOVERY)
        self.torque_on(ids)
