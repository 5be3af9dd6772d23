"""What chains are called in a sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...actuators import SealegsError, load_chain
from ...actuators.chain import LIBRARY, names
from ...envs.contract import chain_hash


def told_chains(chains: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """``sts3215``, or ``hip: sts3215, knee: delay+position_p`` where joints differ; stages where no name is known.

    Args:
        chains: stages by joint.
    """
    known = {chain_hash({"": load_chain(name)}): name for name in names()}
    told = {joint: _told(stages, known) for joint, stages in chains.items()}
    if len(set(told.values())) == 1:
        return next(iter(told.values()))
    return ", ".join(f"{joint}: {chain}" for joint, chain in told.items())


def _told(stages: Sequence[Mapping[str, Any]], known: Mapping[str, str]) -> str:
    joined = "+".join(next(iter(stage)) for stage in stages)
    nets = [Path(str(stage["net"]["file"])) for stage in stages if "net" in stage]
    if any(net.parent != LIBRARY for net in nets):  # which no known chain has, and a contract's path is not opened
        return joined
    try:
        return known.get(chain_hash({"": load_chain(list(stages))}), joined)
    except SealegsError:  # the file of its net is elsewhere
        return joined
