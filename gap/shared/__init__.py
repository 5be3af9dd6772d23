"""Causes that the joints of a robot share, sought over all joints together: masses, payload, inertia, a tilted base."""

from .directions import rows_of, tilt
from .problem import RobotModel, RobotProblem
from .search import LOADS, ROBOT, SharedFound, affected, laid, search_shared

__all__ = [
    "LOADS",
    "ROBOT",
    "RobotModel",
    "RobotProblem",
    "SharedFound",
    "affected",
    "laid",
    "rows_of",
    "search_shared",
    "tilt",
]
