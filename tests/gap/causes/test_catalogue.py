"""What a cause is stands in its fields."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.common.errors import SealegsError
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.causes.cause import Cause, View
from sealegs.gap.causes.registry import ENTRIES
from sealegs.gap.causes.unknown import UNKNOWN
from sealegs.gap.load.pendulum import hung
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
