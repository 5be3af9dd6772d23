"""How long an answer takes on this adapter and computer, beyond the time of its bytes: what a timeout follows from."""

from __future__ import annotations

SHARE, SPREAD_SHARE = 0.125, 0.25  # of a new sample in mean and spread, as in RFC 6298
SPREADS = 4.0  # spreads beyond the mean that a reply may take
MARGIN = 0.002  # [s] beyond that: how finely a port keeps its timeout
SAMPLES = 8  # needed before they count


class RoundTrip:
    """Mean and spread of the round trips so far.

    Attributes:
        mean: [s].
    """

    def __init__(self) -> None:
        self.mean = self._spread = 0.0
        self._count, self._patience = 0, 1.0

    def add(self, seconds: float) -> None:
        """A transaction was answered in full."""
        self._patience = 1.0
        if self._count == 0:
            self.mean, self._spread = seconds, 0.5 * seconds
        self._spread += SPREAD_SHARE * (abs(seconds - self.mean) - self._spread)
        self.mean += SHARE * (seconds - self.mean)
        self._count += 1

    def nobody(self) -> None:
        """Nobody answered in time: the adapter may have become slower, so the next timeout is twice as long."""
        self._patience *= 2.0

    def timeout(self, longest: float) -> float:
        """How long to wait for a reply [s], at most ``longest``."""
        if self._count < SAMPLES:
            return longest
        return min(self._patience * (self.mean + SPREADS * self._spread + MARGIN), longest)
