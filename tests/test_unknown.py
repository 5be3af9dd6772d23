"""What a sidecar may leave open, and how it is said."""

from __future__ import annotations

import numpy as np
import pytest

from gap.log_types import JointLog, LogError, MeasuredRun
from gap.unknown import UNKNOWN, unknown_parameters, with_believed_load


def run_with(unknown: object) -> MeasuredRun:
    time = np.arange(0.0, 1.0, 0.01)
    return MeasuredRun("swing", time, {"servo": JointLog(None, np.sin(time))}, robot="arm", meta={"unknown": unknown})


def test_a_single_word_is_a_list_of_one() -> None:
    assert unknown_parameters(run_with("load")) == unknown_parameters(run_with(["load"])) == UNKNOWN["load"]
    assert with_believed_load(run_with("load")).robot == "bench"


@pytest.mark.parametrize("unknown", ["payload", ["zero", "payload"], {"load": True}, [["load"]], 3])
def test_anything_else_is_refused_with_the_words_that_are_known(unknown: object) -> None:
    for ask in (unknown_parameters, with_believed_load):
        with pytest.raises(LogError, match=r"swing: meta\.unknown holds .* zero, friction, armature, motor, load"):
            ask(run_with(unknown))
