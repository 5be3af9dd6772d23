"""Help for tests of runs on servos: configs, policies that need no training, and a run in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
import torch
from sealegs.agents.export import export_policy, write_onnx
from sealegs.agents.policy_files import describe
from sealegs.configs.compose import compose, split
from sealegs.envs.engine.sb3 import BatchVecEnv
from sealegs.hw.run.policy import Policy
from stable_baselines3 import PPO

POLICIES = Path(__file__).resolve().parents[1] / "policies"


@cache
def committed(kind: str, seed: int = 0) -> Policy:
    """The policy in ``policies/<kind>/seed<seed>``."""
    return Policy(export_policy(POLICIES / kind / f"seed{seed}", Path(mkdtemp()) / "policy.onnx"))


REPOSITORY = Path(__file__).resolve().parents[1]
PATIENT = ["robot.safety.late=1.0", "robot.safety.silent=1.0", "silence=3.0", "hw.timeout=0.5", "live=false"]
"""A machine that runs tests is no machine that runs robots: it may be late without a fault."""


def config(*arguments: str, patient: bool = True) -> dict[str, Any]:
    """Config of deploy.py."""
    return compose(
        "deploy", split([*(PATIENT if patient else []), *arguments], ("policy", "out", "excitation", "port"))
    )


def gentle_policy(path: Path, env_id: str = "SeaLegs/Bench-v0", rate: float = 50.0, **env: Any) -> Path:
    """A policy that moves little and smoothly: an untrained network; written as ONNX."""
    torch.manual_seed(0)
    batch: Any = BatchVecEnv(env_id, 1, seed=0, control_rate=rate, **env)
    model = PPO("MlpPolicy", batch, policy_kwargs={"net_arch": [8]}, device="cpu")
    network: Any = model.policy
    with torch.no_grad():
        network.action_net.weight.mul_(8.0)
    chains = {name: chain.to_list() for name, chain in batch.engine.chains.items()}
    actuator = {key: value for key, value in env.items() if key != "actuator"}
    description = {"env": {"id": env_id, "control_rate": rate, **actuator}, "actuators": chains, "control_rate": rate}
    return write_onnx(path, model, describe(model, None) | description)


def excitation(path: Path, joint: str = "joint", seconds: float = 30.0, amplitude: float = 0.3) -> Path:
    """A slow sine from 0."""
    time = np.arange(0.0, seconds, 0.02)
    goal = amplitude * np.sin(2.0 * np.pi * 0.5 * time)
    np.savetxt(path, np.stack([time, goal], axis=1), "%.4f", ",", header=f"time,{joint}.goal", comments="")
    return path


def start(*arguments: str, terminal: bool = False) -> subprocess.Popen[str]:
    """deploy.py in a process of its own; in a group of its own too, as in a ``terminal``."""
    command = [sys.executable, "deploy.py", *PATIENT, *arguments]
    return subprocess.Popen(
        command, cwd=REPOSITORY, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=terminal
    )
