"""The table of a fleet: what each servo has, which of them share a cause, and how its values spread over them."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from ...common.atomic import written
from ..checks.signal import Z95
from .jobs import Outcome

COLUMNS: tuple[str, ...] = (
    "servo", "verdict", "nominal_rmse", "extended_rmse", "noise_floor", "cause", "kind", "share", "confidence",
    "parameter", "value", "low", "high", "unit", "nominal", "sentence",
)  # fmt: skip
NOT_DIAGNOSED = "not diagnosed"


@dataclass(frozen=True)
class Row:
    """One servo: a joint of one data set.

    Attributes:
        servo: folder, with the joint where the folder has several.
        folder: of the data set.
        verdict, sentence: of the diagnosis; :data:`NOT_DIAGNOSED` and why where there is none.
        gap: error by model, as in ``diagnosis.json``.
        causes: as in ``diagnosis.json``, errors of the log behind them.
    """

    servo: str
    folder: str
    verdict: str
    sentence: str
    gap: dict[str, Any]
    causes: tuple[dict[str, Any], ...]

    @property
    def errors(self) -> str:
        """Error of the nominal and of the extended model, with their unit; empty where one is missing."""
        nominal, extended = ((self.gap.get(name) or {}).get("rmse") for name in ("nominal", "extended"))
        if nominal is None or extended is None:
            return ""
        unit = self.gap.get("unit", "rad")
        size, unit = (1e3, f"m{unit}") if unit in ("rad", "m") else (1.0, unit)
        return f"{size * nominal:.3g} → {size * extended:.3g} {unit}".removesuffix(" 1")

    @property
    def failed(self) -> bool:
        """Whether there is no diagnosis."""
        return self.verdict == NOT_DIAGNOSED


@dataclass(frozen=True)
class Shared:
    """One cause over a fleet.

    Attributes:
        name: of the cause.
        servos: that have it.
        parameter, unit: its first parameter.
        values: (value, low, high) of its first parameter, by servo; one that has the cause in another form has none.
        middle: median value.
        spread: standard deviation of the values over servos; 0 for one.
        common: whether one value lies within the interval of every servo, widened to what so many intervals need.
    """

    name: str
    servos: tuple[str, ...]
    parameter: str
    unit: str
    values: Mapping[str, tuple[float, float, float]]
    middle: float
    spread: float
    common: bool

    @property
    def sentence(self) -> str:
        """For people."""
        values = [value for value, _, _ in self.values.values()]
        if not values:
            return f"{self.name}: {len(self.servos)} servos."
        size = f"{self.parameter} = {self.middle:.4g} {self.unit}".removesuffix(" 1").rstrip()
        if len(self.servos) == 1:
            return f"{self.name}: {self.servos[0]} alone, {size}."
        if len(values) == 1:
            return f"{self.name}: {len(self.servos)} servos, {next(iter(self.values))} with {size}."
        range_ = f"{min(values):.4g} to {max(values):.4g}, standard deviation {self.spread:.2g}"
        same = "one value fits all of them" if self.common else "they differ by more than their intervals"
        return f"{self.name}: {len(self.servos)} servos, median {size} ({range_}); {same}."


def rows_of(outcomes: Sequence[Outcome]) -> list[Row]:
    """The rows of a table, by name."""
    rows = []
    for outcome in sorted(outcomes, key=lambda outcome: outcome.name):
        if outcome.document is None:
            rows.append(Row(outcome.name, outcome.name, NOT_DIAGNOSED, outcome.error, {}, ()))
            continue
        joints = outcome.document.get("joints") or [outcome.document]
        for joint in joints:
            name = outcome.name if len(joints) == 1 else f"{outcome.name}/{joint['joint']}"
            faults = [_fault(error) for error in joint.get("data_errors", ())]  # version 1 has them among the causes
            rows.append(
                Row(name, outcome.name, joint["verdict"], joint["sentence"], joint["gap"], (*joint["causes"], *faults))
            )
    return rows


def _fault(error: Mapping[str, Any]) -> dict[str, Any]:
    """An error of the log, as a row of the table has it: it may be shared like a cause, and has no share of a gap."""
    return {"name": error["name"], "kind": "data", "share": 0.0, "confidence": "", "parameters": error["values"]}


def shared_causes(rows: Sequence[Row]) -> list[Shared]:
    """Every cause that a servo has, the most common one first."""
    names: dict[str, list[tuple[str, dict[str, Any]]]] = {}
    for row in rows:
        for cause in row.causes:
            names.setdefault(cause["name"], []).append((row.servo, cause))
    found = []
    for name, having in names.items():
        first = [next(iter(cause["parameters"].items()), None) for _, cause in having]
        parameters = [item[0] for item in first if item is not None]
        parameter = max(set(parameters), key=parameters.count) if parameters else ""
        values: dict[str, tuple[float, float, float]] = {}
        unit = ""
        for servo, cause in having:
            value = cause["parameters"].get(parameter)
            if value is not None:  # two wrong columns of a servo are one cause of it: the first one's value
                values.setdefault(servo, (float(value["value"]), float(value["low"]), float(value["high"])))
                unit = value["unit"]
        numbers = [value for value, _, _ in values.values()]
        found.append(
            Shared(
                name,
                servos=tuple(dict.fromkeys(servo for servo, _ in having)),
                parameter=parameter,
                unit=unit,
                values=values,
                middle=median(numbers) if numbers else float("nan"),
                spread=float(np.std(numbers, ddof=1)) if len(numbers) > 1 else 0.0,
                common=_common(list(values.values())),
            )
        )
    return sorted(found, key=lambda cause: (-len(cause.servos), cause.name))


def _common(values: Sequence[tuple[float, float, float]]) -> bool:
    """Chi-squared test that one value is behind all of them, from the widths of their intervals."""
    if len(values) < 2:
        return True
    from scipy.stats import chi2

    centre = np.array([value for value, _, _ in values])
    deviation = np.array([max(high - low, 1e-12) / (2.0 * Z95) for _, low, high in values])
    mean = np.sum(centre / deviation**2) / np.sum(1.0 / deviation**2)
    return bool(np.sum(((centre - mean) / deviation) ** 2) < chi2.ppf(0.99, len(values) - 1))


def write_table(rows: Sequence[Row], path: Path) -> None:
    """Write ``fleet.csv``: one line per servo, cause and parameter; one line for a servo without a cause."""
    with written(path, replace=True) as fresh, fresh.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS, restval="", lineterminator="\n")
        table.writeheader()
        for row in rows:
            errors = {
                "nominal_rmse": (row.gap.get("nominal") or {}).get("rmse", ""),
                "extended_rmse": (row.gap.get("extended") or {}).get("rmse", ""),
                "noise_floor": (row.gap.get("noise_floor") or {}).get("rmse", ""),
            }
            line = {"servo": row.servo, "verdict": row.verdict, **errors, "sentence": row.sentence}
            if not row.causes:
                table.writerow(line)
            for cause in row.causes:
                mine = {"cause": cause["name"], **{key: cause[key] for key in ("kind", "share", "confidence")}}
                for path_, value in (cause["parameters"] or {"": {}}).items():
                    table.writerow({**line, **mine, "parameter": path_, **value})
