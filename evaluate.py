"""Compare a policy or a robot with models, machine and paper: ``sealegs evaluate`` from a checkout."""

import sys

try:
    from sealegs.commands.cli import main
except ModuleNotFoundError as missing:
    sys.exit(f"This Python has no {missing.name}: run `make setup` once, then .venv/bin/python evaluate.py.")

if __name__ == "__main__":
    sys.exit(main(["evaluate", *sys.argv[1:]]))
