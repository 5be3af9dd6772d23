"""A slow log of a robot in degrees goes further than its model's joint can."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.checks.data_set import check_run
from sealegs.gap.log.arrays import measured_set

TIME = np.arange(0.0, 20.0, 0.01)
ARM = """<mujoco><compiler angle="radian"/><worldbody><body><joint name="elbow" axis="0 1 0"{range}/>
<geom size="0.1" pos="0 0 -0.2" mass="1"/></body></worldbody></mujoco>"""


def columns_in_degrees(folder: Path, position: float, goal: float, range_: str = ' range="-1.57 1.57"') -> set[str]:
    """Columns that are told to be in degrees; both go slowly over a swing, to either side by so much."""
    (folder / "arm.xml").write_text(ARM.format(range=range_))
    late = np.sin(2.0 * np.pi * 0.2 * (TIME - 0.05))
    noise = 1e-4 * position * np.random.default_rng(0).normal(size=len(TIME))
    columns = {
        "time": TIME,
        "elbow.goal": goal * np.sin(2.0 * np.pi * 0.2 * TIME),
        "elbow.position": position * late + noise,
    }
    run = measured_set([columns], {"robot": str(folder / "arm.xml"), "actuators": {"elbow": "sts3215"}}, "log").runs[0]
    return {str(finding.column) for finding in check_run(run) if finding.code == "unit.degrees"}


@pytest.mark.parametrize(
    ("position", "goal", "wrong"),
    [
        (45.0, 45.0, {"elbow.position", "elbow.goal"}),
        (45.0, 45.0 * np.pi / 180.0, {"elbow.position"}),
        (1.5, 1.5, set()),
        (4.0, 4.0, set()),  # somewhat beyond: a zero or a range that is off
    ],
)
def test_degrees_are_told_by_the_range_of_the_joint(
    tmp_path: Path, position: float, goal: float, wrong: set[str]
) -> None:
    """45 rad were replayed on a joint that ends at 1.57, since nothing else of so slow a log tells its unit."""
    assert columns_in_degrees(tmp_path, position, goal) == wrong


def test_a_joint_without_a_range_may_turn_as_often_as_it_likes(tmp_path: Path) -> None:
    assert columns_in_degrees(tmp_path, 45.0, 45.0, range_="") == set()
