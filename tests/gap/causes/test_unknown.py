"""What a sidecar may leave open, and how it is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.causes.unknown import UNKNOWN, unknown_parameters, with_believed_load
from sealegs.gap.load.pendulum import PendulumLoad
from sealegs.gap.load.tree_load import TreeLoad
from sealegs.gap.log.sidecar import read_sidecar
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


def test_what_the_file_of_a_robot_leaves_open_is_open_and_its_load_starts_from_the_model() -> None:
    chain, load = load_chain("sts3215"), TreeLoad(typical_inertia=0.01, typical_gravity=0.5)
    run = replace(run_with([]), robot="my_arm.yaml")
    found = [p.number for p in unknown_parameters(run, chain, ("load", "friction", "direction"), load)]
    assert found == ["load.mass_factor", "load.extra_inertia", "friction.coulomb", "friction.viscous"]
    assert with_believed_load(replace(run_with("load"), robot="my_arm.yaml")).robot == "my_arm.yaml"


def test_an_unknown_load_that_a_sidecar_starts_from_has_the_arm_of_every_other_bench() -> None:
    """An arm that was left out weighed 0 kg with ``unknown: [load]``, and 0.03 kg without."""
    described = replace(run_with("load"), robot="bench", robot_params={"mass": 0.5, "length": 0.12})
    load, open_load = PendulumLoad(), with_believed_load(described).robot_params
    assert load.inertia(open_load) == load.inertia(described.robot_params)
    assert load.gravity_torque(open_load) == load.gravity_torque(described.robot_params)
    untold = with_believed_load(run_with("load")).robot_params  # nothing that no fit turns is invented
    assert load.inertia(untold) == pytest.approx(untold["mass"] * untold["length"] ** 2)


def test_chains_and_published_fits_are_found_beside_the_log_that_names_them(tmp_path: Path) -> None:
    for name in ("fit.json", "mine.yaml"):
        (tmp_path / name).write_text("{}")
    (tmp_path / "log.yaml").write_text("robot: bench\nactuators: {a: 'bam:fit.json', b: mine.yaml, c: sts3215}\n")
    found = read_sidecar(tmp_path / "run.csv").actuators
    assert found == {"a": f"bam:{tmp_path}/fit.json", "b": f"{tmp_path}/mine.yaml", "c": "sts3215"}
