"""Actuation chains: what happens between a command and the torque on a joint.

A chain is an ordered list of small stages (delay, controller, power stage, motor, gears, friction, spring, encoder),
written as data in ``configs/actuator/*.yaml``. :func:`load_chain` reads one, :class:`Drivetrain` puts chains on the
joints of a MuJoCo model. The laws run inside the engine, so anything that steps MuJoCo (a single environment, a batch
of thousands, a replay) runs them.
"""

import os
import sys

# Without a screen MuJoCo can draw by EGL only, and it looks when it is imported: here first of all in this project.
if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
    os.environ.setdefault("MUJOCO_GL", "egl")

from actuators.chain import Chain, ChainError, load_chain, load_chain_set
from actuators.drivetrain import Drivetrain
from actuators.errors import SealegsError
from actuators.mounting import DrivenCoordinate

__all__ = ["Chain", "ChainError", "DrivenCoordinate", "Drivetrain", "SealegsError", "load_chain", "load_chain_set"]
