"""Servos of the SCS series, which cannot be read several at a time, and have no such instruction."""

from __future__ import annotations

import pytest
from sealegs.envs.robots import get_robot
from sealegs.hw.bus.dialects import READ, SYNC_READ
from sealegs.hw.bus.packets import NoReplyError
from sealegs.hw.bus.registers import load_model
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.machine.scan import rows
from sealegs.hw.virtual.machine import Machine
from sealegs.hw.virtual.rig import Rig, mounts
from sealegs.hw.virtual.simulated_port import SimulatedPort
from sealegs.hw.virtual.wire import Wire

from tests.simulated_runs import Simulation, sine

SCS = load_model("scs0009")
SERVO = ("robot.servo=scs0009", "robot.actuator=sts3032", "robot.params.mass=0.03", "robot.params.length=0.05")
LEGS = ("robot.servo=scs0009", "robot.actuator=sts3215")  # the protocol is what is tested
LOOSE = {"range_margin": 9.0, "speed": 200.0, "following_error": 9.0, "current": 9.0}


@pytest.fixture
def bus() -> ServoBus:
    machine = Machine(get_robot("hopper"), "sts3215")
    wire = Wire(Rig(machine, SCS, mounts(machine.names, None, SCS)))
    return ServoBus("simulated", model="scs0009", opened=SimulatedPort(wire))


def test_nobody_answers_a_sync_read(bus: ServoBus) -> None:
    with pytest.raises(NoReplyError):
        bus.line.transact([1, 2], SYNC_READ, [56, 15, 1, 2], 15)
    assert len(bus.line.transact([2], READ, [56, 15], 15)[2]) == 15


def test_servos_are_read_one_by_one_and_found_by_a_scan(bus: ServoBus) -> None:
    state = bus.read_state([1, 2])
    assert state.ids == (1, 2) and state.missing == () and abs(state.position).max() < 3.0
    lines: list[str] = []
    assert rows(bus, range(4), lines.append) == 2
    assert len(lines) == 3 and all("scs0009" in line for line in lines[1:]), lines


def test_nothing_is_required_of_registers_whose_meaning_is_assumed(bus: ServoBus) -> None:
    assert "phase" not in [needed.register for needed in SCS.requires]
    bus.check([1, 2])


def test_a_run_on_them_ends_released() -> None:
    simulation = Simulation("bench", *SERVO, commands=sine(0.5), limits=LOOSE)
    outcome = simulation.run(2.0)
    assert outcome.ending == "finished" and simulation.torque == [False] and not outcome.bus, outcome


@pytest.mark.long
def test_a_silent_one_is_named_and_the_replies_of_the_others_are_used() -> None:
    silence = {"kind": "silence", "servos": [2], "at": 2.0}
    limits = {**LOOSE, "range_margin": 9.0}
    simulation = Simulation("hopper", *LEGS, rate=50.0, commands=sine(0.1), faults=[silence], limits=limits)
    seen: list[tuple[int, ...]] = []

    def noted() -> None:
        assert simulation.loop.reading is not None and simulation.loop.reading.state is not None
        seen.append(simulation.loop.reading.state.missing)

    simulation.loop.each_cycle = noted
    outcome = simulation.run(3.0)
    assert outcome.fault is not None and (outcome.fault.name, outcome.fault.servos) == ("NoReplyError", (2,))
    assert set(seen) == {(), (2,)}, "all others are still read until it is named"
