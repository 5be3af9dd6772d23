"""Measure the speed and write ``benchmarks/results``; takes a few minutes, ``--quick`` less."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from typing import Any

import mujoco

from benchmarks.speed import RESULTS, ROBOTS, physics, table, training


def main() -> int:
    """Measure what was asked for; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
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
    results: dict[str, Any] = {name: _read(name) for name in ("physics", "training")}
    try:
        if arguments.what != "training":
            old = [row for row in results["physics"] or [] if row["robot"] not in arguments.robots]
            new = physics(*((0.03, 9) if arguments.quick else (0.03, 61)), _print_physics, arguments.robots)
            results["physics"] = sorted([*old, *new], key=lambda row: list(ROBOTS).index(row["robot"]))
        if arguments.what != "physics":
            results["training"] = training(*((2, 1) if arguments.quick else (3, 5)), print)
    except KeyboardInterrupt:
        print("Stopped; the results of the last whole measurement stay.", file=sys.stderr)
        return 130
    page = table(results["physics"] or [], results["training"], machine)
    if not arguments.quick:
        RESULTS.mkdir(parents=True, exist_ok=True)
        for name, value in results.items():
            if value:
                (RESULTS / f"{name}.json").write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")
        (RESULTS / "speed.md").write_text(page, encoding="utf-8")
    print("\n" + page)
    return 0


def _read(name: str) -> Any:
    path = RESULTS / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def _print_physics(row: dict[str, Any]) -> None:
    print(
        f"{row['robot']:7s} {row['chain']:11s} {row['simulations']:5d} simulations: ratio {row['ratio']:.2f}",
        flush=True,
    )


if __name__ == "__main__":
    sys.exit(main())
