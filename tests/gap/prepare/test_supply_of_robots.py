"""What the drives of a robot draw from the supply of all, against the testbed's plant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sealegs.gap.load.robot import Machine
from sealegs.gap.log.types import JointLog, MeasuredRun
from sealegs.gap.prepare.pieces import seen_share, with_neighbours
from sealegs.gap.replay.tree import drawn_beside

from testbed.everyday import drawn
from testbed.logs import hidden_everyday

ARM = """<mujoco><worldbody><body><joint name="shoulder" axis="0 1 0"/><geom size=".02" mass=".1"/>
<body pos="0 0 -.1"><joint name="elbow" axis="0 1 0"/><geom size=".02" mass=".1"/>
<body pos="0 0 -.1"><joint name="hand" axis="0 1 0"/><geom size=".02" mass=".05"/></body>
</body></body></worldbody></mujoco>"""
GRIPPER = drawn(18, 718)
"""Late by 7 ms, on a supply of 0.87 ohm, with a weak wrist; it logs voltage, duty and current."""
SOURCE = next(size for name, _, size in GRIPPER.effects if name == "sag")
WEAK = next(size for name, _, size in GRIPPER.effects if name == "motor_constant")
LATE = next(size for name, _, size in GRIPPER.effects if name == "latency")


@pytest.fixture(scope="module")
def gripper(tmp_path_factory) -> Machine:
    data, _ = hidden_everyday(GRIPPER, tmp_path_factory.mktemp("gripper"))
    return Machine.of(data.runs)


def told(run: MeasuredRun) -> np.ndarray:
    """All that the drives draw by what is estimated of them (n,) [A], at the voltage that was logged."""
    rows = np.sum(list(run.draws.values()), axis=0)
    return rows[:, 0] - rows[:, 1] * sagged(run)


def sagged(run: MeasuredRun) -> np.ndarray:
    """What the supply lacks (n,) [V]."""
    volts = run.joints["wrist"].voltage
    assert volts is not None
    return 7.4 - volts


def without(machine: Machine, *columns: str) -> Machine:
    lost = dict.fromkeys(columns)
    runs = [replace(run, joints={name: replace(log, **lost) for name, log in run.joints.items()}) for run in machine]
    return Machine.of(runs)


@pytest.mark.parametrize(("lost", "alike"), [((), 0.95), (("current",), 0.9), (("current", "duty"), 0.8)])
def test_what_drives_draw_is_what_makes_the_supply_sag(gripper: Machine, lost: tuple[str, ...], alike: float) -> None:
    known = {name: {"delay.seconds": 0.005 + LATE} for name in ("wrist", "jaw")}
    known["wrist"]["dc_motor.motor_constant*"] = WEAK
    for run in with_neighbours(without(gripper, *lost), known):
        taken, sag = told(run), sagged(run)
        assert np.corrcoef(taken, sag)[0, 1] > alike
        assert taken @ sag / (taken @ taken) == pytest.approx(SOURCE, rel=0.15)


def test_a_joint_sees_what_the_others_draw(gripper: Machine) -> None:
    run = with_neighbours(gripper)[0]
    np.testing.assert_array_equal(drawn_beside(run, "wrist"), run.draws["jaw"])
    assert not drawn_beside(replace(run, draws={}), "wrist").any()


def test_duty_times_current_as_logged_is_what_a_bridge_draws_and_it_gives_nothing_back(gripper: Machine) -> None:
    run = gripper[0]
    n = len(run.time)
    for current, taken in ((3.0, 0.0), (-3.0, 1.5)):
        logs = dict(run.joints)
        logs["jaw"] = replace(logs["jaw"], duty=np.full(n, -0.5), current=np.full(n, current))
        found = with_neighbours(Machine.of([replace(run, joints=logs)]))[0].draws["jaw"]
        np.testing.assert_allclose(found[:, 0], taken)
        assert not found[:, 1].any()


def test_what_a_row_does_not_foresee_of_the_next_was_not_seen_between_them() -> None:
    time = np.arange(0.0, 20.0, 0.02)
    assert seen_share(np.sin(3.0 * time)) > 0.99 and seen_share(np.ones(50)) == 1.0
    assert seen_share(np.random.default_rng(0).normal(size=2000)) == pytest.approx(0.0, abs=0.1)
    peaks = np.where(np.arange(1000) % 50 == 7, 1.0, 0.0)
    assert seen_share(peaks) < 0.1


def test_between_slow_rows_drives_draw_what_goals_and_motion_say(gripper: Machine) -> None:
    """A supply of 0.6 ohm was 0.75, for certain: its log had a row after each peak of what the neighbour drew."""
    known = {name: {"delay.seconds": 0.005 + LATE} for name in ("wrist", "jaw")}
    known["wrist"]["dc_motor.motor_constant*"] = WEAK
    for run in with_neighbours(gripper, known):
        slow = replace(
            run,
            time=run.time[::4],
            joints={
                name: JointLog(**{key: value[::4] for key, value in vars(log).items() if isinstance(value, np.ndarray)})
                for name, log in run.joints.items()
            },
        )
        rows = len(slow.time) - 1
        (thinned,) = with_neighbours(Machine.of([slow]), known)
        mean, there = run.draws["jaw"][: 4 * rows, 0].reshape(rows, 4).mean(axis=1), run.draws["jaw"][: 4 * rows : 4, 0]
        found = thinned.draws["jaw"][:rows, 0]
        assert np.mean((found - mean) ** 2) < np.mean((there - mean) ** 2)


def test_a_drive_that_is_off_or_has_a_supply_of_its_own_draws_nothing_from_the_others(gripper: Machine) -> None:
    run = gripper[0]
    off = replace(run.joints["jaw"], enabled=np.zeros(len(run.time)))
    assert not with_neighbours(Machine.of([replace(run, joints=run.joints | {"jaw": off})]))[0].draws["jaw"].any()
    own = [{**stage, "supply": {**stage["supply"], "shared": 0}} if "supply" in stage else stage
           for stage in run.actuators["jaw"]]  # fmt: skip
    alone = with_neighbours(Machine.of([replace(run, actuators={**run.actuators, "jaw": own})]))[0]
    assert "jaw" not in alone.draws and not drawn_beside(alone, "wrist").any()


def test_a_bench_has_no_other_drives() -> None:
    run = MeasuredRun("run", np.arange(3.0), {"servo": JointLog(np.zeros(3), np.zeros(3))})
    assert not with_neighbours(Machine.of([run]))[0].draws


def test_joints_without_a_drive_or_without_readings_draw_nothing(gripper: Machine, tmp_path) -> None:
    """A hand that hangs on a joint nobody drives is logged, too."""
    run = gripper[0]
    blank = replace(run.joints["jaw"], position=np.full(len(run.time), np.nan), duty=None, current=None)
    found = with_neighbours(Machine.of([replace(run, joints=run.joints | {"jaw": blank})]))[0]
    assert set(found.draws) == {"wrist"}
    (tmp_path / "arm.xml").write_text(ARM)
    driven = "joints: {shoulder: {chain: sts3215}, elbow: {chain: sts3215}}"
    (tmp_path / "arm.yaml").write_text(f"model: arm.xml\n{driven}\n")
    logs = {name: JointLog(np.zeros(3), np.zeros(3)) for name in ("shoulder", "elbow", "hand")}
    hanging = MeasuredRun("run", np.arange(3.0), logs, robot=str(tmp_path / "arm.yaml"), source=tmp_path / "run.csv")
    assert set(with_neighbours(Machine.of([hanging]))[0].draws) == {"shoulder", "elbow"}
