"""What is equal at joints that have nothing else in common is of the bus."""

from __future__ import annotations

import pytest
from sealegs.gap.causes.cause import Cause
from sealegs.gap.replay.parameters import Parameter, factor
from sealegs.gap.search.latency import DELAY, NUMBER, Latency, agreeing, mean_of

FOUND = Latency(0.0223, 0.0219, 0.0227, 0.005, ("hip", "knee"), 0.9)


def test_joints_agree_within_their_intervals() -> None:
    assert agreeing({"hip": (0.022, 0.001), "knee": (0.0230, 0.001), "roll": (0.020, 0.003)}) == ["hip", "knee", "roll"]


def test_a_joint_that_says_otherwise_is_left_out() -> None:
    values = {"hip": (0.022, 0.0005), "knee": (0.0222, 0.0005), "roll": (0.0219, 0.0005), "jaw": (0.031, 0.001)}
    assert agreeing(values) == ["hip", "knee", "roll"]


def test_two_joints_that_differ_share_nothing() -> None:
    assert len(agreeing({"hip": (0.022, 0.0005), "knee": (0.012, 0.0005)})) == 1


def test_the_mean_is_of_the_joints_that_know_most_and_as_wide_as_they_differ() -> None:
    value, half = mean_of([(0.022, 0.0002), (0.030, 0.02)])
    assert value == pytest.approx(0.022, abs=1e-5) and half == pytest.approx(0.0002, rel=0.01)
    assert mean_of([(0.020, 0.0005), (0.022, 0.0005)])[1] > mean_of([(0.021, 0.0005), (0.021, 0.0005)])[1]


def test_a_joint_turns_its_delay_about_the_shared_one_alone_and_seeks_no_other() -> None:
    numbers = [factor("delay.seconds", 0.9, 1.1), factor("friction.coulomb", 0.9, 1.1)]
    told = FOUND.numbers_of("hip", numbers)
    assert [p.number for p in told] == ["friction.coulomb", NUMBER]
    assert told[1].start == 0.0223 and told[1].low == pytest.approx(0.0217) and told[1].high == pytest.approx(0.0229)
    assert FOUND.numbers_of("jaw", numbers) == numbers
    delay = Cause(sentence="", picture="", variants=((Parameter(NUMBER, "s", 0.0, 0.2, 0.01, 0.004),),), name=DELAY)
    assert FOUND.causes_of("hip", [delay]) == [] and FOUND.causes_of("jaw", [delay]) == [delay]
