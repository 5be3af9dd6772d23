"""Mistakes in a user's own task end in a sentence that names method and remedy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import sealegs
from sealegs.common.errors import SealegsError

ARM = Path(__file__).parents[1] / "robots" / "arm.xml"
TASK = """
from dataclasses import dataclass
import numpy as np
from sealegs.envs.any_robot.reach import ReachTask

@dataclass(frozen=True)
class Mine(ReachTask):
    episode_steps = 10

    def {method}:
        return {gives}
"""


@pytest.mark.parametrize(
    ("method", "gives", "sentence"),
    [
        ("rewards(self, motion)", "{'r': 1.0}", "Mine.rewards gives 1.0 as 'r'; give an array with one number per sim"),
        ("rewards(self, motion)", "{'r': motion.link}", r"Mine.rewards gives an array of the shape \(2, 2\) as 'r'"),
        ("rewards(self, motion)", "motion.time", "gives an array of the shape .*; it gives a dict of terms by name"),
        ("failed(self, motion)", "False", "Mine.failed gives False; give an array of bool"),
        ("observe(self, motion)", "[motion.time]", "Mine.observe gives 1 numbers, and observation_names names 8"),
        ("observe(self, motion)", "[0.0]", "Mine.observe gives 0.0 as part 0; give arrays with one number"),
    ],
)
def test_what_a_task_gives_in_a_wrong_shape_is_told(method: str, gives: str, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(TASK.format(method=method, gives=gives))
    env = sealegs.make_env(f"{path}:Mine", 2, robot=str(ARM))
    with pytest.raises(SealegsError, match=sentence):
        env.reset(seed=0)
        env.step(np.zeros((2, 2), np.float32))
    env.close()


def test_the_tasks_of_a_file_are_those_that_it_defines(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(TASK.format(method="rewards(self, motion)", gives="{}"))
    with pytest.raises(SealegsError, match=r"has no Mime \(did you mean 'Mine'\?\); its tasks are Mine\."):
        sealegs.make_env(f"{path}:Mime", robot=str(ARM))
