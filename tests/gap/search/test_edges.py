"""A law at the edge of its own shape is the simpler law that it is there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.causes.cause import Cause
from sealegs.gap.causes.friction import RIPPLE_COUNTS
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.problem import Problem
from sealegs.gap.search.fit import Fit
from sealegs.gap.search.forward import Searcher
from sealegs.gap.search.result import Candidate
from sealegs.gap.search.rough import to_try
from sealegs.gap.search.settings import DEFAULT
from sealegs.gap.search.simpler import elaborates, visited
from sealegs.gap.search.state import Judged

from tests.gap.search.test_decisions import evidence
from tests.smooth_bench import CHAIN


class Slow:
    """Data of a joint that moves at up to 1 rad/s, through a tenth of a turn."""

    channels = ("torque", "position")
    measured = 0.1 * 2.0 * np.pi * np.array([[9.0, 0.0], [0.0, 0.5], [0.0, np.nan], [0.0, 1.0], [0.0, 9.0]])
    judged = np.array([True, True, True, True, False])

    def simulate(self, variants: list[dict[str, float]]) -> np.ndarray:
        return np.zeros((len(variants), 3, 4))

    def covariates(self, simulated: np.ndarray) -> dict[str, np.ndarray]:
        del simulated
        return {"speed": np.array([-1.0, 0.2, 1.0])}


def left(
    value: float,
    *names: str,
    taken: tuple[str, ...] = (),
    number: str = "friction.stribeck_velocity",
    at: tuple[str, ...] = (),
    simple: float = 1.0,
) -> list[str]:
    """Names of what stays of the first cause when it was found with a value of a number, in units of its own.

    Args:
        value: of the number.
        names: of causes; the first was found.
        taken: causes that the model has.
        number: that has the value.
        at: numbers that are at a bound.
        simple: loss of what is fitted beside the first cause, whose loss is 1.
    """
    causes = {cause.name: cause for cause in catalogue(JointModel(load_chain(CHAIN)), names)}
    searcher: Any = object.__new__(Searcher)
    searcher.settings = DEFAULT
    searcher.shown, searcher.parts = list(causes.values()), (Slow(), Slow())
    searcher.visited = visited(cast(Problem, Slow()))
    fit = Fit({number: value}, np.zeros((3, 4)), 1.0, at)
    fits = (fit, fit)
    searcher.fit_both = lambda parameters, start: fits
    searcher.judged = lambda found: Judged(found, simple * np.ones(60), 1.0)

    def made(cause: Cause, variant: Any, judged: Judged) -> Candidate:
        return Candidate(cause, variant, judged.fits, replace(evidence(cause.name, 0.3), blocks=judged.blocks))

    searcher.candidate = made
    searcher.at_edge = lambda candidate: Searcher.at_edge(searcher, candidate)
    searcher.repeats = lambda count: Searcher.repeats(searcher, count)
    first = causes[names[0]]
    found = [made(first, first.variants[0], Judged(fits, np.ones(60), 1.0))]
    return [c.cause.name for c in Searcher.simplest(searcher, found, (), set(causes).difference(taken))]


@pytest.mark.parametrize("velocity", [1.2, 3.0])
def test_stribeck_friction_beyond_all_speeds_of_the_log_is_dry_friction(velocity: float) -> None:
    """It was named with confidence 1.00 at a velocity of 3.0 rad/s, its bound, where dry friction was hidden."""
    both = ("friction.stribeck", "friction.coulomb")
    assert left(velocity, *both) == ["friction.coulomb"]
    assert left(velocity, *both, taken=("friction.coulomb",)) == []


def test_within_the_speeds_of_the_log_it_stays_what_it_is() -> None:
    assert "friction.stribeck" in left(0.2, "friction.stribeck", "friction.coulomb")
    assert left(3.0, "friction.stribeck") == ["friction.stribeck"]


def test_a_number_at_a_bound_gives_way_to_a_simpler_cause_that_does_as_well() -> None:
    assert left(0.3, "friction.load_dependent", "friction.coulomb", at=("friction.load",)) == ["friction.coulomb"]
    kept = left(0.3, "friction.load_dependent", "friction.coulomb", at=("friction.load",), simple=1.1)
    assert kept == ["friction.load_dependent", "friction.coulomb"]


def test_bristles_as_stiff_as_any_are_dry_friction() -> None:
    stiff = left(1e6, "friction.presliding", "friction.coulomb", number="friction.bristle_stiffness")
    assert stiff == ["friction.coulomb"]


def test_friction_over_an_eighth_of_its_period_is_dry_friction() -> None:
    """Ripple with three periods a turn was named at an arm's joint that moves by a twenty-fifth of a turn."""
    both, count = ("friction.position_dependent", "friction.coulomb"), "friction.ripple_count"
    assert left(1.2, *both, number=count) == ["friction.coulomb"]
    assert left(12.0, *both, number=count) == ["friction.position_dependent", "friction.coulomb"]


def test_counts_of_which_the_joint_visits_next_to_nothing_are_not_tried() -> None:
    searcher: Any = object.__new__(Searcher)
    searcher.visited, searcher.settings = visited(cast(Problem, Slow())), DEFAULT
    (cause,) = catalogue(JointModel(load_chain(CHAIN)), ("friction.position_dependent",))
    tried = [variant[1].start for variant in Searcher.within_range(searcher, cause).variants]
    assert tried == [count for count in RIPPLE_COUNTS if count >= 5]


def test_data_without_a_position_exclude_no_count() -> None:
    class Heights(Slow):
        channels = ("base.z", "base.vz")

    assert visited(cast(Problem, Heights())) == np.inf
    assert visited(cast(Problem, Slow())) == pytest.approx(0.1 * 2.0 * np.pi)


def test_the_simpler_cause_is_tried_beside_the_best_one() -> None:
    assert left(0.2, "friction.stribeck", "friction.coulomb") == ["friction.stribeck", "friction.coulomb"]


@pytest.mark.parametrize(("gain", "stays"), [(1.1, False), (3.0, True)])
def test_friction_that_differs_by_direction_is_dry_friction_unless_that_makes_much_of_a_difference(
    gain: float, stays: bool
) -> None:
    """Of a model without dry friction both turn it: they were rivals, and neither was sure."""
    nothing = JointModel(load_chain(CHAIN)).with_values({"friction.coulomb": 0.0})
    causes = {cause.name: cause for cause in catalogue(nothing)}
    fit = Fit({}, np.zeros((3, 4)), 1.0, ())

    def candidate(name: str, loss: float) -> Candidate:
        blocks = loss * np.ones(60)
        return Candidate(
            causes[name], causes[name].variants[0], (fit, fit), replace(evidence(name, 0.3), blocks=blocks)
        )

    plain, more = candidate("friction.coulomb", gain), candidate("friction.asymmetric", 1.0)
    assert elaborates(more, plain, DEFAULT) is not stays
    assert not elaborates(plain, more, DEFAULT)


@pytest.mark.parametrize("far", [False, True])
def test_every_cause_is_tried_where_the_model_is_far_from_the_data(far: bool) -> None:
    """The inertia of a published arm was wrong, and the screen, a first order, left it out."""
    causes = [cause for cause in catalogue(JointModel(load_chain(CHAIN))) if not (cause.seen or cause.error)]
    rows = to_try([(causes[0], causes[0].variants[0])], causes, set(), blind=far)
    assert len({cause.name for cause, _ in rows}) == (len(causes) if far else 1)
    laws = {variant[0].number for cause, variant in rows if cause.name == "friction.asymmetric"}
    assert laws == ({"friction.asymmetry", "friction.viscous_asymmetry"} if far else set())
