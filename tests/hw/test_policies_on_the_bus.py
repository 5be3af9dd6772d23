"""Every committed policy can be deployed: its robot is known, has the sensors, and it runs on the virtual bus."""

from __future__ import annotations

import json

import pytest
from sealegs.configs.compose import compose
from sealegs.envs import ENVIRONMENTS
from sealegs.hw.guard.safety import Limits, Safety
from sealegs.hw.machine.robot import build_robot
from sealegs.hw.virtual.__main__ import build

from benchmarks.policies_on_the_bus import on_the_bus
from tests.committed_policies import POLICIES, committed

KINDS = sorted(path.parent.name for path in POLICIES.glob("*/seed0"))


@pytest.mark.parametrize("name", sorted(item.lower() for item in ENVIRONMENTS))
def test_every_robot_of_the_collection_is_known_to_deploy(name: str) -> None:
    config = compose("deploy", {"robot": name})["robot"]
    robot = build_robot(config)
    assert robot.robot.name == name and len(robot.chains) == len(robot.joints)
    Safety(robot, Limits.from_config(config["safety"]), 0.01)


def test_a_virtual_bus_takes_the_robots_own_words_for_its_chains() -> None:
    with build(compose("virtual", {"robot": "leg", "actuator": "silo4_pd"})) as server:
        assert len(server.wire.servos) == 3


def test_no_committed_policy_is_for_another_robot() -> None:
    rows = [json.loads((POLICIES / kind / "seed0" / "policy.json").read_text()) for kind in KINDS]
    robots = {row["env"]["id"].removeprefix("SeaLegs/").removesuffix("-v0") for row in rows}
    assert robots and robots <= set(ENVIRONMENTS)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_a_committed_policy_runs_on_the_virtual_bus_of_its_robot(kind: str) -> None:
    policy = committed(kind)
    found = on_the_bus(policy.contract.robot, policy, 2.0)
    assert found["ending"] == "finished" and found["seconds"] > 0.9, found
