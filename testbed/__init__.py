"""An independent bench that hides effects: the finder under test must name them.

Shares no code with ``actuators/`` or ``gap/`` except the container of the measured log that it fills.
"""

from .bench import LOADS, NOISE_FLOOR, hidden_bench, nominal_chain, run_again, run_machine
from .effects import EFFECTS, MAGNITUDES, STRANGERS, drawn, drawn_constants
from .physics import Machine, simulate

__all__ = [
    "EFFECTS",
    "LOADS",
    "MAGNITUDES",
    "NOISE_FLOOR",
    "STRANGERS",
    "Machine",
    "drawn",
    "drawn_constants",
    "hidden_bench",
    "nominal_chain",
    "run_again",
    "run_machine",
    "simulate",
]
