"""A fleet: many servos, one data set each, diagnosed side by side, and a table of which of them share a cause."""

from gap.fleet.jobs import Job, Outcome, find_jobs
from gap.fleet.run import diagnose_fleet
from gap.fleet.table import Row, Shared, rows_of, shared_causes, write_table

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
