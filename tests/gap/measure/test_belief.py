"""Joints of a robot that the model as believed follows as well as one can: only what is certain is named there."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from sealegs.gap.measure import belief
from sealegs.gap.measure.confidence import Adrift

NOISE = 2e-4  # [rad]


def found_of(monkeypatch: pytest.MonkeyPatch, *, confidence: float, times: float, left: Adrift | None) -> list[str]:
    """What is named of a joint with one cause of that confidence, whose tuned model is so many noise floors off.

    Args:
        left: of the model without the cause, where no goal holds the joint; None where one does.
    """
    cause = SimpleNamespace(name="load.mass", confidence=confidence)
    answers = [
        SimpleNamespace(causes=causes, adrift=drift, open_causes=()) for causes, drift in (((cause,), None), ((), left))
    ]
    monkeypatch.setattr(belief, "measure", lambda *_: answers.pop(0))
    monkeypatch.setattr(belief, "replace", lambda one, **more: SimpleNamespace(**{**vars(one), **more}))
    monkeypatch.setattr(belief, "_without", lambda *_: times)
    problem = SimpleNamespace(open_loop=left is not None, noise=NOISE)
    replay: Any = SimpleNamespace(problem=problem, fitting=problem, wide=(), of_robot=True)
    search: Any = SimpleNamespace(loose=False, accepted=(), less=lambda keys: search)
    return [one.name for one in belief.measured_within_belief(replay, search, "elbow", 0)[0].causes]


@pytest.mark.parametrize(("confidence", "named"), [(0.05, []), (0.8, []), (0.95, ["load.mass"])])
def test_a_joint_that_torques_drive_names_only_what_is_certain_where_its_neighbours_leave_as_much(
    monkeypatch: pytest.MonkeyPatch, confidence: float, named: list[str]
) -> None:
    """The exact file of an arm had its mass named, at 4 %: errors add up where no goal holds the joint."""
    left = Adrift(level=1.0, error=2.5 * NOISE, neighbours=10.0 * NOISE)
    assert found_of(monkeypatch, confidence=confidence, times=2.5, left=left) == named


def test_what_neighbours_cannot_leave_stays_a_cause_however_doubtful(monkeypatch: pytest.MonkeyPatch) -> None:
    left = Adrift(level=1.0, error=20.0 * NOISE, neighbours=10.0 * NOISE)
    assert found_of(monkeypatch, confidence=0.05, times=20.0, left=left) == ["load.mass"]
    assert found_of(monkeypatch, confidence=0.05, times=2.5, left=None) == ["load.mass"], "a goal holds it"


def test_a_joint_that_tuned_numbers_bring_to_the_noise_names_only_what_is_certain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert found_of(monkeypatch, confidence=0.8, times=1.1, left=None) == []
    assert found_of(monkeypatch, confidence=0.95, times=1.1, left=None) == ["load.mass"]
