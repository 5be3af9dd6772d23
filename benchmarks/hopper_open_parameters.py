"""What the hopper's paper leaves open: the search for link lengths, and how much each choice matters.

    python -m benchmarks.hopper_open_parameters

Writes benchmarks/results/hopper_open_parameters.md. Every row runs the same controller with and without actuator (8 s,
the first 2 s left out).
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from sealegs.actuators import Chain, load_chain
from sealegs.common.errors import SealegsError
from sealegs.common.markdown import table
from sealegs.envs.hopper.parameters import NUMBERS
from sealegs.papers.hopper.paper import CHAINS, PRINTED, Legs, measure

from benchmarks.kept import RESULTS, command, study

OUT = RESULTS / "hopper_open_parameters.md"
SECONDS = 8.0
UPPER = (0.088, 0.092, 0.096, 0.100, 0.104, 0.108, 0.112, 0.116)
LOWER = (0.084, 0.088, 0.092, 0.096, 0.100)
INTEGRATORS = {
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "RK4": mujoco.mjtIntegrator.mjINT_RK4,
    "Euler": mujoco.mjtIntegrator.mjINT_EULER,
}


HEAD = """# What the hopper's paper leaves open

The reference controller for 8 s with each value, of which the first 2 s are left out. "cm" is the jump height, "m/s"
the speed forward, and the last column the rms of the four relative errors. Made by `python -m
benchmarks.hopper_open_parameters`.
"""


def say(line: str) -> None:
    """Print a line and add it to the page."""
    print(line, flush=True)
    with OUT.open("a", encoding="utf-8") as page:
        page.write(line + "\n")


def row(label: str, params: Mapping[str, float] | None = None, servo: Chain | None = None, **legs: Any) -> None:
    """Run both cases and print a line; its last column is the rms of the relative errors of frequency and height."""
    cells, errors = [], []
    for name, chain in CHAINS.items():
        try:
            figures = measure(
                Legs(servo if servo and name == "with actuator" else chain, params=params, **legs).hop(SECONDS)
            )
        except SealegsError:
            cells.append("| does not hop | - | - ")
            errors += [1.0, 1.0]
            continue
        cells.append(f"| {figures.frequency:.2f} | {100 * figures.height:.1f} | {figures.speed:.2f} ")
        printed = PRINTED[name]
        errors += [figures.frequency / printed.frequency - 1.0, figures.height / printed.height - 1.0]
    error = float(np.sqrt(np.mean(np.square(errors))))
    say(f"| {label} {''.join(cells)}| {error:.0%} |")


def head(title: str) -> None:
    """Start a table."""
    say(f"\n## {title}\n\n{table(('', 'with: Hz', 'cm', 'm/s', 'without: Hz', 'cm', 'm/s', 'rms error'), ())}")


@study
def main() -> None:
    """Write all tables."""
    command(__doc__).parse_args()
    OUT.write_text(HEAD, encoding="utf-8")
    head("Lengths of upper and lower link [m]")
    for upper in UPPER:
        for lower in LOWER:
            row(f"{upper:.3f}, {lower:.3f}", {"upper_length": upper, "lower_length": lower})
    head("Other numbers that the paper leaves open, one at a time")
    row("as chosen")
    for name, values in (
        ("upper_centre", (0.4, 0.6)),
        ("lower_centre", (0.4, 0.6)),
        ("foot_radius", (0.005, 0.015)),
        ("contact_time", (0.003, 0.01, 0.02)),
        ("floor_friction", (0.7, 1.5)),
    ):
        for value in values:
            unit = NUMBERS[name].unit
            row(f"{name} {value:g}{'' if unit == '-' else ' ' + unit}", {name: value})
    head("Servo")
    servo = load_chain(CHAINS["with actuator"])
    for path, values in (
        ("position_p.gain", (0.75, 10.0, 16.85, 55.0)),
        ("duty_limit.limit", (0.5, 1.0)),
        ("regression.constant", (0.0, 0.13978)),
        ("friction.viscous", (0.25, 0.45)),
        ("regression.armature", (0.008, 0.012)),
    ):
        for value in values:
            row(f"{path} {value:g}", servo=servo.with_value(path, value))
    head("Integrator and step")
    for name, integrator in INTEGRATORS.items():
        for step in (0.001, 0.0005, 0.00025):
            row(f"{name} {1000 * step:g} ms", integrator=integrator, timestep=step)


if __name__ == "__main__":
    sys.exit(main())
