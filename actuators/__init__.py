"""Actuation chains: what happens between a command and the torque on a joint.

A chain is an ordered list of small stages (delay, controller, power stage, motor, gears, friction, spring, encoder),
written as data in ``configs/actuator/*.yaml``. :func:`load_chain` reads one, :class:`Drivetrain` puts chains on the
joints of a MuJoCo model. The laws run inside the engine, so anything that steps MuJoCo (a single environment, a batch
of thousands, a replay) runs them.
"""

from ..common.errors import SealegsError
from .chain import Chain, ChainError, load_chain, load_chain_set
from .drivetrain import Drivetrain
from .mounting import DrivenCoordinate

__all__ = ["Chain", "ChainError", "DrivenCoordinate", "Drivetrain", "SealegsError", "load_chain", "load_chain_set"]
