"""What every converter needs: the recordings of a folder as tables, or one sentence that says what is missing."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ....actuators.errors import nearest
from ....actuators.extras import needed_for
from ..types import Array, LogError

with needed_for("Converting recordings"):
    import pandas as pd

BENCH_JOINT = "servo"
"""Name of the single joint in a converted bench recording."""


def source_files(folder: Path, pattern: str) -> list[Path]:
    """Return the files of ``folder`` that match ``pattern``, sorted by name.

    Raises:
        LogError: no such folder, or no such file in it.
    """
    if not folder.is_dir():
        raise LogError(f"{folder}: no such folder; give the folder that holds the {pattern} recordings")
    files = sorted(folder.glob(pattern))
    if not files:
        raise LogError(f"{folder}: holds no {pattern} recording")
    return files


def read_table(path: Path, needed: Iterable[str]) -> pd.DataFrame:
    """Read one recording, CSV or Parquet, and make sure that it has the columns ``needed``.

    Raises:
        LogError: damaged file, missing column, or a needed column that holds no numbers.
    """
    try:
        table = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)
    except (ValueError, OSError) as error:
        raise LogError(f"{path}: cannot be read: {str(error).splitlines()[0]}") from None
    for name in needed:
        if name not in table:
            raise LogError(f"{path}: the column '{name}' is missing{nearest(name, table.columns)}")
        if not (pd.api.types.is_numeric_dtype(table[name]) or pd.api.types.is_bool_dtype(table[name])):
            raise LogError(f"{path}: the column '{name}' holds text where numbers belong")
    return table


def column(table: pd.DataFrame, name: str) -> Array:
    """Return one column as float64."""
    return table[name].to_numpy(dtype=np.float64)
