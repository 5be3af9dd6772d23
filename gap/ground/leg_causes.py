"""Contact causes of a hopper's log, and the numbers of its ground that nobody knows exactly."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..causes.cause import Cause
from ..replay.parameters import Parameter, factor
from .causes import ground_causes
from .leg_model import LegModel
from .leg_replay import STEP

HEIGHT = 3e-3  # [m] how well the zero of the height is known
SHORTEST = 2.0 * STEP  # [s] the engine takes no shorter time constant for a step
TIME = 3.0  # factor on the time constant of the engine's contact, which stands for no number of the machine
HARD = 2e4  # [N/m] below which that contact is not made by tuning: it would do a soft ground's work unnamed
SHOWN = {"contact.friction": "base.x", "contact.stiffness": "base.z", "contact.slope": "base.x"}
STARTS, SOFT = (1500.0, 5000.0), 4000.0  # [N/m]


def contact_causes(nominal: LegModel, names: Sequence[str] | None = None) -> list[Cause]:
    """The catalogue of the ground under a leg.

    Args:
        nominal: the leg on the ground that is believed in.
        names: of the causes to consider; default: all of them.
    """
    return ground_causes(STARTS, nominal.softest_rigid(), SOFT, SHOWN, names=names)


def ground_numbers(nominal: LegModel) -> list[Parameter]:
    """What every fit tunes: no finding, as long as it stays within these bounds."""
    shortest = SHORTEST / nominal.value("contact.time")
    longest = min(max(math.sqrt(nominal.engine_stiffness() / HARD), 1.0), TIME)
    return [
        factor("contact.time", min(max(1.0 / TIME, shortest), 1.0), longest, 0.2),
        Parameter("contact.height", "m", -HEIGHT, HEIGHT, 0.0, 5e-4),
    ]
