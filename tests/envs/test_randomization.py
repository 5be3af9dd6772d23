"""Domain randomisation draws for each simulation what its config names, and nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sealegs
from sealegs.actuators import load_chain
from sealegs.agents.config import read_config
from sealegs.common.errors import SealegsError
from sealegs.envs.any_robot.reach import ReachTask
from sealegs.envs.any_robot.track import TrackTask
from sealegs.envs.bench.env import BenchTask
from sealegs.envs.engine.batch import BatchEngine
from sealegs.envs.extended import DRAWS, Change, Draws, Extended, Mounted, write_draws
from sealegs.envs.hopper.env import HopperTask
from sealegs.gap.output.extension import write_extended


def hopper(randomization: object, count: int = 6, **keywords: object) -> BatchEngine:
    engine = BatchEngine(HopperTask(), count, randomization=randomization, **keywords)  # type: ignore[arg-type]
    engine.seed(0)
    engine.reset()
    return engine


def test_each_simulation_gets_its_own_value_where_the_engine_reads_it() -> None:
    engine = hopper(
        {"hip": {"friction.viscous": [0.2, 0.5]}, "floor": {"friction": [0.5, 1.0]}, "mass": {"base": [0.8, 1.2]}}
    )
    batch, model = engine.batch, engine.drivetrain.model
    viscous = engine.drawn["hip.friction.viscous"]
    assert len(set(viscous)) == 6
    assert ((viscous >= 0.2) & (viscous <= 0.5)).all()
    dof = model.jnt_dofadr[model.joint("hip_motor").id]
    np.testing.assert_array_equal(batch.expand("dof_damping").reshape(6, model.nv, -1)[:, dof, 0], viscous)
    assert batch.expand("dof_damping").reshape(6, model.nv, -1)[
        :, model.jnt_dofadr[model.joint("knee_motor").id], 0
    ] == (pytest.approx(0.35))
    np.testing.assert_array_equal(
        batch.expand("geom_friction")[:, model.geom("floor").id, 0], engine.drawn["floor.friction"]
    )
    scale = engine.drawn["mass.base"]
    body = model.body("base").id
    assert batch.expand("body_mass")[:, body] == pytest.approx(model.body_mass[body] * scale)
    assert batch.expanded("body_subtreemass")[:, 0] == pytest.approx(  # type: ignore[index]
        model.body_subtreemass[0] + model.body_mass[body] * (scale - 1.0)
    )


def test_several_parameters_of_one_chain_vary_together() -> None:
    engine = hopper({"hip": {"friction.viscous": [0.2, 0.5], "regression.duty_torque": [1.0, 2.0]}}, count=3)
    own = engine.drivetrain.chains["hip"]
    for k in range(3):
        chain = own.with_value("friction.viscous", engine.drawn["hip.friction.viscous"][k])
        program = chain.with_value("regression.duty_torque", engine.drawn["hip.regression.duty_torque"][k]).program()
        row = engine.batch.expand("actuator_user")[k, engine.drivetrain.actuator_ids["hip"]]
        np.testing.assert_array_equal(row[20 : len(program)], program[20:])


def test_randomised_motion_differs_and_a_range_of_no_width_changes_nothing() -> None:
    action = np.full((3, 2), 0.4)
    plain = BatchEngine(HopperTask(start_noise=0.0), 3)
    fixed = BatchEngine(HopperTask(start_noise=0.0), 3, randomization={"all": {"friction.viscous": {"times": [1, 1]}}})
    varied = BatchEngine(
        HopperTask(start_noise=0.0), 3, randomization={"all": {"friction.viscous": {"times": [0.5, 2]}}}
    )
    rows = []
    for engine in (plain, fixed, varied):
        engine.seed(0)
        engine.reset()
        for _ in range(10):
            step = engine.step(action)
        rows.append(step.observation)
    np.testing.assert_array_equal(rows[0], rows[1])
    assert len({tuple(row) for row in rows[2]}) == 3


def test_a_new_episode_draws_anew_and_only_for_its_simulation() -> None:
    engine = hopper({"all": {"friction.viscous": [0.2, 0.5]}}, count=3)
    before = engine.drawn["hip.friction.viscous"].copy()
    engine.reset(np.array([1]))
    after = engine.drawn["hip.friction.viscous"]
    assert after[1] != before[1]
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])


def test_an_encoder_that_varies_is_seen_by_the_host() -> None:
    chain = [{"ideal": {"stiffness": 5.0, "damping": 0.1}}, {"encoder": {"offset": 0.0}}]
    engine = BatchEngine(BenchTask(), 4, actuator=chain, randomization={"joint": {"encoder.offset": [-0.2, 0.2]}})
    engine.seed(0)
    observation = engine.reset()
    assert observation[:, 2] - observation[:, 1] == pytest.approx(engine.drawn["joint.encoder.offset"], abs=1e-6)


def test_it_is_read_from_a_yaml_file(tmp_path: Path) -> None:
    path = tmp_path / "random.yaml"
    path.write_text("floor: {friction: [0.5, 0.6]}\n")
    assert (hopper(str(path)).drawn["floor.friction"] <= 0.6).all()


def test_a_floor_that_the_model_lacks_cannot_vary() -> None:
    arm = Path(__file__).parents[1] / "robots" / "arm.xml"
    with pytest.raises(SealegsError, match="model has no geom 'floor'; leave it out, or add one"):
        BatchEngine(ReachTask.on(arm)(), 2, randomization={"floor": {"friction": [0.5, 1.0]}})


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        ({"hop": {}}, "no 'hop' .did you mean 'hip'"),
        ({"hip": {"friktion.viscous": [0, 1]}}, "no stage 'friktion' .did you mean 'friction'"),
        ({"hip": {"friction.viskous": [0, 1]}}, "no parameter 'viskous' .did you mean 'viscous'"),
        ({"hip": {"friction.viscous": 0.3}}, "must be a range"),
        ({"hip": {"friction.viscous": [0.5, 0.2]}}, "must be a range"),
        ({"hip": {"friction.viscous": [-1, 0.2]}}, "friction.viscous is -1; it must lie between"),
        ({"hip": [1]}, "must be 'name: .low, high.' pairs"),
        ({"mass": {"bsae": [1, 2]}}, "no body 'bsae' .did you mean 'base'"),
        ({"floor": {"colour": [1, 2]}}, "there is no 'colour'; there are friction, slope"),
        ({"floor": {"friction": [-0.5, -0.1]}}, "friction begins at -0.5; it is never below 0"),
        ({"noise": {"speed": [0, 1]}}, "there is no 'speed'; there are reading, tilt, turn_rate"),
        ({"push": {"speed": [0, 1]}}, "push.speed: the base of the robot is not free"),
        ({"lost": {"goals": [0.5, 1.5]}}, "lost.goals ends at 1.5; it is a share"),
        ({"delay": {"goals": [-0.1, 0.0]}}, "delay.goals begins at -0.1; it is never below 0"),
        ({"centre": {"base": [0.0, 0.1]}}, "centre.base must be a body and an axis, such as base.x"),
        ({"gravity": {"z": [9.0, 10.0]}}, "there is no 'z'; there are strength"),
        ({"floor": {"friction": [True, 2]}}, "must be a range"),
        ({"mass": {"all": [-1, -0.5]}}, "mass.all begins at -1; a body has mass: give factors above 0"),
        ({"mass": {"base": {"times": [0, 1]}}}, "mass.base begins at 0; a body has mass"),
        ({"mass": {"base": [0.5, float("nan")]}}, "must be a range"),
        ("nowhere.yaml", "the randomisation nowhere.yaml cannot be read"),
    ],
)
def test_a_wrong_randomisation_is_answered_in_one_sentence(source: object, sentence: str) -> None:
    with pytest.raises(SealegsError, match=sentence):
        hopper(source)


@pytest.mark.long
@pytest.mark.parametrize(
    ("actuator", "path", "ends"),
    [
        ("sts3215", "friction.stribeck", [0.0, 0.1]),
        ("sts3215", "friction.load", [0.0, 0.3]),
        ("sts3215", "friction.asymmetry", [-0.02, 0.0]),
        ("sv1270tg", "friction.coulomb", [0.0, 0.1]),
        ("sv1270tg", "friction.load", [0.0, 0.3]),
    ],
)
def test_friction_that_the_chain_lacks_can_vary_from_zero(actuator: str, path: str, ends: list[float]) -> None:
    asked = [None, *({"all": {path: values}} for values in ([0.0, 0.0], [ends[0]] * 2, [ends[1]] * 2, ends))]
    engines = [hopper(source, actuator=actuator, autoreset=False) for source in asked]
    rng, seen = np.random.default_rng(0), []
    for _ in range(15):
        action = rng.uniform(-1.0, 1.0, (6, 2))
        seen = [engine.step(action).observation for engine in engines]
    none, zero, *fixed, _ = seen
    with_some = fixed[1] if ends[0] == 0.0 else fixed[0]
    np.testing.assert_array_equal(none, zero)
    assert np.abs(with_some - none).max() > 1e-3
    varied = engines[-1]
    assert all(len(set(drawn)) == 6 for drawn in varied.drawn.values())
    assert varied.chains == engines[0].chains, "the robot's own chain is still told"


def test_a_loss_in_the_gears_can_vary_from_none() -> None:
    motor = [{"position_p": {"gain": 5.0}}, {"supply": {"volts": 7.4}}]
    motor += [{"dc_motor": {"motor_constant": 0.012, "resistance": 2.7}}, {"gear": {"ratio": 100.0}}]
    chain = [*motor, {"friction": {"coulomb": 0.05}}]
    engine = BatchEngine(
        BenchTask(), 3, actuator=chain, randomization={"joint": {"gear.efficiency": {"times": [0.6, 1.0]}}}
    )
    engine.reset()
    assert ((engine.drawn["joint.gear.efficiency"] >= 0.6) & (engine.drawn["joint.gear.efficiency"] < 1.0)).all()


def test_latency_that_the_chain_lacks_can_vary_above_zero() -> None:
    chain = [{"ideal": {"stiffness": 5.0}}, {"encoder": {}}]
    ranges = {"joint": {"encoder.latency": [0.001, 0.03]}}
    engine = BatchEngine(BenchTask(), 2, actuator=chain, randomization=ranges)
    engine.seed(0)
    engine.reset()
    late = engine.step(np.ones((2, 1))).observation
    assert (np.abs(late[:, 2] - late[:, 1]) > 1e-4).all()


def test_a_range_that_would_add_memory_is_refused() -> None:
    chain = [{"delay": {"seconds": 0.01}}, {"ideal": {"stiffness": 5.0}}, {"encoder": {"latency": 0.0}}]
    sentence = "randomization.joint.encoder.latency reaches from 0 to 0.01, .* begin the range above it, at 1e-05 say"
    with pytest.raises(SealegsError, match=sentence):
        BatchEngine(BenchTask(), 2, actuator=chain, randomization={"joint": {"encoder.latency": [0.0, 0.01]}})


# --- an episode draws one of several machines whole: its chains, and the numbers of its robot ------------------------

COULOMB, DELAY, MASS = [0.05, 0.08, 0.11], [0.010, 0.015, 0.020], [0.4, 0.5, 0.7]
MACHINES: dict[str, Any] = {
    "chains": {"joint": {"friction.coulomb": COULOMB, "delay.seconds": DELAY}},
    "robot": {"mass": MASS},
}


def bench(machines: dict[str, Any] | None, count: int = 60, **keywords: Any) -> BatchEngine:
    source = None if machines is None else {"machines": machines}
    engine = BatchEngine(TrackTask(lead=0.0), count, actuator="sts3215", randomization=source, **keywords)
    engine.seed(0)
    engine.reset()
    return engine


def test_each_episode_is_of_one_machine_and_its_numbers_go_together() -> None:
    engine = bench(MACHINES)
    which = engine.drawn["machines.number"].astype(int)
    assert set(which) == {0, 1, 2}
    model = engine.drivetrain.model
    coulomb = engine.batch.expand("dof_frictionloss")[:, model.jnt_dofadr[0]].ravel()
    np.testing.assert_allclose(coulomb, np.array(COULOMB)[which])
    arm = 0.03
    np.testing.assert_allclose(
        engine.batch.expand("body_mass")[:, model.body("pendulum").id], np.array(MASS)[which] + arm
    )


def test_a_drawn_machine_moves_as_that_machine_alone() -> None:
    engine = bench(MACHINES, autoreset=False)
    which = engine.drawn["machines.number"].astype(int)
    action = np.full((60, 1), 0.7)
    for _ in range(20):
        engine.step(action)
    for number in range(3):
        chain = load_chain("sts3215")
        for path, values in MACHINES["chains"]["joint"].items():
            chain = chain.with_value(path, values[number])
        alone = BatchEngine(TrackTask(lead=0.0), 60, actuator=chain, params={"mass": MASS[number]}, autoreset=False)
        # the draw of the machine is one number more of each episode's, behind those of the task
        alone.seed(0)
        alone.reset()
        for _ in range(20):
            alone.step(action)
        mine = which == number
        here, there = (one.motion(action).link[mine] for one in (engine, alone))
        np.testing.assert_allclose(here, there, atol=1e-9)


def test_what_goes_on_while_a_machine_runs_may_vary_beside_it() -> None:
    engine = BatchEngine(
        TrackTask(lead=0.0),
        4,
        actuator="sts3215",
        randomization={"bias": {"reading": [0.01, 0.01]}, "machines": MACHINES},
    )
    engine.seed(0)
    engine.reset()
    assert (engine.drawn["bias.reading"] == 0.01).all()


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        ({"machines": {"links": {}}}, "machines has no 'links'"),
        ({"machines": {"chains": {"hip": {"friction.coulomb": [0.1]}}}}, "the robot drives no 'hip'"),
        ({"machines": {"robot": {"mass": [0.1, 0.2], "length": [0.1]}}}, "as many values of each number"),
        ({"machines": {"robot": {"mass": 0.5}}}, "must be a list of numbers"),
        ({"machines": {"robot": {"weight": [0.5]}}}, "has no parameter 'weight'"),
        ({"machines": {"chains": {"joint": {"friction.load": [0.0]}}, "robot": {"mass": [-1.0]}}}, "mass is -1.0"),
        ({"machines": MACHINES, "mass": {"all": [0.9, 1.1]}}, "both draw what a machine has"),
        ({"machines": []}, "must be the folder of a diagnosis"),
    ],
)
def test_wrong_machines_are_answered_in_one_sentence(source: Any, sentence: str) -> None:
    with pytest.raises(SealegsError, match=sentence):
        BatchEngine(TrackTask(lead=0.0), 2, actuator="sts3215", randomization=source)


# --- from a diagnosis ----------------------------------------------------------------------------------------------


def diagnosis() -> Extended:
    chain = load_chain("sts3215").with_value("friction.coulomb", 0.08)
    change = Change("servo", "load.mass_factor", 1.0, 1.2, "load.mass", "robot")
    numbers = (("chain", "servo", "0", "friction.coulomb"), ("change", "servo", "0", "load.mass_factor"))
    return Extended(
        "bench", {"mass": 0.5}, {"servo": (Mounted(chain, "extended.yaml"),)}, (change,),
        draws=Draws(numbers, ((0.07, 1.1), (0.08, 1.2), (0.09, 1.3))),
    )  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    found = diagnosis()
    write_extended(found, tmp_path)
    (tmp_path / "diagnosis.json").write_text("{}")
    assert found.draws is not None
    write_draws(found.draws, tmp_path / DRAWS)
    return tmp_path


def test_training_draws_from_what_a_diagnosis_found(folder: Path) -> None:
    config = read_config(["env=track", f"randomization={folder}"]).config
    assert config is not None
    assert config.extended == str(folder), "the model is the diagnosed one, too"
    machines = config.env["randomization"]["machines"]
    assert machines["chains"] == {"joint": {"friction.coulomb": [0.07, 0.08, 0.09]}}
    assert machines["robot"]["mass"] == pytest.approx([0.55, 0.6, 0.65])
    assert config.env["params"]["mass"] == pytest.approx(0.6)


def test_a_model_of_ones_own_stays_where_only_the_draws_are_of_a_diagnosis(folder: Path) -> None:
    config = read_config(["env=track", "actuator=sts3215", f"randomization={folder}"]).config
    assert config is not None
    assert config.extended is None and config.actuator == "sts3215"
    assert "machines" in config.env["randomization"]


def test_an_environment_draws_from_a_diagnosis_in_memory_and_on_disk(folder: Path) -> None:
    for source in (diagnosis(), folder):
        env = sealegs.make_env("track", 4, randomization=source)
        assert env.engine.chains["joint"].value("friction.coulomb") == pytest.approx(0.08)
        env.reset(seed=0)
        assert set(env.engine.drawn) == {"machines.number"}
        env.close()


def test_noise_may_be_added_to_the_machines_of_a_diagnosis(folder: Path) -> None:
    env = sealegs.make_env("track", 4, randomization={"machines": folder, "noise": {"reading": [0.0, 0.01]}})
    assert set(env.engine.drawn) == {"machines.number", "noise.reading"}


def test_a_servo_that_was_diagnosed_alone_is_drawn_once_for_all_joints(tmp_path: Path) -> None:
    found = diagnosis()
    found = Extended("bench", None, found.chains, (), draws=Draws(found.draws.numbers[:1], ((0.07,), (0.09,))))  # type: ignore[union-attr]
    env = sealegs.make_env("hopper", 2, randomization=found)
    env.reset(seed=1)
    own = env.engine.batch.expand("dof_frictionloss").reshape(2, -1)
    for row in own:
        assert len(set(np.round(row[row > 0.0], 9))) == 1


def test_a_diagnosis_of_before_says_to_diagnose_again(folder: Path) -> None:
    (folder / DRAWS).unlink()
    with pytest.raises(SealegsError, match="holds no machines to draw from"):
        read_config(["env=track", f"randomization={folder}"])
    (folder / DRAWS).write_text('{"version": 1, "numbers": [["chain"]], "machines": [[1.0, 2.0]]}')
    with pytest.raises(SealegsError, match="damaged; diagnose again"):
        read_config(["env=track", f"randomization={folder}"])
