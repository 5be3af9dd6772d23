"""Whatever fails, however the run ends: torque goes off, or a person is told at once that it may be on."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.commands import deploy
from sealegs.configs.script import run as run_script
from sealegs.gap.log import read_measured
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.guard.supervisor import Charge, Supervisor
from sealegs.hw.run.commands import Trajectory, park_motion
from sealegs.hw.run.live import picture
from sealegs.hw.run.measured_log import read_events
from sealegs.hw.virtual import VirtualBus

from tests.servo_runs import PATIENT
from tests.simulated_runs import LEGS, QUIET, XL330, Simulation, sine, when_torque_came_on
from tests.waiting import wait_until

HOPPERS = {"feetech": (), "dynamixel": LEGS}
"""What makes a hopper one of a maker."""
MAKERS = {"feetech": (), "dynamixel": XL330}
"""What makes a bench one of a maker."""
makers = pytest.mark.parametrize("maker", MAKERS)
AWAY = sine(offset=0.9)
"""A start that the robot must first be brought to."""
BEYOND_LIMITS: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    ({"kind": "brown_out", "value": 5.5}, {}, "voltage"),
    ({"kind": "overheat", "value": 68.0}, {}, "temperature"),
    ({"kind": "overheat", "value": 75.0}, {}, "OverheatFault"),
    ({"kind": "drop", "count": 0}, {"voltage_low": 7.6}, "voltage"),
]
"""Faults, limits of the loop where they are others, and what is named before torque comes on."""


# --- on the way to the start ----------------------------------------------------------------------------------


@makers
@pytest.mark.parametrize(
    ("fault", "name"), [({"kind": "silence"}, "NoReplyError"), ({"kind": "unplug"}, "UnpluggedError")]
)
def test_a_failure_on_the_way_to_the_start_is_reported_and_torque_that_may_be_on_is_said(
    fault: dict[str, Any], name: str, maker: str
) -> None:
    simulation = Simulation("bench", *MAKERS[maker], commands=AWAY, faults=[{**fault, "at": 0.28}])
    outcome = simulation.run()
    assert outcome.ending == "fault" and outcome.fault is not None and outcome.fault.name == name
    assert outcome.fault.sentence.startswith("on the way to the start:")
    assert 0.2 < 0.28 - when_torque_came_on(simulation) < 0.28, "a quarter of a second after torque on"
    assert simulation.torque == [True] and list(outcome.not_at_rest) == [1]
    assert any("TORQUE MAY BE ON at servo(s) 1" in line for _, line in simulation.said)
    assert simulation.guard.heard[-1] == "call"


def test_a_servo_that_comes_back_after_a_failure_on_the_way_to_the_start_is_released() -> None:
    simulation = Simulation(commands=AWAY, faults=[{"kind": "silence", "at": 0.28, "seconds": 0.6}])
    outcome = simulation.run()
    assert outcome.ending == "fault" and simulation.torque == [False]
    assert simulation.guard.heard[-1] == "released"


@pytest.mark.long
def test_the_last_line_of_deploy_says_that_torque_may_be_on(tmp_path: Path, capsys: Any) -> None:
    faults = tmp_path / "faults.yaml"
    faults.write_text("- {kind: silence, at: 0.3}\n")
    away = tmp_path / "away.csv"
    np.savetxt(away, [[0.0, 0.9], [5.0, 0.9]], "%.3f", ",", header="time,joint.goal", comments="")
    arguments = ["hw.virtual.time=stepped", *PATIENT, "silence=20", "patience=0.1", f"hw.virtual.faults={faults}"]
    assert run_script(deploy.main, "deploy", "", [*arguments, f"excitation={away}", f"out={tmp_path}"]) == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert error[0].startswith("STOP: on the way to the start: servo 1"), "at once"
    assert error[1].startswith("TORQUE MAY BE ON at servo(s) 1: CUT THE POWER")
    assert error[-1].startswith("TORQUE MAY BE ON at servo(s) 1") and "on the way to the start" in error[-1]


@pytest.mark.parametrize("silent", [False, True])
def test_an_exception_ends_in_the_release_and_its_report(silent: bool) -> None:
    class Broken(Trajectory):
        """A policy with a bug."""

        def goals(self, time: float, reading: Any) -> np.ndarray:
            if silent:
                simulation.fault("silence")
            raise ZeroDivisionError("a bug")

    simulation = Simulation(commands=lambda _: Broken("broken", np.array([0.0, 1.0]), np.zeros((2, 1))))
    with pytest.raises(ZeroDivisionError):
        simulation.run()
    assert simulation.loop.outcome is not None and simulation.loop.outcome.ending == "exception"
    assert bool(simulation.loop.outcome.not_at_rest) == silent == any(simulation.torque)
    assert any("TORQUE MAY BE ON" in line for _, line in simulation.said) == silent


# --- a release that fails -------------------------------------------------------------------------------------


def test_a_release_that_fails_is_said_at_the_first_servo_and_before_anybody_waits() -> None:
    simulation = Simulation("hopper", limits={"range_margin": 3.0, "speed": 200.0})
    begun: list[float] = []

    def noted() -> None:
        begun.append(simulation.port.now())

    simulation.guard.at_each["resting"] = noted
    simulation.loop.each_cycle = lambda: simulation.fault("silence", servos=[1, 2]) or "enough"
    outcome = simulation.run()
    assert set(outcome.not_at_rest) == {1, 2} and simulation.guard.left == ["1", "2"], "the others are released"
    first, line = simulation.said[0]
    assert "TORQUE MAY BE ON at servo(s) 1: CUT THE POWER" in line and first - begun[0] < 0.2
    assert [word for word in simulation.guard.heard if word != "resting"] == ["call"]


def test_ctrl_c_ends_the_wait_for_servos_that_cannot_be_reached(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = Simulation()
    simulation.guard.patience = 1000.0
    simulation.loop.each_cycle = lambda: simulation.fault("unplug") or "enough"

    def pressed(line: str) -> None:
        simulation.said.append((simulation.port.now(), line))
        if "Ctrl-C ends the wait" in line:
            reopened = simulation.port.reopened

            def later() -> Any:
                if simulation.port.now() < 1e9:
                    simulation.stop.ask("Ctrl-C")
                return reopened()

            monkeypatch.setattr(simulation.port, "reopened", later)

    simulation.loop.alarm = pressed
    assert simulation.run().not_at_rest, "it has not waited for a thousand seconds"


def test_the_view_is_stale_once_the_release_has_failed() -> None:
    simulation = Simulation()
    views: list[Any] = []
    simulation.loop.alarm = lambda line: views.append(picture(simulation.loop))
    simulation.loop.each_cycle = lambda: (
        views.append(picture(simulation.loop)) or simulation.fault("unplug") or "enough"
    )
    simulation.run()
    assert "STALE" not in str(views[0].title)
    assert "STALE (NOT AT REST)" in str(views[1].title) and "TORQUE MAY BE ON" in str(views[1].caption)


# --- torque that is lost --------------------------------------------------------------------------------------


def test_why_a_run_stops_is_said_before_anything_that_takes_time() -> None:
    simulation = Simulation(faults=[{"kind": "limp", "at": 0.5}])
    simulation.loop.alarm = lambda line: simulation.said.append((len(simulation.guard.heard), line))
    assert simulation.run(1.0).ending == "fault"
    assert [(heard, line.split(":")[0]) for heard, line in simulation.said] == [(0, "STOP")], "nobody was told to rest"
    assert "servo 1 has lost its torque" in simulation.said[0][1]
    simulation = Simulation(faults=[{"kind": "brown_out", "value": 5.5}])
    assert simulation.run(1.0).ending == "fault" and simulation.said == [], "torque was never on"


@pytest.mark.long
@pytest.mark.parametrize(
    ("maker", "rate"),
    [*(("feetech", rate) for rate in (20.0, 100.0, 250.0)), *(("dynamixel", rate) for rate in (20.0, 100.0))],
)
@pytest.mark.parametrize(
    ("fault", "name"),
    [({"kind": "restart", "value": 0.015}, "restart"), ({"kind": "limp"}, "torque")],
)
def test_a_servo_that_lost_its_torque_is_named_within_100_ms(
    fault: dict[str, Any], name: str, maker: str, rate: float
) -> None:
    limits = {"range_margin": 3.0, "speed": 200.0}
    faults = [{**fault, "servos": [2], "at": 2.0}]
    calm = {} if maker == "feetech" else {"commands": sine(0.1)}
    limits |= {"following_error": 9.0} if calm else {}
    simulation = Simulation("hopper", *HOPPERS[maker], rate=rate, limits=limits, faults=faults, **calm)
    outcome = simulation.run(5.0)
    assert outcome.ending == "fault" and outcome.fault is not None
    assert (outcome.fault.name, outcome.fault.servos) == (name, (2,)) and "servo 2 has" in outcome.fault.sentence
    off = {servo: time for time, servo, on in simulation.rig.history if not on}
    assert off[1] - 2.0 < 0.1 and not any(simulation.torque)


def test_a_restart_is_named_though_the_servo_has_torque_again() -> None:
    simulation = Simulation("hopper", commands=sine(0.1), limits={"range_margin": 3.0, "speed": 200.0})
    servo, at = simulation.rig.servos[1], 1.0

    def restarted() -> None:  # as one whose firmware takes a goal for a wish for torque looks 10 ms later
        if simulation.loop.elapsed > at:
            servo.put("torque_limit", servo.get("max_torque"))

    simulation.loop.each_cycle = restarted
    outcome = simulation.run(5.0)
    assert outcome.fault is not None and (outcome.fault.name, outcome.fault.servos) == ("restart", (2,)), outcome.fault
    assert not any(simulation.torque) and simulation.loop.elapsed - at < 0.2


# --- replies that are lost ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("servos", "minutes"), [(4, 0.1), *(pytest.param(count, 10.0, marks=pytest.mark.weekly) for count in (6, 12))]
)
def test_one_lost_reply_in_a_hundred_is_survived_with_every_servo_inside_its_limits(
    servos: int, minutes: float, tmp_path: Path
) -> None:
    loss = {"kind": "drop", "probability": 0.01}
    simulation = Simulation(
        "row", commands=sine(0.4, 0.7), faults=[loss], servos=servos, folder=tmp_path
    )  # limits of configs/robot
    outcome = simulation.run(60.0 * minutes)
    assert outcome.ending == "finished", outcome.fault
    assert outcome.bus["NoReplyError"] > 50 * servos * minutes, "a hundred cycles a second"
    assert outcome.timing.cycles == pytest.approx(6000 * minutes, rel=1e-2)
    assert outcome.timing.overrun_share < 0.01, "a second try has its time within the cycle"
    missed = sum(event["event"] == "missed" for event in read_events(tmp_path / "run.csv"))
    assert missed < 0.1 * outcome.bus["NoReplyError"], "nearly every one comes at the second try"
    assert not any(simulation.torque) and simulation.said == [] and outcome.cut == {"range": 0, "speed": 0}


@pytest.mark.long
def test_the_replies_that_came_are_used_while_one_servo_is_silent_and_then_it_is_named() -> None:
    silence = {"kind": "silence", "servos": [2], "at": 2.0}
    simulation = Simulation("hopper", commands=sine(0.1), faults=[silence], limits=QUIET)
    seen: list[tuple[float, np.ndarray, np.ndarray]] = []

    def noted() -> None:
        assert simulation.loop.reading is not None
        seen.append((simulation.port.now(), simulation.loop.reading.position, simulation.loop.sent))

    simulation.loop.each_cycle = noted
    outcome = simulation.run(5.0)
    assert outcome.fault is not None and (outcome.fault.name, outcome.fault.servos) == ("NoReplyError", (2,))
    assert 0.04 < simulation.rig.history[-1][0] - 2.0 < 0.1, "50 ms after its latest reply"
    during = [row for row in seen if row[0] > 2.0][1:]
    assert len(during) >= 4
    assert len({position[0] for _, position, _ in during}) > 2, "servo 1 is still read"
    assert len({sent[0] for _, _, sent in during}) == len(during), "and still commanded"


def test_a_lost_reply_is_waited_for_as_long_as_round_trips_take_and_not_for_the_whole_timeout() -> None:
    simulation = Simulation(timeout=0.02, latency=0.001)
    with simulation.bus as bus:
        for _ in range(50):
            bus.read_cycle([1], until=simulation.port.now() + 0.005)
        simulation.fault("drop", count=1)
        begun = simulation.port.now()
        state = bus.read_cycle([1], until=begun + 0.005)
    assert state.missing == () and simulation.port.now() - begun < 0.008 and bus.counts["NoReplyError"] == 1


# --- a rate that cannot be kept -------------------------------------------------------------------------------


@pytest.mark.long
def test_a_slow_adapter_is_named_before_torque_comes_on_with_the_command_that_mends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ttyUSB7").mkdir()
    (tmp_path / "ttyUSB7" / "latency_timer").write_text("16")
    monkeypatch.setattr("sealegs.hw.run.pace.DEVICES", tmp_path)
    simulation = Simulation(latency=0.016)
    simulation.bus.port = "/dev/ttyUSB7"
    simulation.run(1.0)
    said, line = simulation.said[0]
    assert said < when_torque_came_on(simulation)
    assert "takes 16" in line and "rate=42" in line
    assert "echo 1 | sudo tee" in line and "ttyUSB7/latency_timer" in line
    dynamixel_too = Simulation("bench", *XL330, latency=0.016)
    dynamixel_too.run(1.0)
    said, line = dynamixel_too.said[0]
    assert said < when_torque_came_on(dynamixel_too) and "takes 16" in line
    strict = Simulation(latency=0.016, overruns="stop")
    outcome = strict.run(1.0)
    assert outcome.fault is not None and outcome.fault.name == "slow" and not strict.switched_on
    assert Simulation(latency=0.001).run(1.0).ending == "finished"


@pytest.mark.long
@pytest.mark.parametrize("overruns", ["log", "stop"])
def test_overruns_that_go_on_are_named_and_end_the_run_where_that_is_set(overruns: str, tmp_path: Path) -> None:
    simulation = Simulation(overruns=overruns, folder=tmp_path, limits={"following_error": 1.0})
    simulation.loop.each_cycle = lambda: simulation.port.sleep(0.012 if simulation.loop.elapsed > 2.0 else 0.0)
    outcome = simulation.run(6.0)
    (event,) = [event for event in read_events(tmp_path / "run.csv") if event["event"] == "pace"]
    assert event["name"] == "overruns" and 2.0 < event["time"] < 4.0 and "10.0 ms" in event["sentence"]
    assert (outcome.fault is not None and outcome.fault.name == "overruns") == (overruns == "stop")
    assert [line.startswith("STOP: ") for _, line in simulation.said] == [overruns == "stop"]


def test_a_single_stall_is_no_sustained_overrun() -> None:
    simulation = Simulation(limits={"following_error": 1.0})
    stalls = iter([0.2])
    simulation.loop.each_cycle = lambda: simulation.port.sleep(
        next(stalls, 0.0) if simulation.loop.elapsed > 2.0 else 0.0
    )
    assert simulation.run(4.0).ending == "finished" and simulation.said == []


# --- before torque, and beside the motion ---------------------------------------------------------------------


@pytest.mark.parametrize("maker", ["feetech", pytest.param("dynamixel", marks=pytest.mark.long)])
@pytest.mark.parametrize(("fault", "limits", "name"), BEYOND_LIMITS)
def test_limits_are_judged_before_torque_comes_on(
    fault: dict[str, Any], limits: dict[str, Any], name: str, maker: str
) -> None:
    simulation = Simulation("bench", *MAKERS[maker], faults=[fault], limits=limits)
    outcome = simulation.run()
    assert outcome.fault is not None and outcome.fault.name == name and not simulation.switched_on
    assert outcome.fault.sentence.startswith("before torque came on:")


@pytest.mark.long
def test_a_current_that_is_reported_as_a_magnitude_gets_its_sign(tmp_path: Path) -> None:
    logs = []
    for kind in ("unsigned", "drop"):
        folder = tmp_path / kind
        fault = {"kind": kind, "count": None if kind == "unsigned" else 0}
        simulation = Simulation(commands=sine(0.8, 1.0), faults=[fault], limits={"speed": 99.0}, folder=folder)
        assert simulation.run(3.0).ending == "finished"
        log = read_measured(folder / "run.csv").runs[0].joints["joint"]
        assert log.current is not None
        logs.append(log.current)
        noted = [event for event in read_events(folder / "run.csv") if event["event"] == "current without sign"]
        assert [event["servos"] for event in noted] == ([[1]] if kind == "unsigned" else [])
    made, true = logs
    assert true.min() < -0.1 and np.abs(made - true).max() < 0.2 and np.corrcoef(made, true)[0, 1] > 0.98


def test_a_disk_that_takes_half_a_row_leaves_a_log_that_reads_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = Simulation(folder=tmp_path)
    write = os.write
    left = [20_000]

    def filling(file: int, data: bytes) -> int:
        if not data.endswith(b"\n") or data.startswith(b"{"):
            return write(file, data)
        if left[0] <= 0:
            raise OSError(28, "No space left on device")
        taken = write(file, data[: left[0]])
        left[0] -= taken
        return taken

    monkeypatch.setattr("sealegs.hw.run.measured_log.os.write", filling)
    outcome = simulation.run(10.0)
    monkeypatch.undo()
    assert outcome.fault is not None and outcome.fault.name == "LogError" and "No space left" in outcome.fault.sentence
    assert simulation.torque == [False] and outcome.not_at_rest == {}
    assert simulation.log is not None
    assert len(read_measured(tmp_path / "run.csv").runs[0].time) == simulation.log.rows > 50


# --- how it ends ----------------------------------------------------------------------------------------------


def parked(*robot: str, **keys: Any) -> Simulation:
    def made(robot: Any) -> Any:
        return sine(0.3)(robot)

    simulation = Simulation("bench", *robot, commands=made, **keys)
    simulation.loop.park = park_motion({"joint": -0.9}, simulation.robot)
    return simulation


@pytest.mark.long
@pytest.mark.parametrize(
    ("maker", "stopped", "within"),
    [("feetech", False, 0.1), ("feetech", True, 0.1), ("dynamixel", False, 0.12)],
)
def test_a_robot_sits_down_before_it_is_released(maker: str, stopped: bool, within: float) -> None:
    simulation = parked(*MAKERS[maker])
    if stopped:
        asks = iter(["enough"])
        simulation.loop.each_cycle = lambda: (
            simulation.stop.ask(next(asks))
            if simulation.loop.elapsed > 1.0 and simulation.stop.reason is None
            else None
        )
    places: list[float] = []

    def noted() -> None:
        places.append(simulation.rig.machine.position(0))

    simulation.guard.at_each["beat"] = noted
    outcome = simulation.run(2.0)
    assert outcome.ending == ("stopped" if stopped else "finished") and simulation.torque == [False]
    assert places[-1] == pytest.approx(-0.9, abs=within), "it is at its park pose when torque goes off"
    assert np.abs(np.diff(places)).max() < 0.05, "without a jump"


@pytest.mark.long
def test_a_further_stop_and_a_fault_cut_the_way_down_short() -> None:
    simulation = parked()
    begun: list[float] = []

    def beat() -> None:
        if simulation.loop.state == "sitting down":
            begun.append(simulation.port.now())
            if len(begun) == 5:
                simulation.stop.ask("Ctrl-C")

    simulation.guard.at_each["beat"] = beat
    simulation.run(1.0)
    assert simulation.torque == [False] and simulation.port.now() - begun[4] < 0.05
    simulation = parked(faults=[{"kind": "overheat", "at": 2.2}])
    outcome = simulation.run(1.0)
    assert outcome.fault is not None and outcome.fault.name == "OverheatFault" and simulation.torque == [False]
    assert outcome.fault.sentence.startswith("while sitting down:")


@makers
@pytest.mark.parametrize("stopped", [False, True])
def test_servos_that_are_held_are_left_to_the_supervisor(maker: str, stopped: bool) -> None:
    simulation = Simulation("bench", *MAKERS[maker], rest="hold")
    if stopped:
        simulation.loop.each_cycle = lambda: simulation.stop.ask("enough") if simulation.loop.elapsed > 0.5 else None
    outcome = simulation.run(1.0)
    assert (outcome.ending, outcome.rest) == ("stopped" if stopped else "finished", "hold")
    assert simulation.torque == [True] and simulation.loop.holder == 4711
    if maker == "dynamixel":
        simulation.port.sleep(1.0)
        assert simulation.rig.servos[0].get("bus_watchdog") == 0, "nobody asks it any more, and it holds"


@pytest.mark.long
@pytest.mark.parametrize("how", ["fault", "asked", "later run"])
def test_the_supervisor_watches_servos_that_are_held_and_releases_them(how: str, tmp_path: Path) -> None:
    with VirtualBus(robot="bench", link=tmp_path / "servos") as virtual:
        with ServoBus(virtual.port, timeout=0.5) as bus:
            bus.torque_on([1])
            bus.hold([1])
        events = tmp_path / "run.events.jsonl"
        charge = Charge(
            virtual.port, 1_000_000, "sts3215", 0.5, [1], "hold", 60.0, os.getpid(), str(events)
        )  # fmt: skip
        supervisor = Supervisor(charge)
        assert supervisor.starting() and supervisor.holding()
        holder = supervisor.leave_held()
        time.sleep(1.0)
        assert virtual.status()["servos"]["1"]["torque"], "nothing is wrong yet"
        if how == "later run":
            later = Supervisor(charge)
            assert later.starting() and later.beat()
            wait_until(lambda: events.is_file() and "watched by a later run" in events.read_text())
            wait_until(lambda: not supervisor.alive)
            assert virtual.status()["servos"]["1"]["torque"], "which is the later run's business"
            later.dismiss()
            return
        virtual.fault("overheat") if how == "fault" else os.kill(holder, signal.SIGTERM)
        wait_until(lambda: not virtual.status()["servos"]["1"]["torque"] and events.is_file())
        assert ("hotter" if how == "fault" else "was asked to end.") in events.read_text()
