"""The stages of an actuation chain, one file per link, in the order a command passes through them."""

from . import command, controller, motor, net, power, sensor, transmission
from .base import STAGES, ChainError, Quantity, Stage, build_stage

__all__ = [
    "STAGES",
    "ChainError",
    "Quantity",
    "Stage",
    "build_stage",
    "command",
    "controller",
    "motor",
    "net",
    "power",
    "sensor",
    "transmission",
]
