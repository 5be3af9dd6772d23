"""Measure, diagnose, extend, train, deploy and compare: ``sealegs loop`` from a checkout."""

import sys

try:
    from sealegs.commands.cli import main
except ModuleNotFoundError as missing:
    sys.exit(f"This Python has no {missing.name}: run `make setup` once, then .venv/bin/python loop.py.")

if __name__ == "__main__":
    sys.exit(main(["loop", *sys.argv[1:]]))
