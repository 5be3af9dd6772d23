"""`evaluate` brings a robot to rest, checks what it is told, and reports, as `deploy` does."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from sealegs.commands.evaluate import PLAIN
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import compose, split
from sealegs.evaluation.comparison import compare
from sealegs.hw.bus.clock import Metronome
from sealegs.hw.guard.safety import Fault
from sealegs.hw.run import deployment
from sealegs.hw.run.deployment import Deployment, NotAtRestError, Run
from sealegs.hw.run.outcome import Outcome

from tests.servo_runs import gentle_policy


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
