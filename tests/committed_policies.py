"""Policies of ``policies/`` as files, each exported once in a run of tests."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from sealegs.agents.export import export_policy
from sealegs.hw.run.policy import Policy

POLICIES = Path(__file__).resolve().parents[1] / "policies"


@cache
def committed(kind: str, seed: int = 0) -> Policy:
    """The policy in ``policies/<kind>/seed<seed>``."""
    return Policy(export_policy(POLICIES / kind / f"seed{seed}", Path(mkdtemp()) / "policy.onnx"))
