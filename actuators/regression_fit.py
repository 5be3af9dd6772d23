"""From brake bench measurements to the regression stage: paper 004, section III-C."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..common.atomic import written
from ..common.errors import SealegsError, nearest
from .brake_bench import BenchTable

RPM = np.pi / 30.0  # [rad/s]
COLUMNS = ("duty", "speed", "torque", "temperature", "valid")
OTHER_UNITS = {"speed_rpm": ("speed", RPM), "torque_nmm": ("torque", 1e-3)}


@dataclass(frozen=True)
class RegressionFit:
    """``torque = duty_torque duty + speed_torque speed + constant``.

    Attributes:
        duty_torque: [N.m].
        speed_torque: [N.m.s/rad].
        constant: [N.m].
        points: measurements that it was fitted to.
        rms: of the torque residual [N.m].
        r2: share of the torque's variance that it explains [-].
    """

    duty_torque: float
    speed_torque: float
    constant: float
    points: int = 0
    rms: float = 0.0
    r2: float = 1.0

    def printed(self) -> str:
        """The fit as the paper prints it, in N.mm and rpm."""
        n = 1e3 * self.speed_torque * RPM
        return f"{1e3 * self.duty_torque:.2f} PWM {n:+.2f} n {1e3 * self.constant:+.2f}"

    def torque(self, duty: NDArray[np.float64], speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Predicted torque [N.m]."""
        return self.duty_torque * duty + self.speed_torque * speed + self.constant


HIGH, SLOW, USED = 0.6, 3.0, 0.8
"""From which PWM [-], up to which speed [rad/s] and torque [N.m] the parts of :func:`misses` reach; the torque is the
paper's range of use, the others are assumed."""


def misses(table: BenchTable, fit: RegressionFit) -> dict[str, float]:
    """How far a line misses the usable rows of a table, rms [N.m], where the paper looks at it (III-C); nan: no rows.

    A servo is no line where its supply sags, its gear loses more under load or its friction falls with speed.
    """
    rows = table.where(usable(table))
    predicted = fit.torque(rows.duty, rows.speed)
    error, small = rows.torque - predicted, np.abs(predicted) < USED
    parts = {
        "high PWM, low speed": (np.abs(rows.duty) >= HIGH) & (np.abs(rows.speed) <= SLOW),
        f"below {USED:g} N.m": small,
        f"above {USED:g} N.m": ~small,
    }
    return {
        name: float(np.sqrt(np.mean(np.square(error[chosen])))) if chosen.any() else float("nan")
        for name, chosen in parts.items()
    }


EQUATION_3 = RegressionFit(1.80438, -16.96e-3 / RPM, -0.13978, points=4419)
"""Paper 004, equation (3): torque [N.mm] = 1804.38 PWM - 16.96 n [rpm] - 139.78."""


def usable(table: BenchTable) -> NDArray[np.bool_]:
    """Rows that count: valid, and within two standard deviations of the line of their PWM (section III-C).

    For a constant PWM torque is linear in speed (equation (2)), so each PWM has its own line of torque over speed.
    """
    kept = table.valid.copy()
    for duty in np.unique(table.duty[kept]):
        rows = np.flatnonzero(kept & (table.duty == duty))
        if len(rows) < 4 or np.ptp(table.speed[rows]) == 0.0:
            continue
        line = np.polynomial.Polynomial.fit(table.speed[rows], table.torque[rows], 1)
        residual = table.torque[rows] - line(table.speed[rows])
        kept[rows[np.abs(residual) > 2.0 * residual.std()]] = False
    return kept


def fit_regression(table: BenchTable) -> RegressionFit:
    """Least squares over the usable rows of a table.

    Raises:
        SealegsError: the rows do not determine three coefficients.
    """
    rows = table.where(usable(table))
    if len(rows) < 3:
        raise SealegsError(
            f"the brake bench table has {len(rows)} valid measurements; a regression needs at least 3, "
            "at several duties and loads."
        )
    inputs = np.column_stack([rows.duty, rows.speed, np.ones(len(rows))])
    size = np.linalg.norm(inputs, axis=0)
    if np.any(size == 0.0) or np.linalg.cond(inputs / np.where(size == 0.0, 1.0, size)) > 1e6:
        raise SealegsError(
            "the brake bench table does not tell duty and speed apart (one duty only, or one load only); "
            "measure at several of both."
        )
    coefficients, *_ = np.linalg.lstsq(inputs, rows.torque, rcond=None)
    residual = rows.torque - inputs @ coefficients
    spread = float(np.sum((rows.torque - rows.torque.mean()) ** 2))
    return RegressionFit(
        *(float(value) for value in coefficients),
        points=len(rows),
        rms=float(np.sqrt(np.mean(residual**2))),
        r2=1.0 - float(np.sum(residual**2)) / spread if spread > 0.0 else 1.0,
    )


def write_table(table: BenchTable, path: Path) -> None:
    """Write a table as CSV with the columns duty, speed [rad/s], torque [N.m], temperature [degC], valid."""
    with written(path) as fresh, fresh.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for row in zip(table.duty, table.speed, table.torque, table.temperature, table.valid, strict=True):
            writer.writerow([*("" if np.isnan(value) else f"{value:.9g}" for value in row[:4]), int(row[4])])


def read_table(path: Path) -> BenchTable:
    """Read the CSV of a brake bench.

    Columns: ``duty`` (-1 to 1); ``speed`` [rad/s] or ``speed_rpm``; ``torque`` [N.m] or ``torque_nmm``; where known
    ``temperature`` [degC] and ``valid`` (0 or 1). Speed and torque have the sign of the duty where the servo drives.

    Raises:
        SealegsError: the file cannot be read, a column is missing or unknown, or a value makes no sense.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SealegsError(f"cannot read the table {path}: {getattr(error, 'strerror', None) or error}.") from None
    if len(rows) < 2:
        raise SealegsError(f"{path} holds no measurements; it needs a line of column names and one line each.")
    names = [name.strip() for name in rows[0]]
    known = (*COLUMNS, *OTHER_UNITS)
    for name in names:
        if name not in known:
            raise SealegsError(
                f"{path} has an unknown column '{name}'{nearest(name, known)}; it may have {', '.join(known)}."
            )
    columns: dict[str, NDArray[np.float64]] = {}
    for k, name in enumerate(names):
        quantity, factor = OTHER_UNITS.get(name, (name, 1.0))
        if quantity in columns:
            raise SealegsError(f"{path} gives {quantity} twice; keep one of its columns.")
        columns[quantity] = factor * np.array([_cell(path, name, i, row, k) for i, row in enumerate(rows[1:], 2)])
    for name in ("duty", "speed", "torque"):
        if name not in columns:
            raise SealegsError(f"{path} lacks the column '{name}'; it has {', '.join(names)}.")
    size = len(rows) - 1
    valid = columns.get("valid", np.ones(size)) == 1.0
    table = BenchTable(
        columns["duty"], columns["speed"], columns["torque"], columns.get("temperature", np.full(size, np.nan)), valid
    )
    _check(table, path)
    return table


def _cell(path: Path, name: str, line: int, row: list[str], k: int) -> float:
    text = row[k].strip() if k < len(row) else ""
    if not text:
        return float("nan")
    try:
        return float(text)
    except ValueError:
        raise SealegsError(f"{path}, line {line}: {name} is {text!r}, not a number.") from None


def _check(table: BenchTable, path: Path) -> None:
    largest = np.nanmax(np.abs(table.duty)) if np.isfinite(table.duty).any() else float("nan")
    if not largest <= 1.0:
        raise SealegsError(f"{path}: duty reaches {largest:g}; give it as a share of full, 0.5 for 50 %.")
    if not table.valid.any():
        raise SealegsError(f"{path}: no measurement is marked valid.")
    for name in ("duty", "speed", "torque"):
        bad = np.flatnonzero(table.valid & ~np.isfinite(getattr(table, name)))
        if bad.size:
            raise SealegsError(
                f"{path}, line {bad[0] + 2}: {name} is missing in a valid measurement; fill it in or set 'valid' to 0."
            )
    moving = table.valid & (table.duty != 0.0)
    braked = np.mean(table.speed[moving] * table.duty[moving] >= 0.0) if moving.any() else 1.0
    if braked < 0.5:
        raise SealegsError(f"{path}: speed and duty have opposite signs in most rows; turn the sign of one of them.")
