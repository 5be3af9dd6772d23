"""A fleet: many servos, one data set each, diagnosed side by side, and a table of which of them share a cause."""

from .jobs import Job, Outcome, find_jobs
from .run import diagnose_fleet
from .table import Row, Shared, rows_of, shared_causes, write_table

__all__ = [
    "Job",
    "Outcome",
    "Row",
    "Shared",
    "diagnose_fleet",
    "find_jobs",
    "rows_of",
    "shared_causes",
    "write_table",
]
