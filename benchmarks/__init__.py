"""Measurements of speed and of numerical accuracy; their results are committed in ``benchmarks/results``."""

import sys

try:
    import numpy  # noqa: F401
    import sealegs  # noqa: F401
except ModuleNotFoundError as missing:
    sys.exit(f"This Python has no {missing.name}: run `make setup` once, then .venv/bin/python -m benchmarks.")
