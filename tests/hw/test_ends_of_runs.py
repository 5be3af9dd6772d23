"""The end of a run says what is true: servos are held where somebody watches them, and released as soon as can be."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from sealegs.common.errors import SealegsError
from sealegs.hw.bus.clock import Metronome, Timing
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.guard.stop import Stop, emergency_stop, release
from sealegs.hw.guard.supervisor import Charge, Supervisor
from sealegs.hw.run import deployment
from sealegs.hw.run.deployment import Run, prepare
from sealegs.hw.run.outcome import Outcome
from sealegs.hw.virtual import VirtualBus

from tests.servo_runs import config
from tests.simulated_runs import Simulation
from tests.waiting import wait_until


def dying(seconds: float, **keys: Any) -> Simulation:
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


def test_a_supervisor_that_dies_as_a_servo_cannot_be_held_has_the_others_released() -> None:
    simulation = Simulation("row", rest="hold")
    simulation.fault("silence", at=0.5, servos=[2])

    def dying_then() -> None:
        simulation.guard.lives = simulation.guard.heard.count("resting") < 2

    simulation.guard.at_each["resting"] = dying_then
    outcome = simulation.run(1.0)
    assert outcome.rest == "release" and simulation.torque == [False, True, False, False]
    assert list(outcome.not_at_rest) == [2]


def test_of_a_supervisor_that_has_died_nobody_says_that_it_goes_on_trying() -> None:
    simulation = dying(0.3)
    simulation.fault("silence", at=0.6, servos=[2])
    simulation.guard.patience = 0.2
    outcome = simulation.run(1.0)
    assert list(outcome.not_at_rest) == [2]
    said = " ".join(line for _, line in simulation.said)
    assert "TORQUE MAY BE ON at servo(s) 2" in said and "The supervisor goes on trying" not in said
    assert "nobody goes on trying" in said and "call" not in simulation.guard.heard


# --- an emergency stop as the run ends ---------------------------------------------------------------------------


@pytest.mark.parametrize("when", ["before", "after"])
def test_an_emergency_stop_while_servos_become_held_releases_them(when: str, monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = Simulation("row", rest="hold")
    hold = simulation.bus.hold

    def pressing(ids: list[int]) -> None:
        last = simulation.loop.state == "to rest" and ids == [4 if when == "after" else 1]
        if last and when == "before":
            simulation.stop.press("pressed")
        hold(ids)
        if last:
            simulation.stop.press("pressed")

    monkeypatch.setattr(simulation.bus, "hold", pressing)
    outcome = simulation.run(0.5)
    assert outcome.rest == "release" and simulation.torque == [False] * 4 and simulation.loop.holder is None
    assert "release only" in simulation.guard.heard and simulation.guard.heard[-1] == "dismiss"


def test_an_emergency_stop_does_not_end_the_wait_for_servos_that_may_have_torque(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulation = Simulation("row", rest="hold")
    simulation.fault("silence", at=0.5, servos=[2])
    call, waited = simulation.guard.call, list[bool]()

    def pressed(give_up: Callable[[], bool], left: Sequence[str]) -> bool:
        simulation.stop.press("pressed")
        waited.append(not give_up())
        simulation.wire.faults.clear()
        return bool(call(give_up, left))

    monkeypatch.setattr(simulation.guard, "call", pressed)
    outcome = simulation.run(1.0)
    assert waited == [True] and outcome.rest == "release" and simulation.loop.holder is None


def test_the_supervisor_hears_of_an_emergency_stop_before_the_bus_is_waited_for() -> None:
    heard: list[str] = []

    class Told:
        def release_only(self) -> None:
            heard.append("release only")

        def resting(self) -> bool:
            heard.append("resting")
            return True

        def torque_off(self, ids: list[int]) -> None:
            heard.append("torque off")

    told: Any = Told()
    release(told, told, [1])
    assert heard == ["release only", "resting", "torque off"]


@pytest.mark.long
@pytest.mark.parametrize("how", ["button", "loop"])
def test_an_emergency_stop_releases_servos_that_are_held_after_the_run(how: str, tmp_path: Path) -> None:
    button, pressed = os.pipe()
    with VirtualBus(robot="bench", link=tmp_path / "servos") as virtual:
        with ServoBus(virtual.port, timeout=0.5) as bus:
            bus.torque_on([1])
        events = tmp_path / "run.events.jsonl"
        charge = Charge(
            virtual.port, 1_000_000, "sts3215", 0.5, [1], "hold", 60.0, os.getpid(), str(events), button=button
        )
        supervisor = Supervisor(charge)
        assert supervisor.holding()
        supervisor.leave_held()
        os.close(button)
        time.sleep(1.0)
        assert virtual.status()["servos"]["1"]["torque"], "nothing is wrong yet"
        os.write(pressed, b"!") if how == "button" else supervisor.release_only()
        wait_until(lambda: not virtual.status()["servos"]["1"]["torque"] and events.is_file())
        wait_until(lambda: "emergency stop" in events.read_text())
    os.close(pressed)


# --- a descriptor that is no button ------------------------------------------------------------------------------


@pytest.mark.parametrize(("number", "said"), [(-1, "no file descriptor -1 is open"), (987, "no file descriptor 987")])
def test_an_emergency_stop_that_is_not_there_is_refused(number: int, said: str) -> None:
    with pytest.raises(SealegsError, match=said):
        prepare(config("excitation=chirp", f"estop={number}"))


def test_a_file_on_a_disk_is_no_emergency_stop(tmp_path: Path) -> None:
    with (tmp_path / "button").open("w") as file, pytest.raises(SealegsError, match="a file on a disk"):
        prepare(config("excitation=chirp", f"estop={file.fileno()}"))


def test_an_emergency_stop_that_breaks_stops() -> None:
    for broken in (-1, 987):
        stop, acted = Stop(), threading.Event()
        with emergency_stop(broken, stop, acted.set):
            assert acted.wait(5.0) and stop.emergency


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


def ended(folder: Path, *events: dict[str, str]) -> Run:
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


# --- goals that safety cut ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("cut", "warns"), [(236, True), (3, True), (2, False), (0, None)])
def test_a_run_whose_goals_were_cut_often_says_what_mends_it(cut: int, warns: bool | None) -> None:
    """236 cycles of 250 were cut, with one quiet line."""
    timing = Timing(250, 0, 0, 0.0, 0.0, 0.0, 0.0, *(0.0, 0.0), command_p99=0.0, cpu_share=0.0)
    said = Outcome("finished", None, fault=None, timing=timing, cut={"range": 0, "speed": cut}, bus={}).told_cut()
    assert (str(cut) in said and f"({100 * cut / 250:.0f} %)" in said) if cut else said == ""
    assert ("raise env.servo.goal_rate, env.smooth_weight" in said) is bool(warns)
