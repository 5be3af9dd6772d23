"""A bus that exists only as a process: the servos' bytes on a pseudo-terminal, and a simulated robot behind them."""

from .control import VirtualBus

__all__ = ["VirtualBus"]
