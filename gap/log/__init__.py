"""The measured log: types, reader and writer in one place to import from."""

from .reader import iterate_runs, read_measured, write_run
from .types import SIGNAL_UNITS, JointLog, LogError, MeasuredRun, MeasuredSet

__all__ = [
    "SIGNAL_UNITS",
    "JointLog",
    "LogError",
    "MeasuredRun",
    "MeasuredSet",
    "iterate_runs",
    "read_measured",
    "write_run",
]
