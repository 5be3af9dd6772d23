"""Fit a servo's torque from a brake bench: ``sealegs characterize`` from a checkout."""

import sys

try:
    from sealegs.commands.cli import main
except ModuleNotFoundError as missing:
    sys.exit(f"This Python has no {missing.name}: run `make setup` once, then .venv/bin/python characterize.py.")

if __name__ == "__main__":
    sys.exit(main(["characterize", *sys.argv[1:]]))
