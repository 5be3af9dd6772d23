"""Where the integral of a position controller begins, where a joint moves as measured.

Nothing of a given motion pulls a wrong integral back. So it is read from the column that is judged, in the rows that
are replayed but not judged: its mean error there, in each variant of the model.
"""

from __future__ import annotations

import numpy as np

from ...actuators.chain import Chain
from .compiled import compiled
from .constants import K


def integral_constants(chain: Chain, program: np.ndarray) -> dict[str, float]:
    """Of :class:`sealegs.gap.replay.constants.Constants`, where a chain keeps its integral and what it does."""
    loop = chain.find("position_pi")
    if loop is None or loop.integral == 0.0:
        return {}
    record = chain.address("position_pi.gain")  # the first number of its record, behind where its memory starts
    found = {"integral": float(program[record - 1]), "sampled": float(loop.period > 0.0)}
    motor, supply = chain.find("dc_motor"), chain.find("supply")
    if motor is None or supply is None:
        return found
    stall = supply.volts / motor.resistance
    constant = motor.motor_constant * chain.gear_ratio() * chain.magnetisation()
    return {**found, "duty_current": stall, "duty_torque": constant * stall}


@compiled(forceinline=True)
def teach(k, s, missing):
    """Add to the integral of a controller what makes up for so much duty that its replay lacks."""
    m = int(k[K.integral])
    s[m] += missing
    if k[K.sampled] > 0.0:  # what it holds of its latest sample, see the law of the controller
        s[m + 2] += missing
        s[m + 4] += missing
