"""What keeps a robot safe on Feetech servos keeps it safe on Dynamixels, too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.gap.log import read_measured
from sealegs.hw.bus.packets import CorruptReplyError
from sealegs.hw.run.commands import park_motion

from tests.simulated_runs import BEYOND_LIMITS, Simulation, sine, when_torque_came_on

XL330 = ("robot.servo=xl330_m288", "robot.actuator=xl330", "robot.params.mass=0.05", "robot.params.length=0.05")
LEGS = ("robot.servo=xl330_m288", "robot.actuator=sts3215")  # the protocol is what is tested
AWAY = sine(offset=0.9)
"""A start that the robot must first be brought to."""
QUIET = {"range_margin": 9.0, "speed": 200.0, "following_error": 9.0, "current": 9.0}
"""For a hopper that falls over: what is tested is the bus."""


def bench(**keys: Any) -> Simulation:
    return Simulation("bench", *XL330, **keys)


@pytest.mark.long
def test_a_run_ends_released_and_its_log_has_signed_currents(tmp_path: Path) -> None:
    simulation = bench(commands=sine(0.8, 1.0), folder=tmp_path, limits={"speed": 99.0})
    assert simulation.run(3.0).ending == "finished" and simulation.torque == [False]
    log = read_measured(tmp_path / "run.csv").runs[0].joints["joint"]
    assert log.current is not None and log.current.min() < -0.05 < 0.05 < log.current.max()
    assert simulation.rig.servos[0].get("bus_watchdog") > 0 and simulation.said == [], "its own second line was on"


@pytest.mark.parametrize(
    ("fault", "name"), [({"kind": "silence"}, "NoReplyError"), ({"kind": "unplug"}, "UnpluggedError")]
)
def test_a_failure_on_the_way_to_the_start_is_reported_and_torque_that_may_be_on_is_said(
    fault: dict[str, Any], name: str
) -> None:
    at = 0.3
    simulation = bench(commands=AWAY, faults=[{**fault, "at": at}])
    outcome = simulation.run()
    assert outcome.fault is not None and outcome.fault.name == name
    assert outcome.fault.sentence.startswith("on the way to the start:") and when_torque_came_on(simulation) < at
    assert list(outcome.not_at_rest) == [1] and simulation.guard.heard[-1] == "call"
    assert any("TORQUE MAY BE ON at servo(s) 1" in line for _, line in simulation.said)


def test_a_servo_that_nobody_asks_any_more_stops_by_itself() -> None:
    simulation = bench(commands=AWAY, faults=[{"kind": "unplug", "at": 0.5}])
    simulation.guard.patience = 0.1
    simulation.run()
    simulation.port.sleep(1.0)
    (servo,) = simulation.rig.servos
    assert simulation.torque == [True] and servo.get("bus_watchdog") == -1
    here = servo.sensors.steps
    simulation.port.sleep(1.0)
    assert abs(servo.sensors.steps - here) < 5, "it stands where its watchdog stopped it"


def test_a_stall_of_the_computer_that_the_watchdog_ended_is_named_within_100_ms() -> None:
    simulation = bench(limits={"following_error": 9.0, "goal_speed": 99.0})
    stalls = iter([0.4])

    def stall() -> None:
        if simulation.loop.elapsed > 2.0:
            simulation.port.sleep(next(stalls, 0.0))

    simulation.loop.each_cycle = stall
    outcome = simulation.run(6.0)
    assert outcome.fault is not None and outcome.fault.name == "watchdog" and simulation.torque == [False]
    assert simulation.rig.history[-1][0] - when_torque_came_on(simulation) < 4.0


def test_a_slow_loop_is_not_stopped_by_the_servos_own_watchdog() -> None:
    limits = {"range_margin": 9.0, "speed": 99.0, "following_error": 9.0}
    simulation = bench(rate=4.0, commands=sine(0.1, 0.2), limits=limits)
    outcome = simulation.run(4.0)
    assert outcome.ending == "finished", outcome.fault
    assert simulation.rig.servos[0].get("bus_watchdog") == 38, "three periods of 0.25 s, in 20 ms"


@pytest.mark.long
@pytest.mark.parametrize("rate", [20.0, 100.0])
@pytest.mark.parametrize(
    ("fault", "name"), [({"kind": "restart", "value": 0.015}, "restart"), ({"kind": "limp"}, "torque")]
)
def test_a_servo_that_lost_its_torque_is_named_within_100_ms(fault: dict[str, Any], name: str, rate: float) -> None:
    limits = {"range_margin": 3.0, "speed": 200.0, "following_error": 9.0}
    faults = [{**fault, "servos": [2], "at": 2.0}]
    simulation = Simulation("hopper", *LEGS, rate=rate, commands=sine(0.1), limits=limits, faults=faults)
    outcome = simulation.run(5.0)
    assert outcome.fault is not None and (outcome.fault.name, outcome.fault.servos) == (name, (2,)), outcome.fault
    off = {servo: time for time, servo, on in simulation.rig.history if not on}
    assert off[1] - 2.0 < 0.1 and not any(simulation.torque)


@pytest.mark.long
def test_a_servo_whose_restart_gives_it_torque_again_is_named_within_100_ms() -> None:
    restart = {"kind": "restart", "value": 0.015, "servos": [2], "at": 2.0}
    simulation = Simulation("hopper", *LEGS, commands=sine(0.1), limits=QUIET, faults=[restart])
    simulation.rig.servos[1].set_up("startup_configuration", 1)
    outcome = simulation.run(5.0)
    assert outcome.fault is not None and (outcome.fault.name, outcome.fault.servos) == ("restart", (2,)), outcome.fault
    assert "'torque_enable' is 1 again" in outcome.fault.sentence
    off = {servo: time for time, servo, on in simulation.rig.history if not on}
    assert off[1] - 2.0 < 0.1 and not any(simulation.torque)


def test_a_frozen_encoder_ends_the_run() -> None:
    simulation = bench(
        commands=sine(0.8), faults=[{"kind": "frozen", "at": 3.0}], limits={"range_margin": 9.0, "speed": 99.0}
    )
    outcome = simulation.run(12.0)
    assert outcome.fault is not None and outcome.fault.name in ("following", "frozen") and simulation.torque == [False]
    assert simulation.port.now() < 5.5


@pytest.mark.long
def test_one_lost_reply_in_a_hundred_is_survived() -> None:
    loss = {"kind": "drop", "probability": 0.01}
    simulation = Simulation("hopper", *LEGS, commands=sine(0.1), faults=[loss], limits=QUIET)
    outcome = simulation.run(10.0)
    assert outcome.ending == "finished", outcome.fault
    assert outcome.bus["NoReplyError"] + outcome.bus.get("CorruptReplyError", 0) > 30
    assert outcome.timing.overrun_share < 0.01 and simulation.torque == [False, False] and simulation.said == []


@pytest.mark.long
def test_a_garbled_request_is_asked_again() -> None:
    noise = {"kind": "garble", "probability": 0.01}
    simulation = Simulation("hopper", *LEGS, commands=sine(0.1), faults=[noise], limits=QUIET)
    outcome = simulation.run(10.0)
    assert outcome.ending == "finished", outcome.fault
    assert outcome.bus["CorruptReplyError"] > 30 and "RefusedError" not in outcome.bus
    assert simulation.torque == [False, False] and outcome.not_at_rest == {} and simulation.said == []


def test_a_garbled_request_costs_no_other_servo_its_reply_and_leaves_no_torque() -> None:
    simulation = Simulation("hopper", *LEGS)
    simulation.bus.torque_on([1, 2])
    simulation.fault("garble", servos=[1], count=1)
    with pytest.raises(CorruptReplyError, match="reached servo 1 on simulated with a wrong checksum") as caught:
        simulation.bus.read_state(simulation.robot.all_ids, retries=0)
    assert caught.value.servos == (1,) and sorted(caught.value.replies) == simulation.robot.all_ids[1:]
    simulation.fault("garble", count=6)
    assert simulation.bus.torque_off([1, 2]) == {} and simulation.torque == [False, False]


@pytest.mark.long
def test_a_silent_servo_is_named_alone_though_others_wait_for_its_packet() -> None:
    silence = {"kind": "silence", "servos": [1], "at": 2.0}
    simulation = Simulation("hopper", *LEGS, commands=sine(0.1), faults=[silence], limits=QUIET)
    outcome = simulation.run(5.0)
    assert outcome.fault is not None and (outcome.fault.name, outcome.fault.servos) == ("NoReplyError", (1,))
    off = {servo: time for time, servo, on in simulation.rig.history if not on}
    assert off[2] - 2.0 < 0.3, "the others are released"
    assert list(outcome.not_at_rest) == [1] and any("TORQUE MAY BE ON" in line for _, line in simulation.said)


def test_a_slow_adapter_is_named_before_torque_comes_on() -> None:
    simulation = bench(latency=0.016)
    simulation.bus.port = "/dev/ttyUSB7"
    simulation.run(1.0)
    said, line = simulation.said[0]
    assert said < when_torque_came_on(simulation) and "takes 16" in line


@pytest.mark.long
@pytest.mark.parametrize(("fault", "limits", "name"), BEYOND_LIMITS)
def test_limits_are_judged_before_torque_comes_on(fault: dict[str, Any], limits: dict[str, Any], name: str) -> None:
    simulation = bench(faults=[fault], limits=limits)
    outcome = simulation.run()
    assert outcome.fault is not None and outcome.fault.name == name and not simulation.switched_on, outcome.fault
    assert outcome.fault.sentence.startswith("before torque came on:")


def test_a_shutdown_of_the_servo_is_named_with_what_frees_it() -> None:
    simulation = bench(faults=[{"kind": "overload", "at": 2.0}])
    outcome = simulation.run(5.0)
    assert outcome.fault is not None and outcome.fault.name == "OverloadFault" and simulation.torque == [False]
    assert "sealegs scan id=1 reboot=true" in outcome.fault.sentence and outcome.not_at_rest == {}


@pytest.mark.long
def test_a_robot_sits_down_before_it_is_released(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = bench(commands=sine(0.3))
    simulation.loop.park = park_motion({"joint": -0.9}, simulation.robot)
    places: list[float] = []
    monkeypatch.setattr(simulation.guard, "beat", lambda: places.append(simulation.rig.machine.position(0)) or True)
    assert simulation.run(2.0).ending == "finished" and simulation.torque == [False]
    assert places[-1] == pytest.approx(-0.9, abs=0.12) and np.abs(np.diff(places)).max() < 0.05


def test_servos_that_are_held_do_not_stop_by_their_watchdog() -> None:
    simulation = bench(rest="hold")
    outcome = simulation.run(1.0)
    assert outcome.rest == "hold" and simulation.torque == [True] and simulation.loop.holder == 4711
    simulation.port.sleep(1.0)
    assert simulation.rig.servos[0].get("bus_watchdog") == 0
