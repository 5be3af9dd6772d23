"""Causes that the joints of a robot share, sought over all joints together: masses, payload, inertia, a tilted base."""

from .search import ROBOT, SharedFound, affected, search_shared

__all__ = ["ROBOT", "SharedFound", "affected", "search_shared"]
