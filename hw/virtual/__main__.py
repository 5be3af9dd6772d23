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

from ...common.errors import SealegsError
from ...configs.check import checked
from ...configs.compose import compose, split
from ...configs.script import run
from .in_process import PLAIN, duration, wires_of
from .server import Server, announce


def build(config: dict[str, Any]) -> Server:
    """A server from its config; see ``configs/virtual.yaml``.

    Raises:
        SealegsError: a value is wrong.
    """
    if (mode := checked("time", config["time"], str)) not in ("real", "stepped"):
        raise SealegsError(f"time is '{mode}'; it may be real or stepped.")
    wire, *others = wires_of(config)
    return Server(
        wire,
        stepped=mode == "stepped",
        cycle=duration("cycle", config),
        latency=duration("latency", config),
        link=Path(config["link"]) if config["link"] is not None else None,
        linger=checked("linger", config["linger"], float | None),
        others=others,
    )


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
