"""What a person is told to type after a diagnosis works."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from sealegs.actuators.chain import Chain
from sealegs.actuators.stages import build_stage
from sealegs.gap.output import terminal
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.verdict.verdict import EXPLAINED

SERVO = [("ideal", {"stiffness": 20.0, "damping": 0.5})]
TORQUE = [("torque_command", {})]


@pytest.mark.parametrize(("stages", "trained"), [(SERVO, True), (TORQUE, False)])
def test_nobody_is_told_to_train_what_torques_drive(
    stages: list[tuple[str, dict[str, float]]], trained: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`sealegs train` refuses such a robot."""
    monkeypatch.setattr(terminal, "to_document", lambda item: {})
    monkeypatch.setattr(terminal, "overall", lambda items: {"verdict": EXPLAINED})
    monkeypatch.setattr(terminal, "train_command", lambda folder: f"sealegs train extended={folder}")
    model = JointModel(Chain(tuple(build_stage(name, given, "a chain") for name, given in stages)))
    problem = SimpleNamespace(joint=SimpleNamespace(models=(model,)))
    found: Any = SimpleNamespace(
        joint="elbow", causes=("one",), model="extended", problem=problem, experiment=None, refitted=False
    )
    sentence, commands = terminal.next_step([found], {"extended": Path("diagnosis/extended.yaml")})
    assert bool(commands) == trained and ("with your own code" in sentence) != trained
