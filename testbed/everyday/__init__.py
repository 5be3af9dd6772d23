"""Machines of everyday kind, with several effects at once, some of them shared by all joints.

``machines`` are the nominal machines as their makers publish them, ``effects`` what they hide, ``physics`` the rigid
bodies and servos, ``recorded`` the logs that a hobbyist makes of them.
"""

from .effects import EFFECTS, SHARED, STRANGERS, Hidden
from .machines import MACHINES, Machine, mjcf, nominal_chain
from .recorded import Drawn, drawn, record_drawn
from .running import Running

__all__ = [
    "EFFECTS",
    "MACHINES",
    "SHARED",
    "STRANGERS",
    "Drawn",
    "Hidden",
    "Machine",
    "Running",
    "drawn",
    "mjcf",
    "nominal_chain",
    "record_drawn",
]
