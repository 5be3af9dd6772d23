"""A policy or adapter slower than its period: told before torque comes on, named, and no period is caught up."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import compose
from sealegs.envs.contract import make_contract
from sealegs.gap.log import read_measured
from sealegs.hw.bus.clock import Timing
from sealegs.hw.bus.registers import load_model
from sealegs.hw.machine.limits import Limits
from sealegs.hw.machine.robot import ServoRobot, build_robot
from sealegs.hw.run import deployment, pace
from sealegs.hw.run.commands import PolicyCommands, Trajectory
from sealegs.hw.run.measured_log import read_events
from sealegs.hw.run.outcome import Outcome
from sealegs.hw.run.pace import not_kept
from sealegs.hw.run.policy import Policy
from sealegs.hw.run.simulated import Recording, simulate
from sealegs.hw.virtual.in_process import bus_in_process

from tests.servo_runs import config, gentle_policy
from tests.simulated_runs import QUIET, Simulation, TimedPolicy, sine

PERIOD = 0.02


def rig(stub: Any, **keys: Any) -> Simulation:
    """The bench with a policy on it, on a clock that the policy's calls move too."""
    made = Simulation(commands=lambda robot: PolicyCommands(stub, robot), rate=1.0 / PERIOD, limits=QUIET, **keys)
    stub.sleep = made.port.sleep
    return made


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Policy:
    return Policy(gentle_policy(tmp_path_factory.mktemp("policy") / "policy.onnx"))


def events(simulation: Simulation, name: str) -> list[dict[str, Any]]:
    assert simulation.log is not None
    return [event for event in read_events(simulation.log.path) if event.get("name") == name]


def test_a_policy_slower_than_its_period_makes_cycles_longer_and_no_longer(policy: Policy, tmp_path: Path) -> None:
    """Missed calls were made up for, which missed more: intervals of 30, 55, 81, 107 ... 387 ms."""
    stub = TimedPolicy(policy, 0.025)
    simulation, begun = rig(stub, folder=tmp_path), list[float]()
    simulation.loop.each_cycle = lambda: begun.append(simulation.port.now())
    outcome = simulation.run(1.5)
    assert outcome.ending == "finished" and outcome.timing.overruns > 40
    running = np.array(begun[-outcome.timing.cycles :])
    assert np.diff(running).max() < 0.03, "one call a cycle"
    clock, seconds = np.array(stub.asked[-outcome.timing.cycles :]), running - running[0]
    assert np.abs(clock * PERIOD - seconds[: len(clock)]).max() <= PERIOD, "its clock is that of the run"
    (before,), (late,) = events(simulation, "slow"), events(simulation, "overruns")
    for told, first in ((before, "the policy takes 25.0 ms for its goals"), (late, "(the policy 25.0 ms")):
        assert first in told["sentence"] and "train it again with env.control_rate=25" in told["sentence"]
    assert simulation.log is not None
    order = [event.get("name", event["event"]) for event in read_events(simulation.log.path)]
    assert order.index("slow") < order.index("torque on") < order.index("overruns")


def test_a_policy_that_cannot_keep_its_rate_gets_no_torque_where_that_ends_the_run(policy: Policy) -> None:
    simulation = rig(TimedPolicy(policy, 0.025), overruns="stop")
    outcome = simulation.run()
    assert outcome.fault is not None and outcome.fault.name == "slow" and "the policy takes" in outcome.fault.sentence
    assert not simulation.switched_on


@pytest.mark.parametrize("seconds", [0.0, 0.010])
def test_a_policy_that_keeps_its_rate_is_not_told(policy: Policy, seconds: float, tmp_path: Path) -> None:
    simulation = rig(TimedPolicy(policy, seconds), folder=tmp_path)
    assert simulation.run(0.5).timing.overruns == 0
    assert not events(simulation, "slow") and not events(simulation, "overruns")


def test_a_policy_that_becomes_slow_ends_the_run_where_that_is_asked_for(policy: Policy) -> None:
    stub = TimedPolicy(policy)
    simulation = rig(stub, overruns="stop")

    def slower() -> None:
        stub.seconds = 0.03 if simulation.loop.state == "running" else 0.0

    simulation.loop.each_cycle = slower
    outcome = simulation.run(2.0)
    assert outcome.fault is not None and outcome.fault.name == "overruns" and "the policy 3" in outcome.fault.sentence
    assert simulation.torque == [False]


def test_a_policy_that_fails_in_mid_run_is_the_fault_and_the_servos_are_released(policy: Policy) -> None:
    stub = TimedPolicy(policy)
    simulation = rig(stub)

    def fails() -> None:
        if simulation.loop.state == "running" and simulation.loop.elapsed > 0.2:
            stub.fails_after = 0

    simulation.loop.each_cycle = fails
    outcome = simulation.run()
    assert outcome.fault is not None and outcome.fault.name == "PolicyError"
    assert outcome.fault.sentence == "the policy stub.onnx broke off: a bug." and simulation.torque == [False]


# --- periods that were left out -------------------------------------------------------------------------------------


class Gait:
    """A policy of the leg, which acts 100 times a second and gives goals 500 times: it only counts its calls."""

    def __init__(self) -> None:
        robot = self.robot = build_robot(compose("deploy", {"robot": "leg"})["robot"])
        chains = {name: chain.to_list() for name, chain in robot.chains.items()}
        self.contract, self.path = make_contract({"id": "SeaLegs/Leg-v0"}, chains, 100.0), "gait.onnx"
        self.time, self.seconds, self.asked = 0.0, 0.0, list[int]()
        bus, _ = bus_in_process(robot)
        self.reading = robot.reading(bus.read_state(robot.all_ids))

    def now(self) -> float:
        return self.time

    def act(self, observation: np.ndarray, command: np.ndarray, state: np.ndarray) -> Any:
        self.time += self.seconds
        self.asked.append(round(state[0, 0]))
        after = state.copy()
        after[0, 0] += 1.0
        return np.zeros((1, len(self.contract.actions))), np.asarray(self.contract.start)[None], after

    def commands(self) -> PolicyCommands:
        stub: Any = self
        made = PolicyCommands(stub, self.robot)
        made.rehearse(self.reading, 0.002, self.now)
        self.asked.clear()
        return made


@pytest.fixture(scope="module")
def gait() -> Gait:
    return Gait()


def asked(gait: Gait, seconds: float, times: Sequence[float]) -> list[list[int]]:
    """Goals that the gait was asked for in each cycle, where a call takes so long [s]."""
    gait.seconds = seconds
    commands, found = gait.commands(), list[list[int]]()
    for time in times:
        gait.asked.clear()
        commands.goals(time, gait.reading)
        found.append(list(gait.asked))
    return found


def test_a_generator_makes_up_for_missed_periods_where_that_takes_little(gait: Gait) -> None:
    assert asked(gait, 0.0005, [0.0, 0.002, 0.008, 0.010]) == [[0], [1], [2, 3, 4], [5]]


def test_a_generator_stands_still_in_missed_periods_that_it_has_no_time_for(gait: Gait) -> None:
    cycles = asked(gait, 0.0025, [0.0, 0.004, 0.008, 0.012])
    assert [len(calls) for calls in cycles] == [1] * 4, "or it would miss more and more"
    assert cycles == [[0], [2], [4], [5]], "the goal that an action belongs to is never left out"


def test_a_generator_whose_calls_take_now_long_and_now_short_misses_no_more_and_more(gait: Gait) -> None:
    """A busy computer: what the last call took says little of the next, and cycles of 30 ms became 466 ms long."""
    commands, longest, act, due = gait.commands(), 0.004, gait.act, 0

    def uneven(*given: np.ndarray) -> Any:
        gait.seconds = longest if gait.asked[-1:] != [due - 1] else 0.0001  # short as the cycle ends, long within it
        return act(*given)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gait, "act", uneven)
        begin, spans = 0.0, [0.03]
        for _ in range(12):
            begin, due = begin + spans[-1], round((begin + spans[-1]) * 500.0)
            before = gait.time
            commands.goals(begin, gait.reading)
            spans.append(max(0.002, gait.time - before))
    for span, following in itertools.pairwise(spans):
        assert following <= 0.5 * span + 2 * longest


def test_a_goal_is_asked_for_once_however_often_a_cycle_comes(gait: Gait) -> None:
    assert asked(gait, 0.0, [0.0, 0.0004, 0.002]) == [[0], [], [1]]


def test_a_gait_runs_at_a_rate_that_its_actions_fit_and_says_which(gait: Gait) -> None:
    assert gait.contract.rates == (500.0, 100.0)
    gait.robot.check_contract(gait.contract, 100.0)
    with pytest.raises(SealegsError, match=r"'goal_rate' is 500 Hz, and here it is 250 Hz; .* give one of 100\."):
        gait.robot.check_contract(gait.contract, 250.0)
    assert asked(gait, 0.0005, [0.0, 0.01, 0.02]) == [[0], [1, 2, 3, 4, 5], [6, 7, 8, 9, 10]]
    commands = gait.commands()
    assert (
        commands.slower(312.0)
        == "give rate=100, at which each goal is held for 5 periods of its own, as it was not trained"
    )
    assert "env.control_rate=50 and give rate=50" in commands.slower(70.0)


# --- the end --------------------------------------------------------------------------------------------------------


def timing(overruns: int, busy: float = 1.4) -> Timing:
    return Timing(100, overruns, 40, 0.0, 0.0, busy, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("found", "says"),
    [
        (timing(10), None),
        (
            timing(60),
            "60 % of 100 cycles came too late, and 40 periods were left out; up to 50 Hz are possible: let the",
        ),
        (timing(60, 0.6), "let the computer do less beside"),
    ],
)
def test_a_run_that_did_not_keep_its_rate_is_told_so_at_its_end(found: Timing, says: str | None) -> None:
    told = not_kept(found, 100.0, None)
    assert told is None if says is None else told is not None and says in told


@pytest.mark.parametrize("rate", [50.0, None])
def test_a_policy_that_was_not_asked_at_its_rate_did_not_run(
    rate: float | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every cycle of the leg's policy came too late, and the exit status was 0."""
    outcome = Outcome("finished", None, None, timing(100), {}, {})
    deployed: Any = SimpleNamespace(config={"rest": "release"}, rate=50.0, commands=SimpleNamespace(rate=rate))
    if rate is None:  # an excitation has its times in the log
        deployment.report(deployed, deployment.Run(outcome, tmp_path / "run.csv"))
        assert "was not kept" in capsys.readouterr().out.splitlines()[-1]
        return
    with pytest.raises(SealegsError, match=r"100 % of 100 cycles came too late.*the servos are released"):
        deployment.report(deployed, deployment.Run(outcome, tmp_path / "run.csv"))


RATE, SECONDS, DELAY = 50.0, 0.8, 0.012


class Late(Trajectory):
    """A step whose goals go out a fixed time after the reading that they follow from."""

    def __init__(self, delay: float) -> None:
        time = np.arange(0.0, SECONDS, 1.0 / RATE)
        super().__init__("late", time, np.where(time < 0.3, 0.0, 0.4)[:, None])
        self.delay = delay


def simulated(delay: float) -> Recording:
    settings = config()["robot"]
    return simulate(build_robot(settings), Late(delay), Limits.from_config(settings["safety"]), RATE, SECONDS)


def test_a_simulated_run_keeps_the_delay_of_its_commands() -> None:
    prompt, late = simulated(0.0), simulated(DELAY)
    assert late.sent - late.time == pytest.approx(np.full(len(late.time), DELAY), abs=2e-4), "time of the goals' bytes"
    period = pytest.approx(np.full(len(late.time) - 1, 1.0 / RATE), abs=3e-4)  # some readings ask for more
    assert np.diff(late.time) == period, "the rate is kept"
    behind = prompt.position - late.position
    assert behind.max() > 0.02 and behind.min() > -0.05, "the same motion, later"


@pytest.mark.long
def test_a_run_in_stepped_time_keeps_the_delay_as_a_simulated_one_does(tmp_path: Path) -> None:
    """It was simulated and run without it, and compared with servos that had it."""
    settings = config("hw.virtual.time=stepped", "silence=20", f"rate={RATE}", f"out={tmp_path}", "name=run")

    def source(_: ServoRobot) -> Late:
        return Late(DELAY)

    done = deployment.run(deployment.prepare(settings, source), lambda _: None)
    assert done is not None and done.outcome.ending == "finished"
    log = read_measured(done.log).runs[0]
    assert log.host["goal_sent"] - log.time == pytest.approx(np.full(len(log.time), DELAY), abs=2e-4)
    assert np.diff(log.time) == pytest.approx(np.full(len(log.time) - 1, 1.0 / RATE), abs=3e-4)
    moved, late = log.joints["joint"].position, simulated(DELAY).position[:, 0]
    prompt = simulated(0.0).position[:, 0]
    assert np.abs(moved - late).max() < 0.01 < 0.02 < np.abs(moved - prompt).max()


# --- adapters that are slow ----------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("latency", [0.0045, 0.012])
def test_an_adapter_that_becomes_slower_for_good_is_waited_for(latency: float) -> None:
    simulation = Simulation(latency=0.001, commands=sine(0.1), limits=QUIET)

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
