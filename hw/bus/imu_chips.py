"""IMUs on an I2C bus, through Adafruit's drivers (extra ``imu``), or a serial port; and what ``imu.part`` may name."""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Any

import numpy as np

from ...common.errors import SealegsError, nearest
from ...common.extras import needed_for
from ...configs.check import Count, Natural, checked_fields
from ...envs.engine.base import quaternion
from ...envs.engine.imu import PREFIX
from .imu import ImuError, ImuSource, ThreadedImu, Tilt


@dataclass(frozen=True)
class Chip:
    """One kind of part.

    Attributes:
        module, driver: of the library.
        address: on the bus, where its pins leave it.
        prepare: makes the driver give the motion in turn, at a rate [Hz].
        orientation: attribute with a quaternion; "": it has none, and its acceleration tells how it is turned.
        real_last: whether that quaternion ends with its real part.
    """

    module: str
    driver: str
    address: int
    prepare: Callable[[Any, float], None] = lambda driver, rate: None
    orientation: str = ""
    real_last: bool = False


def _without_compass(driver: Any, rate: float) -> None:
    """A BNO055 that leaves its magnetometer out, which a motor beside it deceives (mode IMUPLUS)."""
    del rate
    driver.mode = 0x08


def _reports(driver: Any, rate: float) -> None:
    """A BNO08x that reports its turn rate, and its orientation without the magnetometer."""
    for report in (0x02, 0x08):  # BNO_REPORT_GYROSCOPE, BNO_REPORT_GAME_ROTATION_VECTOR
        driver.enable_feature(report, round(1e6 / rate))


CHIPS = {
    "bno055": Chip("adafruit_bno055", "BNO055_I2C", 0x28, _without_compass, "quaternion"),
    "bno08x": Chip("adafruit_bno08x.i2c", "BNO08X_I2C", 0x4A, _reports, "game_quaternion", real_last=True),
    "icm20948": Chip("adafruit_icm20x", "ICM20948", 0x69),
    "icm20649": Chip("adafruit_icm20x", "ICM20649", 0x68),
    "mpu6050": Chip("adafruit_mpu6050", "MPU6050", 0x68),
}
"""By their names in ``imu.part``."""
PARTS = (*CHIPS, "serial")


@dataclass(frozen=True)
class ChipPart:
    """``imu.part`` of a chip: ``bus`` is the number in /dev/i2c-1, ``address`` None the usual one."""

    name: str
    bus: Natural = 1
    address: Natural | None = None


@dataclass(frozen=True)
class SerialPart:
    """``imu.part`` of an IMU that sends lines, as :class:`LineFormat` reads them; ``line`` None: the plain one."""

    name: str
    port: str | None = None
    baudrate: Count = 115_200
    line: str | None = None


class ChipImu(ThreadedImu):
    """A chip, which is asked at its rate."""

    def __init__(self, part: ChipPart, rate: float) -> None:
        """Open the bus, start the chip and wait for its first sample.

        Raises:
            SealegsError: the extra is not installed, there is no such bus or chip, or it gives nothing.
        """
        chip, self._period = CHIPS[part.name], 1.0 / rate
        with needed_for(f"the IMU {part.name}"):
            extended = importlib.import_module("adafruit_extended_bus")
            module = importlib.import_module(chip.module)
        address = chip.address if part.address is None else part.address
        try:
            self._bus = extended.ExtendedI2C(part.bus)
            self._driver = getattr(module, chip.driver)(self._bus, address=address)
            chip.prepare(self._driver, rate)
        except Exception as error:  # of a driver that is not ours
            raise ImuError(
                f"the IMU {part.name} does not answer at address {address:#x} of /dev/i2c-{part.bus}: {error}"
            ) from None
        self._chip, self._tilt, self._next = chip, Tilt(self._period), monotonic()
        super().__init__(f"{part.name} on /dev/i2c-{part.bus}")

    def read(self) -> tuple[np.ndarray, np.ndarray] | None:
        self._closing.wait(max(self._next - monotonic(), 0.0))
        self._next = max(self._next + self._period, monotonic())
        try:
            told = getattr(self._driver, self._chip.orientation or "acceleration")
            rate = self._driver.gyro
        except Exception as error:  # of a driver that is not ours: a spoilt packet is a PacketError, or a KeyError
            raise ImuError(f"its driver says {type(error).__name__} {error}") from None
        if told is None or rate is None or None in told or None in rate:  # a reading that the driver found spoilt
            return None
        told, rate = np.array(told, float), np.array(rate, float)
        if not self._chip.orientation:
            return self._tilt.after(told, rate), rate
        turn = np.roll(told, 1) if self._chip.real_last else told
        length = float(np.linalg.norm(turn))  # 0 before the chip has its bearings
        return (turn / length, rate) if length > 0.5 else None

    def close(self) -> None:
        super().close()
        self._bus.deinit()


def checked_part(document: Mapping[str, Any], switches: Sequence[str] = ()) -> ChipPart | SerialPart:
    """``imu.part`` of a robot's file.

    Args:
        document: it.
        switches: names of contact switches on the same board.

    Raises:
        SealegsError: the part is unknown, or lacks something.
    """
    name = document.get("name")
    if name not in PARTS:
        what = "is missing" if name is None else f"is {name!r}{nearest(str(name), PARTS)}"
        raise SealegsError(f"imu.part.name {what}: how the IMU is read; it may be {', '.join(PARTS)}.")
    if name != "serial":
        if switches:
            raise SealegsError(
                f"imu.switches: a {name} has no contact switches; let a microcontroller send them in lines with what "
                "the IMU says (imu.part.name=serial)."
            )
        return checked_fields("imu.part", dict(document), ChipPart)
    part = checked_fields("imu.part", dict(document), SerialPart)
    LineFormat.read(plain(switches) if part.line is None else part.line, switches)
    return part


def open_imu(document: Mapping[str, Any], rate: float, switches: Sequence[str] = ()) -> ImuSource:
    """The part that ``imu.part`` names, read from now on.

    Args:
        document: ``imu.part``.
        rate: samples per second [Hz].
        switches: names of contact switches on the same board.

    Raises:
        SealegsError: as :func:`checked_part`, or it cannot be read.
    """
    part = checked_part(document, switches)
    if isinstance(part, ChipPart):
        return ChipImu(part, rate)
    if part.port is None:
        raise SealegsError(
            "imu.part.port is missing: the serial port of the IMU, such as robot.imu.part.port=/dev/ttyACM0."
        )
    return LineImu(part.port, part.baudrate, part.line or plain(switches), rate, switches)


# --- IMUs that send lines of text over a serial port, in a format that the robot's YAML describes --------------------
#
#     line: "w, x, y, z, turn_x, turn_y, turn_z"
#     line: "$VNYMR, yaw [deg], pitch [deg], roll [deg], _, _, _, _, _, _, turn_x, turn_y, turn_z"
#     line: "acc_x [g], acc_y [g], acc_z [g], turn_x [deg/s], turn_y [deg/s], turn_z [deg/s]"
#
# Names stand for numbers, ``switch.<name>`` for a contact switch of the robot (closed above 0.5), ``_`` for one that
# is passed over, and any other word for itself: lines without it are other lines. What separates names separates
# numbers; a checksum behind ``*`` is left out.

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
