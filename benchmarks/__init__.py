"""Measurements of speed and of numerical accuracy; their results are committed in ``benchmarks/results``."""

import functools
import sys
from collections.abc import Callable

try:
    import numpy  # noqa: F401
    import sealegs  # noqa: F401
except ModuleNotFoundError as missing:
    sys.exit(f"This Python has no {missing.name}: run `make setup` once, then .venv/bin/python -m benchmarks.")


def study(main: Callable[[], None]) -> Callable[[], int]:
    """A study that keeps its rows as they are made, as the main function of a script.

    Returns:
        Its exit status: 0; 2 for wrong input, which is told in a sentence; 130 where it is stopped.
    """
    from sealegs.common.errors import SealegsError

    @functools.wraps(main)
    def run() -> int:
        try:
            main()
        except SealegsError as error:
            print(error, file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            print("Stopped; rows that are done stay.", file=sys.stderr)
            return 130
        return 0

    return run
