"""What the hexapod's paper leaves open: how much each assumed number matters.

    python -m benchmarks.hexapod_open_parameters        about ten minutes

Writes benchmarks/results/hexapod_open_parameters.md. Every row stands for 2 s with its motors at 0 V (LuGre and
dry/viscous), and walks at 3 cm/s with the three joint frictions of Fig. 12; the last cycle of 2.25 is measured.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping

import numpy as np
from sealegs.common.errors import SealegsError
from sealegs.common.markdown import table
from sealegs.envs.hexapod.gait import Tripod
from sealegs.envs.hexapod.parameters import NUMBERS
from sealegs.papers.hexapod.measures import drawing
from sealegs.papers.hexapod.paper import BREAKAWAY_AT_REST, WALKING, Machine, chains_with, stand_unpowered

from benchmarks.kept import RESULTS, command, study

OUT = RESULTS / "hexapod_open_parameters.md"
SPEED = 0.03  # [m/s] the fastest of the paper: its cycle is the shortest
STOOD = 2.0  # [s]
STEPS = (0.00025, 0.0005, 0.001, 0.002)  # [s]
HOLDING = (1, 2, 4, 5)  # legs at the sides; the foremost and the last are loaded beyond their breakaway force
WALKED = ("dry/viscous", "LuGre", "dry/viscous 2")

CHAIN = {  # assumed values of the chains and what they are changed by
    "vertical.friction.coulomb": (0.7, 1.3),
    "vertical.friction.stribeck": (0.85, 1.15),
    "vertical.friction.viscous": (0.5, 2.0),
    "horizontal.friction.coulomb": (0.7, 1.3),
    "horizontal.friction.load": (0.7, 1.3),
    "horizontal.friction.load_quadratic": (0.7, 1.3),
    "rotation.friction.coulomb": (0.7, 1.3),
    "rotation.friction.viscous": (0.5, 2.0),
    "vertical.position_pi.gain": (0.5, 2.0),
    "vertical.position_pi.integral": (0.5, 2.0),
    "vertical.position_pi.band": (0.5, 2.0),
    "vertical.dc_motor.resistance": (0.7, 1.3),
    "vertical.dc_motor.motor_constant": (0.8, 1.25),
    "vertical.gear.ratio": (0.7, 1.4),
}
ROBOT = {  # assumed numbers of the robot
    "ratio": (0.75, 1.1),
    "stance_radius": (0.9, 1.1),
    "stance_height": (0.85, 1.15),
    "link_centre": (0.8, 1.2),
    "floor_friction": (0.6, 1.4),
    "ground_damping": (0.5, 2.0),
    "slip_speed": (0.3, 3.0),
}
GAIT = {"lift": (0.02, 0.06), "double_stance": (1 / 24, 1 / 8), "lifting": (0.2, 0.4)}


def cases() -> Iterator[tuple[str, dict[str, float], dict[str, float], Tripod]]:
    """Label, changes of the chains, changes of the robot, and gait of each row."""
    yield "as chosen", {}, {}, Tripod(SPEED)
    for path, factors in CHAIN.items():
        name = next(k for k in WALKED[::-1] if path_value(k, path) != 0.0)
        for factor in factors:
            value = path_value(name, path) * factor
            yield f"{path} {value:.4g}", {path: value}, {}, Tripod(SPEED)
    for name, factors in ROBOT.items():
        for factor in factors:
            value = NUMBERS[name].value * factor
            yield f"{name} {value:.4g}", {}, {name: value}, Tripod(SPEED)
    for name, values in GAIT.items():
        for value in values:
            yield f"gait.{name} {value:.3g}", {}, {}, Tripod(SPEED, **{name: value})


def path_value(friction: str, path: str) -> float:
    """An assumed value of the chains, by ``kind.stage.parameter``; 0 where this friction has none."""
    kind, stage, key = path.split(".")
    found = chains_with(friction, WALKING)[f"leg0_{kind}"].find(stage)
    return float(getattr(found, key)) if found is not None else 0.0


def row(label: str, changes: Mapping[str, float], params: Mapping[str, float], gait: Tripod) -> str:
    """One line of the table."""
    at_rest = dict(changes)
    if (key := "vertical.friction.stribeck") in at_rest:  # the same share of the other table's value
        at_rest[key] *= BREAKAWAY_AT_REST / path_value("LuGre", key)
    try:
        return _cells(label, at_rest, changes, params, gait, None)
    except SealegsError as error:
        return f"| {label} | {error} |"


def _cells(
    label: str,
    at_rest: Mapping[str, float],
    changes: Mapping[str, float],
    params: Mapping[str, float],
    gait: Tripod,
    timestep: float | None,
) -> str:
    sunk = [1e3 * stand_unpowered(name, STOOD, at_rest, params, timestep).sinking for name in WALKED[1::-1]]
    walks = {name: Machine(name, {**WALKING, **changes}, params, timestep).walk(gait, 2.25) for name in WALKED}
    dry, lugre, load = (walk.resistance() for walk in walks.values())
    drawn = [100.0 * max(drawing(walks[name], leg) for leg in HOLDING) for name in WALKED[1::-1]]
    return (
        f"| {label} | {sunk[0]:.2f} | {sunk[1] * 10.0 / STOOD:.1f} | {drawn[0]:.0f} | {drawn[1]:.0f} | {dry:.2f} | "
        f"{lugre / dry - 1.0:+.1%} | {1.0 - dry / load:.0%} |"
    )


HEAD = """# What the hexapod's paper leaves open

2 s with motors at 0 V, then one cycle at 3 cm/s. "xi" is the specific resistance with dry/viscous friction, "LuGre" how
far it differs with LuGre, and "better" what the absence of load dependence saves. "Draws" is the share of a settled
support in which a vertical motor draws current, of the worst of the four legs at the sides. Made by `python -m
benchmarks.hexapod_open_parameters`.
"""
COLUMNS = (
    "",
    "LuGre sinks [mm]",
    "dry sinks [mm in 10 s]",
    "LuGre draws [% of support]",
    "dry draws [% of support]",
    "xi dry",
    "LuGre",
    "better",
)


@study
def main() -> None:
    """Write both tables."""
    command(__doc__).parse_args()
    np.seterr(all="ignore")
    OUT.write_text(HEAD, encoding="utf-8")

    def say(line: str) -> None:
        print(line, flush=True)
        with OUT.open("a", encoding="utf-8") as page:
            page.write(line + "\n")

    head = table(COLUMNS, ())
    say(f"\n## Physics step\n\n{head}")
    for step in STEPS:
        say(_cells(f"{1e3 * step:g} ms", {}, {}, {}, Tripod(SPEED), step))
    say(f"\n## Sensitivity\n\n{head}")
    for case in cases():
        say(row(*case))


if __name__ == "__main__":
    sys.exit(main())
