"""Film a policy: ``sealegs watch`` from a checkout. ``python watch.py --help`` tells the rest."""

import sys

try:
    from sealegs.commands.cli import main
except ModuleNotFoundError as missing:
    sys.exit(f"This Python has no {missing.name}: run `make setup` once, then .venv/bin/python watch.py.")

if __name__ == "__main__":
    sys.exit(main(["watch", *sys.argv[1:]]))
