"""Configs: one folder per choice, one file per script, and the code that reads them."""

import importlib.util
import sys

# Scripts begin here: a person who runs one with another Python gets a sentence instead of a traceback.
if importlib.util.find_spec("hydra") is None or importlib.util.find_spec("numba") is None:
    sys.exit("The project's packages are not in this Python: run `make setup` once, then .venv/bin/python <script>.")
