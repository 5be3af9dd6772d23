"""Explain a gap from measured logs: ``sealegs diagnose`` from a checkout."""

import sys

try:
    from sealegs.commands.cli import main
except ModuleNotFoundError as missing:
    sys.exit(f"This Python has no {missing.name}: run `make setup` once, then .venv/bin/python diagnose.py.")

if __name__ == "__main__":
    sys.exit(main(["diagnose", *sys.argv[1:]]))
