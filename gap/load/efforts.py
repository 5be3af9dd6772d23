"""What a chain says of the effort of its drive: which of torque, current and duty it predicts at all."""

from __future__ import annotations

from ...actuators import Chain
from ...actuators.stages import Quantity

EFFORTS = ("torque", "current", "duty")  # the most direct first


def predicted(chain: Chain) -> tuple[str, ...]:
    """Those of :data:`EFFORTS` that a chain predicts: without a motor there is no current, and an ideal servo has no
    duty either.
    """
    says = {
        "torque": True,
        "current": chain.find("dc_motor") is not None,
        "duty": any(stage.gives == Quantity.DUTY for stage in chain.stages),
    }
    return tuple(effort for effort in EFFORTS if says[effort])
