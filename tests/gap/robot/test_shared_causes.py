"""Causes that joints of a robot share: one number of the robot, with the same effect as in the engine's own model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from sealegs.envs.described.as_robot import as_robot, bare_model
from sealegs.envs.extended import Extended
from sealegs.gap.causes.cause import Cause
from sealegs.gap.diagnose import diagnose
from sealegs.gap.load.robot import LoggedRobot, Machine
from sealegs.gap.load.terms import T_COLUMNS, T_DRAWN
from sealegs.gap.load.tree import block_along
from sealegs.gap.log.types import MeasuredRun
from sealegs.gap.measure.case import ROBOT, Case
from sealegs.gap.measure.measured import Measured, rival_of
from sealegs.gap.measure.named import CERTAIN, Error, NamedCause, Value
from sealegs.gap.output.extension import shared_changes
from sealegs.gap.output.pictures.first_look import budget_slices
from sealegs.gap.prepare.pieces import cut_joint
from sealegs.gap.replay.parameters import TIGHT, Parameter, factor
from sealegs.gap.replay.tree import motion_of
from sealegs.gap.robot.directions import (
    ROW_RATE,
    Direction,
    about_joints,
    carries,
    centres,
    masses,
    payload,
    rows_of,
    tilt,
)
from sealegs.gap.robot.judged import beside_before
from sealegs.gap.robot.search import SharedFound, affected, helped
from sealegs.gap.robot.together import (
    RESISTANCE,
    SAG,
    agreed_latency,
    beside_latency,
    joined,
    with_latency,
    with_supply,
)
from sealegs.gap.search.latency import DELAY, NUMBER, Latency, agreeing, apart_from, mean_of
from sealegs.gap.search.settings import DEFAULT
from sealegs.gap.verdict.verdict import EXPLAINED, NOT_IDENTIFIABLE, JointDiagnosis, Reason

from testbed.logs import hidden_arm
from tests.logged_robots import JOINTS, free_replay, robot, two_link_run


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> MeasuredRun:
    return two_link_run(tmp_path_factory.mktemp("arm"), 2.0)


def found_of_robot(number: str, value: float) -> JointDiagnosis:
    return JointDiagnosis.of(joint=ROBOT, verdict="explained", signal="", values={number: value})


def numbers(machine: LoggedRobot) -> dict[str, tuple[Direction, float]]:
    """A number of each kind with a size that shows."""
    carried = payload(machine, "elbow")
    assert carried is not None
    every = [(carried, 0.1), *((d, 1.3) for d in masses(machine)), (tilt(machine)[1], 0.03)]
    every += [(group[1], 0.003) for _, group in centres(machine)]
    return {direction.number: (direction, size) for direction, size in every}


@pytest.mark.parametrize("joint", JOINTS)
def test_a_number_of_the_robot_does_to_each_joint_what_it_does_in_the_robots_model(
    recorded: MeasuredRun, joint: str
) -> None:
    machine = robot(recorded)
    every = max(round(1.0 / (ROW_RATE * recorded.period)), 1)
    at = np.arange(0, len(recorded.time), every)[:40]
    whole = motion_of(machine, recorded)
    motion = type(whole)(whole.position[at], whole.speed[at], whole.acceleration[at])
    believed = block_along(machine.model, machine.number(joint), motion)
    for number, (direction, size) in numbers(machine).items():
        found = Extended(recorded.robot, {}, {}, tuple(shared_changes(machine, found_of_robot(number, size))))
        model = bare_model(machine.file, found.params_on(as_robot(machine.file)))
        change = block_along(model, machine.number(joint), motion) - believed
        rows = rows_of(direction, machine, joint, [recorded], [whole])
        said = np.zeros_like(change) if rows is None else (size - direction.neutral) * rows[0][at]
        np.testing.assert_allclose(said, change, atol=0.02 * np.abs(change).max() + 1e-5, err_msg=number)


def test_a_joint_does_not_feel_the_mass_of_a_body_that_it_does_not_carry(recorded: MeasuredRun) -> None:
    machine = robot(recorded)
    bodies = {name: machine.model.body(f"{name}_link").id for name in JOINTS}
    felt = {
        (joint, body): carries(machine.model, machine.number(joint), bodies[body])
        for joint in JOINTS
        for body in JOINTS
    }
    assert felt == {(a, b): (a, b) != ("elbow", "shoulder") for a in JOINTS for b in JOINTS}


def test_a_spring_of_a_joint_is_no_bodys_weight(recorded: MeasuredRun) -> None:
    """It was in the rows of every body: -8.59 N.m per factor of a mass in place of -1.59."""
    plain, sprung = robot(recorded), robot(recorded)
    sprung = replace(sprung, model=sprung.model.__copy__())
    sprung.model.jnt_stiffness[:] = 7.0
    whole = motion_of(plain, recorded)
    for one, other in zip(masses(plain), masses(sprung), strict=True):
        rows, again = (
            rows_of(direction, machine, "elbow", [recorded], [whole])
            for direction, machine in ((one, plain), (other, sprung))
        )
        assert (rows is None) == (again is None)
        if rows is not None and again is not None:
            np.testing.assert_allclose(rows[0], again[0])


def test_what_the_robot_has_is_not_the_share_of_a_joints_tuned_numbers() -> None:
    """ "tuned numbers 95 %" where a payload had taken the error from 25.2 to 1.4 mrad."""

    def judged(nominal: float, carried: float, **more: Any) -> JointDiagnosis:
        """A joint that its friction moves by 1 part, a stop by 4, and the payload in its load by ``carried``."""

        def simulate(rows: list[dict[str, float]]) -> np.ndarray:
            return np.array(
                [[row.get("friction.coulomb*", 0.0), row.get("load.stop_angle", 0.0), carried] for row in rows]
            )

        replay: Any = SimpleNamespace(problem=SimpleNamespace(simulate=simulate, position_error=lambda row: row))
        gap = {name: Error(size, size) for name, size in (("nominal", nominal), ("noise_floor", 1e-3))}
        case = Case("elbow", signal="elbow.position", unit="rad", replay=replay)
        return found_of_robot("x", 0.0).changed(case=case, gap=gap, **more)

    stop = NamedCause(
        "contact.blocked", "", "elbow", 0.9, 0.99, {"load.stop_angle": Value(4.0, 3.0, 5.0, "rad", 9.0)}, 0.5, "effect"
    )
    values = {"friction.coulomb*": 1.0, "load.stop_angle": 4.0}
    after = judged(2e-3, 2.0, values=values, causes=(stop,), tuned_share=0.0, unexplained=0.1)
    said, names = "body.hand.payload 0.15 kg", {"load.mass": 0.4}
    now = beside_before(after, judged(20e-3, 0.0), said, names)
    kept = 3.0 / 399.0
    explained = 1.0 - 0.1 * kept
    assert now.gap["nominal"].rmse == 20e-3 and now.unexplained == pytest.approx(0.1 * kept)
    assert now.shared_shares == {"load.mass": pytest.approx(explained * 4.0 / 21.0)}
    assert (now.causes[0].share, now.tuned_share) == pytest.approx((explained * 16.0 / 21.0, explained / 21.0))
    assert "(body.hand.payload 0.15 kg) takes the error from 20 to 2 mrad" in now.reasons[0].sentence
    assert {piece.label for piece in budget_slices(now)} >= {"whole robot", "tuned numbers"}
    unhelped = beside_before(judged(20e-3, 0.0, values=values, unexplained=0.1), judged(20e-3, 0.0), said, names)
    assert unhelped.shared_share == 0.0 and unhelped.tuned_share == pytest.approx(0.9) and not unhelped.reasons


def with_inertias_about_joints(text: str) -> str:
    """The arm's file as somebody writes it who takes inertias about the joints for those about the centres of mass."""
    model = mujoco.MjModel.from_xml_string(text)
    for body in ("shoulder_link", "elbow_link"):
        mass, centre = model.body(body).mass[0], model.body(body).ipos
        own = model.body(body).inertia
        about = np.sort(own)[::-1] + mass * float(centre @ centre) * np.array([1.0, 1.0, 0.0])
        a = text.index("fullinertia", text.index(f'name="{body}"'))
        b = text.index('"', text.index('"', a) + 1)
        text = text[:a] + f'fullinertia="{about[0]} {about[2]} {about[1]} 0 0 0' + text[b:]
    return text


def test_inertias_that_a_file_gives_about_the_joints_are_one_number(tmp_path: Path, recorded: MeasuredRun) -> None:
    text = Path(recorded.robot).read_text()
    model = mujoco.MjModel.from_xml_string(text)
    assert about_joints(robot(recorded)) is None
    (tmp_path / "arm.xml").write_text(with_inertias_about_joints(text))
    machine = robot(type(recorded)(**{**vars(recorded), "robot": str(tmp_path / "arm.xml")}))
    assert about_joints(machine) is not None
    changes = tuple(shared_changes(machine, found_of_robot("robot.about_joints", 1.0)))
    mended = bare_model(
        machine.file, Extended(str(tmp_path / "arm.xml"), {}, {}, changes).params_on(as_robot(machine.file))
    )
    for body in ("shoulder_link", "elbow_link"):
        np.testing.assert_allclose(np.sort(mended.body(body).inertia), np.sort(model.body(body).inertia), rtol=1e-3)


def test_a_shared_cause_is_not_credited_with_what_joints_have_of_their_own() -> None:
    """Its confidence counted what it left of the nominal error, which the joints' own causes had mostly removed."""
    friction = Parameter("friction.coulomb", "N.m", 0.0, 1.0, 0.0, 0.01)
    assert rival_of(()) == "tuned" and rival_of((friction,)) == "refitted"


def test_joints_that_have_nothing_left_are_not_searched_together() -> None:
    assert not affected({"elbow": ["friction.coulomb"]}, {"elbow": False})
    assert affected({"elbow": ["load.mass"]}, {"elbow": False}) and affected({"elbow": []}, {"elbow": True})


def test_a_goal_that_one_run_lacks_stops_only_the_joint_that_it_is_of(tmp_path: Path) -> None:
    """The nominal replay of each neighbour wants a goal in every run."""
    data, _ = hidden_arm(tmp_path, "two_link", {}, seed=5, runs=2, duration=10.0)
    first, second = data.runs
    without = replace(second, joints={**second.joints, "elbow": replace(second.joints["elbow"], goal=None)})
    terms = cut_joint(Machine.of([first, without]), "shoulder", None).terms
    assert terms is not None and len(terms[1]) == len(without.time)


@pytest.mark.long
def test_a_payload_is_named_once_and_not_joint_by_joint(tmp_path: Path) -> None:
    data, _ = hidden_arm(tmp_path, "two_link", {"payload": ("elbow", "clear")}, seed=2, runs=2, duration=10.0)
    found = diagnose(data, causes=["load.mass", "friction.coulomb"])
    (cause,) = found.joint(ROBOT).causes
    assert cause.name == "load.mass"
    value = cause.parameters["body.elbow_link.payload"]
    assert value.low < 0.15 * 1.03 and value.high > 0.15 * 0.97
    for joint in JOINTS:
        assert not found.joint(joint).causes


@pytest.mark.weekly
def test_inertias_about_the_joints_are_named_of_the_robot_and_friction_at_its_joint(tmp_path: Path) -> None:
    hidden = {"friction": ("elbow", "clear")}
    data, _ = hidden_arm(tmp_path, "two_link", hidden, seed=5, runs=2, duration=10.0, by_torque=True)
    file = Path(data.runs[0].robot)
    file.write_text(with_inertias_about_joints(file.read_text()))
    found = diagnose(data, causes=["load.inertia", "friction.coulomb"])
    (cause,) = found.joint(ROBOT).causes
    assert cause.name == "load.inertia" and cause.parameters["robot.about_joints"].value == pytest.approx(1.0, abs=0.05)
    assert [cause.name for cause in found.joint("elbow").causes] == ["friction.coulomb"]
    assert not found.joint("shoulder").causes


def test_a_joint_shares_a_cause_that_removes_a_good_part_of_its_own_loss() -> None:
    before = {"shoulder": 17.0, "elbow": 71.0}  # of a double pendulum whose inertias are about the joints
    assert helped(before, {"shoulder": 11.0, "elbow": 11.0}) == {"shoulder", "elbow"}
    assert helped(before, {"shoulder": 17.0, "elbow": 11.0}) == {"elbow"}


@pytest.mark.parametrize(("heavier", "of_robot"), [({"tilt"}, True), (set(), False), ({"pan"}, False)])
def test_bodies_that_one_joint_found_heavier_are_the_robots(heavier: set[str], of_robot: bool) -> None:
    """A camera of 0.22 kg for 0.12 was a factor of 1.65 on all behind the tilt, since the pan hardly felt it."""
    losses = iter([{"pan": 10.0, "tilt": 90.0}, {"pan": 9.9, "tilt": 11.0}])

    class OfTilt(SharedFound):
        def _losses(self, values: Any) -> dict[str, float]:
            return next(losses)

    fits = SimpleNamespace(values={})
    search: Any = SimpleNamespace(settings=DEFAULT, base=(fits, fits), fits=(fits, fits), accepted=())
    problem: Any = None
    assert OfTilt(problem, search, (), {}, frozenset(heavier)).widespread() == of_robot


@pytest.mark.weekly
@pytest.mark.parametrize("kinds", [("steps",) * 4, ("multisine", "chirp") * 2])
def test_a_payload_is_as_heavy_on_steps_as_on_smooth_motion(kinds: tuple[str, ...], tmp_path: Path) -> None:
    """Steps made it a tenth too heavy: smoothing takes the peak of every acceleration that the other joint has."""
    data, _ = hidden_arm(tmp_path, "two_link", {"payload": ("elbow", "clear")}, 5, kinds=kinds)
    (cause,) = diagnose(data, causes=["load.mass"]).joint(ROBOT).causes
    value = cause.parameters["body.elbow_link.payload"]
    assert value.low <= 0.15 <= value.high
    assert value.value == pytest.approx(0.15, rel=0.04)


# --- what all joints share, such as a latency of the bus, comes first where it does most -----------------------------

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


def test_a_sag_under_what_neighbours_draw_is_known_as_well_as_their_motors(recorded: MeasuredRun) -> None:
    """An arm on 0.506 ohm was told 0.476, and 0.495 at most, by joints whose neighbours' motors were 5 % off."""
    problem = free_replay(recorded, "elbow")
    assert problem.terms is not None
    drawn = np.zeros_like(problem.terms)
    drawn[:, T_DRAWN] = 0.8
    blind, seen = np.array([1.0, 0.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 1.0])
    alone, beside, logged = (
        replace(problem, terms=terms, weight=weight).systematic_error(RESISTANCE)
        for terms, weight in ((problem.terms, blind), (drawn, blind), (drawn, seen))
    )
    assert alone == logged < TIGHT < beside
    assert replace(problem, terms=drawn, weight=blind).systematic_error("friction.coulomb") == alone


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


def test_a_joint_that_a_first_look_left_out_has_the_latency_of_all_where_its_search_finds_it() -> None:
    """A shoulder beside a weaker motor was told 18.0 ms of its own, where all others shared 17.7."""
    less = replace(FOUND, confidence=0.6)
    (shoulder,), found = joined(late_joints({"shoulder": FOUND.value + 4e-4}), less)
    assert found.joints == (*FOUND.joints, "shoulder") and found.confidence > less.confidence
    assert not shoulder.causes and shoulder.sentence.startswith("The latency of all joints")
    other = late_joints({"shoulder": FOUND.value + 5e-3})
    assert joined(other, less) == (other, less), "it is later than the bus"
