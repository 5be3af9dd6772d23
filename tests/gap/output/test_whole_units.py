"""The whole robot is simulated along the log as it was judged: in the model's units, whatever those of the file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.output.extension import extended_of
from sealegs.gap.output.whole import confirm_whole

from testbed.bench import NOISE_FLOOR
from tests.logged_robots import JOINTS, two_link_run


@pytest.mark.long
def test_a_log_in_degrees_is_simulated_in_radians(tmp_path: Path) -> None:
    """The errors were those of a machine that flew apart: 86 rad, under warnings of the engine."""
    run = two_link_run(tmp_path, 6.0)
    joints = {
        name: replace(log, position=np.degrees(log.position), goal=np.degrees(np.asarray(log.goal)), velocity=None)
        for name, log in run.joints.items()
    }
    said = replace(run, joints=joints, meta={**run.meta, "units": {"position": "deg", "goal": "deg"}})
    data = MeasuredSet((said,), "degrees")
    diagnoses = list(diagnose(data, causes=["friction.coulomb"]))
    extended = extended_of(diagnoses, data)
    assert extended is not None
    found = confirm_whole(diagnoses, data, extended)
    assert found is not None
    assert all(found["joints"][joint]["nominal"] < 3.0 * NOISE_FLOOR for joint in JOINTS)
