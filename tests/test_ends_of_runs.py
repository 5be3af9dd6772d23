"""The end of a run says what is true: servos are held where somebody watches them, and released as soon as can be."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from sealegs.hw import deployment
from sealegs.hw.clock import Metronome, Timing
from sealegs.hw.deployment import Run
from sealegs.hw.outcome import Outcome

from tests.simulated_runs import Simulation


def dying(seconds: float, **keys: str) -> Simulation:
    """A run whose supervisor dies after so long [s]."""
    simulation = Simulation("row", **keys)

    def each() -> None:
        if simulation.loop.elapsed > seconds and simulation.loop.state == "running":
            simulation.guard.lives = False

    simulation.loop.each_cycle = each
    return simulation


# --- a supervisor that has died ----------------------------------------------------------------------------------


def test_servos_that_nobody_would_watch_are_released_though_they_were_to_be_held() -> None:
    simulation = dying(0.3, rest="hold")
    outcome = simulation.run(1.0)
    assert outcome.fault is not None and outcome.fault.name == "supervisor"
    assert simulation.torque == [False] * 4 and outcome.rest == "release" and simulation.loop.holder is None


def test_a_supervisor_that_dies_as_the_servos_are_held_has_them_released(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = Simulation("row", rest="hold")
    hold = simulation.bus.hold

    def last(ids: list[int]) -> None:
        hold(ids)
        if simulation.loop.state == "to rest":
            simulation.guard.lives = False

    monkeypatch.setattr(simulation.bus, "hold", last)
    outcome = simulation.run(0.5)
    assert outcome.ending == "finished" and outcome.rest == "release" and outcome.not_at_rest == {}
    assert simulation.torque == [False] * 4 and simulation.loop.holder is None


def test_of_a_supervisor_that_has_died_nobody_says_that_it_goes_on_trying() -> None:
    simulation = dying(0.3)
    simulation.fault("silence", at=0.6, servos=[2])
    simulation.guard.patience = 0.2
    outcome = simulation.run(1.0)
    assert list(outcome.not_at_rest) == [2]
    said = " ".join(line for _, line in simulation.said)
    assert "TORQUE MAY BE ON at servo(s) 2" in said and "The supervisor goes on trying" not in said
    assert "nobody goes on trying" in said and "call" not in simulation.guard.heard


# --- torque goes off first ---------------------------------------------------------------------------------------


def test_no_servo_waits_for_the_figures_of_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = Simulation("row")
    torque: list[bool] = []
    timing = Metronome.timing

    def taken(metronome: Metronome) -> Timing:
        torque.extend(simulation.torque)
        return timing(metronome)

    monkeypatch.setattr(Metronome, "timing", taken)
    assert simulation.run(0.3).ending == "finished"
    assert torque == [False] * 4


# --- whose events they are ---------------------------------------------------------------------------------------


def ended(folder: Path, *events: dict[str, object]) -> Run:
    (folder / "run.events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
    outcome = Outcome("stopped", "Ctrl-C", None, Metronome(50.0).timing(), {}, {}, {1: "silent"})
    return Run(outcome, folder / "run.csv")


BEFORE = {"event": "at rest", "by": "supervisor"}
LOOP = {"event": "not at rest", "by": "loop"}


def test_what_the_supervisor_of_an_earlier_run_noted_is_not_taken_for_this_runs(tmp_path: Path) -> None:
    done = ended(tmp_path, LOOP, BEFORE, LOOP, {"event": "end"})
    assert "TORQUE MAY BE ON at servo(s) 1" in deployment.at_rest_sentence(done, "release")
    done = ended(tmp_path, LOOP, LOOP, BEFORE, {"event": "end"})
    assert deployment.at_rest_sentence(done, "release") == "the servos are released."


def test_where_the_events_are_gone_torque_may_be_on(tmp_path: Path) -> None:
    done = ended(tmp_path)
    (tmp_path / "run.events.jsonl").unlink()
    assert "TORQUE MAY BE ON at servo(s) 1" in deployment.at_rest_sentence(done, "release")
