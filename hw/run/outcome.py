"""What became of a run."""

from __future__ import annotations

from dataclasses import dataclass, field

from ...common.errors import SealegsError
from ..bus.clock import Timing
from ..bus.packets import BusError
from ..guard.safety import Fault

TERMS = {"speed": "raise env.servo.goal_rate, env.smooth_weight", "range": "raise env.smooth_weight"}
"""Weights of the reward with which a policy is trained that avoids such goals, by reason."""
OFTEN = 0.01  # share of the cycles from which goals that are cut are no accident


@dataclass
class Outcome:
    """What became of a run.

    Attributes:
        ending: ``finished``, ``stopped`` (by a person) or ``fault``.
        reason: why a person stopped it.
        fault: where there was one.
        timing: of the loop.
        cut: goals that safety cut, by reason.
        bus: failures of the bus by name, the cured ones included.
        not_at_rest: servos that could not be brought to rest by the loop, and why.
        rest: what was done to them: ``release`` or ``hold``.
        rest_seconds: from the end of the last cycle to the servos at rest [s].
        note: what else a person should know; "": nothing.
    """

    ending: str
    reason: str | None
    fault: Fault | None
    timing: Timing
    cut: dict[str, int]
    bus: dict[str, int]
    not_at_rest: dict[int, str] = field(default_factory=dict)
    rest_seconds: float = 0.0
    rest: str = "release"
    note: str = ""

    def told_cut(self) -> str:
        """How many cycles had goals that safety cut, and what helps where that is no accident; "": none had."""
        kinds = [(count, key) for key, count in self.cut.items() if count]
        if not kinds:
            return ""
        counts = " and ".join(f"{count} by their {key}" for count, key in kinds)
        share = max(kinds)[0] / max(self.timing.cycles, 1)
        told = f"Safety cut the goals of cycles: {counts}, of {self.timing.cycles} ({100.0 * share:.0f} %)"
        if share < OFTEN:
            return f"{told}."
        return (
            f"{told}. The servos cannot follow what is asked: train a policy with smoother actions "
            f"({TERMS[max(kinds)[1]]}, or take a smaller env.correction), slow down an excitation."
        )


def fault_of(error: SealegsError) -> Fault:
    """An error of bus, log or robot as the end of a run."""
    servos = error.servos if isinstance(error, BusError) else ()
    return Fault(type(error).__name__, str(error), tuple(servos))
