"""A stop is read off the log before anything is fitted, told in its frame, and bounds every motion that is proposed."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.causes.load import with_stops
from sealegs.gap.checks.stops import Stop, read_stops, stops_of
from sealegs.gap.experiment.excitations import STOP_CLEARANCE, Limits, excitations, within
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.load.robot import Machine
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.prepare.pieces import cut_joint, fit_runs
from sealegs.gap.replay.joint_model import JointModel

from testbed import hidden_bench
from tests.changed_logs import JOINT, with_log
from tests.smooth_bench import CHAIN, PARAMS

LIFTS = (("triangle", "steps"), ("lift_and_drop", "multisine"))


def blocked(angle: float | None, shift: float = 0.0, side: int = 1) -> MeasuredSet:
    """A bench whose link stands against a stop, and whose encoder and goals are shifted, perhaps mirrored."""
    data, _ = hidden_bench(
        {} if angle is None else {"contact.blocked": angle}, 3, runs=2, duration=8.0, schedules=LIFTS
    )
    runs = []
    for run in data.runs:
        log = run.joints[JOINT]
        assert log.goal is not None
        goal, position = side * log.goal + shift, side * log.position + shift
        runs.append(with_log(run, goal=goal, position=position, velocity=None, duty=None, current=None))
    return replace(data, runs=tuple(runs))


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("shift", [0.0, 0.35])
def test_a_stop_is_read_off_in_the_frame_of_the_log(shift: float, side: int) -> None:
    """It was told at -0.69 rad, between an encoder offset and itself, where the log has it at -1.03."""
    (stop,) = stops_of(blocked(0.75, shift, side).runs, JOINT)
    assert stop.side == side
    assert stop.angle == pytest.approx(side * 0.75 + shift, abs=0.01)
    assert stop.beyond > 0.1


def test_a_stop_that_a_joint_ran_into_is_read_off_where_the_joint_rests_against_it() -> None:
    """A gripper's jaw went 30 mrad into a soft stop and came back by as much: nothing was within 15 mrad of the top."""
    goal, top = np.tile(np.linspace(0.2, 1.0, 400), 4), 0.7
    position = np.minimum(goal, top + 0.02 * np.maximum(goal - top, 0.0))
    slow = np.ones(len(goal), bool)
    for k in range(0, len(goal), 400):
        position[k : k + 4], slow[k : k + 4] = 0.75, False
    log: Any = SimpleNamespace(goal=goal, goal_alone=None, position=position, touched=None)
    every = np.ones(len(goal), bool)
    seen: Any = SimpleNamespace(log=log, still=False, on=every, moving=~slow, period=0.02, noise=2.4e-3)
    (stop,) = read_stops([seen])
    assert stop.angle == pytest.approx(0.70, abs=0.01) and stop.beyond > 0.25


def test_a_joint_that_is_free_has_no_stop() -> None:
    assert stops_of(blocked(None).runs, JOINT) == ()


@pytest.mark.parametrize("effect", ["friction.coulomb", "drive.deadband", "drive.saturation", "transmission.backlash"])
def test_what_only_holds_a_joint_back_is_no_stop(effect: str) -> None:
    data, _ = hidden_bench({effect: "clear"}, 3, "heavy", runs=2, duration=8.0, schedules=LIFTS)
    assert stops_of(data.runs, JOINT) == ()


def test_no_proposed_motion_goes_to_a_stop() -> None:
    limits = within(Limits(-1.2, 1.2), (Stop(-0.6, -1, 0.2, 1.0), Stop(0.9, 1, 0.2, 1.0)))
    assert limits is not None and limits == Limits(-0.6 + STOP_CLEARANCE, 0.9 - STOP_CLEARANCE)
    for goal in excitations(limits, JointModel(load_chain(CHAIN)), PARAMS).values():
        assert goal.min() >= limits.lower - 1e-9 and goal.max() <= limits.upper + 1e-9
    assert within(Limits(-1.2, 1.2), (Stop(0.1, -1, 0.2, 1.0), Stop(0.15, 1, 0.2, 1.0))) is None


def test_a_stop_that_was_seen_is_tried_from_where_it_is() -> None:
    nominal = JointModel(load_chain(CHAIN))
    causes = with_stops(catalogue(nominal), (Stop(-1.03, -1, 0.08, 3.0),), nominal)
    (cause,) = [cause for cause in causes if cause.seen]
    assert cause.name == "contact.blocked"
    stop, hardness = cause.variants[0]
    assert (stop.number, stop.start) == ("load.lower_stop", -1.03)
    assert (hardness.number, hardness.start) == ("load.stop_stiffness", nominal.axis.stop_stiffness)
    assert np.isfinite(cause.variants[0][0].low)


@pytest.mark.long
def test_a_stop_that_is_softer_than_assumed_is_no_compliance_of_the_joint() -> None:
    """A wall of 200 N.m/rad, taken for one of 500, was told with a compliance beside it at every joint of two legs."""
    data, _ = hidden_bench(
        {"contact.blocked": 0.75}, 3, duration=8.0, schedules=LIFTS, constants={"stop_stiffness": 150.0}
    )
    (found,) = diagnose(data, causes=["contact.blocked", "transmission.compliance", "friction.coulomb"])
    (cause,) = found.causes
    angle, stiffness = cause.parameters["load.stop_angle"], cause.parameters["load.stop_stiffness"]
    assert angle.low <= 0.75 <= angle.high
    # its interval, 155 to 164, leaves the truth out: why is open
    assert stiffness.value == pytest.approx(150.0, rel=0.1)


def test_a_stop_that_only_the_test_part_meets_is_told_and_not_fitted() -> None:
    """Its angle was where the search began: the test part had told the fit what it was to foretell."""
    hit = blocked(0.75)
    free = [
        with_log(run, **{key: 0.3 * getattr(run.joints[JOINT], key) for key in ("goal", "position")})
        for run in blocked(None).runs
    ]
    parted = [
        replace(run, name=f"{run.name}-{k}", meta={**run.meta, "group": name})
        for k, (run, name) in enumerate([(free[0], "a"), (free[1], "b"), (hit.runs[0], "last"), (hit.runs[1], "last")])
    ]
    pieces = cut_joint(Machine.of(parted), JOINT, "last")
    assert stops_of(pieces.runs, JOINT) and stops_of(fit_runs(pieces), JOINT) == ()
    pieces = cut_joint(Machine.of(parted), JOINT, "a")
    assert stops_of(fit_runs(pieces), JOINT) == stops_of(pieces.runs, JOINT)
