"""Makes the actuator nets of a robot from simulated runs: those that are missing; a net that is there already stays."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from ..actuators.chain import LIBRARY
from ..actuators.net_training import TrainedNet, write_net
from ..common.errors import SealegsError


def make_missing(nets: Mapping[str, Callable[[], TrainedNet]]) -> int:
    """Train and write what ``configs/actuator`` lacks.

    Args:
        nets: what trains each net of a torque, by its name.

    Returns:
        The exit status: 1 where a net cannot be trained, with its sentence on standard error.
    """
    for name, train in nets.items():
        path = Path(LIBRARY) / f"{name}.npz"
        if path.exists():
            print(f"{path.name} is there already.")
            continue
        try:
            trained = train()
        except SealegsError as error:
            print(error, file=sys.stderr)
            return 1
        write_net(trained.arrays, path)
        print(f"{path.name}: rms {trained.rms:.3g} N.m, {trained.r2:.2%} of the variance on unseen runs", flush=True)
    return 0
