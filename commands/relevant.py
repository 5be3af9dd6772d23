"""Which dynamics of a robot are relevant: what its motors' torque goes into, over workspace and speed.

    sealegs evaluate relevant robot=leg
    sealegs evaluate relevant robot=hopper actuator=ideal
    sealegs evaluate relevant robot=my_arm.yaml

Moves the robot in simulation from point to point at several tempos and splits the torque of each motor into constant
and varying inertia, Coriolis and centrifugal torque, gravity, springs, friction and contact. A part under 5 % on every
run can be left out; the error that this makes is printed. Writes relevant.json and two pictures.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..common.atomic import fresh, write_text

WORD = "relevant"
FLOATING, FIXED = 0.15, 0.8  # amplitude where it is not given


def main(arguments: list[str]) -> None:
    """Analyse the robot that the command line names."""
    from ..common.errors import SealegsError
    from ..configs.check import checked
    from ..configs.compose import compose, split

    config = compose(WORD, split(arguments, plain=("robot", "out", "extended"), first="robot"))
    if config["robot"] is None:
        raise SealegsError("say which robot to analyse: robot=leg.")
    tempos = [checked("tempos", tempo, float) for tempo in _list(config["tempos"])]
    seconds, seed = checked("seconds", config["seconds"], float), int(checked("seed", config["seed"], int))
    if min(tempos) <= 0.0 or seconds < 0.5:
        raise SealegsError("tempos are positive times [s], and seconds is at least 0.5.")
    out = Path(str(config["out"] or fresh(Path("runs"), f"relevant-{Path(str(config['robot'])).stem}")))
    analyse(
        str(config["robot"]), config["actuator"], tempos, seconds, config["amplitude"], seed, out,
        extended=checked("extended", config["extended"], str | None),
    )  # fmt: skip


def _list(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else [value]


def analyse(
    robot: str,
    actuator: Any,
    tempos: list[float],
    seconds: float,
    amplitude: float | None,
    seed: int,
    out: Path,
    *,
    extended: str | None = None,
) -> dict[str, Any]:
    """Move, split, judge, write and tell.

    Args:
        robot: name, id of its environment, or the path of a robot's file, which moves as in the task ``track``.
        actuator: chains; None: the robot's own.
        tempos: seconds for the whole range of a coordinate, each a run [s].
        seconds: of each run.
        amplitude: share of the range; None: 0.8, and 0.15 for a robot that stands on the ground.
        seed: of the points.
        out: folder, without an earlier analysis.
        extended: folder of a diagnosis, in the place of ``actuator``.

    Raises:
        SealegsError: wrong input, or a folder that has results.
    """
    from ..common.errors import SealegsError
    from ..envs.described.robot_file import is_robot_file
    from ..envs.extended import extended_arguments
    from ..envs.make import environment_id
    from ..evaluation.relevant import RULE, Mover, judge

    if (out / "relevant.json").exists():
        raise SealegsError(f"{out} holds an analysis already; give another folder as out=.")
    of_file = is_robot_file(robot)
    env, file, params = environment_id("track" if of_file else robot), robot if of_file else None, None
    if extended is not None:
        actuator, params = extended_arguments(env, extended, actuator, None, file)
    mover = Mover(env, actuator, params, robot=file)
    if amplitude is None:
        amplitude = FLOATING if mover.floating else FIXED
    out.mkdir(parents=True, exist_ok=True)
    runs = []
    for tempo in sorted(tempos, reverse=True):
        print(f"moving {seconds:g} s, {tempo:g} s for the whole range of a joint")
        runs.append(mover.run(tempo, seconds, float(amplitude), seed))
    verdict = judge(mover.names, runs)
    result = {
        "robot": robot,
        "tempos_s": [run.tempo for run in runs],
        "amplitude": amplitude,
        "shares": {f"{run.tempo:g}": {k: v.tolist() for k, v in run.shares().items()} for run in runs},
        "most": verdict.shares,
        "left_out": verdict.left_out,
        "error_of_leaving_out": verdict.error,
        "balance": [run.balance() for run in runs],
    }
    write_text(out / "relevant.json", json.dumps(result, indent=1) + "\n")
    from ..evaluation.pictures import draw_parts

    pictures = draw_parts(mover.names, runs, out)
    parts = list(next(iter(verdict.shares.values())))
    wide = max(map(len, mover.names))
    print(f"\nlargest share of the motor's torque over all runs; * under {RULE:.0%}: can be left out")
    print(f"{'':{wide}s}" + "".join(f"{part:>19s}" for part in parts) + f"{'error':>9s}")
    for name, row in verdict.shares.items():
        cells = "".join(f"{row[part]:18.1%}{'*' if part in verdict.left_out[name] else ' '}" for part in parts)
        print(f"{name:{wide}s}{cells}{verdict.error[name]:9.1%}")
    print("\nWritten: " + ", ".join(f"{out}/{name}" for name in ("relevant.json", *pictures)))
    return result
