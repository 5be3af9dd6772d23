"""Measured logs from memory: columns as arrays or a table, and what a sidecar would say as a dict."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from .reader import build_run, driven_joints, only_joint
from .sidecar import Sidecar, checked_sidecar
from .table import check_columns, with_joint
from .types import Array, LogError, MeasuredRun, MeasuredSet


@runtime_checkable
class Table(Protocol):
    """A data frame: named columns, as of pandas or Polars."""

    @property
    def columns(self) -> Any:  # pandas declares a descriptor, which no checker takes for an iterable
        """Names of the columns."""
        ...

    def __getitem__(self, key: Any, /) -> Any:
        """A column by its name."""
        ...


Columns = Mapping[str, Any] | Table
"""Columns of one run by name, as in docs/log-format.md: ``time``, ``<joint>.goal``, ``<joint>.position``, ..."""
InMemory = MeasuredSet | MeasuredRun | Columns | Sequence[MeasuredRun | Columns]


def measured_set(
    runs: InMemory, sidecar: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None, name: str = "log"
) -> MeasuredSet:
    """Runs in memory as one data set.

    Args:
        runs: one run or several, measured runs or columns.
        sidecar: of all runs, or one for each; measured runs have their own.
        name: of the set.

    Raises:
        LogError: one sentence on what is wrong, with run and column.
    """
    if isinstance(runs, MeasuredSet):
        return runs
    several: list[MeasuredRun | Columns] = list(runs) if isinstance(runs, Sequence) else [runs]
    if not several:
        raise LogError("there is no run in the log; give one run or more.")
    sidecars = [None] * len(several) if sidecar is None else sidecar
    if isinstance(sidecars, str) or not isinstance(sidecars, Mapping | Sequence):
        raise LogError(
            f"sidecar={sidecar!r} is no sidecar; give a dict such as {{'robot': 'bench', 'robot_params': {{...}}, "
            "'actuators': {'<joint>': '<chain>'}}, or one for each run."
        )
    if isinstance(sidecars, Mapping):
        sidecars = [sidecars] * len(several)
    if len(sidecars) != len(several):
        raise LogError(
            f"there are {len(several)} runs and {len(sidecars)} sidecars; give one for all, or one for each."
        )
    built = [_run(run, side, f"run{k}") for k, (run, side) in enumerate(zip(several, sidecars, strict=True), 1)]
    for run in built:
        if run.robot != built[0].robot:
            raise LogError(
                f"{built[0].name} is a run of robot {built[0].robot!r}, {run.name} one of {run.robot!r}; diagnose one "
                "machine at a time."
            )
    return MeasuredSet(tuple(built), name)


def _run(run: MeasuredRun | Columns, sidecar: Mapping[str, Any] | None, name: str) -> MeasuredRun:
    if isinstance(run, MeasuredRun):
        return run
    columns = run.keys() if isinstance(run, Mapping) else run.columns if isinstance(run, Table) else None
    if columns is None:
        raise LogError(
            f"{name} is {type(run).__name__}; a log is a path, a measured run, a data frame, or a dict of columns."
        )
    if sidecar is None:
        raise LogError(
            f"{name} has no sidecar; give sidecar={{'robot': 'bench', 'robot_params': {{...}}, 'actuators': "
            "{'<joint>': '<chain>'}}."
        )
    checked: Sidecar = checked_sidecar(sidecar, f"the sidecar of {name}")
    table = {str(column): _column(run[column], str(column), name) for column in columns}
    lengths = {column: len(values) for column, values in table.items()}
    if len(set(lengths.values())) > 1:
        short, long = min(lengths, key=lengths.__getitem__), max(lengths, key=lengths.__getitem__)
        raise LogError(
            f"{name}: column '{short}' has {lengths[short]} samples and '{long}' has {lengths[long]}; columns of a run "
            "are equally long."
        )
    table = dict(zip(with_joint(list(table), only_joint(checked)), table.values(), strict=True))
    check_columns(list(table), Path(name), driven_joints(checked))
    return dataclasses.replace(build_run(name, table, checked, Path(name), 0), source=None)


def _column(values: Any, column: str, name: str) -> Array:
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise LogError(f"{name}: column '{column}' holds values that are no numbers; convert or remove them.") from None
    if array.ndim != 1:
        raise LogError(f"{name}: column '{column}' has the shape {array.shape}; a column is one number per sample.")
    return array
