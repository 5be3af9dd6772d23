"""The measured log: types, reader and writer in one place to import from."""

from gap.log_reader import iterate_runs, read_measured
from gap.log_types import SIGNAL_UNITS, JointLog, LogError, MeasuredRun, MeasuredSet
from gap.log_writer import write_run

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
