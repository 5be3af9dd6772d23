"""Causes that joints of a robot share: one number of the robot, with the same effect as in the engine's own model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from sealegs.envs.described.robot_described import as_robot, bare_model
from sealegs.envs.extended import Extended
from sealegs.gap.diagnose import diagnose
from sealegs.gap.load.robot import LoggedRobot, Machine
from sealegs.gap.load.tree import block_along
from sealegs.gap.log.types import MeasuredRun
from sealegs.gap.measure.case import ROBOT, Case
from sealegs.gap.measure.measured import rival_of
from sealegs.gap.measure.named import Error, NamedCause, Value
from sealegs.gap.output.extension import shared_changes
from sealegs.gap.output.pictures.first_look import budget_slices
from sealegs.gap.prepare.pieces import cut_joint
from sealegs.gap.replay.parameters import Parameter
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
from sealegs.gap.search.settings import DEFAULT
from sealegs.gap.verdict.verdict import JointDiagnosis

from testbed.logs import hidden_arm
from tests.logged_robots import JOINTS, robot, two_link_run


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> MeasuredRun:
    return two_link_run(tmp_path_factory.mktemp("arm"), 2.0)


def found_of_robot(number: str, value: float) -> JointDiagnosis:
    return JointDiagnosis.of(
        joint=ROBOT,
        verdict="explained",
        sentence="",
        signal="",
        unit="rad",
        values={number: value},
    )


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
