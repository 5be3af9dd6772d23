"""Command line of the converters."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ....actuators.errors import SealegsError
from . import CONVERTERS


def main(arguments: list[str] | None = None) -> int:
    """Convert a folder of recordings; return the exit status (2: wrong input, 130: stopped)."""
    parser = argparse.ArgumentParser(
        prog="sealegs import",
        description="Turn published recordings of real machines into measured logs that sealegs diagnose reads.",
        epilog="Example: sealegs import xl330 ../shared/data/xl330_pendulum outputs/xl330",
    )
    parser.add_argument("machine", choices=sorted(CONVERTERS), help="which recordings the source folder holds")
    parser.add_argument("source", type=Path, metavar="source-folder", help="folder with the recordings; only read")
    parser.add_argument("target", type=Path, metavar="target-folder", help="folder to write to; nothing is overwritten")
    options = parser.parse_args(arguments)
    try:
        written = CONVERTERS[options.machine](options.source, options.target)
    except SealegsError as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("Stopped; the logs written so far are complete.", file=sys.stderr)
        return 130
    print(f"{len(written)} measured logs in {options.target}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
