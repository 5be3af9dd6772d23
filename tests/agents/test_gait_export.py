"""Exported policies that correct or modulate a gait: the file does what policy and environment do together."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.agents.export import export_policy
from sealegs.agents.make_env import make_vec_env
from sealegs.agents.policy_files import load_policy
from sealegs.agents.policy_graph import ActionPipeline
from sealegs.agents.traced import ROWS, OnnxGraph, Traced, TracingError
from sealegs.common.errors import SealegsError
from sealegs.envs.contract import make_contract, start_pose
from sealegs.hw.run.policy import Policy

POLICIES = Path(__file__).resolve().parents[2] / "policies"
KINDS = ("hopper", "biped", "biped_hopping", "hexapod", "leg", "arm")
COMMITTED = sorted(f"{path.parent.parent.name}/{path.parent.name}" for path in POLICIES.glob("*/*/policy.json"))
PARITY = 1e-5


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Policy]:
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
    kind: str, rows: int, actions: int, exported: Mapping[str, Policy]
) -> None:
    act, _ = load_policy(POLICIES / kind / "seed0")
    assert max(differences(exported[kind], act, rows, actions).values()) < PARITY


@pytest.mark.long
@pytest.mark.parametrize("name", COMMITTED)
def test_each_committed_policy_does_so_over_ten_thousand_observations(name: str, tmp_path: Path) -> None:
    act, _ = load_policy(POLICIES / name)
    policy = Policy(export_policy(POLICIES / name, tmp_path / "policy.onnx"))
    assert max(differences(policy, act, 100, 100).values()) < PARITY


def test_every_kind_of_committed_policy_is_tried() -> None:
    assert {name.partition("/")[0] for name in COMMITTED} == set(KINDS)


@pytest.mark.parametrize("kind", ["biped", "hexapod"])
@pytest.mark.long
def test_the_file_keeps_step_with_the_environment(
    kind: str, exported: Mapping[str, Policy], monkeypatch: pytest.MonkeyPatch
) -> None:
    policy = exported[kind]
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
def test_the_contract_says_what_the_policy_needs(exported: Mapping[str, Policy]) -> None:
    hopper, biped, hexapod = (exported[kind].contract for kind in ("hopper", "biped", "hexapod"))
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
