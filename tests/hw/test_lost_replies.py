"""What comes of a transaction of which a part was lost, and of an adapter that becomes slower."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealegs.gap.log import read_measured
from sealegs.hw.bus.dialects import Reply
from sealegs.hw.bus.packets import NoReplyError, ShortReplyError, StaleReplyError, StalledError
from sealegs.hw.bus.registers import load_model
from sealegs.hw.run import pace
from sealegs.hw.run.commands import Reference, read_replay
from sealegs.hw.run.simulated import recorded

from tests.simulated_runs import Simulation, sine

LOOSE = {"range_margin": 9.0, "speed": 200.0, "following_error": 9.0, "current": 9.0}


def test_a_short_reply_costs_no_other_servo_its_own() -> None:
    simulation = Simulation("hopper")
    ids = simulation.robot.all_ids
    simulation.fault("short", servos=[2], count=1)
    with pytest.raises(ShortReplyError) as caught:
        simulation.bus.read_state(ids, retries=0)
    assert caught.value.servos == (2,) and sorted(caught.value.replies) == [1, 3, 4, 5, 6]
    simulation = Simulation("hopper")
    simulation.fault("short", servos=[2], count=1)
    simulation.fault("silence", servos=[5], seconds=0.05)
    with pytest.raises(NoReplyError) as silent:
        simulation.bus.read_state(ids, retries=0)
    assert silent.value.servos == (5,) and sorted(silent.value.replies) == [1, 3, 4, 6]


def test_a_second_master_that_never_ends_does_not_keep_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = Simulation("hopper")
    bus, port = simulation.bus, simulation.port
    heard: list[float] = []

    def babble(_: object) -> tuple[Reply, bool]:
        assert len(heard) < 1000, "for ever"
        port.sleep(0.001)
        heard.append(port.now())
        return Reply(99, 0, [0], [99]), False

    monkeypatch.setattr(bus.line.dialect, "receive", babble)
    with pytest.raises(StaleReplyError, match="servo 99 on simulated"):
        bus.read_state([1, 2], retries=0)
    assert heard[-1] - heard[0] < 0.03


def test_an_adapter_that_takes_no_bytes_is_said_before_the_second_try_to_release(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulation = Simulation("hopper")
    said: list[float] = []

    def stalled(*_: object) -> float:
        simulation.port.sleep(0.5)
        raise StalledError("the adapter takes no more bytes.")

    monkeypatch.setattr(simulation.bus.line, "send_all", stalled)
    begun = simulation.port.now()
    failed = simulation.bus.torque_off([1, 2], lambda servos, error: said.append(simulation.port.now() - begun))
    assert sorted(failed) == [1, 2] and said == [pytest.approx(0.5)]


def test_a_servo_that_answers_twice_is_not_believed_and_costs_no_other_its_reply(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulation = Simulation("hopper")
    exchange = simulation.wire.exchange

    def doubled(*arguments: object) -> list[tuple[float, bytes]]:
        found = exchange(*arguments)  # type: ignore[arg-type]
        return [row for at, packet in found for row in [(at, packet)] * (1 + (packet[2] == 3))]

    monkeypatch.setattr(simulation.wire, "exchange", doubled)
    with pytest.raises(StaleReplyError) as caught:
        simulation.bus.read_state(simulation.robot.all_ids, retries=0)
    assert caught.value.servos == (3,) and sorted(caught.value.replies) == [1, 2, 4, 5, 6]


def test_the_torque_of_a_servo_that_did_not_answer_is_not_known() -> None:
    simulation = Simulation("hopper")
    bus, ids = simulation.bus, simulation.robot.all_ids
    bus.torque_on([1, 2])
    bus.read_cycle(ids, True)
    simulation.fault("silence", servos=[2])
    state = bus.read_cycle(ids, True, simulation.port.now() + 0.005)
    assert state.torque is not None and state.missing == (2,)
    assert state.torque.tolist()[:2] == [1, -1]


@pytest.mark.long
@pytest.mark.parametrize("latency", [0.0045, 0.012])
def test_an_adapter_that_becomes_slower_for_good_is_waited_for(latency: float) -> None:
    simulation = Simulation(latency=0.001, commands=sine(0.1), limits=LOOSE)

    def slower() -> None:
        simulation.port.latency = 0.001 if simulation.loop.elapsed < 1.0 else latency

    simulation.loop.each_cycle = slower
    outcome = simulation.run(3.0)
    assert outcome.ending == "finished", outcome.fault
    assert outcome.bus["NoReplyError"] < 20, "then its round trip is known"


@pytest.mark.parametrize(("held", "mends"), [("16", True), ("1", False), (None, False)])
def test_the_latency_timer_is_named_where_the_adapter_has_one_that_holds_bytes(
    held: str | None, mends: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if held is not None:  # a CH340 has no such file
        (tmp_path / "ttyUSB7").mkdir()
        (tmp_path / "ttyUSB7" / "latency_timer").write_text(held + "\n")
    monkeypatch.setattr(pace, "DEVICES", tmp_path)
    said = pace.Pace(0.017, "/dev/ttyUSB7", load_model("sts3215")).too_slow(0.01)
    assert said is not None and "rate=41" in said
    assert (f"holds bytes for 16 ms, which `echo 1 | sudo tee {tmp_path}/ttyUSB7/latency_timer`" in said) == mends
    assert ("higher baud rate" in said and "return_delay" in said) != mends


@pytest.mark.parametrize(("model", "name"), [("sts3215", "return_delay:0"), ("xl330_m288", "return_delay_time:0")])
def test_what_makes_replies_faster_is_named_as_this_make_calls_it(model: str, name: str) -> None:
    said = pace.Pace(0.017, "/dev/ttyUSB7", load_model(model)).too_slow(0.01)
    assert said is not None and f"sealegs scan port=/dev/ttyUSB7 servo={model} id=1 set={name})" in said


def test_eighteen_servos_at_a_hundred_hertz_are_not_called_too_slow() -> None:
    assert pace.Pace(0.0061, "/dev/ttyUSB7", load_model("sts3215")).too_slow(0.01) is None


def test_a_silent_encoder_leaves_only_its_own_cells_of_a_log_without_a_value(tmp_path: Path) -> None:
    simulation = Simulation("hopper", commands=Reference, folder=tmp_path, limits={"range_margin": 3.0})
    silenced: list[float] = []

    def once() -> None:
        if simulation.log is not None and simulation.log.rows > 20 and not silenced:
            silenced.append(simulation.loop.elapsed)
            simulation.fault("silence", servos=[3, 6], seconds=0.03)

    simulation.loop.each_cycle = once
    assert simulation.run(0.6).ending == "finished"
    run = read_measured(tmp_path / "run.csv").runs[0]
    lost = np.isnan(run.base["base_z"])
    assert 1 <= lost.sum() <= 5 and np.diff(run.time).max() < 0.015, "no cycle is left out"
    for joint, same in (("hip", lost), ("knee", np.zeros_like(lost))):
        link = run.joints[joint].link_position
        assert link is not None and (np.isnan(link) == same).all()
    assert np.isfinite(run.base["base_x"]).all()
    goals = read_replay(tmp_path / "run.csv", simulation.robot)
    assert goals.duration == pytest.approx(run.time[-1] - run.time[0], abs=0.02)
    policy: Any = SimpleNamespace(history=[])
    compared = recorded(tmp_path / "run.csv", policy)
    assert len(compared.time) == (~lost).sum() and np.isfinite(compared.base).all()
