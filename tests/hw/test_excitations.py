"""Excitations of the library on a robot: each joint and each seed has a motion of its own."""

import numpy as np
import pytest
from sealegs.configs.compose import compose
from sealegs.gap.experiment import library
from sealegs.hw.machine.robot import build_robot
from sealegs.hw.run.excitation import library_excitation


@pytest.mark.parametrize("word", ["multisine", "steps", "fast_steps"])
def test_no_joint_repeats_under_a_neighbouring_seed_what_another_does(word: str) -> None:
    robot = build_robot(compose("deploy", {"robot": "hopper"})["robot"])
    middles = [0.5 * (joint.low + joint.high) for joint in robot.joints]
    motions = [
        column - middle
        for seed in range(3)
        for column, middle in zip(library_excitation(word, robot, 0.3, seed)._goals.T, middles, strict=True)
    ]
    for k, one in enumerate(motions):
        assert not any(np.allclose(one, other) for other in motions[:k])
    first = library(0.0, 0.3, 2)[word.replace("_", " ")]
    assert motions[4] == pytest.approx(first), "the first joint moves as on a bench with that seed"
