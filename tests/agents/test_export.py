"""Exported policies: they act as the trained one, know what robot they are for, and are never overwritten."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import onnx
import pytest
import sealegs
import torch
from sb3_contrib import ARS, TQC, TRPO, CrossQ, RecurrentPPO
from sealegs.actuators import load_chain
from sealegs.agents.export import export_policy, write_onnx
from sealegs.agents.make_env import make_vec_env
from sealegs.agents.policy_files import describe, load_policy, save_policy
from sealegs.agents.policy_graph import ActionPipeline
from sealegs.agents.traced import ROWS, OnnxGraph, Traced, TracingError
from sealegs.common.errors import SealegsError
from sealegs.envs.contract import KEY, Contract, ContractError, chain_hash, make_contract, start_pose
from sealegs.envs.engine.sb3 import BatchVecEnv
from sealegs.hw.run.policy import Policy
from stable_baselines3 import A2C, DDPG, PPO, SAC, TD3
from stable_baselines3.common.vec_env import VecEnvWrapper, VecFrameStack, VecMonitor, VecNormalize

REPOSITORY = Path(__file__).resolve().parents[2]
ENV = {"id": "SeaLegs/Hopper-v0", "randomization": None}


def learner(algorithm: str, activation: type[torch.nn.Module], normalize: bool) -> tuple[Any, dict[str, Any]]:
    """An untrained policy with large weights and a normaliser that has seen something; and its description."""
    torch.manual_seed(3)
    env: Any = BatchVecEnv(ENV["id"], 4, seed=0)
    chains = {name: chain.to_list() for name, chain in env.engine.chains.items()}
    if normalize:
        env = VecNormalize(env, clip_obs=5.0)
        env.reset()
        for _ in range(20):
            env.step(np.random.default_rng(0).uniform(-1.0, 1.0, (4, 2)))
    keywords = {"policy_kwargs": {"net_arch": [32, 32], "activation_fn": activation}, "device": "cpu"}
    model = PPO("MlpPolicy", env, **keywords) if algorithm == "ppo" else SAC("MlpPolicy", env, **keywords)
    with torch.no_grad():
        for parameter in model.policy.parameters():
            parameter.mul_(2.0)
        if algorithm == "ppo":  # which begins with actions near 0
            policy: Any = model.policy
            policy.action_net.weight.mul_(50.0)
    description = {"env": ENV, "actuators": chains, "control_rate": 50.0, "algorithm": algorithm}
    return model, describe(model, model.get_vec_normalize_env()) | description


@pytest.mark.parametrize(
    ("algorithm", "activation", "normalize"),
    [("ppo", torch.nn.Tanh, True), ("ppo", torch.nn.ELU, False), ("sac", torch.nn.ReLU, True)],
)
def test_an_exported_policy_acts_as_the_trained_one(
    algorithm: str, activation: type[torch.nn.Module], normalize: bool, tmp_path: Path
) -> None:
    model, description = learner(algorithm, activation, normalize)
    policy = Policy(write_onnx(tmp_path / "policy.onnx", model, description))
    random = np.random.default_rng(1)
    spread = 30.0 if normalize else 1.0  # larger values than a policy learnt with are for a normaliser to clip
    observations = (random.normal(0.0, 1.0, (10_000, 14)) * random.uniform(0.01, spread, 14)).astype(np.float32)
    normalizer = model.get_vec_normalize_env()
    seen = normalizer.normalize_obs(observations) if normalizer else observations
    wanted = model.predict(seen, deterministic=True)[0]
    # what the policy knows itself is taken from its state, whatever stands in the observation
    state = np.concatenate([np.zeros((10_000, 1)), observations[:, 12:], np.zeros((10_000, 2))], axis=1)
    blind = observations.copy()
    blind[:, [0, 12, 13]] = np.nan
    action, goal, after = policy.act(blind, observations[:, :1], state)
    assert np.abs(wanted).min() < 0.5 and np.abs(wanted).max() == 1.0, "saturated actions and others"
    assert np.abs(action - wanted).max() < 1e-5
    low, high = np.array(policy.contract.goal_low), np.array(policy.contract.goal_high)
    assert np.allclose(goal, 0.5 * (low + high) + 0.5 * (high - low) * action, atol=1e-12)
    assert (after[:, 0] == 1.0).all() and np.allclose(after[:, 1:], np.hstack([action, state[:, 1:3]]))
    rows = zip(blind[:50], observations[:50, :1], state[:50], strict=True)
    single = np.concatenate([policy.act(seen[None], asked[None], was[None])[0] for seen, asked, was in rows])
    assert np.abs(single - wanted[:50]).max() < 1e-5


def test_a_policy_knows_the_robot_that_it_is_for(tmp_path: Path) -> None:
    model, description = learner("ppo", torch.nn.Tanh, True)
    contract = Policy(write_onnx(tmp_path / "policy.onnx", model, description)).contract
    assert contract.robot == "hopper" and contract.joints == ("hip", "knee") and contract.control_rate == 50.0
    assert len(contract.observation_names) == 14 and contract.observation_names[1] == "hip height [m]"
    assert contract.goal_limits["hip"] == pytest.approx((-1.21, -0.01))
    assert contract == make_contract(ENV, description["actuators"], 50.0), "the same wherever it is made"
    heavier = make_contract(ENV | {"params": {"total_mass": 0.6}}, description["actuators"], 50.0)
    assert heavier.robot_hash != contract.robot_hash and heavier.chain_hash == contract.chain_hash


def test_a_chain_is_known_by_its_numbers_and_a_net_by_its_weights(tmp_path: Path) -> None:
    servo = load_chain("sts3215")
    assert chain_hash({"joint": servo}) == chain_hash({"joint": load_chain(servo.to_list())})
    assert chain_hash({"joint": servo}) != chain_hash({"joint": servo.with_value("friction.coulomb", 0.053)})
    net = load_chain("net")
    copy = tmp_path / "copy.npz"
    original = REPOSITORY / "configs" / "actuator" / "sts3215_net.npz"
    copy.write_bytes(original.read_bytes())
    stages = net.to_list()
    stages[0]["net"]["file"] = str(copy)
    assert chain_hash({"joint": load_chain(stages)}) == chain_hash({"joint": net}), "wherever the file lies"


def exported(model: Any, out: Path, rows: int, **keywords: Any) -> Contract:
    """The contract of a policy that one call wrote, which acts as the model does."""
    policy = Policy(sealegs.export(model, out, **keywords))
    assert len(policy.contract.observation_names) == rows
    return policy.contract


@pytest.mark.parametrize("algorithm", [PPO, SAC, TD3, DDPG, A2C, ARS, CrossQ, TQC, TRPO])
def test_one_call_exports_a_model_of_a_script_of_ones_own(algorithm: Any, tmp_path: Path) -> None:
    env = BatchVecEnv("SeaLegs/Track-v1", 2, seed=0, robot="bench", amplitude=0.5, actuator="sts3215")
    contract = exported(algorithm("MlpPolicy", VecNormalize(env), device="cpu"), tmp_path / "policy.onnx", 5)
    kept = {"id": "SeaLegs/Track-v1", "robot": "bench", "amplitude": 0.5, **env.engine.fitted}
    assert contract.env == kept and kept["lead"] > 0.0
    assert contract.chains == {"joint": env.engine.chains["joint"].to_list()} and contract.control_rate == 50.0


def louder(model: Any) -> Any:
    """The model with weights so large that its actions and its memory move."""
    with torch.no_grad():
        for parameter in model.policy.parameters():
            parameter.mul_(3.0)
    return model


@pytest.mark.parametrize("stacked", [1, 3])
@pytest.mark.parametrize("algorithm", [SAC, RecurrentPPO])
def test_a_policy_that_remembers_acts_from_its_file_as_in_training(
    algorithm: Any, stacked: int, tmp_path: Path
) -> None:
    """Over an episode, the file carries what SB3 keeps outside of the model: earlier observations, an LSTM's state."""
    batch = BatchVecEnv("SeaLegs/Hopper-v0", 3, seed=0)
    env = VecNormalize(VecFrameStack(batch, stacked) if stacked > 1 else batch, training=False)
    recurrent = algorithm is RecurrentPPO
    network = {"lstm_hidden_size": 8, "n_lstm_layers": 2, "net_arch": [8]} if recurrent else {"net_arch": [8]}
    model = louder(algorithm("MlpLstmPolicy" if recurrent else "MlpPolicy", env, policy_kwargs=network, device="cpu"))
    policy = Policy(sealegs.export(model, tmp_path / "policy.onnx"))
    size, contract = len(policy.contract.observation_names), policy.contract
    assert contract.history == stacked and contract.policy_memory == (stacked - 1) * size + 32 * recurrent
    seen, began, memory = env.reset(), np.ones(3, bool), None
    state = np.tile(np.asarray(contract.state), (3, 1))
    held = [k for k, name in enumerate(contract.observation_names) if name.startswith("last")]
    state[:, 1:3] = np.asarray(env.get_original_obs())[:, np.array(held) - size]  # each begins in a pose of its own
    assert contract.observation_names[0] == "commanded speed [m/s]" and contract.commands == 1
    actions = []
    for _ in range(12):
        action, memory = model.predict(seen, memory, began, deterministic=True)
        measured = np.asarray(env.get_original_obs())[:, -size:]
        from_file, _, state = policy.act(measured, measured[:, :1], state)
        assert from_file == pytest.approx(action, abs=1e-5)
        actions.append(action)
        seen, _, began, _ = env.step(action)
        if began.any():
            break
    assert len(actions) > 5 and np.ptp(actions, axis=0).max() > 0.01


def test_an_observation_stacked_after_the_normaliser_is_refused(tmp_path: Path) -> None:
    env = VecFrameStack(VecNormalize(BatchVecEnv("SeaLegs/Hopper-v0", 2)), 2)
    with pytest.raises(SealegsError, match="put VecNormalize around"):
        sealegs.export(PPO("MlpPolicy", env, device="cpu"), tmp_path / "policy.onnx")


def test_a_wrapper_that_no_file_holds_is_refused_by_name(tmp_path: Path) -> None:
    class Doubled(VecEnvWrapper):
        def reset(self) -> Any:
            return self.venv.reset()

        def step_wait(self) -> Any:
            observation, *rest = self.venv.step_wait()
            return (2.0 * np.asarray(observation), *rest)

    batch = BatchVecEnv("SeaLegs/Hopper-v0", 2)
    exported(PPO("MlpPolicy", VecMonitor(batch), device="cpu"), tmp_path / "monitor.onnx", 14)
    with pytest.raises(SealegsError, match="what Doubled does is in no file"):
        sealegs.export(PPO("MlpPolicy", Doubled(batch), device="cpu"), tmp_path / "policy.onnx")


def test_a_model_of_single_environments_is_exported_and_one_of_another_project_refused(tmp_path: Path) -> None:
    single = gym.make("SeaLegs/Bench-v0", control_rate=25.0, render_mode="rgb_array")
    contract = exported(PPO("MlpPolicy", single, device="cpu"), tmp_path / "single.onnx", 6)
    assert contract.env == {"id": "SeaLegs/Bench-v0", "control_rate": 25.0} and contract.control_rate == 25.0
    with pytest.raises(SealegsError, match="is none of this project's"):
        sealegs.export(PPO("MlpPolicy", gym.make("Pendulum-v1"), device="cpu"), tmp_path / "other.onnx")


def test_a_saved_policy_is_exported_once_and_never_overwritten(tmp_path: Path) -> None:
    model, description = learner("ppo", torch.nn.Tanh, False)
    save_policy(tmp_path, model, description)
    written = export_policy(tmp_path)
    assert written == tmp_path / "policy.onnx" and Policy(tmp_path).contract.robot == "hopper"
    with pytest.raises(SealegsError, match="never overwritten"):
        export_policy(tmp_path)


def test_a_network_that_cannot_be_exported_is_refused_by_name(tmp_path: Path) -> None:
    model, description = learner("ppo", torch.nn.GELU, False)
    with pytest.raises(SealegsError, match="layer GELU"):
        write_onnx(tmp_path / "policy.onnx", model, description)
    assert not (tmp_path / "policy.onnx").exists()


def test_a_file_without_contract_or_with_a_damaged_one_is_refused(tmp_path: Path) -> None:
    model, description = learner("ppo", torch.nn.Tanh, False)
    path = write_onnx(tmp_path / "policy.onnx", model, description)
    document = onnx.load(path)
    del document.metadata_props[:]
    onnx.save(document, tmp_path / "bare.onnx")
    with pytest.raises(ContractError, match="has no contract"):
        Policy(tmp_path / "bare.onnx")
    onnx.helper.set_model_props(document, {KEY: '{"version": 1, "robot": "hopper"}'})
    onnx.save(document, tmp_path / "damaged.onnx")
    with pytest.raises(ContractError, match="export the policy again"):
        Policy(tmp_path / "damaged.onnx")
    (tmp_path / "torn.onnx").write_bytes(path.read_bytes()[:500])
    with pytest.raises(ContractError, match="no ONNX file"):
        Policy(tmp_path / "torn.onnx")
    with pytest.raises(ContractError, match="there is no policy"):
        Policy(tmp_path / "none.onnx")
    with pytest.raises(ContractError, match="version 99"):
        Contract.from_json('{"version": 99}', "here")


@pytest.mark.long
def test_running_a_policy_needs_no_torch() -> None:
    code = "import sys, sealegs.hw.run.policy; sys.exit('torch' in sys.modules or 'stable_baselines3' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY).returncode == 0


# --- exported policies that correct or modulate a gait: the file does what policy and environment do together --------

POLICIES = Path(__file__).resolve().parents[2] / "policies"
KINDS = ("hopper", "biped", "biped_hopping", "hexapod", "leg", "arm")
COMMITTED = sorted(f"{path.parent.parent.name}/{path.parent.name}" for path in POLICIES.glob("*/*/policy.json"))
PARITY = 1e-5


@pytest.fixture(scope="module")
def exported_gait(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Policy]:
    folder = tmp_path_factory.mktemp("policies")

    class Exported(dict[str, Policy]):
        def __missing__(self, kind: str) -> Policy:
            self[kind] = Policy(export_policy(POLICIES / kind / "seed0", folder / f"{kind}.onnx"))
            return self[kind]

    return Exported()


def differences(policy: Policy, act: Any, rows: int, actions: int) -> dict[str, float]:
    """Largest differences of action, goal and memory over ``rows`` times ``actions`` observations that mean nothing."""
    pipeline = ActionPipeline(policy.contract, rows)
    random, state, found = np.random.default_rng(1), pipeline.state(), dict[str, float]()
    for _ in range(actions * policy.contract.goals_per_action):
        measured = random.normal(0.0, 1.0, (rows, len(policy.contract.observation_names))).astype(np.float32)
        wanted, goal = pipeline.step(measured, act)
        action, got, state = policy.act(measured, pipeline.command, state)
        pairs = {"action": (action, wanted), "goal": (got, goal), "memory": (state, pipeline.state())}
        found = {key: max(found.get(key, 0.0), float(np.abs(a - b).max())) for key, (a, b) in pairs.items()}
    return found


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "rows", "actions"),
    [("hopper", 100, 5), ("biped", 100, 5), ("hexapod", 50, 2), ("leg", 20, 1), ("arm", 20, 1)],
)
def test_the_file_gives_what_policy_and_gait_give(
    kind: str, rows: int, actions: int, exported_gait: Mapping[str, Policy]
) -> None:
    act, _ = load_policy(POLICIES / kind / "seed0")
    assert max(differences(exported_gait[kind], act, rows, actions).values()) < PARITY


@pytest.mark.long
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name.endswith("seed0") else pytest.mark.weekly) for name in COMMITTED]
)
def test_each_committed_policy_does_so_over_ten_thousand_observations(name: str, tmp_path: Path) -> None:
    act, _ = load_policy(POLICIES / name)
    policy = Policy(export_policy(POLICIES / name, tmp_path / "policy.onnx"))
    assert max(differences(policy, act, 100, 100).values()) < PARITY


def test_every_kind_of_committed_policy_is_tried() -> None:
    assert {name.partition("/")[0] for name in COMMITTED} == set(KINDS)


@pytest.mark.parametrize("kind", ["biped", "hexapod"])
@pytest.mark.long
def test_the_file_keeps_step_with_the_environment(
    kind: str, exported_gait: Mapping[str, Policy], monkeypatch: pytest.MonkeyPatch
) -> None:
    policy = exported_gait[kind]
    contract, per_action = policy.contract, policy.contract.goals_per_action
    description = json.loads((POLICIES / kind / "seed0" / "policy.json").read_text())
    act, _ = load_policy(POLICIES / kind / "seed0")
    env = make_vec_env(description["env"], description["actuators"], 2, seed=0)
    motions: list[Any] = []
    task = type(env.engine.task)
    observe = task.observe
    monkeypatch.setattr(task, "observe", lambda self, motion: motions.append(motion) or observe(self, motion))
    observation: Any = env.reset()
    first = motions[-1]
    memory = first.memory.copy() if first.memory.size else np.empty((2, 0))
    state = np.concatenate([np.zeros((2, 1)), first.action, first.action, memory], axis=1)
    goals = env.engine.batch.bind("ctrl")
    for _ in range(2 if kind == "hexapod" else 20):
        action = act(observation)
        for _ in range(per_action):
            got, goal, state = policy.act(observation, first.command, state)
            assert np.abs(got - np.clip(action, -1.0, 1.0)).max() < PARITY
        observation, *_ = env.step(action)
        assert np.abs(goal - goals).max() < PARITY
        if first.memory.size:
            assert np.abs(state[:, 1 + 2 * len(contract.actions) :] - motions[-1].memory).max() < PARITY


@pytest.mark.long
def test_the_contract_says_what_the_policy_needs(exported_gait: Mapping[str, Policy]) -> None:
    hopper, biped, hexapod = (exported_gait[kind].contract for kind in ("hopper", "biped", "hexapod"))
    assert hopper.sensors == ("hip.link", "knee.link", "base_x", "base_z")
    assert biped.sensors[-3:] == ("hip_x", "hip_z", "torso_pitch") and biped.control_rate == biped.goal_rate == 50.0
    assert hexapod.control_rate == 1.0 and hexapod.goal_rate == 100.0 and hexapod.units[:3] == ("rad", "m", "m")
    assert set(hexapod.sensors) == {f"body.{key}" for key in ("x", "y", "z", "roll", "pitch", "yaw")}
    assert start_pose(biped)["hip_z"] == pytest.approx(0.97, abs=0.02)


def test_what_a_file_cannot_say_is_refused_by_name() -> None:
    traced = Traced(OnnxGraph(), "x", np.zeros((ROWS, 3)))

    def refused(does: Any) -> str:
        with pytest.raises(TracingError) as refusal:
            does()
        return str(refusal.value)

    def in_place() -> None:
        part = traced[:, 1]
        part += 1.0

    assert "np.where says it" in refused(lambda: 1.0 if traced[:, 0] > 0.0 else 0.0)
    assert "np.interp" in refused(lambda: np.interp(traced, [0.0, 1.0], [0.0, 1.0]))
    assert "plain one" in refused(lambda: np.asarray(traced))
    assert "in place" in refused(in_place)
    assert "measured" in refused(lambda: traced + np.arange(3 * ROWS).reshape(ROWS, 3))


def test_a_fixed_delay_is_in_contract_and_environment() -> None:
    env = {"id": "SeaLegs/Hopper-v0", "action_delay": 0.005}
    late, prompt = (make_vec_env({**env, "action_delay": delay}, None, 1, seed=0) for delay in (0.005, 0.0))
    chains = {name: chain.to_list() for name, chain in late.engine.chains.items()}
    assert make_contract(env, chains, 50.0).delay == 0.005
    late.reset()
    prompt.reset()
    action = np.full((1, 2), 0.5)
    moved = [env.engine.step(action).observation for env in (late, prompt)]
    assert np.abs(moved[0] - moved[1]).max() > 1e-3, "goals hold for 5 ms more"
    with pytest.raises(SealegsError, match="whole number of steps"):
        make_vec_env({**env, "action_delay": 0.0055}, None, 1, seed=0)
    with pytest.raises(SealegsError, match=r"less than 0\.02 s"):
        make_vec_env({**env, "action_delay": 0.02}, None, 1, seed=0)
