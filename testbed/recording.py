"""What a machine of the testbed recorded: plain arrays, and what its sidecar believes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Recording(NamedTuple):
    """One run of one machine.

    Attributes:
        name: of the run.
        time: sample times (n,) [s].
        joints: signals (n,) by joint and name: ``goal``, ``position``, ``velocity``, ``duty``, ...
        base: signals (n,) of the base by name.
        robot: its name.
        robot_params: its numbers as the sidecar believes them.
        actuators: nominal chain by joint.
    """

    name: str
    time: np.ndarray
    joints: dict[str, dict[str, np.ndarray]]
    base: dict[str, np.ndarray]
    robot: str
    robot_params: dict[str, float]
    actuators: dict[str, list[dict[str, dict[str, float]]]]
