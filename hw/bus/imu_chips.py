"""IMUs on an I2C bus of the computer, through Adafruit's drivers (extra ``imu``); and what ``imu.part`` may name."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Any

import numpy as np

from ...common.errors import SealegsError, nearest
from ...common.extras import needed_for
from ...configs.check import Count, Natural, checked_fields
from .imu import ImuError, ImuSource, ThreadedImu
from .imu_fusion import Tilt
from .imu_line import LineFormat, LineImu, plain


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
    """``imu.part`` of an IMU that sends lines, see :mod:`sealegs.hw.bus.imu_line`; ``line`` None: the plain one."""

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
