"""The end of a run says what is true: servos are held where somebody watches them, and released as soon as can be."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.commands.evaluate import PLAIN
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import compose, split
from sealegs.evaluation.comparison import compare
from sealegs.gap.log import read_measured
from sealegs.hw.bus.clock import Metronome, Timing
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.guard.safety import Fault
from sealegs.hw.guard.stop import Stop, emergency_stop, release
from sealegs.hw.guard.supervisor import Charge, Supervisor
from sealegs.hw.run import deployment
from sealegs.hw.run.commands import Reference, Trajectory, park_motion
from sealegs.hw.run.deployment import Deployment, NotAtRestError, Run, prepare
from sealegs.hw.run.live import picture
from sealegs.hw.run.measured_log import read_events
from sealegs.hw.run.outcome import Outcome
from sealegs.hw.virtual import VirtualBus

from benchmarks import many_starts
from tests.servo_runs import POLICIES, committed, config, gentle_policy
from tests.simulated_runs import Simulation, sine
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


# --- `evaluate` brings a robot to rest, checks what it is told, and reports, as `deploy` does ------------------------


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return gentle_policy(tmp_path_factory.mktemp("policy") / "policy.onnx")


class Reached(Exception):
    """A run would begin now."""


@pytest.fixture
def run(policy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Evaluates with some arguments up to the run on the machine, and returns what would be run."""
    begun: list[Deployment] = []

    def begin(prepared: Deployment, say: Any) -> Run:
        begun.append(prepared)
        raise Reached

    def evaluated(*arguments: str) -> Deployment:
        monkeypatch.setattr(deployment, "run", begin)
        with pytest.raises(Reached):
            compare(compose("evaluate", split([f"policy={policy}", *arguments], PLAIN)), tmp_path, lambda _: None)
        return begun[-1]

    return evaluated


def test_the_end_that_the_robots_file_asks_for_is_that_of_evaluate(run: Any) -> None:
    assert run().config["rest"] == "release"
    assert run("robot.rest=hold").config["rest"] == "hold", "a hexapod that is released drops"
    sitting = run("rest=sit", "robot.park={joint: 0.2}")
    assert sitting.config["rest"] == "sit" and sitting.park is not None
    assert sitting.rate == 50.0 and sitting.commands.name == "policy"


@pytest.mark.long
def test_a_real_robot_has_its_emergency_stop_and_dead_mans_switch_here_too(run: Any) -> None:
    assert run("estop=key").config["estop"] == "key" and run("dead_man=true").config["dead_man"] is True
    assert run().config["estop"] is None and run().config["dead_man"] is False


@pytest.mark.parametrize(
    ("argument", "said"),
    [
        ("rest=lie", "release, hold or sit"),
        ("silence=0.01", "three periods"),
        ("live=7", "live"),
        ("estop=-1", "estop"),
    ],
)
def test_what_deploy_refuses_is_refused(argument: str, said: str, policy: Path, tmp_path: Path) -> None:
    config = compose("evaluate", split([f"policy={policy}", argument], PLAIN))
    with pytest.raises(SealegsError, match=said):
        compare(config, tmp_path, lambda _: None)


def test_torque_that_may_be_on_is_the_last_that_is_said(
    policy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "machine.csv"
    events = [{"event": "not at rest", "servos": ["1"]}, {"event": "gone"}]  # with a virtual machine that has ended
    lines = [json.dumps({**event, "by": "supervisor"}) + "\n" for event in events]
    log.with_name("machine.events.jsonl").write_text("".join(lines))
    fault = Fault("NoReplyError", "servo 1 did not answer.", (1,))
    ended = Outcome("fault", None, fault, Metronome(50.0).timing(), {}, {}, {1: "silent"})
    monkeypatch.setattr(deployment, "run", lambda prepared, say: Run(ended, log))
    with pytest.raises(NotAtRestError, match=r"^TORQUE MAY BE ON at servo.s. 1, .*cut their power.*did not answer"):
        compare(compose("evaluate", split([f"policy={policy}"], PLAIN)), tmp_path, lambda _: None)


def test_model_and_machine_are_asked_for_what_a_person_asks(run: Any, policy: Path, tmp_path: Path) -> None:
    (tmp_path / "motion.csv").write_text("time,joint\n0,0.1\n1,0.3\n")
    asked = run(f"command={tmp_path / 'motion.csv'}").commands.asked
    assert [asked(time)[0] for time in (0.0, 0.5, 2.0)] == pytest.approx([0.1, 0.2, 0.3])
    with pytest.raises(SealegsError, match="command=keyboard is for deploy"):
        compare(compose("evaluate", split([f"policy={policy}", "command=keyboard"], PLAIN)), tmp_path, lambda _: None)


# --- A robot that sits down at the end of a run: along its motion whatever is lost, logged, and let go at once -------

KINDS = sorted(path.parent.name for path in POLICIES.glob("*/seed0"))


def sitting(motion: bool = True, **keys: Any) -> Simulation:
    """A bench that sits down over 1.5 s, along a stored motion or to a pose."""
    simulation = Simulation(commands=sine(0.1), **keys)
    time = np.arange(0.0, 1.5, 0.01)
    stored = Trajectory("park", time, 0.2 - 0.6 * time[:, None])
    simulation.loop.park = stored if motion else park_motion({"joint": -0.7}, simulation.robot)
    return simulation


def test_a_cycle_in_which_nobody_answers_does_not_send_it_back_to_where_the_motion_began() -> None:
    simulation = sitting(limits={"log_only": ["goal_speed", "following"]})
    sent: list[float] = []

    def noted() -> None:
        if simulation.loop.state == "sitting down":
            sent.append(float(simulation.loop.sent[0]))
            if len(sent) in (80, 100, 101):
                simulation.fault("drop", seconds=0.015)

    simulation.guard.at_each["beat"] = noted
    outcome = simulation.run(1.0)
    assert outcome.ending == "finished" and outcome.bus["NoReplyError"] >= 4
    assert np.abs(np.diff(sent)).max() < 0.02, "1 rad/s at most, in a cycle of 10 ms"
    assert sent[-1] == pytest.approx(-0.69, abs=0.02)


@pytest.mark.parametrize("when", ["running", "sitting down"])
def test_a_dead_mans_switch_that_is_let_go_releases_at_once(when: str) -> None:
    simulation = sitting()
    let_go: list[float] = []

    def held() -> str | None:
        loop = simulation.loop
        if loop.state == when and loop.elapsed > (0.5 if when == "running" else 1.5):
            let_go.append(simulation.port.now())
            return "the dead-man's switch was let go"
        return None

    simulation.loop.each_cycle = held
    outcome = simulation.run(1.0)
    assert outcome.reason == "the dead-man's switch was let go" and simulation.torque == [False]
    assert len(let_go) == 1 and simulation.rig.history[-1][0] - let_go[0] < 0.02


def test_the_way_down_is_logged_and_shown(tmp_path: Path) -> None:
    simulation = sitting(folder=tmp_path, motion=False)
    titles: list[str] = []

    def noted() -> None:
        if simulation.loop.state == "sitting down":
            titles.append(str(picture(simulation.loop).title))

    simulation.guard.at_each["beat"] = noted
    simulation.run(1.0)
    (begun,) = [e["time"] for e in read_events(tmp_path / "run.csv") if e["event"] == "sitting down"]
    run = read_measured(tmp_path / "run.csv").runs[0]
    rows = run.time > begun
    joint = run.joints["joint"]
    assert rows.sum() > 80 and joint.goal is not None and joint.goal[-1] == pytest.approx(-0.7, abs=1e-3)
    assert joint.position[-1] == pytest.approx(-0.7, abs=0.05) and "STALE" not in titles[-1]


def test_the_way_down_begins_near_the_robot_and_not_at_a_goal_that_a_policy_sent_far_ahead() -> None:
    """A leg that pushed off had its goal 0.7 rad ahead: 'blocked or blind', in 6 of 8 normal ends of the hopper."""
    simulation = Simulation("hopper")
    place, safety = np.array([-0.7, 0.5]), simulation.loop.safety
    for goal in (np.array([-0.0, 1.2]), place + 0.01):
        begin = safety.goals_from(goal, place)
        assert (np.abs(begin - place) <= 0.1 + 1e-9).all() and (np.sign(begin - place) == np.sign(goal - place)).all()
    assert begin == pytest.approx(place + 0.01), "who is still is not let sag"


@pytest.mark.parametrize("start", [0, 5])
def test_a_hopper_ends_well_wherever_its_policy_leaves_it(start: int) -> None:
    row = many_starts.end(committed("hopper"), start)
    assert many_starts.well("ends", row), row


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "starts"),
    [pytest.param("hopper", 25, marks=pytest.mark.weekly), *((kind, 3) for kind in KINDS if kind != "hopper")],
)
def test_every_robot_ends_well_wherever_its_policy_leaves_it(kind: str, starts: int) -> None:
    for start in range(100, 100 + starts):
        row = many_starts.end(committed(kind), start)
        assert many_starts.well("ends", row), row


def test_a_joint_that_does_not_get_to_its_park_pose_is_released_at_once_and_that_is_no_fault(tmp_path: Path) -> None:
    simulation = sitting(folder=tmp_path)

    def noted() -> None:
        if simulation.loop.state == "sitting down":
            simulation.rig.held = "order"  # as the ground holds a leg

    simulation.guard.at_each["beat"] = noted
    outcome = simulation.run(0.5)
    assert (outcome.ending, outcome.fault, simulation.torque) == ("finished", None, [False])
    assert outcome.note.startswith("The robot was released before it sat: joint joint (servo 1)")
    (begun,), (ended,) = (
        [e["time"] for e in read_events(tmp_path / "run.csv") if e["event"] == kind]
        for kind in ("sitting down", "not seated")
    )
    assert ended - begun < 1.0, "and not pressed for the whole way"


@pytest.mark.long
def test_the_hopper_folds_its_leg_before_it_is_released_as_its_file_says() -> None:
    settings = config("robot=hopper", patient=False)
    assert settings["robot"]["rest"] == "sit" and prepare({**settings, "reference": True}).park is not None
    simulation = Simulation("hopper", commands=Reference, limits={"range_margin": 3.0})
    simulation.loop.park = park_motion(settings["robot"]["park"], simulation.robot)
    machine, heights = simulation.rig.machine, list[float]()

    def noted() -> None:
        heights.append(machine.base()[0]["base_z"])

    simulation.guard.at_each["beat"] = noted
    outcome = simulation.run(0.5)
    assert outcome.ending == "finished", outcome.fault
    assert heights[-1] < 0.7 * heights[0] and abs(machine.base()[1]["base_z"]) < 0.1, "low, and at rest"


def test_a_joint_that_the_park_pose_leaves_out_stays_where_it_is(tmp_path: Path) -> None:
    begin = np.array([-0.61, 0.4])
    commands = Trajectory("still", np.array([0.0, 1.0]), np.tile(begin, (2, 1)))
    stored = tmp_path / "sit.csv"
    stored.write_text("time,hip.goal\n0,-0.7\n0.5,-0.9\n")
    for park, end in (({"hip": -0.9}, -0.9), (str(stored), -0.9)):
        simulation = Simulation("hopper", commands=lambda _: commands, limits={"range_margin": 3.0})
        simulation.loop.park = park_motion(park, simulation.robot)
        outcome = simulation.run(0.3)
        assert outcome.ending == "finished", outcome.fault
        assert simulation.loop.sent == pytest.approx([end, 0.4], abs=1e-3)
