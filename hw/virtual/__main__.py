"""A virtual bus of servos, Feetech's or Dynamixels, with a robot of this project behind it.

    sealegs virtual                                       # the bench
    sealegs virtual robot=hopper hidden=extended.yaml     # a hopper that is not what it seems
    sealegs virtual faults=faults.yaml link=/tmp/servos   # what goes wrong when; a port of a fixed name
    sealegs virtual model=xl330_m288 actuator=xl330       # Dynamixels, as they leave the factory: at 57600 bit/s

Prints the port that any client of such a bus can open, and runs until Ctrl-C.
"""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Any

from ...actuators.errors import SealegsError
from ...configs.check import checked, checked_seed
from ...configs.compose import compose, split
from ...configs.script import run
from ...envs.robots import get_robot
from ..registers import ServoModel, load_model
from .faults import Fault, read_faults
from .machine import Machine
from .rig import Held, Rig, mounts
from .server import Server, announce
from .wire import Wire

PLAIN = ("robot", "actuator", "hidden", "faults", "link")


def build(config: dict[str, Any]) -> Server:
    """A server from its config; see ``configs/virtual.yaml``.

    Raises:
        SealegsError: a value is wrong.
    """
    robot = get_robot(checked("robot", config["robot"], str))
    actuator = config["actuator"]
    if (mode := checked("time", config["time"], str)) not in ("real", "stepped"):
        raise SealegsError(f"time is '{mode}'; it may be real or stepped.")
    numbers = {key: checked(key, config[key], float) for key in ("cycle", "latency")}
    for key, value in numbers.items():
        if value < 0.0:
            raise SealegsError(f"{key} is {value:g} s; it cannot be negative.")
    model = load_model(checked("model", config["model"], str))
    machine = Machine(
        robot, actuator, checked("hidden", config["hidden"], str | None), config["params"], config["sensors"],
        config["pose"],
    )  # fmt: skip
    faults = faults_again(config)
    others = {str(name): load_model(checked(f"buses.{name}", row, str)) for name, row in config["buses"].items()}
    mounted = mounts(machine.encoders, config["servos"], model, others)
    counts = {"": registers(config["registers"], model)}
    counts |= {name: registers(config["bus_registers"].get(name), table) for name, table in others.items()}
    held = checked("held", config["held"], Held | None)
    rig = Rig(machine, model, mounted, held, others=others, registers=counts)
    seed = checked_seed(config["seed"])
    wire = Wire(rig, faults, seed)
    return Server(
        wire,
        stepped=mode == "stepped",
        cycle=numbers["cycle"],
        latency=numbers["latency"],
        link=Path(config["link"]) if config["link"] is not None else None,
        linger=checked("linger", config["linger"], float | None),
        others=[Wire(rig, faults_again(config), seed + k, name) for k, name in enumerate(others, 1)],
    )


def registers(given: dict[str, Any] | None, model: ServoModel) -> dict[str, int]:
    """Counts that servos keep, checked.

    Raises:
        SealegsError: there is no such register, or it does not take the count.
    """
    found = {}
    for name, value in (given or {}).items():
        count, register = checked(f"registers.{name}", value, int), model[str(name)]
        if register.area != "eeprom" or not register.low <= count <= register.high:
            raise SealegsError(
                f"registers.{name} is {count}; it must be a register that servos keep without power, and its count "
                f"between {register.low} and {register.high}."
            )
        found[str(name)] = count
    return found


def faults_again(config: dict[str, Any]) -> list[Fault]:
    """The faults of a config; each line has its own, which it counts down."""
    return read_faults(config["faults"]) if config["faults"] is not None else []


def main(arguments: list[str]) -> None:
    """Serve one port."""
    with build(compose("virtual", split(arguments, PLAIN))) as server:
        received: list[int] = []

        def end(number: int, _: object) -> None:
            received.append(number)
            server.stop()

        # an exception that a signal raises is lost where it meets a callback or a finaliser
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, end)
        announce(server)
        server.run()
        if signal.SIGINT in received:
            raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(run(main, "virtual", __doc__ or "", sys.argv[1:]))
