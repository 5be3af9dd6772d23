"""A bus that exists only as a process: the servos' bytes on a pseudo-terminal, and a simulated robot behind them."""

from .launcher import VirtualBus

__all__ = ["VirtualBus"]
