"""A joint's trip from its log to a verdict: ``python -m benchmarks.trip [log]`` prints the files of the finder that a
diagnosis enters, and its climbs.

A climb is a call against the arrow of imports: a pair of files of which the called one imports the caller's, if only
over others, as where a callback leads back up. Without a log, one is recorded on the virtual bench. The joint is
diagnosed twice, so that no import counts.
"""

from __future__ import annotations

import sys
import tempfile
import threading
from pathlib import Path
from types import FrameType

import grimp
import sealegs
from sealegs.gap.virtual.bench import record

from benchmarks.kept import command, study

FINDER = "sealegs.gap."


class Trip:
    """What a profiler sees of the finder.

    Attributes:
        rooms: names of the files whose functions ran.
        calls: caller and called, where they are of two files; what is called over others counts for the nearest caller.
    """

    def __init__(self) -> None:
        """See nothing yet."""
        self.rooms: set[str] = set()
        self.calls: set[tuple[str, str]] = set()

    def __call__(self, frame: FrameType, event: str, argument: object) -> None:
        """What `sys.setprofile` takes."""
        room = frame.f_globals.get("__name__", "")
        if event != "call" or not room.startswith(FINDER) or frame.f_code.co_name == "<module>":
            return
        self.rooms.add(room)
        caller = frame.f_back
        while caller is not None and not caller.f_globals.get("__name__", "").startswith(FINDER):
            caller = caller.f_back
        if caller is not None and (name := caller.f_globals["__name__"]) != room:
            self.calls.add((name, room))


def trip_of(log: Path) -> Trip:
    """Diagnose a joint in this process, and see where the diagnosis goes."""
    sealegs.diagnose(log)
    trip = Trip()
    threading.setprofile(trip)
    sys.setprofile(trip)
    try:
        print(sealegs.diagnose(log).sentence)
    finally:
        sys.setprofile(None)
        threading.setprofile(None)  # type: ignore[arg-type]
    return trip


def climbs(trip: Trip) -> list[tuple[str, str]]:
    """Calls against the arrow of imports."""
    graph = grimp.build_graph("sealegs")
    above = {room: graph.find_downstream_modules(room) for room, _ in trip.calls}
    return sorted((caller, called) for caller, called in trip.calls if called in above[caller])


@study
def main() -> None:
    """Command line."""
    parser = command(__doc__)
    parser.add_argument("log", nargs="?", type=Path)
    asked = parser.parse_args().log
    with tempfile.TemporaryDirectory() as folder:
        if asked is None:
            record(Path(folder) / "bench", "sts3215", {"friction.coulomb": 0.12})
        trip = trip_of(asked or Path(folder) / "bench")
    against = climbs(trip)
    folders = {room.split(".")[2] for room in trip.rooms}
    print(f"{len(trip.rooms)} files in {len(folders)} folders, {len(trip.calls)} pairs of them, {len(against)} climbs")
    for caller, called in against:
        print(f"  {caller.removeprefix(FINDER)} calls {called.removeprefix(FINDER)}")


if __name__ == "__main__":
    sys.exit(main())
