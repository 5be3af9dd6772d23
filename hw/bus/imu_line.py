"""IMUs that send lines of text over a serial port, in a format that the robot's YAML describes.

    line: "w, x, y, z, turn_x, turn_y, turn_z"
    line: "$VNYMR, yaw [deg], pitch [deg], roll [deg], _, _, _, _, _, _, turn_x, turn_y, turn_z"
    line: "acc_x [g], acc_y [g], acc_z [g], turn_x [deg/s], turn_y [deg/s], turn_z [deg/s]"

Names stand for numbers, ``switch.<name>`` for a contact switch of the robot (closed above 0.5), ``_`` for one that is
passed over, and any other word for itself: lines without it are other lines. What separates names separates numbers; a
checksum behind ``*`` is left out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...common.errors import nearest
from ...common.extras import needed_for
from ...envs.engine.base import quaternion
from ...envs.engine.switches import PREFIX
from .imu import ImuError, ThreadedImu
from .imu_fusion import Tilt

PLAIN = "w, x, y, z, turn_x, turn_y, turn_z"
"""A line without switches, where none is given; those follow in their order."""
UNITS = {
    "rad": 1.0, "deg": math.pi / 180.0, "rad/s": 1.0, "deg/s": math.pi / 180.0, "mdeg/s": math.pi / 180e3,
    "m/s2": 1.0, "g": 9.80665, "mg": 9.80665e-3, "1": 1.0,
}  # fmt: skip
"""Of what a line holds, in SI units."""
TURNS, ANGLES = ("w", "x", "y", "z"), ("roll", "pitch", "yaw")
RATES, PULLS = (tuple(f"{word}_{axis}" for axis in "xyz") for word in ("turn", "acc"))
KINDS = {
    **dict.fromkeys(TURNS, "1"), **dict.fromkeys(ANGLES, "rad"), **dict.fromkeys(RATES, "rad/s"),
    **dict.fromkeys(PULLS, "m/s2"),
}  # fmt: skip
"""Unit of each name."""
TOKEN = re.compile(r"\s*([^\s\[\],;]+)\s*(?:\[([^\]]*)\])?\s*")
LONGEST = 1024  # [byte] of a line


@dataclass(frozen=True)
class LineFormat:
    """What the numbers of a line are.

    Attributes:
        words: of the line by place: a name of :data:`KINDS`, a switch, ``_``, or a word that stands for itself.
        factors: to SI units, likewise.
        separator: between numbers; None: blanks.
    """

    words: tuple[str, ...]
    factors: tuple[float, ...]
    separator: str | None

    @classmethod
    def read(cls, text: str, switches: Sequence[str] = ()) -> LineFormat:
        """From what stands in YAML.

        Args:
            text: such as :data:`PLAIN`.
            switches: names of the switches that it must hold.

        Raises:
            ImuError: a unit is unknown, or the line does not tell orientation, turn rate and switches.
        """
        separator = next((sign for sign in ",;" if sign in text), None)
        parts = text.split(separator) if separator else re.findall(r"\S+(?:\s*\[[^\]]*\])?", text)
        words, factors = [], []
        for part in parts:
            if (match := TOKEN.fullmatch(part)) is None:
                raise ImuError(f"imu.part.line: '{part.strip()}' is no name with a unit, such as turn_x [deg/s].")
            word, unit = match.groups()
            usual = KINDS.get(word, "1")
            if unit is not None and (unit not in UNITS or (word in KINDS and not _fits(unit, usual))):
                raise ImuError(f"imu.part.line: {word} in '{unit}' is not known{nearest(unit, UNITS)}; give {usual}.")
            words.append(word)
            factors.append(UNITS[unit or usual])
        if lacking := [PREFIX + name for name in switches if PREFIX + name not in words]:
            raise ImuError(f"imu.part.line: it needs the contact switches of the robot: {', '.join(lacking)}.")
        if not set(RATES) <= set(words):
            raise ImuError(f"imu.part.line: it needs {', '.join(RATES)}, of names {', '.join(KINDS)} and _.")
        if not any(set(names) <= set(words) for names in (TURNS, ANGLES, PULLS)):
            raise ImuError(
                f"imu.part.line: it needs how the IMU is turned: {', '.join(TURNS)}, or {', '.join(ANGLES)}, or "
                f"{', '.join(PULLS)}, which it is worked out from."
            )
        return cls(tuple(words), tuple(factors), separator)

    def values(self, line: str) -> dict[str, float] | None:
        """Numbers of a line by name, in SI units; None: it is another line, or a torn one."""
        cells = [cell.strip() for cell in line.partition("*")[0].split(self.separator)]
        if len(cells) != len(self.words):
            return None
        found = {}
        for word, factor, cell in zip(self.words, self.factors, cells, strict=True):
            if word == "_":
                continue
            if word not in KINDS and not word.startswith(PREFIX):
                if cell != word:
                    return None
                continue
            try:
                found[word] = factor * float(cell)
            except ValueError:
                return None
        return found if all(map(math.isfinite, found.values())) else None


def plain(switches: Sequence[str]) -> str:
    """:data:`PLAIN` with switches behind it."""
    return ", ".join([PLAIN, *(PREFIX + name for name in switches)])


def _fits(unit: str, usual: str) -> bool:
    kinds = ({"rad", "deg"}, {"rad/s", "deg/s", "mdeg/s"}, {"m/s2", "g", "mg"}, {"1"})
    return any({unit, usual} <= kind for kind in kinds)


class LineImu(ThreadedImu):
    """An IMU on a serial port."""

    def __init__(self, port: str, baudrate: int, line: str, rate: float, switches: Sequence[str] = ()) -> None:
        """Open the port and wait for the first whole line.

        Args:
            port: path.
            baudrate: [bit/s].
            line: format.
            rate: lines per second that are expected [Hz].
            switches: names of contact switches that the line tells of.

        Raises:
            SealegsError: the port cannot be opened, or nothing that can be read comes.
        """
        with needed_for("an IMU on a serial port"):
            import serial
        self._format, self._tilt = LineFormat.read(line, switches), Tilt(1.0 / rate)
        self._switches = [PREFIX + name for name in switches]
        try:
            self._port = serial.Serial(port, baudrate, timeout=max(0.05, 3.0 / rate), exclusive=True)
        except (OSError, ValueError) as error:
            raise ImuError(f"the port {port} of the IMU cannot be opened: {error}.") from None
        self._buffer = b""
        super().__init__(f"at {port}")

    def read(self) -> tuple[np.ndarray, ...] | None:
        come = self._port.read(max(1, self._port.in_waiting))
        *lines, self._buffer = (self._buffer + come).split(b"\n")
        self._buffer = self._buffer[-LONGEST:]
        found = None
        for text in lines:  # all of them, since what is worked out goes from sample to sample
            if (values := self._format.values(text.decode("ascii", "replace"))) is not None:
                turned = self._sample_of(values)
                closed = np.array([float(values[name] > 0.5) for name in self._switches])
                found = None if turned is None else (*turned, closed)
            elif text.strip():
                self._problem = f"lines such as '{text.decode('ascii', 'replace').strip()[:60]}' do not fit its format"
        return found

    def close(self) -> None:
        super().close()
        self._port.close()

    def _sample_of(self, values: dict[str, float]) -> tuple[np.ndarray, np.ndarray] | None:
        rate = np.array([values[name] for name in RATES])
        if set(TURNS) <= values.keys():
            turn = np.array([values[name] for name in TURNS])
            length = float(np.linalg.norm(turn))
            return (turn / length, rate) if length > 0.5 else None
        if set(ANGLES) <= values.keys():
            return quaternion(values["roll"], values["pitch"], values["yaw"]), rate
        return self._tilt.after(np.array([values[name] for name in PULLS]), rate), rate
