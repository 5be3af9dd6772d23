"""A law at the edge of its own shape is the simpler law that it is there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import sealegs
from sealegs.actuators import load_chain
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.causes.cause import Cause
from sealegs.gap.causes.friction import RIPPLE_COUNTS
from sealegs.gap.finder.diagnosis import first_look
from sealegs.gap.fit import FittedValue
from sealegs.gap.measure.rivals import beside_rivals
from sealegs.gap.prepare.request import Request
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.parameters import Parameter, factor
from sealegs.gap.replay.problem import Problem
from sealegs.gap.search.correlated import shared
from sealegs.gap.search.fit import Fit
from sealegs.gap.search.forward import Searcher
from sealegs.gap.search.intervals import inflation
from sealegs.gap.search.result import Candidate
from sealegs.gap.search.rough import to_try
from sealegs.gap.search.settings import DEFAULT
from sealegs.gap.search.simpler import elaborates, visited
from sealegs.gap.search.state import Judged

from testbed import hidden_bench
from testbed.everyday import drawn
from testbed.logs import hidden_everyday
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


# --- intervals: errors that hang together, instants at which a column was read, and rivals of another cause ----------


def drifting(time: np.ndarray, memory: float) -> np.ndarray:
    """Errors of unit variance that forget within ``memory`` [s]."""
    rng = np.random.default_rng(2)
    kept = np.exp(-np.diff(time, prepend=time[0]) / memory)
    error, last = np.empty(len(time)), rng.standard_normal()
    for k, share in enumerate(kept):
        last = share * last + np.sqrt(1.0 - share**2) * rng.standard_normal()
        error[k] = last
    return error


def test_what_neighbours_share_does_not_hang_on_which_run_comes_first() -> None:
    """The first run's period counted for all: 0.62 or 0.89 by their order."""
    times = np.arange(0.0, 20.0, 0.002), np.arange(0.0, 400.0, 0.02)
    errors = [drifting(time, 0.1) for time in times]
    found = []
    for order in ((0, 1), (1, 0)):
        starts = np.cumsum([0, *(len(times[k]) for k in order)])
        problem = SimpleNamespace(time=np.concatenate([times[k] for k in order]), starts=starts)
        found.append(shared(cast(Any, problem), np.concatenate([errors[k] for k in order])))
    assert found[0] == pytest.approx(found[1])


def test_each_parameter_is_widened_by_how_its_own_errors_hang_together() -> None:
    """A mean over all: a slow parameter beside a quick one had an interval of half its size."""
    rng = np.random.default_rng(0)
    moves = rng.standard_normal((4000, 2)) * np.sqrt([50.0, 1.0])
    found = inflation(np.eye(2), moves)
    assert found[0] == pytest.approx(50.0, rel=0.1) and found[1] == pytest.approx(1.0, rel=0.1)


ASKED = ("friction.viscous", "delay.seconds")


def true_and_fitted(seed: int) -> dict[str, tuple[float, FittedValue]]:
    """What a machine has, and what is fitted to 6 s of it; its duty and current are up to 0.25 ms old when read."""
    data, truth = hidden_bench({"friction.viscous": 0.05}, seed=seed, runs=1, duration=6.0, nominal_error=0.0)
    machine = truth["machines"][0]
    found = sealegs.fit(data, ASKED)
    return {name: (getattr(machine, key), found.values[name]) for name, key in zip(ASKED, KEYS, strict=True)}


KEYS = ("viscous", "command_delay")


def test_columns_that_are_read_a_little_late_widen_the_intervals_of_delay_and_viscous_friction() -> None:
    """Both left the truth out: the clock widened no number that is fitted as a factor, and none but times."""
    for true, value in true_and_fitted(3).values():
        assert value.low < true < value.high
        assert value.high - value.low < 0.08 * true


@pytest.mark.long
def test_intervals_of_delay_and_viscous_friction_hold_the_truth() -> None:
    seeds = range(1, 9)
    inside: dict[str, int] = dict.fromkeys(ASKED, 0)
    for seed in seeds:
        for name, (true, value) in true_and_fitted(seed).items():
            inside[name] += value.low < true < value.high
    assert min(inside.values()) >= len(seeds) - 1, inside


ROTOR = Parameter("load.extra_inertia", "kg.m2", 0.0, 0.04, 0.0, 0.01)
SCALE = Parameter("encoder.scale", "1", 0.8, 1.25, 1.05, 0.02)
TUNED = factor("dc_motor.resistance", 0.94, 1.06, 0.05, 0.4)
BOUNDS = {ROTOR.path: (0.0287, 0.0326), SCALE.path: (1.07, 1.10), TUNED.path: (0.95, 1.06)}


def fitted(**values: float) -> Any:
    """Fits to both parts of the data."""
    return (SimpleNamespace(values=values),) * 2


def widened(
    there: dict[str, tuple[float, float]], *paths: str, accepted: bool = True
) -> dict[str, tuple[float, float]]:
    """Intervals of a rotor beside an encoder that reads too much, with a rival of the encoder that leaves those open.

    Args:
        there: intervals beside the rival.
        paths: that the rival's model turns.
        accepted: whether the round is one of what was found.
    """
    rival = SimpleNamespace(fits=fitted(**dict.fromkeys(paths, 1.0)), variant=(TUNED,))
    first, second = (SimpleNamespace(accepted=accepted, rivals=those) for those in ((), (rival,)))
    search: Any = SimpleNamespace(
        rounds=[first, second, SimpleNamespace(accepted=False, rivals=(rival,))], tuned=(TUNED,),
        accepted=[SimpleNamespace(variant=(p,)) for p in (ROTOR, SCALE)], close=lambda step: step.rivals,
    )  # fmt: skip
    return beside_rivals(search, BOUNDS, lambda turned, fits: {p.path: there[p.path] for p in turned})


def test_a_rotor_may_be_what_it_is_beside_a_rival_of_another_cause() -> None:
    """Beside an encoder's scale of 1.09 it was 0.0297 [0.0287, 0.0326], beside the weaker motor that was meant 0.02."""
    there = {ROTOR.path: (0.0191, 0.0230), TUNED.path: (0.94, 1.0)}
    found = widened(there, ROTOR.path, TUNED.path)
    assert found == {**BOUNDS, ROTOR.path: (0.0191, 0.0326)}  # the rest is told beside what was found


def test_without_a_rival_an_interval_stays() -> None:
    there = {ROTOR.path: (0.0191, 0.0230), TUNED.path: (0.94, 1.0)}
    assert widened(there, ROTOR.path, TUNED.path, accepted=False) == BOUNDS
    assert widened(there, TUNED.path) == BOUNDS  # it was tried before the rotor was found


# --- A latency of the bus is found at first sight, also where it is longer than a sample and the duty is logged ------


@pytest.mark.long
@pytest.mark.parametrize("seed", [716, 1106])
def test_a_latency_that_is_longer_than_a_sample_is_one_of_all_joints(seed: int, tmp_path: Path) -> None:
    """24 ms at one of two joints were told as 12: each sample of duty and current leaves a fit a minimum."""
    case = drawn(seed % 100, seed)
    data, truth = hidden_everyday(case, tmp_path)
    (late,) = [effect["values"][0] for effect in truth["effects"] if effect["name"] == "latency"]
    found = first_look(data, Request()).latency
    assert found is not None and len(found.joints) == len(case.machine.joints)
    assert found.value == pytest.approx(late, abs=1e-3) and found.low <= late <= found.high
