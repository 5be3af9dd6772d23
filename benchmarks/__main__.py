"""Measure the speed and write ``benchmarks/results``; takes a few minutes, ``--quick`` less."""

from __future__ import annotations

import os
import platform
import sys
from typing import Any

import mujoco

from benchmarks.kept import command, read, study, write
from benchmarks.speed import ROBOTS, physics, told, training


@study
def main() -> None:
    """Measure what was asked for."""
    parser = command(__doc__)
    parser.add_argument("what", nargs="?", choices=("physics", "training", "all"), default="all")
    parser.add_argument("--quick", action="store_true", help="short repeats; prints, writes nothing")
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS), help="others keep their rows")
    arguments = parser.parse_args()
    machine = {
        "cores": os.cpu_count(),
        "processor": platform.machine(),
        "mujoco": mujoco.__version__,
        "python": platform.python_version(),
    }
    results: dict[str, Any] = {name: read(name, None) for name in ("physics", "training")}
    if arguments.what != "training":
        old = [row for row in results["physics"] or [] if row["robot"] not in arguments.robots]
        new = physics(*((0.03, 9) if arguments.quick else (0.03, 61)), _print_physics, arguments.robots)
        results["physics"] = sorted([*old, *new], key=lambda row: list(ROBOTS).index(row["robot"]))
    if arguments.what != "physics":
        results["training"] = training(*((2, 1) if arguments.quick else (3, 5)), print)
    page = told(results["physics"] or [], results["training"], machine)
    if not arguments.quick:
        for name, value in results.items():
            write(name, None, value or None)
        write("speed", page)
    print("\n" + page)


def _print_physics(row: dict[str, Any]) -> None:
    print(
        f"{row['robot']:7s} {row['chain']:11s} {row['simulations']:5d} simulations: ratio {row['ratio']:.2f}",
        flush=True,
    )


if __name__ == "__main__":
    sys.exit(main())
