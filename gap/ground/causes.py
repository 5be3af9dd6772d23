"""Contact causes of a legged log, and the numbers of the ground that nobody knows exactly."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..causes.catalogue import checked
from ..causes.cause import Cause
from ..replay.parameters import Parameter, factor
from .leg_model import LegModel
from .leg_replay import STEP

HEIGHT = 3e-3  # [m] how well the zero of the height is known
SHORTEST = 2.0 * STEP  # [s] the engine takes no shorter time constant for a step
TIME = 3.0  # factor on the time constant of the engine's contact, which stands for no number of the machine
HARD = 2e4  # [N/m] below which that contact is not made by tuning: it would do a soft ground's work unnamed


def contact_causes(nominal: LegModel, names: Sequence[str] | None = None) -> list[Cause]:
    """The catalogue of the ground under a leg.

    Args:
        nominal: the leg on the ground that is believed in.
        names: of the causes to consider; default: all of them.
    """
    stiffest = nominal.softest_rigid()
    friction = [
        (Parameter("contact.friction", "1", 0.05, 4.0, start, 0.2, logarithmic=True, factor=True),)
        for start in (0.4, 0.8)
    ]
    soft = [
        (
            Parameter("contact.stiffness", "N/m", 200.0, stiffest, start, 0.3, logarithmic=True),
            Parameter("contact.damping", "N.s/m", 1.0, 300.0, 20.0, 0.4, logarithmic=True, shape=True),
        )
        for start in (1500.0, 5000.0)
    ]
    slope = Parameter("contact.slope", "rad", -0.4, 0.4, 0.0, 0.01)
    every = [
        Cause(
            name="contact.friction",
            sentence="The foot slides on less, or holds on more, friction than the model has.",
            picture="stance",
            against="base.x",
            plausible={"contact.friction*": 0.5},
            variants=tuple(friction),
            error=True,
        ),
        Cause(
            name="contact.stiffness",
            sentence="The ground gives way under the foot.",
            picture="stance",
            against="base.z",
            plausible={"contact.stiffness": 4000.0},
            variants=tuple(soft),
        ),
        Cause(
            name="contact.slope",
            sentence="The ground is not level.",
            picture="stance",
            against="base.x",
            plausible={"contact.slope": 0.02},
            variants=((slope,),),
        ),
    ]
    return [cause for cause in every if cause.name in checked(names)]


def ground_numbers(nominal: LegModel) -> list[Parameter]:
    """What every fit tunes: no finding, as long as it stays within these bounds."""
    shortest = SHORTEST / nominal.value("contact.time")
    longest = min(max(math.sqrt(nominal.engine_stiffness() / HARD), 1.0), TIME)
    return [
        factor("contact.time", min(max(1.0 / TIME, shortest), 1.0), longest, 0.2),
        Parameter("contact.height", "m", -HEIGHT, HEIGHT, 0.0, 5e-4),
    ]
