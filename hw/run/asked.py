"""What a person asks a policy for while it runs: numbers, a trajectory, the keyboard, a gamepad, a function.

Numbers go by the names that the policy's task gives them, with or without the unit: ``forward``, or a joint. Within the
range of training they are taken as they are; a file beyond it is refused, a hand or a function held within.
"""

from __future__ import annotations

import contextlib
import os
import select
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np

from ...common.errors import SealegsError, nearest
from ...common.extras import needed_for
from ...configs.check import checked
from ...envs.engine.task import Task
from ..guard.stop import pressed_key

KEYS, GAMEPAD = "keyboard", "gamepad"
STEPS = 20  # key presses from the lowest to the highest value
DEAD_ZONE = 0.1  # share of a stick's way that counts as its middle
ARROWS = {b"\x1b[A": (0, 1), b"\x1b[B": (0, -1), b"\x1b[D": (1, 1), b"\x1b[C": (1, -1)}
LETTERS = {
    b"w": (0, 1),
    b"s": (0, -1),
    b"a": (1, 1),
    b"d": (1, -1),
    b"q": (2, 1),
    b"e": (2, -1),
    b"r": (3, 1),
    b"f": (3, -1),
}
"""Which number a key moves, and to which side."""
AXES = ((1, -1.0), (0, -1.0), (2, -1.0), (3, -1.0))
"""Axis of a gamepad for each number, and its sign: the left stick up and left, the right one left and up."""
Function = Callable[[float], Any]


class Asked:
    """What is asked for at a time [s] since the start, a number for each of the task's names (m,).

    Attributes:
        names: of the numbers, with their units.
        low, high: of training (m,).
        description: what a log says of it.
    """

    def __init__(self, task: Task, description: Any) -> None:
        self.names, self.description = task.asked_names(), description
        self.low, self.high = task.asked_range()

    @property
    def middle(self) -> np.ndarray:
        """What nobody moves: 0 where that was trained, else the middle (m,)."""
        return np.where((self.low <= 0.0) & (self.high >= 0.0), 0.0, 0.5 * (self.low + self.high))

    def __call__(self, time: float) -> np.ndarray:
        del time
        return self.middle

    def still(self) -> Asked:
        """What a rehearsal asks for: nobody's keys, and no function, are called for it."""
        return self

    def opened(self) -> AbstractContextManager[Any]:
        """While the robot runs."""
        return contextlib.nullcontext()

    def place(self, name: str, where: str) -> int:
        """Which number is called ``name``.

        Raises:
            SealegsError: none is.
        """
        short = [item.partition(" [")[0] for item in self.names]
        for known in (list(self.names), short):
            if name.strip() in known:
                return known.index(name.strip())
        raise SealegsError(f"{where} names '{name}'{nearest(name, short)}; the task asks for {self.told}.")

    @property
    def told(self) -> str:
        """The names, in a sentence."""
        return ", ".join(self.names)

    def check(self, values: np.ndarray, where: str) -> np.ndarray:
        """Values (n, m) within the range of training.

        Raises:
            SealegsError: one is not, or is not finite.
        """
        slack = 1e-6 + 0.01 * (self.high - self.low)  # the corners of a draw are not all of them
        for k, name in enumerate(self.names):
            far = ~((values[:, k] >= self.low[k] - slack[k]) & (values[:, k] <= self.high[k] + slack[k]))
            if far.any():
                raise SealegsError(
                    f"{where} asks for {name} {values[far][0, k]:.4g}, but the policy was trained with "
                    f"{self.low[k]:.4g} to {self.high[k]:.4g}; give values of that, or train it for more."
                )
        return values


class AskedPath(Asked):
    """Numbers over time, straight between their times; the last ones stay."""

    def __init__(self, task: Task, time: np.ndarray, columns: Mapping[str, np.ndarray], where: str) -> None:
        """Prepare.

        Args:
            task: of the policy.
            time: (n,) [s], from 0.
            columns: numbers over time (n,) by name; what has no column stays in its middle.
            where: they come from, for messages and logs.
        """
        super().__init__(task, where)
        self._time, self._values = time, np.tile(self.middle, (len(time), 1))
        for name, values in columns.items():
            self._values[:, self.place(name, where)] = values
        self.check(self._values, where)
        if len(time) == 1:  # numbers that stay
            self.description = self._values[0].tolist()

    def __call__(self, time: float) -> np.ndarray:
        return np.array([np.interp(time, self._time, column) for column in self._values.T])


class AskedFunction(Asked):
    """A function of the caller's, from time [s] to numbers (m,) or to a mapping by name."""

    def __init__(self, task: Task, function: Function) -> None:
        super().__init__(task, getattr(function, "__name__", "function"))
        self._function = function

    def __call__(self, time: float) -> np.ndarray:
        given = self._function(time)
        values = self.middle.copy()
        if isinstance(given, Mapping):
            for name, value in given.items():
                values[self.place(str(name), "command")] = value
        else:
            wanted = np.atleast_1d(np.asarray(given, float))
            if wanted.shape != values.shape:
                raise SealegsError(f"command gives {wanted.shape[0]} number(s); the task asks for {self.told}.")
            values = wanted
        if not np.isfinite(values).all():
            raise SealegsError(f"command gives a number that is not finite at {time:.3f} s.")
        return np.clip(values, self.low, self.high)


class AskedKeys(Asked):
    """The keyboard: arrows or letters move the numbers by steps, space brings them back to their middle."""

    def __init__(self, task: Task) -> None:
        super().__init__(task, KEYS)
        self._values, self._descriptor = self.middle, -1

    def still(self) -> Asked:
        return _Still(self)

    @contextlib.contextmanager
    def opened(self) -> Iterator[None]:
        pairs = ("up and down (w, s)", "left and right (a, d)", "q and e", "r and f")
        moved = "; ".join(f"{keys}: {name}" for keys, name in zip(pairs, self.names, strict=False))
        print(f"Keys: {moved}; space: back to the middle.", flush=True)
        with pressed_key(f"command={KEYS}") as self._descriptor:
            yield
        self._descriptor = -1

    def __call__(self, time: float) -> np.ndarray:
        del time
        while self._descriptor >= 0 and select.select([self._descriptor], [], [], 0.0)[0]:
            typed = os.read(self._descriptor, 64)
            if not typed:  # the terminal was closed: nobody steers
                self._values, self._descriptor = self.middle, -1
                break
            self.press(typed)
        return self._values

    def press(self, typed: bytes) -> None:
        """Move the numbers by the keys in ``typed``."""
        while typed:
            if typed[:1] == b" ":
                self._values = self.middle
            number, side = ARROWS.get(typed[:3]) or LETTERS.get(typed[:1]) or (len(self.names), 0)
            if number < len(self.names):
                values = self._values.copy()
                values[number] += side * (self.high - self.low)[number] / STEPS
                self._values = np.clip(values, self.low, self.high)
            typed = typed[3 if typed[:3] in ARROWS else 1 :]


class AskedPad(Asked):
    """A gamepad: a stick at rest is the middle of a number, at its end the end of its range."""

    def __init__(self, task: Task) -> None:
        super().__init__(task, GAMEPAD)
        with needed_for(f"command={GAMEPAD}"):
            import pygame
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # it has no window
        pygame.display.init()
        pygame.joystick.init()
        if not pygame.joystick.get_count():
            raise SealegsError(f"command={GAMEPAD} needs a gamepad, and none is connected.")
        self._pygame, self._pad = pygame, pygame.joystick.Joystick(0)

    def still(self) -> Asked:
        return _Still(self)

    def __call__(self, time: float) -> np.ndarray:
        del time
        gone = self._pygame.JOYDEVICEREMOVED
        if any(event.type == gone for event in self._pygame.event.get()) or not self._pad.get_init():
            return self.middle
        values = self.middle.copy()
        for number, (axis, sign) in enumerate(AXES[: min(len(values), self._pad.get_numaxes())]):
            way = sign * self._pad.get_axis(axis)
            if abs(way) > DEAD_ZONE:
                way = (abs(way) - DEAD_ZONE) / (1.0 - DEAD_ZONE) * np.sign(way)
                room = (self.high if way > 0.0 else self.low)[number] - values[number]
                values[number] += abs(way) * room
        return values


class _Still(Asked):
    """The middle of what another asks for."""

    def __init__(self, other: Asked) -> None:
        self.names, self.low, self.high, self.description = other.names, other.low, other.high, other.description


def asked_for(word: Any, task: Task) -> Asked:
    """What the key ``command`` asks for.

    Args:
        word: numbers, a mapping by name, the path of a CSV, ``keyboard``, ``gamepad``, or a function of the caller's.
        task: of the policy.

    Raises:
        SealegsError: it is none of these, or does not fit the task.
    """
    if callable(word):
        return AskedFunction(task, word)
    if word == KEYS:
        return AskedKeys(task)
    if word == GAMEPAD:
        return AskedPad(task)
    if isinstance(word, str):
        time, columns = read_asked(Path(word))
        return AskedPath(task, time, columns, f"the file {word}")
    if isinstance(word, Mapping):
        numbers = {str(key): np.array([checked(f"command.{key}", value, float)]) for key, value in word.items()}
        return AskedPath(task, np.zeros(1), numbers, "command=")
    values = np.atleast_1d(np.asarray(checked("command", word, list[float] | float), float))
    names = task.asked_names()
    if len(values) != len(names):
        raise SealegsError(f"the task takes {len(names)} command value(s), not {len(values)}: {', '.join(names)}.")
    return AskedPath(task, np.zeros(1), {name: values[k : k + 1] for k, name in enumerate(names)}, "command=")


def read_asked(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times (n,) [s] and columns by name of a CSV.

    Raises:
        SealegsError: it cannot be read, or has no rising column ``time``.
    """
    import pandas

    try:
        table = pandas.read_csv(path, encoding="utf-8-sig", skipinitialspace=True).astype(float)
    except (OSError, ValueError) as error:  # pandas tells a table that is none by ValueErrors of its own
        raise SealegsError(f"command={path} cannot be read as a table of numbers: {error}.") from None
    table.columns = [str(name).strip() for name in table.columns]
    time = next((table.pop(name).to_numpy() for name in ("time", "time [s]") if name in table), None)
    if time is None or not len(time) or table.shape[1] == 0:
        raise SealegsError(f"command={path} needs a column time [s], and one of each command's name.")
    if not (np.diff(time) > 0.0).all():
        raise SealegsError(f"command={path}: its time does not rise from row to row.")
    return time - time[0], {str(name): column.to_numpy() for name, column in table.items()}
