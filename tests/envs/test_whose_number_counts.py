"""Whose damping, friction and armature count where a chain comes from elsewhere than the robot's YAML."""

from __future__ import annotations

from pathlib import Path

import pytest
from sealegs.actuators import load_chain
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.robot import Robot, _tell
from sealegs.envs.extended import Change, Extended, Mounted
from sealegs.envs.robots import get_robot
from sealegs.hw.virtual.machine import Machine

ARM = """<mujoco><compiler angle="radian"/><worldbody><body><joint name="j" axis="0 1 0" range="-1 1"
damping="0.5" frictionloss="0.02" armature="0.01"/><geom size="0.1" mass="1"/></body></worldbody></mujoco>"""
IDEAL = {"ideal": {"stiffness": 40.0, "damping": 2.0}}
FILE = "damping: file, armature: file, frictionloss: file"


def robot(folder: Path, chain: str = "[{ideal: {stiffness: 40, damping: 2}}]", more: str = FILE) -> Robot:
    (folder / "arm.xml").write_text(ARM)
    path = folder / "arm.yaml"
    path.write_text(f"model: arm.xml\njoints: {{j: {{chain: {chain}, {more}}}}}\n")
    return get_robot(path)


def numbers(machine: Robot, actuator: object = None) -> tuple[float, float, float]:
    """Damping, dry friction and armature of the joint with a chain."""
    model = machine.drivetrain(actuator).model  # pyright: ignore[reportArgumentType]
    return float(model.dof_damping[0]), float(model.dof_frictionloss[0]), float(model.dof_armature[0])


def of(chain: object) -> tuple[float, float, float]:
    loaded = load_chain(chain)  # pyright: ignore[reportArgumentType]
    return loaded.value("friction.viscous"), loaded.value("friction.coulomb"), loaded.armature()


def test_in_the_yaml_file_means_the_file(tmp_path: Path) -> None:
    assert numbers(robot(tmp_path, "sts3215")) == (0.5, 0.02, 0.01)


@pytest.mark.parametrize("actuator", ["sts3215", {"j": "sts3215"}])
def test_a_chain_that_is_named_elsewhere_counts_with_its_own_numbers_and_that_is_said_once(
    actuator: object, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Damping was 0.5 with `chain: sts3215` and 0.059 with `actuator=sts3215`, and nobody said so."""
    machine = robot(tmp_path)
    _tell.cache_clear()
    for _ in range(2):
        assert numbers(machine, actuator) == pytest.approx(of("sts3215"))
    said = [record.getMessage() for record in caplog.records if "of the chain sts3215 count" in record.getMessage()]
    assert len(said) == 1


def test_what_is_said_names_joints_numbers_and_the_way_out(tmp_path: Path) -> None:
    file = load_robot_file(robot(tmp_path).source)
    assert file.whose({"j": load_chain("sts3215")}) == (
        "joint j: damping, armature, frictionloss of the chain sts3215 count, not of arm.xml; to count these, name the "
        "chain in arm.yaml, with damping: file.",
    )
    assert file.whose({"j": file.joint("j").chain}) == ()
    assert file.whose({"j": load_chain([IDEAL])}) == (), "it states none: the file's count"
    bare = load_robot_file(tmp_path / "arm.xml")
    assert "name the chain in a YAML of the robot" in bare.whose({"j": load_chain("sts3215")})[0]


def test_a_friction_of_zero_is_a_number_and_no_stage_is_none(tmp_path: Path) -> None:
    """A chain without dry friction got the file's back."""
    machine = robot(tmp_path)
    assert numbers(machine, [IDEAL]) == (0.5, 0.02, 0.01)
    assert numbers(machine, [IDEAL, {"friction": {"coulomb": 0.0, "viscous": 0.3}}]) == (0.3, 0.0, 0.01)
    assert numbers(machine, [IDEAL, {"friction": {"coulomb": 0.1}}]) == (0.0, 0.1, 0.01)
    assert numbers(machine, [IDEAL, {"friction": {}}]) == (0.0, 0.0, 0.01)


@pytest.mark.parametrize("given", [{}, {"damping": "file"}, {"damping": "chain"}])
def test_a_chain_of_the_yaml_is_read_alike(given: dict[str, str], tmp_path: Path) -> None:
    more = ", ".join(f"{key}: {value}" for key, value in given.items()) or "unknown: []"
    machine = robot(tmp_path, "[{ideal: {stiffness: 40, damping: 2}}, {friction: {coulomb: 0.1}}]", more)
    damping = 0.5 if given == {"damping": "file"} else 0.0
    assert numbers(machine) == (damping, 0.1, 0.01)
    assert machine.file is not None
    said = "Warning: joint j: damping is 0.5 in arm.xml and 0 in its chain; the chain's counts (damping: chain)"
    assert any(said in sentence for sentence in machine.file.said) == (not given)


@pytest.mark.parametrize("found", [0.0, 0.2])
def test_a_chain_of_a_diagnosis_keeps_the_friction_that_was_found(
    found: float, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    machine = robot(tmp_path)
    assert machine.file is not None
    chain = load_chain([IDEAL, {"friction": {"coulomb": found, "viscous": 0.5}}])
    change = Change("j", "friction.coulomb", 0.02, found, "friction.coulomb", "chain")
    digest = machine.file.model.digest
    extended = Extended(machine.source, {}, {"j": (Mounted(chain, "j.yaml"),)}, (change,), digest=digest)
    caplog.clear()
    for _ in range(2):  # and again from its stages, as they stand in a run's config
        assert numbers(machine, extended.chains_on(machine)) == (0.5, found, 0.01)
        extended = Extended.from_dict(extended.to_dict())
    assert not [record for record in caplog.records if "of the chain" in record.getMessage()]


@pytest.mark.parametrize("hidden", [0.0, 0.2])
def test_a_friction_that_a_virtual_machine_hides_is_there_also_where_it_is_none(hidden: float, tmp_path: Path) -> None:
    path = tmp_path / "hidden.yaml"
    path.write_text(f"j: {{friction.coulomb: {hidden}}}\n")
    model = Machine(robot(tmp_path), hidden=str(path)).model
    assert (float(model.dof_damping[0]), float(model.dof_frictionloss[0])) == (0.5, hidden)
