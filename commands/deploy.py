"""Run a policy, an excitation, a log or a reference controller on servos, and log it.

    sealegs deploy policy=runs/first/final robot=hopper                on a virtual machine
    sealegs deploy excitation=chirp                                    an excitation of the library, on the bench
    sealegs deploy excitation=diagnosis/next_experiment.csv out=logs/today     on the robot that its .yaml names
    sealegs deploy policy=runs/first/final robot=hopper hw=feetech port=/dev/ttyUSB0
    sealegs deploy policy=runs/first/final robot=hopper dry_run=true   print the first goals, no torque

Limits on joints, speed, current, temperature, voltage and late data hold for every run (configs/robot). However a run
ends, a separate process makes sure that the servos are released or held. The log is a measured log (docs/log-format.md)
that sealegs diagnose reads, complete up to the last cycle.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from ..common.errors import SealegsError
from ..configs.script import Interrupted

PLAIN = (
    "policy",
    "task",
    "excitation",
    "replay",
    "port",
    "actuator",
    "extended",
    "calibration",
    "out",
    "name",
    "hw.virtual.hidden",
    "hw.virtual.faults",
)


def main(arguments: list[str]) -> None:
    """Run what the command line names."""
    from ..configs.compose import compose, split  # here, so that --help does not wait for the compiled laws
    from ..envs.described.robot_file import is_robot_file
    from ..hw.machine.own_robot import READERS
    from ..hw.run import deployment

    given = split(arguments, PLAIN, _meant(arguments))
    if "robot" not in given and (robot := _robot_of_the_excitation(arguments)) is not None:
        if is_robot_file(robot) and given.get("hw", "virtual") != "virtual":
            raise SealegsError(
                f"the file beside the excitation names the robot {robot}, whose file holds the limits of the servos: "
                f"give {shlex.quote(f'robot={robot}')} yourself."
            )
        print(f"The robot is {robot}, as the file beside the excitation says.")
        given["robot"] = robot
    config = compose("deploy", given, readers=READERS)
    prepared = deployment.prepare(config)
    done = deployment.run(prepared)
    if done is None:
        return
    deployment.report(prepared, done)
    if done.outcome.ending == "stopped":
        why = "" if done.outcome.reason == "Ctrl-C" else f", since {done.outcome.reason}"
        rest = "held" if done.outcome.rest == "hold" else "released"
        raise Interrupted(f"Stopped{why}; the servos are {rest}.")


def _meant(arguments: list[str]) -> str:
    """The key that a value without one is likely meant for."""
    value = next((argument for argument in arguments if "=" not in argument), "")
    return "excitation" if value.endswith(".csv") or "/" not in value else "policy"


def _robot_of_the_excitation(arguments: Sequence[str]) -> str | None:
    """The robot that the sidecar of an excitation names; None where there is none: its goals are one robot's.

    Raises:
        SealegsError: the sidecar cannot be read.
    """
    from ..hw.run.commands import robot_beside

    words = [argument.partition("=")[2].strip("'\" ") for argument in arguments if argument.startswith("excitation=")]
    path = Path(words[-1] if words else "")
    return robot_beside(path) if path.suffix == ".csv" else None
