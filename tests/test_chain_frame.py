"""A chain in the frame of a log and in that of its robot's model is one and the same drive."""

from __future__ import annotations

import numpy as np
import pytest
from sealegs.actuators.chain import load_chain
from sealegs.gap.load.chain_frame import in_frame, in_log
from sealegs.gap.load.robot import Frame

from tests.test_driven_replay import RIGID, drive

MESHING = {
    "breakaway_positive": 0.05, "breakaway_negative": 0.08, "coulomb_positive": 0.03, "coulomb_negative": 0.06,
    "ripple_1_positive": 0.01, "ripple_1_negative": 0.02, "frequency_1": 3.0, "phase_1": 0.4,
    "ripple_2_positive": 0.01, "ripple_2_negative": 0.015, "frequency_2": 7.0, "phase_2": -0.9,
}  # fmt: skip
FRICTION = {
    "coulomb": 0.05, "viscous": 0.3, "asymmetry": 0.02, "viscous_asymmetry": 0.05, "ripple": 0.03, "ripple_count": 5.0,
    "ripple_phase": 0.7,
}  # fmt: skip
DRIVEN = [stage for stage in RIGID if "friction" not in stage]
CHAINS = {
    "friction": [*DRIVEN[:-1], {"friction": FRICTION}, {"encoder": {"ticks": 0, "scale": 1.02, "offset": 0.01}}],
    "meshing": [*DRIVEN[:-1], {"friction": {"coulomb": 0.01}}, {"meshing": MESHING}, DRIVEN[-1]],
    "regression": [
        {"position_p": {"gain": 30.0}},
        {"duty_limit": {"limit": 0.9}},
        {"regression": {"duty_torque": 1.8, "speed_torque": -0.16, "constant": 0.07, "armature": 0.01}},
    ],
}
FRAMES = [Frame(0.4, -1.0), Frame(-0.3, 1.0), Frame(0.0, -1.0)]


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("name", CHAINS)
def test_a_chain_in_the_frame_of_the_model_gives_the_torques_of_the_log_there(name: str, frame: Frame) -> None:
    """The phase of friction over the angle was left as it was: other angles then had the extended model's friction."""
    time = np.arange(0.0, 3.0, 0.005)
    motion = np.stack([0.8 * np.sin(2.5 * time), 2.0 * np.cos(2.5 * time), -5.0 * np.sin(2.5 * time)], axis=1)
    goal = motion[:, 0] + 0.02 * np.cos(1.7 * time)
    chain = load_chain(CHAINS[name])
    there = np.stack([frame.to_model(motion[:, 0]), frame.sign * motion[:, 1], frame.sign * motion[:, 2]], axis=1)
    logged = driven(chain, goal, motion, time)
    modelled = driven(in_frame(chain, frame), frame.to_model(goal), there, time)
    np.testing.assert_allclose(modelled[5:, 1:], frame.sign * logged[5:, 1:], atol=1e-9)


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("name", CHAINS)
def test_a_chain_of_the_model_comes_back_as_it_was(name: str, frame: Frame) -> None:
    """A nominal friction that differs between the directions was turned once: nothing was found, and it had changed."""
    chain = load_chain(CHAINS[name])
    for stage, other in zip(in_frame(in_log(chain, frame), frame).stages, chain.stages, strict=True):
        assert stage.parameters() == pytest.approx(other.parameters())


def driven(chain, goal: np.ndarray, link: np.ndarray, time: np.ndarray) -> np.ndarray:
    return drive([{stage.name: stage.parameters()} for stage in chain.stages], goal, link, time)
