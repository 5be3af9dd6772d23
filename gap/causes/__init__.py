"""What a gap can be named for. These names are all that a cause from outside needs (docs/build-on-it.md)."""

from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter, factor
from . import catalogue
from .cause import Cause, Ceiling, Limit, Needs, always, both, entry, has, has_any, lacks, number, stall_torque

__all__ = [
    "Cause",
    "Ceiling",
    "JointModel",
    "Limit",
    "Needs",
    "Parameter",
    "always",
    "both",
    "catalogue",
    "entry",
    "factor",
    "has",
    "has_any",
    "lacks",
    "number",
    "stall_torque",
]
