"""The hopper's rows in short runs, and another value of each of its chosen numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from sealegs.actuators import load_chain, regression_fit
from sealegs.actuators.brake_bench import Noise
from sealegs.envs.hopper.controller import BangBang
from sealegs.envs.hopper.parameters import NUMBERS
from sealegs.papers.hopper import choices, paper, servo_rows
from sealegs.papers.hopper import rows as hopper
from sealegs.papers.published import Row

from .changes import Change, assumed_numbers, attribute, item

SHORT = 4.0  # [s]


def rows() -> Sequence[Row]:
    """All rows."""
    return hopper.rows(hopper.run(SHORT, say=lambda line: None, timed=0.02))


def along_the_unit_vector(controller: BangBang, motor: np.ndarray, link: np.ndarray) -> np.ndarray:
    """The signal, of the springs' torque along w over its length: another reading of the threshold."""
    torque = controller.stiffness * (motor - link) @ np.asarray(controller.weights) / np.hypot(*controller.weights)
    signal = controller.amplitude * np.sign(torque) * (np.abs(torque) > controller.threshold)
    return np.asarray(controller.rest) + signal[..., None] * np.asarray(controller.weights)


def with_spurious(spurious: float = Noise.spurious) -> Noise:
    """Noise with more measurements that are wrong altogether."""
    return Noise(spurious=spurious + 0.02)


UPPER, LOWER = choices.BLIND_LENGTHS
OTHERWISE: Mapping[str, Change] = {
    **assumed_numbers(NUMBERS),
    "blind_upper_length": attribute(choices, "BLIND_LENGTHS", (1.1 * UPPER, LOWER)),
    "blind_lower_length": attribute(choices, "BLIND_LENGTHS", (UPPER, 1.1 * LOWER)),
    "signal": attribute(BangBang, "goals", along_the_unit_vector),
    "gain_unit": item(paper.CHAINS, "with actuator", load_chain("sv1270tg").with_value("position_p.gain", 20.0)),
    "height_of_a_jump": attribute(paper.Figures, "height", property(lambda figures: figures.rise)),
    "other_signals": attribute(choices, "SIGNALS", ((0.3, 0.45),)),
    "settling": attribute(paper, "SETTLING", 1.5),
    "peak": attribute(paper, "PEAK", 3.0),
    "leg_distance": attribute(paper, "LEG_DISTANCE", 0.2),
    "bench_motor": attribute(servo_rows, "MOTOR", load_chain("sv1270tg_motor").with_value("dc_motor.resistance", 1.7)),
    "bench_noise": attribute(servo_rows, "Noise", partial(Noise, torque=0.02, speed=0.05)),
    "spurious": attribute(servo_rows, "Noise", with_spurious),
    "constant_on_the_bench": attribute(servo_rows, "constant_as_friction", lambda chain: chain),
    "parts_of_the_bench": attribute(regression_fit, "HIGH", 0.5),
}
