"""The stages of an actuation chain, in the order in which a command passes through them; every file here is loaded."""

import importlib
import pkgutil

from .base import (
    STAGES,
    ChainError,
    Law,
    Quantity,
    Stage,
    build_stage,
    in_order,
    known_stages,
    number_laws,
    order,
    parameter,
    register,
    stage_of,
)
from .parity import ANGLE, EVEN, ODD, Phase, Reading, Swapped

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")

OPCODES: dict[Law, int] = number_laws(STAGES[name] for name in in_order(STAGES))
"""The number by which a program names each law of this package; :mod:`sealegs.actuators.outside` has the others."""

__all__ = [
    "ANGLE",
    "EVEN",
    "ODD",
    "OPCODES",
    "STAGES",
    "ChainError",
    "Law",
    "Phase",
    "Quantity",
    "Reading",
    "Stage",
    "Swapped",
    "build_stage",
    "known_stages",
    "order",
    "parameter",
    "register",
    "stage_of",
]
