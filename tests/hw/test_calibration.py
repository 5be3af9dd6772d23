"""Calibration: a person is guided, what cannot be is refused, nothing is overwritten, the newest file counts."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from sealegs.configs.compose import compose
from sealegs.configs.script import run
from sealegs.envs.robots import get_robot
from sealegs.hw.bus.registers import load_model
from sealegs.hw.bus.servo_state import ServoState
from sealegs.hw.machine import calibration
from sealegs.hw.machine.calibration import guide, kept, unfinished, write_calibration
from sealegs.hw.machine.calibration_file import newest, read_joints
from sealegs.hw.machine.joints import CalibrationError, Joint, Line, check_joints, nominal_joints
from sealegs.hw.machine.robot import ServoRobot, build_robot

SERVO = load_model("sts3215")
HOPPER, BENCH = get_robot("hopper"), get_robot("bench")


class Hand:
    """Servos without torque that a scripted hand moves, and the person who answers the questions with it."""

    def __init__(self, script: list[dict[int, int | list[int]]], steps: dict[int, int]) -> None:
        self.steps, self._script, self.asked, self.said = dict(steps), script, list[str](), list[str]()
        self.off: list[int] = []
        self._sweep: dict[int, list[int]] = {}

    def scan(self, ids: Iterable[int] = ()) -> dict[int, int]:
        return dict.fromkeys(self.steps, 777)

    def torque_off(self, ids: Sequence[int]) -> dict[int, Exception]:
        self.off = list(ids)
        return {}

    def read_register(self, servo: int, name: str) -> int:
        if name == "homing_offset":
            return 17
        assert name == "present_position"
        if self._sweep.get(servo):
            self.steps[servo] = self._sweep[servo].pop(0)
        return self.steps[servo]

    def ask(self, question: str) -> str:
        self.asked.append(question)
        for servo, move in self._script.pop(0).items():
            if isinstance(move, list):
                self._sweep[servo] = list(move)
                while self._sweep[servo]:
                    pass
            else:
                self.steps[servo] = move
        return ""


def sweep(low: int, high: int) -> list[int]:
    return [int(step) for step in np.linspace(low, high, 9)]


def calibrated(hand: Hand, robot=HOPPER) -> list[Joint]:
    return guide(hand, robot, SERVO, {}, hand.ask, hand.said.append)


def test_a_person_is_guided_to_ids_zeros_directions_and_ranges(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sealegs.hw.machine.calibration.PERIOD", 0.0)
    hand = Hand(
        [
            {7: 2500},  # the hip's servo is the one that moves
            {7: 2100},  # hip at 0
            {7: 2000},  # its positive direction: falling steps
            {7: sweep(2000, 3000)},
            {3: 2048},  # the knee's is left over: at 0
            {3: 2200},
            {3: sweep(2000, 2900)},
        ],
        {3: 2048, 7: 2048},
    )
    hip, knee = calibrated(hand)
    step = 2.0 * math.pi / 4096
    assert (hip.id, hip.zero, hip.direction) == (7, 2100, -1) and (knee.id, knee.zero, knee.direction) == (3, 2048, 1)
    assert hip.low == pytest.approx(-900 * step + 0.02) and hip.high == pytest.approx(100 * step - 0.02)
    assert knee.high == pytest.approx(852 * step - 0.02)
    assert hand.off == [3, 7], "torque is off before anybody touches a joint"
    assert hip.homing_offset == 17


def test_a_joint_behind_a_gear_is_calibrated_in_its_own_units(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("sealegs.hw.machine.calibration.PERIOD", 0.0)
    settings = compose("calibrate", {"robot": "hexapod"})["robot"]
    robot, drawn = get_robot("hexapod"), build_robot(settings).joints[1]
    assert drawn.name == "leg0_vertical" and drawn.per_radian == 0.006, "a screw, 6 mm per radian"
    place = round(drawn.zero + 0.0379 / (0.006 * SERVO.step))  # 0 m is beyond the encoder's turn
    script: list[dict[int, int | list[int]]] = [{5: place}, {5: place + 300}, {5: [1200, *sweep(100, 4000)]}]
    hand, names = Hand(script, {5: 2048}), ["leg0_vertical"]
    (joint,) = guide(hand, robot, SERVO, {}, hand.ask, hand.said.append, names=names, gears=settings["gears"])
    assert joint.per_radian == 0.006 and "bring it to 0.0379 m" in hand.asked[0] and hand.said[-1].endswith(" m.")
    assert (joint.direction, joint.zero) == (1, pytest.approx(drawn.zero, abs=1))
    assert joint.low == pytest.approx(0.006 * ((100 - drawn.zero) * SERVO.step + 0.02), abs=1e-5)
    assert joint.high == pytest.approx(0.006 * ((4000 - drawn.zero) * SERVO.step - 0.02), abs=1e-5)
    assert joint.low < drawn.low and drawn.high < joint.high, "the robot's goals, in metres"


def test_a_calibration_behind_other_gears_than_the_robots_file_names_is_refused(tmp_path: Path) -> None:
    settings = compose("calibrate", {"robot": "hexapod"})["robot"]
    robot = build_robot(settings)
    fits, direct = tmp_path / "fits.yaml", tmp_path / "direct.yaml"
    write_calibration(fits, robot.robot, SERVO, robot.joints)
    assert build_robot(settings, None, fits).joints == robot.joints
    low_and_high = {"zero": 2048, "low": -1.5, "high": 1.5, "per_radian": 1.0}  # as if a radian were a metre
    write_calibration(direct, robot.robot, SERVO, [replace(joint, **low_and_high) for joint in robot.joints])
    with pytest.raises(CalibrationError, match=r"moves 1 per radian of its servo in .*direct.yaml, and 0.15 by"):
        build_robot(settings, None, direct)


def test_it_asks_again_when_nothing_moved_or_two_joints_did(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sealegs.hw.machine.calibration.PERIOD", 0.0)
    script: list[dict[int, int | list[int]]] = [
        {7: 2050},
        {7: 2500, 3: 2500},
        {7: 2100},
        {},
        {7: 2110},
        {7: 2000},
        {7: sweep(2050, 3000)},
    ]
    hand = Hand([*script, {3: 2048}, {3: 2200}, {3: sweep(2000, 2900)}], {3: 2048, 7: 2048})
    assert [joint.id for joint in calibrated(hand)] == [7, 3]
    assert any("Nothing moved" in line for line in hand.said) and any("both moved" in line for line in hand.said)
    assert any("and 60 are needed" in line for line in hand.said)


def test_a_range_over_the_encoders_seam_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sealegs.hw.machine.calibration.PERIOD", 0.0)
    hand = Hand([{1: 3900}, {1: 4000}, {1: [3900, 4000, 4090, 5, 90, 200]}], {1: 3900})
    with pytest.raises(CalibrationError, match="seam") as refusal:
        guide(hand, BENCH, SERVO, {}, hand.ask, hand.said.append, port="/dev/ttyUSB3")
    # the middle, step 4098, is at 4115 without the offset of 17; 2067 of them leave it at 2048, or -2029 the other way
    typed = "sealegs scan port=/dev/ttyUSB3 servo=sts3215 id=1 set=homing_offset:-2029"
    assert f"move the seam away ({typed}), or turn the horn by half a turn" in str(refusal.value)


def test_a_joint_that_goes_all_the_way_round_is_refused_for_what_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sealegs.hw.machine.calibration.PERIOD", 0.0)
    round_and_round = [step % 4096 for step in range(2000, 2000 + 4600, 200)]
    hand = Hand([{1: 2000}, {1: 2100}, {1: round_and_round}], {1: 2000})
    with pytest.raises(CalibrationError, match=r"went round by 1\.\d turns .* less than one turn"):
        calibrated(hand, BENCH)
    with pytest.raises(CalibrationError, match=r"hip goes from -3.50 to 3.50 rad, 1.11 turns of its servo"):
        check_joints(joints(hip={"low": -3.5, "high": 3.5}), HOPPER, SERVO, {})


def test_the_homing_offset_that_is_named_brings_the_range_clear_of_the_seam() -> None:
    over = joints(knee={"zero": 3800, "homing_offset": 17})
    with pytest.raises(CalibrationError, match=r"set=homing_offset:(-?\d+)\), or mount") as refusal:
        check_joints(over, HOPPER, SERVO, {}, "/dev/ttyUSB3")
    assert "sealegs scan port=/dev/ttyUSB3 servo=sts3215 id=2 set=" in str(refusal.value)
    offset = int(re.search(r"homing_offset:(-?\d+)", str(refusal.value))[1])  # type: ignore[index]
    again = (3800 + 17 - offset) % 4096  # where the zero is then
    check_joints(joints(knee={"zero": again, "homing_offset": offset}), HOPPER, SERVO, {})


def test_too_few_servos_are_refused() -> None:
    with pytest.raises(CalibrationError, match="2 joint\\(s\\), but 1 servo"):
        calibrated(Hand([], {1: 2048}))


def joints(**changes: dict[str, float]) -> list[Joint]:
    base = {"hip": Joint("hip", 1, 2048, 1, -1.2, 0.0), "knee": Joint("knee", 2, 2048, 1, 0.0, 1.2)}
    return [Joint(**{**vars(joint), **changes.get(name, {})}) for name, joint in base.items()]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"knee": {"id": 1}}, "joints hip and knee both have the servo with id 1"),
        ({"knee": {"id": 253}}, "ids are 0 to 252"),
        ({"knee": {"high": 3.3}}, "joint knee cannot reach 3.300 rad: its encoder ends at step 0 and 4095"),
        ({"knee": {"zero": 3800}}, "joint knee cannot reach 1.200 rad"),
        ({"hip": {"zero": 900, "low": -1.5}}, "joint hip cannot reach -1.500 rad"),
        ({"knee": {"low": -1.2, "high": -0.4}}, "works between 0.01 and 1.21 rad; zero or direction is wrong"),
        ({"hip": {"low": 0.0, "high": 0.0}}, "which is none"),
        ({"hip": {"high": math.nan}}, "which is none"),
        ({"hip": {"direction": 0}}, "it is 1 or -1"),
        ({"hip": {"name": "hipp"}}, "did you mean 'hip'?"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(changes: dict[str, dict[str, float]], says: str) -> None:
    with pytest.raises(CalibrationError) as refusal:
        check_joints(joints(**changes), HOPPER, SERVO, {})
    assert says in str(refusal.value)


def test_a_range_of_a_slide_is_told_in_metres(tmp_path: Path) -> None:
    model = tmp_path / "lift.xml"
    model.write_text(
        '<mujoco><worldbody><body><joint name="rail" type="slide" axis="0 0 1" range="-0.3 0.3"/>'
        '<geom size="0.1" mass="1"/></body></worldbody></mujoco>'
    )
    robot = get_robot(str(model))
    for low, high, said in (
        (0.4, 0.5, "0.40 to 0.50 m, but robot .* works between -0.30 and 0.30 m"),
        (0, 0, "0 to 0 m"),
    ):
        with pytest.raises(CalibrationError, match=said):
            check_joints([Joint("rail", 1, 2048, 1, low, high)], robot, SERVO, {})


def test_a_missing_joint_is_refused() -> None:
    with pytest.raises(CalibrationError, match="knee is missing"):
        check_joints(joints()[:1], HOPPER, SERVO, {})


def test_a_file_is_read_as_written_and_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "calibrations" / "hopper-a.yaml"
    written = joints(hip={"homing_offset": -35})
    write_calibration(path, HOPPER, SERVO, written)
    assert read_joints(path, HOPPER, SERVO) == written and newest("hopper", path.parent) == path
    before = path.read_text()
    with pytest.raises(CalibrationError, match="never overwritten"):
        write_calibration(path, HOPPER, SERVO, joints(hip={"id": 9}))
    assert path.read_text() == before
    with pytest.raises(CalibrationError, match="of robot 'hopper', not of 'bench'"):
        read_joints(path, BENCH, SERVO)


@pytest.mark.parametrize("text", ["", "- 1", "robot: hopper\njoints: {hip: {id: x}}", "robot: [", "robot: hopper"])
def test_a_damaged_file_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(CalibrationError, match="calibrat") as refusal:
        read_joints(path, HOPPER, SERVO)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("homing_offset", "homing_ofset", "did you mean 'homing_offset'"),
        ("zero: 2048", "zero: 2048.9", "joints.joint.zero takes a whole number, not 2048.9"),
        ("direction: 1", "direction: 1.9", "joints.joint.direction takes 1 or -1, not 1.9"),
        ("direction: 1", "direction: 0", "takes 1 or -1"),
        ("[-1.0, 1.0]", "[-1.0, 1.0, 2.5]", "two numbers"),
        ("[-1.0, 1.0]", "[1.0, -1.0]", "the lower one first"),
        ("id: 1", "id: true", "joints.joint.id takes a whole number, not True"),
        ("id: 1", "id: 1, per_radian: 0", "per_radian must be more than 0"),
        ("servo: sts3215", "sevro: sts3215", "did you mean 'servo'"),
        ("{id", "[id", "calibrate again"),
    ],
)
def test_a_row_that_is_wrong_is_refused(old: str, new: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "bench.yaml"
    row = "{id: 1, zero: 2048, direction: 1, range: [-1.0, 1.0], homing_offset: 85}"
    good = f"robot: bench\nservo: sts3215\ndate: 2026-01-01T00:00:00\njoints:\n  joint: {row}\n"
    path.write_text(good)
    assert read_joints(path, BENCH, SERVO) == [Joint("joint", 1, 2048, 1, -1.0, 1.0, 85)]
    path.write_text(good.replace(old, new))
    with pytest.raises(CalibrationError) as refusal:
        read_joints(path, BENCH, SERVO)
    assert says in str(refusal.value) and "\n" not in str(refusal.value)


def test_a_calibration_of_other_servos_is_refused(tmp_path: Path) -> None:
    arm = Line("arm", 1, load_model("scs0009"), joints=("knee",))
    made = [joints()[0], replace(joints()[1], line=arm)]
    path = tmp_path / "hopper-a.yaml"
    write_calibration(path, HOPPER, SERVO, made)
    assert read_joints(path, HOPPER, SERVO, [arm]) == made
    with pytest.raises(CalibrationError, match="joint hip was calibrated with servo sts3215 and has xl330_m288 now"):
        read_joints(path, HOPPER, load_model("xl330_m288"), [arm])
    for lines in ([], [replace(arm, servo=load_model("scs15"))]):
        with pytest.raises(CalibrationError, match="joint knee was calibrated with servo scs0009 and has "):
            read_joints(path, HOPPER, SERVO, lines)


def test_angles_turn_with_zero_and_direction() -> None:
    mounted = [Joint("hip", 1, 1848, -1, -1.2, 0.0), Joint("knee", 2, 2048, 1, 0.0, 1.2)]
    robot = ServoRobot(HOPPER, {}, SERVO, mounted, dict(HOPPER.chains))
    angles = np.array([-0.5, 0.7])
    shafts = robot.to_servo(angles)
    zero = np.zeros(2)
    state = ServoState((1, 2), 0.0, 0.1, shafts, np.ones(2), zero, zero, zero, np.ones(2), zero, zero, zero, {})
    reading = robot.reading(state)
    assert reading.position == pytest.approx(angles) and reading.time == 0.05
    assert reading.velocity == pytest.approx([-1.0, 1.0]) and reading.current == pytest.approx([-1.0, 1.0])


def test_a_machine_built_as_drawn_has_ids_from_one_and_the_robots_range() -> None:
    hip, knee = nominal_joints(HOPPER, SERVO, {})
    assert (hip.id, knee.id, hip.zero) == (1, 2, 2048) and (hip.low, hip.high) == pytest.approx((-1.21, -0.01))


def test_a_calibration_that_is_stopped_keeps_the_joints_that_are_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sealegs.hw.machine.calibration.PERIOD", 0.0)
    path = unfinished(tmp_path / "hopper-1.yaml", HOPPER)
    hip: list[dict[int, int | list[int]]] = [{7: 2500}, {7: 2100}, {7: 2000}, {7: sweep(2000, 3000)}]
    knee: list[dict[int, int | list[int]]] = [{3: 2048}, {3: 2200}, {3: sweep(2000, 2900)}]

    def work(hand: Hand, stopped: bool) -> list[Joint]:
        def ask(question: str) -> str:
            if stopped and question.startswith("knee"):
                raise EOFError
            return hand.ask(question)

        return kept(
            path,
            HOPPER,
            lambda done, keep: guide(hand, HOPPER, SERVO, {}, ask, hand.said.append, done, keep),
            SERVO,
        )

    with pytest.raises(CalibrationError, match=r"terminal was closed; hip is kept in .*hopper-1\.yaml\.unfinished"):
        work(Hand(hip, {3: 2048, 7: 2048}), stopped=True)
    hand = Hand(knee, {3: 2048, 7: 2500})
    joints = work(hand, stopped=False)
    assert [joint.name for joint in joints] == ["hip", "knee"] and joints[0].zero == 2100
    assert any("Kept from before: hip" in line for line in hand.said)
    assert newest("hopper", tmp_path) is None, "what is unfinished is no calibration"


def test_what_is_unfinished_of_one_machine_is_not_carried_into_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    left, right = Path("calibrations/hopper-left.yaml"), Path("calibrations/hopper-right.yaml")

    def stopped(done: object, keep: Callable[[list[Joint]], None]) -> list[Joint]:
        keep(joints()[:1])
        raise EOFError

    with pytest.raises(CalibrationError, match="hip is kept"):
        kept(unfinished(left, HOPPER), HOPPER, stopped, SERVO)
    for out, known in ((left, ["hip"]), (right, []), (None, []), (Path("calibrations/hopper.yaml"), [])):
        found = kept(unfinished(out, HOPPER), HOPPER, lambda done, _: list(done), SERVO)
        assert [joint.name for joint in found] == known


def test_a_baud_rate_that_is_none_is_refused_in_a_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(calibration.main, "calibrate", "", ["port=/dev/null", "baudrate=fast"]) == 2
    assert "baudrate takes a whole number, not 'fast'." in capsys.readouterr().err


OLD, NEW = "2026-03-01T10:00:00+01:00", "2026-04-01T10:00:00+02:00"


def write(folder: Path, name: str, robot: str = "arm", day: Any = None, touched: float = 0.0) -> Path:
    """A calibration as far as it says whose it is; touched so many seconds after 2001-09-09."""
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump({"robot": robot, **({} if day is None else {"date": day}), "joints": {}}))
    os.utime(path, (1e9 + touched, 1e9 + touched))
    return path


def test_the_calibration_of_a_robot_whose_name_goes_on_is_not_taken(tmp_path: Path) -> None:
    mine = write(tmp_path, "arm-20260301-100000", "arm", OLD)
    write(tmp_path, "arm-left-20260401-100000", "arm-left", NEW, 9.0)
    assert newest("arm", tmp_path) == mine
    assert newest("leg", tmp_path) is None


@pytest.mark.parametrize(
    ("newer", "others"),
    [
        pytest.param(("20260401-100000", NEW), [("20260301-100000", OLD), ("spare", OLD)], id="copies and touches"),
        pytest.param(("20250101-000000", NEW), [("20260501-000000", OLD)], id="the date in the file before its name"),
        pytest.param(("b", date(2026, 4, 1)), [("a", OLD)], id="a date that YAML reads as one"),
        pytest.param(("20260401-100000", None), [("20260301-100000", None)], id="without dates, the stamp in the name"),
    ],
)
def test_the_newest_calibration_is_told_by_its_date(
    newer: tuple[str, Any], others: list[tuple[str, Any]], tmp_path: Path
) -> None:
    now = write(tmp_path, f"arm-{newer[0]}", "arm", newer[1])
    for k, (name, day) in enumerate(others):
        write(tmp_path, f"arm-{name}", "arm", day, 9.0 + 90.0 * k)
    assert newest("arm", tmp_path) == now


def test_one_file_needs_no_date_and_of_several_it_is_asked_for(tmp_path: Path) -> None:
    only = write(tmp_path, "arm-workshop")
    assert newest("arm", tmp_path) == only
    write(tmp_path, "arm-20260401-100000", "arm", NEW, 9.0)
    with pytest.raises(CalibrationError, match=r"arm-workshop\.yaml says no date.*calibration=<file>"):
        newest("arm", tmp_path)


DAMAGED = ["robot: [", "- 1", "", "date: 2026-04-01", "robot: arm\ndate: yesterday", b"\xff\xfe\x00"]


@pytest.mark.parametrize("text", DAMAGED)
@pytest.mark.parametrize("name", ["arm-20260501-100000", "arm-workshop"])
def test_a_damaged_file_that_may_be_the_newest_is_told(text: str | bytes, name: str, tmp_path: Path) -> None:
    write(tmp_path, "arm-20260401-100000", "arm", NEW)
    (tmp_path / f"{name}.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(CalibrationError, match=rf"{name}\.yaml .*calibration=<file>") as refusal:
        newest("arm", tmp_path)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("name", ["arm-20260301-100000", "arm-left-20260501-100000"])
def test_a_damaged_file_that_is_older_or_another_robots_does_not_matter(name: str, tmp_path: Path) -> None:
    now = write(tmp_path, "arm-20260401-100000", "arm", NEW)
    (tmp_path / f"{name}.yaml").write_text("robot: [")
    assert newest("arm", tmp_path) == now


def test_a_damaged_file_alone_is_told(tmp_path: Path) -> None:
    (tmp_path / "arm-20260301-100000.yaml").mkdir()
    with pytest.raises(CalibrationError, match=r"cannot be read: Is a directory"):
        newest("arm", tmp_path)
