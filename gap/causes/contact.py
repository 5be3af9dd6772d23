"""What the link meets on its way."""

from __future__ import annotations

from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter
from .cause import Cause, Needs, Variant
from .registry import entry


@entry("contact.blocked")
def blocked(nominal: JointModel) -> Cause:
    del nominal
    variants: list[Variant] = []
    for start in (0.9, 0.5, 0.25):
        upper = Parameter("load.stop_angle", "rad", -0.5, 2.0, start, 0.03)
        lower = Parameter("load.lower_stop", "rad", -2.0, 0.5, -start, 0.03)
        variants += [(upper,), (lower,), (upper, lower)]
    return Cause(
        sentence="Something stops the link at an angle.",
        picture="response",
        variants=tuple(variants),
        needs=Needs(free_link=True),
    )
