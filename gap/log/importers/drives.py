"""Chains for recordings that say how their drive was set: the servo of BAM, and gains of an impedance drive (MIT mode).

Gains are numbers of the file, or columns that are constant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ....actuators.chain import LIBRARY, load_chain
from ....actuators.published import DRIVES, as_recorded
from ..types import BESIDE_GOAL
from .expression import names_in
from .names import Claim
from .proposal import Proposal
from .recording import Recording

Chain = str | list[dict[str, Any]]
GAIN_UNITS = {"stiffness": "N.m/rad", "damping": "N.m.s/rad"}
PLAIN_UNITS = ("rad", "m", "rad/s", "m/s", "N.m", "N")
"""Units of columns in which gains are in N.m/rad and N.m.s/rad."""


def of_one_servo(recording: Recording, joints: Sequence[str]) -> bool:
    """Whether it is of one servo with a pendulum on its shaft, whose gain the file may say."""
    return recording.kind in ("bam", "table") and {"mass", "length"} <= recording.facts.keys() and len(joints) == 1


def shipped_chain(facts: Mapping[str, float | str]) -> Chain | None:
    """The shipped chain of a recording's motor, set as it says; None where there is none or it says no gain."""
    motor = facts.get("motor")
    if not isinstance(motor, str) or motor not in DRIVES or not (LIBRARY / f"{motor}.yaml").is_file():
        return None
    return as_recorded(DRIVES[motor], load_chain(motor).to_list(), facts) if "kp" in facts else None


def with_gains(chain: list[dict[str, Any]], recording: Recording) -> list[dict[str, Any]]:
    """A chain whose drive is a stiffness and a damping, with those that a recording says: ``kp``, and ``kd`` or
    ``damping``.

    Alone, of BAM, or of a motor whose own drive is known, ``kp`` is a register or in amperes, and no stiffness.
    """
    facts = recording.facts
    damping = next((key for key in ("kd", "damping") if key in facts), "")
    if not (damping and "kp" in facts) or recording.kind == "bam" or facts.get("motor") in DRIVES:
        return chain
    own = {"stiffness": "${kp}", "damping": f"${{{damping}}}"}
    return [{name: {**(values or {}), **own} if name == "ideal" else values for name, values in stage.items()}
            for stage in chain]  # fmt: skip


@dataclass(frozen=True)
class _Gain:
    """A gain: its column, its usual value and the share of rows that have it."""

    column: str
    value: float
    share: float


def impedance_chains(
    recordings: Sequence[Recording],
    out: Proposal,
    claims: Mapping[str, Claim],
    limits: Mapping[str, float] | None = None,
) -> dict[str, list[dict[str, Any]]]:
    """Chains of joints whose stiffness and damping the recordings have in columns.

    A joint whose gains change has none: then only the whole torque says what its drive was told. Nor has one whose
    columns are in degrees or turns: nobody says whether its gains are, too.

    Args:
        recordings: of one kind.
        out: what is proposed.
        claims: on columns.
        limits: largest torque of a joint [N.m], as a robot's file has it.
    """
    chains = {}
    for joint in out.joints:
        goal = out.columns.get(f"{joint}.goal")
        beside = [out.columns[name] for signal in BESIDE_GOAL if (name := f"{joint}.{signal}") in out.columns]
        if goal is None or not all(line.unit in PLAIN_UNITS for line in (goal, *beside)):
            continue
        owners = {claims[name].joint for name in names_in(goal.text) if name in claims} | {joint}
        stiffness, damping = (_gain(recordings, claims, owners, what) for what in ("stiffness", "damping"))
        if stiffness is None or damping is None:
            continue
        for gain, what in ((stiffness, "stiffness"), (damping, "damping")):
            register = "" if beside else "; where it is a register of a servo, replace the chain under sidecar"
            out.unused[gain.column] = f"the {what} of {joint}'s chain [{GAIN_UNITS[what]}]{register}"
        changing = [gain for gain in (stiffness, damping) if gain.share < 1.0]
        for gain in changing:
            out.unused[gain.column] = (
                f"it is {gain.value:g} in {gain.share:.0%} of the rows, so no chain holds for {joint}: leave the "
                "others out under where and write the chain under sidecar, or compute the torque that its drive was "
                f"told and give it as {joint}.torque_command, without the goal"
            )
        if changing or stiffness.value <= 0.0:
            continue
        limit = {"torque_limit": limits[joint]} if limits and joint in limits else {}
        drive = {"stiffness": stiffness.value, "damping": damping.value, **limit}
        chains[joint] = [{"ideal": drive | ({"feedforward": 1} if beside else {})}]
    return chains


def _gain(recordings: Sequence[Recording], claims: Mapping[str, Claim], owners: set[str], what: str) -> _Gain | None:
    """A gain of one of these joints; None where no column, or more than one, is it."""
    names = [name for name, claim in claims.items() if claim.joint in owners and claim.aside.startswith(what)]
    if len(names) != 1:
        return None
    values = np.concatenate([run.columns[names[0]] for run in recordings])
    each, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    return _Gain(names[0], float(each[np.argmax(counts)]), float(counts.max() / len(values))) if len(each) else None
