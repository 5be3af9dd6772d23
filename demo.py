"""The main job, once: ``sealegs demo`` from a checkout. ``python demo.py --help`` tells the rest."""

import sys

try:
    from sealegs.commands.cli import main
except ModuleNotFoundError as missing:
    sys.exit(f"This Python has no {missing.name}: run `make setup` once, then .venv/bin/python demo.py.")

if __name__ == "__main__":
    sys.exit(main(["demo", *sys.argv[1:]]))
