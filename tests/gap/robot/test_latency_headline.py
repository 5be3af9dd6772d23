"""What all joints share, such as a latency of the bus, comes first where it does most."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealegs.gap.causes.cause import Cause
from sealegs.gap.load.terms import T_COLUMNS
from sealegs.gap.measure.case import ROBOT, Case
from sealegs.gap.measure.measured import Measured
from sealegs.gap.measure.named import CERTAIN, Error, NamedCause, Value
from sealegs.gap.replay.parameters import Parameter, factor
from sealegs.gap.robot.search import SharedFound
from sealegs.gap.robot.together import RESISTANCE, SAG, agreed_latency, beside_latency, with_latency, with_supply
from sealegs.gap.search.latency import DELAY, NUMBER, Latency, agreeing, apart_from, mean_of
from sealegs.gap.verdict.verdict import EXPLAINED, NOT_IDENTIFIABLE, JointDiagnosis, Reason

LATE = Latency(0.0243, 0.0236, 0.025, 0.005, ("pan", "tilt"), 1.0)
NOISE, BEFORE = 1e-3, 80e-3


def cause(name: str, share: float, joint: str = "pan", number: str = "") -> NamedCause:
    parameters = {number: Value(1.0, 0.9, 1.1, "1", 0.0)} if number else {}
    return NamedCause(name, "", joint, share, 0.99, parameters, 0.5, "effect", standing=CERTAIN)


MOVED = {NUMBER: 9.0, "friction.load": 2.0, "dc_motor.resistance*": 1.0}


def judged(joint: str, *causes: NamedCause, sentence: str, **more: Any) -> JointDiagnosis:
    """A joint that its latency moves by 9 parts, load friction by 2, and its other numbers by 1."""

    def simulate(rows: list[dict[str, float]]) -> np.ndarray:
        return np.array([[size if path in row else 0.0 for path, size in MOVED.items()] for row in rows])

    tree = SimpleNamespace(terms=np.ones((1, T_COLUMNS)))
    problem = SimpleNamespace(simulate=simulate, position_error=lambda row: row, joint=tree)
    replay: Any = SimpleNamespace(problem=problem)
    sizes = {"nominal": BEFORE, "refitted": BEFORE, "extended": NOISE, "noise_floor": NOISE}
    known: dict[str, Any] = {
        "verdict": EXPLAINED, "tuned_share": 0.93, "unexplained": 0.0, "values": dict.fromkeys(MOVED, 1.0)
    }  # fmt: skip
    return JointDiagnosis.of(
        case=Case(joint, signal=f"{joint}.position", unit="rad", replay=replay),
        gap={name: Error(size, size) for name, size in sizes.items()},
        causes=causes,
        sentence=sentence,
        **(known | more),
    )


def test_a_latency_that_does_most_comes_before_a_cause_of_the_joint() -> None:
    """It read "tuned numbers and friction.load_dependent explain the gap of 'pan'", of which the bus had 87 %."""
    numbers = "Tuned numbers and friction.load_dependent explain the gap of 'pan'."
    one = cause("friction.load_dependent", 0.07, number="friction.load")
    found = beside_latency(judged("pan", one, sentence=numbers), LATE)
    shares = found.shared_share, found.causes[0].share, found.tuned_share
    assert shares == pytest.approx((81.0 / 86.0, 4.0 / 86.0, 1.0 / 86.0))
    assert found.sentence == (
        "The latency of all joints, 24.3 ms, explains 94 % of the gap of 'pan', friction.load_dependent 5 % "
        "(confidence 99 %): error 80.0 mrad to 1.0 mrad."
    )


def test_a_cause_that_does_more_than_the_latency_stays_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stop that moved a joint further than the latency was told behind it: their shares were of two kinds."""
    monkeypatch.setitem(MOVED, "friction.load", 12.0)
    said = "friction.load_dependent explains the gap of 'pan'."
    one = cause("friction.load_dependent", 0.4, number="friction.load")
    found = beside_latency(judged("pan", one, sentence=said, tuned_share=0.6), LATE)
    assert found.sentence == said and found.causes[0].share > found.shared_share


def test_a_joint_that_only_the_latency_moves_is_explained_by_it_whatever_its_motion_hides() -> None:
    blind = (Reason("blind", "But the motion is so poor that it would hardly show contact.blocked."),)
    poor = judged("tilt", sentence="Within 1 mrad, but ...", verdict=NOT_IDENTIFIABLE, reasons=blind)
    found = beside_latency(poor, LATE)
    assert found.verdict == EXPLAINED and found.sentence.startswith("The latency of all joints, 24.3 ms, explains 94 %")
    assert any(reason.code == "blind" for reason in found.reasons)


@pytest.mark.parametrize(("late", "mass"), [(0.87, 0.07), (0.2, 0.7)])
def test_the_robots_headline_is_the_largest_that_joints_share(late: float, mass: float) -> None:
    """It read "tuned numbers and load.mass explain the gap of 'robot'", where the latency had 87 %, load.mass 7 %."""
    joints = [beside_latency(judged(name, sentence=""), LATE) for name in LATE.joints]
    said = "load.mass explains the gap of 'robot': error 64.2 to 0.8."
    shares: dict[str, Any] = {"values": {}, "tuned_share": 1.0 - late - mass, "shared_shares": {"drive.delay": late}}
    found = with_latency([*joints, judged(ROBOT, cause("load.mass", mass, ROBOT), sentence=said, **shares)], LATE)[-1]
    assert [one.name for one in found.causes] == sorted(["drive.delay", "load.mass"], reverse=late < mass)
    assert found.tuned_share + found.shared_share + sum(one.share for one in found.causes) == pytest.approx(1.0)
    first = "All joints: latency 24.3 ms" if late > mass else said.removesuffix(".")
    second = f"load.mass {100 * mass:.0f} %" if late > mass else "the latency 24.3 ms"
    assert found.sentence.startswith(first) and second in found.sentence


def test_shares_of_the_robot_are_by_how_far_each_cause_moves_the_joints() -> None:
    """A payload had 100 % of a leg's gap beside 34 % of a latency that moved the joints twice as far."""
    sizes = {"body.foot.payload": 3.0, "hip|delay.seconds": 6.0, "hip|friction.coulomb*": 1.0}

    def simulate(rows: list[dict[str, float]]) -> np.ndarray:
        return np.array([[sizes[path] if path in row else 0.0 for path in sizes] for row in rows])

    fits = SimpleNamespace(values=dict.fromkeys(sizes, 1.0))
    problem: Any = SimpleNamespace(simulate=simulate, position_error=lambda row: row)
    search: Any = SimpleNamespace(fits=(fits, fits))
    payload = replace(cause("load.mass", 1.0, ROBOT), parameters={"body.foot.payload": Value(1.0, 0.9, 1.1, "kg", 0.0)})
    split = SharedFound(problem, search, (), {}).by_effect(Measured(causes=(payload,)), NUMBER, DELAY)
    assert split.causes[0].share == pytest.approx(9.0 / 46.0)
    assert (split.shared_shares[DELAY], split.tuned_share) == pytest.approx((36.0 / 46.0, 1.0 / 46.0))
    alone = SharedFound(problem, search, (), {}).by_effect(Measured(causes=(payload,)))
    assert not alone.shared_shares and alone.tuned_share == pytest.approx(37.0 / 46.0)


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


def test_what_one_joint_alone_says_or_a_clock_may_hide_is_no_latency_of_all() -> None:
    """The knee of a leg hid resistance and viscous friction: 4.4 ms at all joints, where 5.0 was believed and right."""
    knee = {"hip_roll": (4.69, 1.0), "hip_pitch": (3.99, 1.0), "knee": (4.56, 1.0)}
    assert apart_from(5.0, knee, clock=1.0) is None
    assert apart_from(5.0, {"hip": (7.0, 4.0), "knee": (12.0, 0.5)}, clock=0.5) is None
    value, half = apart_from(5.0, {"wrist": (18.4, 2.0), "jaw": (17.8, 2.0)}, clock=1.0) or (0.0, 0.0)
    assert value == pytest.approx(18.1) and half == pytest.approx(2.0 / 2.0**0.5)
    assert apart_from(5.0, {"wrist": (18.4, 0.1), "jaw": (17.8, 0.1)}, clock=1.0) == pytest.approx((18.1, 1.0))


def test_a_joint_turns_its_delay_about_the_shared_one_alone_and_seeks_no_other() -> None:
    numbers = [factor("delay.seconds", 0.9, 1.1), factor("friction.coulomb", 0.9, 1.1)]
    told = FOUND.numbers_of("hip", numbers)
    assert [p.number for p in told] == ["friction.coulomb", NUMBER]
    assert told[1].start == 0.0223 and told[1].low == pytest.approx(0.0217) and told[1].high == pytest.approx(0.0229)
    assert FOUND.numbers_of("jaw", numbers) == numbers
    delay = Cause(sentence="", picture="", variants=((Parameter(NUMBER, "s", 0.0, 0.2, 0.01, 0.004),),), name=DELAY)
    assert FOUND.causes_of("hip", [delay]) == [] and FOUND.causes_of("jaw", [delay]) == [delay]


SAGS = {"hip_roll": (0.64, 0.678, 0.716), "hip_pitch": (0.60, 0.629, 0.657), "knee": (0.553, 0.62, 0.686)}


def sagging(sags: dict[str, tuple[float, float, float]], *others: NamedCause) -> list[JointDiagnosis]:
    """Joints that were each found to have a supply of so many ohms: lower end, value, upper end."""
    found = []
    for joint, (low, value, high) in sags.items():
        parameters = {RESISTANCE: Value(value, low, high, "ohm", 0.0)}
        own = replace(cause(SAG, 0.6, joint), parameters=parameters)
        found.append(judged(joint, own, *others, sentence=f"{SAG} explains the gap of '{joint}'.", tuned_share=0.4))
    return found


def test_a_supply_that_joints_agree_on_is_told_once() -> None:
    """A leg on 0.66 ohm was told three sags."""
    *joints, robot = with_supply(sagging(SAGS), None)
    told = robot.causes[0]
    value = told.parameters[RESISTANCE]
    assert robot.joint == ROBOT and told.name == SAG and told.confidence == 0.99
    assert value.low <= 0.662 <= value.high and value.high - value.low < 0.1
    assert robot.sentence.startswith("All joints: supply 0.64 ohm") and robot.verdict == EXPLAINED
    for joint in joints:
        assert not joint.causes and joint.shared == {RESISTANCE: SAG} and joint.shared_shares == {SAG: 0.6}
        assert joint.sentence.startswith(f"{SAG} of the robot explains 60 % of the gap of '{joint.joint}'")


def test_sags_of_other_sizes_are_of_the_joints_own_wires() -> None:
    apart = sagging({"hip": (0.18, 0.2, 0.22), "knee": (0.68, 0.7, 0.72)})
    assert with_supply(apart, None) == apart
    assert with_supply(alone := sagging({"hip": (0.6, 0.7, 0.8)}), None) == alone


def test_the_supply_comes_beside_the_latency_of_all_joints() -> None:
    late = with_latency(
        [beside_latency(one, FOUND) for one in sagging(dict.fromkeys(FOUND.joints, SAGS["knee"]))], FOUND
    )
    robot = with_supply(late, FOUND)[-1]
    assert [one.name for one in robot.causes] == [DELAY, SAG]
    assert robot.tuned_share + robot.unexplained + sum(one.share for one in robot.causes) == pytest.approx(1.0)
    assert "latency 22.3 ms" in robot.sentence and robot.sentence.endswith("% of the gap.")
    assert "beside it the supply 0.62 ohm" in robot.sentence


def late_joints(delays: dict[str, float]) -> list[JointDiagnosis]:
    """Joints that were each found to be late by so much, within 0.7 ms [s]."""
    found = []
    for joint, value in delays.items():
        parameters = {NUMBER: Value(value, value - 7e-4, value + 7e-4, "s", 0.005)}
        own = replace(cause(DELAY, 0.6, joint), parameters=parameters)
        found.append(judged(joint, own, sentence=f"{DELAY} explains the gap of '{joint}'.", tuned_share=0.4))
    return found


def test_a_latency_that_joints_agree_on_after_their_searches_is_told_once() -> None:
    """A first look took 15.7 ms for 20 at the wrist of a gripper, and both joints had a latency of their own."""
    joints, found = agreed_latency(late_joints({"wrist": 0.0206, "jaw": 0.0205}))
    assert (
        found is not None
        and found.low < 0.02055 < found.high
        and found.high - found.low == pytest.approx(1.4e-3, rel=0.1)
    )
    *_, robot = with_latency(joints, found)
    assert robot.joint == ROBOT and [one.name for one in robot.causes] == [DELAY]
    assert all(not one.causes and one.sentence.startswith("The latency of all joints, 20.") for one in joints)


@pytest.mark.parametrize("delays", [{"wrist": 0.0206, "jaw": 0.0123}, {"wrist": 0.0206}])
def test_joints_that_are_late_by_other_times_have_their_own(delays: dict[str, float]) -> None:
    late = late_joints(delays)
    assert agreed_latency(late) == (late, None)


def test_a_latency_that_no_joint_tells_from_a_late_reading_stays_with_the_joints() -> None:
    late = [
        one.changed(causes=tuple(replace(c, rivals=("sensor.delay",)) for c in one.causes))
        for one in late_joints({"wrist": 0.0206, "jaw": 0.0205})
    ]
    assert agreed_latency(late) == (late, None)


def test_a_latency_of_two_joints_of_six_is_not_that_of_the_bus() -> None:
    others = [judged(joint, sentence="", tuned_share=0.0) for joint in ("a", "b", "c", "d")]
    late = [*late_joints({"wrist": 0.0206, "jaw": 0.0205}), *others]
    assert agreed_latency(late)[1] is None
