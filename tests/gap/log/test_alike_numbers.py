"""Numbers that are one quantity, such as a rotor and what it turns: evidence for one is none against the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.arrays import measured_set
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.search.alike import with_alike

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
