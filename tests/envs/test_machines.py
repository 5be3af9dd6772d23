"""An episode draws one of several machines whole: its chains, and the numbers of its robot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sealegs
from sealegs.actuators import load_chain
from sealegs.agents.config import read_config
from sealegs.common.errors import SealegsError
from sealegs.envs.any_robot.track import TrackTask
from sealegs.envs.engine.batch import BatchEngine
from sealegs.envs.extended import DRAWS, Change, Draws, Extended, Mounted, write_draws
from sealegs.gap.output.extension import write_extended

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
