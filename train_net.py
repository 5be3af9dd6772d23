"""Train an actuator net: ``sealegs train-net`` from a checkout. ``python train_net.py --help`` tells the rest."""

import sys

try:
    from sealegs.commands.cli import main
except ModuleNotFoundError as missing:
    sys.exit(f"This Python has no {missing.name}: run `make setup` once, then .venv/bin/python train_net.py.")

if __name__ == "__main__":
    sys.exit(main(["train-net", *sys.argv[1:]]))
