"""A new run that begins with what another one learnt: which numbers it takes, which model it has, what is refused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from safetensors.torch import load_file
from sealegs.agents.config import TrainConfig, read_config, train_config
from sealegs.agents.training import new_learner
from sealegs.common.errors import SealegsError
from sealegs.envs.any_robot.track import TrackTask
from sealegs.envs.engine.sb3 import BatchVecEnv
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.running_mean_std import RunningMeanStd

from tests.agents.short_training import SMALL, run

TRACK = ["env=track", "robot=bench", *(word for word in SMALL if word != "env=bench")]


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run of the task track, whose lead is measured on its model."""
    out = tmp_path_factory.mktemp("runs")
    assert run(*TRACK, f"out={out}", "name=first", "seed=3") == 0
    return out / "first"


def begun(*arguments: str) -> tuple[TrainConfig, BaseAlgorithm, BatchVecEnv]:
    config = read_config(list(arguments)).config
    assert config is not None
    return config, *new_learner(config, config.actuator)


def lead_of(env: BatchVecEnv) -> float:
    task = env.engine.task
    assert isinstance(task, TrackTask) and task.lead is not None
    return task.lead


@pytest.mark.parametrize("part", ["", "best", "final"])
def test_a_run_begins_with_weights_and_normaliser_of_another(first: Path, part: str) -> None:
    config, model, _ = begun(f"from={first / part}")
    assert config.env["id"] == "SeaLegs/Track-v1" and config.agent["n_steps"] == 32, "task and config are that run's"
    kept = load_file(first / (part or "final") / "policy.safetensors")
    own = model.policy.state_dict()
    assert all(np.array_equal(value, kept[name]) for name, value in own.items() if name != "log_std")
    assert own["log_std"].unique().tolist() == [config.agent["policy_kwargs"]["log_std_init"]], "it explores anew"
    described = json.loads((first / (part or "final") / "policy.json").read_text())["observation"]
    normalizer = model.get_vec_normalize_env()
    assert normalizer is not None and isinstance(normalizer.obs_rms, RunningMeanStd)
    assert normalizer.obs_rms.mean.tolist() == described["mean"]
    assert normalizer.obs_rms.var.tolist() == described["variance"]
    assert model.num_timesteps == 0, "its steps count anew"


def test_another_model_is_given_its_own_lead(first: Path, tmp_path: Path) -> None:
    chain = yaml.safe_load((first / "actuators.yaml").read_text())["joint"]
    late = [{"delay": {"seconds": 0.06}}, *(stage for stage in chain if "delay" not in stage)]
    (tmp_path / "late.yaml").write_text(yaml.safe_dump(late))
    lead = yaml.safe_load((first / "config.yaml").read_text())["env"]["lead"]
    _, _, same = begun(f"from={first}")
    _, _, other = begun(f"from={first}", f"actuator={tmp_path / 'late.yaml'}")
    assert lead_of(same) == pytest.approx(lead, abs=1e-3)
    assert lead_of(other) > lead + 0.03
    _, _, asked = begun(f"from={first}", f"actuator={tmp_path / 'late.yaml'}", "env.lead=0.01")
    assert lead_of(asked) == 0.01


def test_what_followed_from_the_size_of_a_robot_does_so_again(tmp_path: Path) -> None:
    """A walking run that began with another was refused: its cadence was that of no gait."""
    walking = read_config(["env=walk"]).config
    assert walking is not None
    env = walking.env | {"cadence": 2.5, "lift": 0.02}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({**walking.as_dict(), "env": env, "measured": ["cadence"]}))
    config = read_config([f"from={tmp_path}"]).config
    assert config is not None and config.env["cadence"] is None and config.env["lift"] == 0.02


def test_a_run_that_began_from_another_says_so_and_is_a_run_as_any(first: Path) -> None:
    out = first.parent
    assert run(f"from={first}", f"out={out}", "name=second", "total_timesteps=64") == 0
    config = yaml.safe_load((out / "second" / "config.yaml").read_text())
    assert config["begun_from"] == str(first) and config["total_timesteps"] == 64 and config["seed"] == 0
    assert run(f"resume={out / 'second'}", "total_timesteps=128") == 0
    assert json.loads((out / "second" / "final" / "policy.json").read_text())["step"] == 128


def test_each_of_several_seeds_begins_with_the_other_run(first: Path) -> None:
    config = read_config([f"from={first}", "seeds=2"]).config
    assert config is not None
    stored = config.as_dict() | {"seed": 1}  # as the folder of a further seed has it
    config = train_config(stored)
    model, _ = new_learner(config, config.actuator)
    kept = load_file(first / "final" / "policy.safetensors")
    assert np.array_equal(model.policy.state_dict()["action_net.bias"], kept["action_net.bias"])


def test_what_does_not_fit_is_refused_in_a_sentence(first: Path, tmp_path: Path) -> None:
    with pytest.raises(SealegsError, match="holds no config"):
        begun(f"from={tmp_path}")
    with pytest.raises(SealegsError, match="leave agent= out"):
        begun(f"from={first}", "agent=sac")
    with pytest.raises(SealegsError, match="no task of your own"):
        begun(f"from={first}", "env=hopper")
    with pytest.raises(SealegsError, match="from cannot be given with resume"):
        begun(f"from={first}", f"resume={first}")
    with pytest.raises(SealegsError, match="does not fit"):
        begun(f"from={first}", "agent.policy_kwargs.net_arch=[9]")
    other = shutil.copytree(first / "final", tmp_path / "other")
    shutil.copy(first / "config.yaml", other)
    description = json.loads((other / "policy.json").read_text())
    description["observation_names"][0] = "something else"
    (other / "policy.json").write_text(json.dumps(description))
    with pytest.raises(SealegsError, match="a policy of another task"):
        begun(f"from={other}")
