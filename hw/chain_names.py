"""What chains are called in a sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..actuators import SealegsError, load_chain
from ..actuators.chain import names
from ..envs.contract import chain_hash


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
    try:
        return known.get(chain_hash({"": load_chain(list(stages))}), joined)
    except SealegsError:  # the file of its net is elsewhere
        return joined
