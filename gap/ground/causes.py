"""Contact causes of a legged log: what the ground may be that the model does not say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..causes.catalogue import checked
from ..causes.cause import Cause
from ..replay.parameters import Parameter

CONTACT_TIME_FACTOR = 3.0
"""Factor on the time constant of the engine's contact that fits may take: it stands for no number of the machine."""


def ground_causes(
    stiffness: Sequence[float],
    stiffest: float,
    soft: float,
    shown: Mapping[str, str],
    slopes: Sequence[str] = ("contact.slope",),
    names: Sequence[str] | None = None,
    *,
    damped: bool = True,
) -> list[Cause]:
    """The catalogue of the ground under a robot.

    Args:
        stiffness: from which fits of soft ground start [N/m].
        stiffest: ground that still counts as soft [N/m].
        soft: ground that is plausible [N/m].
        shown: column that shows each cause best, by its name.
        slopes: numbers of the ground's slope; those that the robot can feel.
        names: of the causes to consider; default: all of them.
        damped: whether the damping of soft ground is fitted with it; else it is tuned in every fit.
    """
    friction = [
        (Parameter("contact.friction", "1", 0.05, 4.0, start, 0.2, logarithmic=True, factor=True),)
        for start in (0.4, 0.8)
    ]
    damping = Parameter("contact.damping", "N.s/m", 1.0, 300.0, 20.0, 0.4, logarithmic=True, shape=True)
    gives = [
        (
            Parameter("contact.stiffness", "N/m", 200.0, stiffest, start, 0.3, logarithmic=True),
            *((damping,) if damped else ()),
        )
        for start in stiffness
    ]
    slope = tuple(Parameter(name, "rad", -0.4, 0.4, 0.0, 0.01) for name in slopes)
    every = [
        Cause(
            name="contact.friction",
            sentence="The foot slides on less, or holds on more, friction than the model has.",
            picture="stance",
            against=shown["contact.friction"],
            plausible={"contact.friction*": 0.5},
            variants=tuple(friction),
            error=True,
        ),
        Cause(
            name="contact.stiffness",
            sentence="The ground gives way under the foot.",
            picture="stance",
            against=shown["contact.stiffness"],
            plausible={"contact.stiffness": soft},
            variants=tuple(gives),
        ),
        Cause(
            name="contact.slope",
            sentence="The ground is not level.",
            picture="stance",
            against=shown["contact.slope"],
            plausible={slopes[0]: 0.02},
            variants=(slope,),
        ),
    ]
    return [cause for cause in every if cause.name in checked(names)]
