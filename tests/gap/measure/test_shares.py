"""What a finding is worth: its share by its effect, beside numbers that are alike, where the model fits already."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.reader import measured_set, read_measured
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.measure import belief
from sealegs.gap.measure.confidence import Adrift, by_effect
from sealegs.gap.output.pictures.first_look import budget_slices
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.search.alike import with_alike
from sealegs.gap.virtual.bench import LOADS, record

DELAY = 0.0225  # [s]
SHOWN = ("steps", "multisine", "slow triangle")


@pytest.mark.long
def test_a_delay_that_is_all_of_the_gap_gets_all_of_what_is_explained(tmp_path: Path) -> None:
    """Tuned numbers took a third of it: alone, they imitate a delay; beside it, they stay where they were."""
    record(tmp_path, "sv1270tg", {"delay.seconds": DELAY}, seed=0, loads=LOADS[:1], excitations=SHOWN)
    (found,) = diagnose(read_measured(tmp_path), causes=("drive.delay", "friction.viscous"))
    (delay,) = found.causes
    assert delay.name == "drive.delay"
    assert delay.parameters["delay.seconds"].value == pytest.approx(DELAY, rel=0.03)
    assert delay.share > 0.95 * (1.0 - found.unexplained)
    assert delay.share + found.tuned_share + found.unexplained == pytest.approx(1.0)
    slices = {piece.label: piece.share for piece in budget_slices(found)}
    assert slices["drive.delay"] > 20.0 * slices.get("tuned numbers", 0.0)


def test_a_part_has_its_share_by_how_far_it_moves_the_replay_whatever_would_make_up_for_it() -> None:
    """Of a gain and an offset that moved a hip by 38 and 37 mrad, the offset had 73 % and the gain 26 %."""

    def simulate(rows: list[dict[str, float]]) -> np.ndarray:
        return np.array(
            [[row.get("gain", 0.0), row.get("offset", 0.0), row.get("a", 0.0) + row.get("b", 0.0)] for row in rows]
        )

    problem: Any = SimpleNamespace(simulate=simulate, position_error=lambda row: row)
    values = {"gain": 4.0, "offset": 2.0, "a": 3.0, "b": -2.0}
    assert by_effect(problem, values, [{"gain"}, {"offset"}, {"a", "b"}]) == pytest.approx([16 / 21, 4 / 21, 1 / 21])
    assert by_effect(problem, {}, [set(), set()]) == pytest.approx([0.0, 0.0])


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


MASS, CENTRE, LINK, ROTOR, DRY, VISCOUS = 0.6, 0.12, 0.004, 0.02, 0.06, 0.08
STEP, EVERY, GRAVITY = 2e-4, 20, 9.81
CHAIN = [
    {"delay": {"seconds": 0.0}},
    {"torque_command": {"armature": ROTOR}},
    {"friction": {"coulomb": DRY, "viscous": VISCOUS}},
]
MODEL = f"""<mujoco><worldbody><body><joint name="hinge" axis="0 1 0"/>
<inertial pos="0 0 -{CENTRE}" mass="{MASS}" diaginertia="{LINK} {LINK} 0.0005"/></body></worldbody></mujoco>"""


def pendulum(folder: Path, more: float) -> MeasuredSet:
    """Two runs of a pendulum that follows torques, by equations of its own; its link has more inertia [kg.m2]."""
    (folder / "one.xml").write_text(MODEL)
    inertia, runs = LINK + more + MASS * CENTRE**2 + ROTOR, []
    for seed, highest in enumerate((2.0, 4.0)):
        rng = np.random.default_rng(seed)
        time = np.arange(0.0, 14.0, STEP)
        rates, phases = np.exp(rng.uniform(np.log(0.2), np.log(highest), 8)), rng.uniform(0.0, 6.3, 8)
        waves = np.sum(
            [np.sin(2.0 * np.pi * f * time + p) / np.sqrt(f + 0.3) for f, p in zip(rates, phases, strict=True)], axis=0
        )
        torque = 0.7 * waves / np.abs(waves).max() * np.clip(time, 0.0, 1.0)
        torque = torque[np.arange(len(time)) // EVERY * EVERY]  # held between commands
        q, v, position = 0.0, 0.0, np.empty(len(time))
        for k, command in enumerate(torque):
            position[k] = q
            driven = v + STEP * (command - MASS * GRAVITY * CENTRE * np.sin(q) - VISCOUS * v) / inertia
            v = driven - np.clip(driven, -STEP * DRY / inertia, STEP * DRY / inertia)
            q += STEP * v
        read = position[::EVERY] + rng.normal(0.0, 2e-4, len(position[::EVERY]))
        runs.append({"time": time[::EVERY], "hinge.torque_command": torque[::EVERY], "hinge.position": read})
    return measured_set(runs, {"robot": str(folder / "one.xml"), "actuators": {"hinge": CHAIN}}, "one")


@pytest.mark.long
def test_an_inertia_is_as_certain_as_its_evidence_though_the_rotor_fits_as_well(tmp_path: Path) -> None:
    """A right one had a confidence of 2 %: refitting the rotor's armature leaves as little, being the same number."""
    (found,) = diagnose(pendulum(tmp_path, 0.008))
    assert [(cause.name, cause.standing) for cause in found.causes] == [("load.inertia", "certain")]
    (value,) = found.causes[0].parameters.values()
    assert value.low < 0.008 < value.high
    assert "rotor" in found.causes[0].sentence


def test_rotor_and_link_are_one_inertia_unless_something_gives_between_them() -> None:
    rigid = JointModel(load_chain(CHAIN))
    assert with_alike({"torque_command.armature"}, rigid) >= {"load.extra_inertia", "load.rotor_inertia"}
    assert with_alike({"friction.coulomb"}, rigid) == {"friction.coulomb"}
    assert with_alike({"torque_command.armature"}, None) == {"torque_command.armature"}
    elastic = JointModel(load_chain([*CHAIN, {"compliance": {"stiffness": 20.0, "damping": 0.0}}]))
    assert with_alike({"torque_command.armature"}, elastic) == {"torque_command.armature"}
