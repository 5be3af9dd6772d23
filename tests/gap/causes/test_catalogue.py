"""What a cause is stands in its fields; what a sidecar may leave open, and how that is said."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.common.errors import SealegsError
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.causes.cause import ENTRIES, Cause, View
from sealegs.gap.causes.unknown import UNKNOWN, unknown_parameters, with_believed_load
from sealegs.gap.load.load import PendulumLoad, hung
from sealegs.gap.load.tree import TreeLoad
from sealegs.gap.log.sidecar import read_sidecar
from sealegs.gap.log.types import JointLog, LogError, MeasuredRun
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.parameters import Target, address

NOMINAL = JointModel(load_chain("sts3215"))
BEHIND_THE_LINK = {"load.mass", "load.inertia", "load.centre_of_mass", "contact.blocked"}


def causes(nominal: JointModel = NOMINAL) -> dict[str, Cause]:
    return {cause.name: cause for cause in catalogue(nominal)}


def every() -> Iterator[Cause]:
    """The causes of joints with and without a spring."""
    yield from causes().values()
    *drive, encoder = NOMINAL.chain.to_list()
    springy = [*drive, {"spring": {"stiffness": 10.0}}, encoder]
    yield from causes(JointModel(load_chain(springy))).values()


def test_every_cause_of_the_catalogue_applies_to_some_joint_and_names_causes_that_there_are() -> None:
    found = {cause.name: cause for cause in every()}
    assert set(found) == set(ENTRIES)
    for cause in found.values():
        assert cause.sentence.endswith(".") and cause.variants
        assert cause.degenerates_to is None or cause.degenerates_to.cause in ENTRIES


def test_a_joint_that_is_moved_as_measured_hides_what_is_behind_its_link_and_in_front_of_its_motor() -> None:
    def hidden(view: View) -> set[str]:
        return {name for name, cause in causes().items() if not cause.needs.met_by(view)}

    assert hidden(View()) == set()
    assert hidden(View(free_link=False)) == BEHIND_THE_LINK
    rigid = View(free_link=False, free_motor=False, columns=frozenset({"duty"}))
    friction = {name for name, cause in causes().items() if cause.needs.torque}
    between = {"transmission.backlash", "transmission.compliance"}
    assert hidden(rigid) == BEHIND_THE_LINK | between | friction and len(friction) == len(
        [name for name in ENTRIES if address(name).owner == "friction"]
    )
    assert hidden(View(False, False, frozenset({"torque"}))) == BEHIND_THE_LINK | between


def test_nobody_is_wrong_about_a_load_that_nobody_knows() -> None:
    unknown = JointModel(NOMINAL.chain, unknown=UNKNOWN["load"])
    assert set(causes()) - set(causes(unknown)) == {"load.mass", "load.inertia", "load.centre_of_mass", "sensor.offset"}


def test_duties_above_a_fitted_limit_refute_it() -> None:
    ceiling = causes()["drive.saturation"].refuted_by
    assert ceiling is not None
    duty = np.array([0.1, -0.95, 0.5, 0.5])
    assert ceiling.exceeded(duty, [{"duty_limit.limit": 0.9}, {"duty_limit.limit": 0.97}], NOMINAL) == 0.25
    assert ceiling.exceeded(duty, [{"duty_limit.limit*": 1.0}], NOMINAL) == 0.0


def test_causes_are_chosen_by_name_and_a_wrong_name_gets_a_hint() -> None:
    assert [cause.name for cause in catalogue(NOMINAL, ["drive.delay", "load.mass"])] == ["drive.delay", "load.mass"]
    with pytest.raises(SealegsError, match=r"no cause 'friction.columb'.*friction.coulomb"):
        catalogue(NOMINAL, ["friction.columb"])
    with pytest.raises(SealegsError, match=r"no cause 'friction'; there are .*friction.coulomb, friction.viscous"):
        catalogue(NOMINAL, ["friction"])


@pytest.mark.parametrize(
    ("path", "target", "factor"),
    [
        ("friction.coulomb*", Target.STAGE, True),
        ("load.mass_factor", Target.LOAD, False),
        ("host.offset", Target.HOST, False),
        ("gear_ratio.factor", Target.GEAR, False),
        ("contact.friction*", Target.GROUND, True),
    ],
)
def test_a_path_says_whose_number_it_is(path: str, target: Target, factor: bool) -> None:
    found = address(path)
    assert (found.target, found.factor) == (target, factor)
    assert f"{found.number}{'*' if factor else ''}" == path


@pytest.mark.parametrize(("believed", "turned"), [(0.0, {"asymmetry", "coulomb"}), (0.02, {"asymmetry"})])
def test_a_model_without_dry_friction_gets_it_together_with_its_asymmetry(believed: float, turned: set[str]) -> None:
    """Alone it would be friction in one direction only, which an offset then hides."""
    joint = JointModel(load_chain("sts3215")).with_values({"friction.coulomb": believed})
    (cause,) = (cause for cause in catalogue(joint) if cause.name == "friction.asymmetric")
    assert {address(parameter.number).key for parameter in cause.variants[0]} == turned


def test_inertia_is_sought_by_the_size_of_what_hangs_there() -> None:
    """From 2 g.m2 on, whatever hung there: of 1.3 kg.m2 that is nothing, and it was never tried further."""
    small, large = ({"mass": 0.3, "length": 0.12}, {"mass": 5.0, "length": 0.5})
    for params, inertia in ((small, 0.0043), (large, 1.25)):
        nominal = JointModel(load_chain("sts3215"), hung([params, {"mass": 0.1, "length": 0.1}]))
        (cause,) = [cause for cause in catalogue(nominal) if cause.name == "load.inertia"]
        (extra,) = cause.variants[0]
        assert max(0.002, 0.1 * inertia) <= extra.start <= 0.01 + 0.15 * inertia
        assert extra.high >= 10.0 * inertia


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
