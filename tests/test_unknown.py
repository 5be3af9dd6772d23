"""What a sidecar may leave open, and how it is said."""

from __future__ import annotations

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.causes.unknown import UNKNOWN, unknown_parameters, with_believed_load
from sealegs.gap.log.types import JointLog, LogError, MeasuredRun
from sealegs.gap.replay.joint_model import JointModel


def run_with(unknown: object) -> MeasuredRun:
    time = np.arange(0.0, 1.0, 0.01)
    return MeasuredRun("swing", time, {"servo": JointLog(None, np.sin(time))}, robot="arm", meta={"unknown": unknown})


def test_a_single_word_is_a_list_of_one() -> None:
    chain = load_chain("sts3215")
    one, several = (unknown_parameters(run_with(said), chain) for said in ("load", ["load"]))
    assert one == several == UNKNOWN["load"]
    assert with_believed_load(run_with("load")).robot == "bench"


@pytest.mark.parametrize("unknown", ["payload", ["zero", "payload"], {"load": True}, [["load"]], 3])
def test_anything_else_is_refused_with_the_words_that_are_known(unknown: object) -> None:
    for ask in (lambda run: unknown_parameters(run, load_chain("sts3215")), with_believed_load):
        with pytest.raises(LogError, match=r"swing: meta\.unknown holds .* zero, friction, armature, motor, load"):
            ask(run_with(unknown))


@pytest.mark.parametrize("word", ["friction", "armature", "motor"])
def test_what_the_chain_lacks_cannot_be_unknown(word: str) -> None:
    bare = load_chain([{"ideal": {"stiffness": 10.0, "damping": 0.1}}])
    with pytest.raises(
        LogError, match=rf"swing: meta\.unknown holds '{word}', and the chain has no .*; give the chain"
    ):
        unknown_parameters(run_with([word]), bare)


def test_a_number_that_the_chain_has_at_zero_stays_in_the_catalogue() -> None:
    chain = load_chain("sts3215").with_value("friction.viscous", 0.0)
    joint = JointModel(chain, unknown=unknown_parameters(run_with("friction"), chain))
    assert [p.path for p in joint.unknown] == ["friction.coulomb*"]
    names = [cause.name for cause in catalogue(joint)]
    assert "friction.viscous" in names and "friction.coulomb" not in names
