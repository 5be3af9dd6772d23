"""The stages of an actuation chain, in the order in which a command passes through them; every file here is loaded."""

import importlib
import pkgutil

from .base import STAGES, ChainError, Law, Quantity, Stage, build_stage, in_order, number_laws

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")

ORDER: tuple[str, ...] = in_order(STAGES)
"""Names of the stages in the order of a chain."""

OPCODES: dict[Law, int] = number_laws(STAGES[name] for name in ORDER)
"""The number by which a program names each law."""

__all__ = ["OPCODES", "ORDER", "STAGES", "ChainError", "Law", "Quantity", "Stage", "build_stage"]
