"""A cause must bring its own features where they were measured; where a test goes further is said."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.log.finding import Finding
from sealegs.gap.log.parts import TEST, cut
from sealegs.gap.measure.confidence import standing
from sealegs.gap.measure.named import CERTAIN, LIKELY, NamedCause, Value
from sealegs.gap.measure.signatures import (
    AGREES,
    DISAGREES,
    FEATURES,
    Piece,
    Signature,
    coasted,
    disagreeing,
    signatures,
)
from sealegs.gap.measure.unseen import unseen_range
from sealegs.gap.output.pictures import png
from sealegs.gap.output.pictures.timeline import features
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.verdict.verdict import recording_reasons

from benchmarks.hidden import LOADS
from testbed import NOISE_FLOOR, hidden_bench
from testbed.excitation import DEFAULT_SCHEDULES

STEPS = (("steps", "steps", "lift_and_drop", "steps"), ("steps", "lift_and_drop", "steps", "steps"))


@cache
def problem(name: str, value: float, schedules: tuple[tuple[str, ...], ...] = DEFAULT_SCHEDULES) -> FreeProblem:
    """A bench whose numbers are right but for one effect."""
    data, _ = hidden_bench(
        {name: value}, 11, ("medium", "light"), runs=2, duration=12.0, schedules=schedules, nominal_error=0.0
    )
    runs = data.runs
    models = [JointModel(load_chain(run.actuators["servo"])) for run in runs]
    return free_problem(runs, "servo", models, cut(runs, "servo"), {"position": 1.0 / NOISE_FLOOR})


def read(key: str, found: FreeProblem, values: Mapping[str, float]) -> tuple[Signature, ...]:
    nominal, extended = found.simulate([{}, values])
    return signatures(key, found, nominal, extended)


def test_a_late_reading_is_not_a_late_command_by_when_the_duty_follows():
    found = problem("sensor.delay", 0.008)
    right, wrong = (read("lag", found, v) for v in ({"encoder.latency": 0.008}, {"delay.seconds": 0.013}))
    assert disagreeing(right) is None and AGREES in {seen.verdict for seen in right}
    contradiction = disagreeing(wrong)
    assert contradiction is not None and "duty" in contradiction.name
    assert abs(contradiction.extended) == pytest.approx(0.008, rel=0.4)


def test_dry_friction_shows_at_reversals_and_drag_does_not_bring_it_back():
    found = problem("friction.coulomb", 0.09)
    (right,), (wrong,) = (
        read("reversal", found, v) for v in ({"friction.coulomb": 0.052 + 0.09}, {"friction.viscous": 0.059 + 0.03})
    )
    assert right.verdict == AGREES and wrong.verdict == DISAGREES


def test_play_shows_when_the_drive_pushes_the_other_way():
    found = problem("transmission.backlash", 0.05)
    (right,) = read("play", found, {"backlash.width": 0.05})
    assert right.verdict != DISAGREES and abs(right.extended) < 0.2 * right.nominal


def test_friction_by_speed_shows_in_the_duty_of_a_constant_velocity():
    found = problem("friction.viscous", 0.1)
    (right,), (wrong,) = (read("speed", found, v) for v in ({"friction.viscous": 0.159}, {"friction.coulomb": 0.15}))
    assert "duty per speed" in right.name and right.verdict == AGREES and wrong.verdict != AGREES


def test_a_joint_with_its_drive_off_coasts_less_far_than_a_model_that_lacks_friction():
    time = np.linspace(0.0, 2.0, 401)
    on = (time < 0.5) | (time > 1.5)
    speed = np.where(on, 1.0, np.maximum(1.0 - 2.0 * (time - 0.5), 0.0))
    short = np.where(on, 0.0, -0.01 * (time - 0.5) ** 2)  # [rad] measured less the model's angle
    piece = Piece(time, speed, speed, speed, time >= 0.0, short, speed, speed, 0.05, on)
    assert coasted(piece) == pytest.approx(-0.01, rel=0.05)
    assert np.isnan(coasted(replace(piece, on=np.ones(len(time), bool))))


@pytest.mark.long
def test_nothing_hidden_contradicts_nothing():
    for found in (problem("friction.coulomb", 0.0), problem("friction.coulomb", 0.0, STEPS)):
        for key in FEATURES:
            assert disagreeing(read(key, found, {})) is None


def test_a_contradicted_cause_is_never_certain_and_its_features_are_drawn():
    assert standing(0.99, ()) == CERTAIN and standing(0.99, (), contradicted=True) == LIKELY
    seen = read("lag", problem("sensor.delay", 0.008), {"delay.seconds": 0.013})
    cause = NamedCause("drive.delay", "Late.", "servo", 1.0, 0.9, {}, 0.5, "number", signatures=seen)
    assert png(features(cause)).startswith(b"\x89PNG")


def test_a_delay_that_recording_makes_is_told_as_that():
    knots = Finding("goal.knots", "note", "servo", "servo.goal", "Lines.", value=0.010)

    def reasons(seconds: float) -> list[str]:
        value = Value(seconds, seconds - 1e-4, seconds + 1e-4, "s", 0.005)
        cause = NamedCause("drive.delay", "Late.", "servo", 1.0, 0.9, {"delay.seconds": value}, 0.5, "number")
        return [reason.code for reason in recording_reasons([cause], [knots])]

    assert reasons(0.0145) == ["interpolated"]
    assert reasons(0.030) == [] and reasons(0.001) == ["stamps"]


STOP = 0.985  # [rad] either side; with this seed the lower one is met in the test part alone
SEED = 30050


def recorded(effects: dict[str, float]) -> FreeProblem:
    data, _ = hidden_bench(dict(effects), SEED, LOADS, nominal_error=0.0)
    models = [JointModel(load_chain(run.actuators["servo"])) for run in data.runs]
    return free_problem(data.runs, "servo", models, cut(data.runs, "servo"), {"position": 1.0 / 6e-4})


def test_a_stop_that_only_the_test_part_meets_is_pointed_out() -> None:
    problem = recorded({"contact.blocked": STOP})
    upper = problem.simulate([{"load.stop_angle": STOP}])[0]
    found = unseen_range(problem, upper, "servo")
    assert found is not None and found.severity == "note" and not found.data_error
    assert found.value == pytest.approx(-STOP, abs=0.05)
    assert "record that motion" in found.sentence


def reaching(problem: FreeProblem, simulated: np.ndarray, *, test: bool) -> None:
    """Let one piece go to 1.5 rad for a moment, measured and simulated."""
    piece = next(k for k, unit in enumerate(problem.units) if (unit.part == TEST) is test)
    middle = (problem.starts[piece] + problem.starts[piece + 1]) // 2
    problem.measured[middle : middle + 2, 0] = simulated[middle : middle + 2, 0] = 1.5


def test_nothing_is_said_where_the_model_is_right_there_as_well() -> None:
    problem = recorded({})
    simulated = problem.simulate([{}])[0]
    reaching(problem, simulated, test=True)
    assert unseen_range(problem, simulated, "servo") is None
    # nor where it is as wrong within the range as beyond it
    assert unseen_range(problem, simulated + 0.05, "servo") is None


def test_nothing_is_said_where_all_parts_reach_as_far() -> None:
    problem = recorded({})
    simulated = problem.simulate([{}])[0]
    reaching(problem, simulated, test=True)
    piece = int(np.searchsorted(problem.starts, np.argmax(simulated[:, 0]), side="right")) - 1
    simulated[problem.starts[piece] : problem.starts[piece + 1], 0] += 0.05
    assert unseen_range(problem, simulated, "servo") is not None
    reaching(problem, simulated, test=False)
    assert unseen_range(problem, simulated, "servo") is None
