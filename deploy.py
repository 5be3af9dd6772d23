"""Run a policy or an excitation on servos: ``sealegs deploy`` from a checkout."""

import sys

try:
    from sealegs.commands.cli import main
except ModuleNotFoundError as missing:
    sys.exit(f"This Python has no {missing.name}: run `make setup` once, then .venv/bin/python deploy.py.")

if __name__ == "__main__":
    sys.exit(main(["deploy", *sys.argv[1:]]))
