"""Numbers of a model that are one quantity: what turns one of them turns the other as well.

A rotor and what it turns are one inertia about the joint, unless something gives between them. No log tells their parts
apart; only what is believed of each does.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter
from ..replay.problem import Problem

ROTOR = ".armature"
"""End of the number of a chain that holds the inertia of its rotor about the joint."""
LINK, MORE = "load.extra_inertia", "load.rotor_inertia"
"""Inertias about the joint that a chain has no number for: the first also of what joints above turn."""


def with_alike(numbers: Collection[str], nominal: JointModel | None) -> frozenset[str]:
    """Numbers, and those of the same quantity.

    Args:
        numbers: by ``owner.key``.
        nominal: the joint that they are of; None for what is not of one joint.
    """
    found = frozenset(numbers)
    if nominal is not None and not nominal.elastic and any(number.endswith(ROTOR) for number in found):
        found |= {LINK, MORE}
    return found


def inertia_room(
    problem: Problem, parameters: Sequence[Parameter], values: Mapping[str, float], scale: tuple[float, float]
) -> dict[str, tuple[float, float]]:
    """Between which values an inertia may lie by path [kg.m2], as that of the rotor is somewhere within its tolerance.

    The replays are the same there. To first order about one optimum they are not quite, and logs of a good encoder seem
    to tell them apart.

    Args:
        problem: of which the parameters are.
        parameters: that were fitted.
        values: of them, by path.
        scale: the least and the largest factor on all torques and inertias (:func:`.torque_gauge.room`).
    """
    joint = problem.joint
    rotor = next((p for p in parameters if p.number.endswith(ROTOR) and p.factor), None)
    if joint is None or joint.free_joint is None or rotor is None or joint.models[0].elastic:
        return {}
    nominal, found = joint.models[0], {}
    inertia = nominal.chain.armature()
    for p in parameters:
        if p.number == MORE or (p.number == LINK and MORE not in of_load(nominal)):
            whole = values[p.path] + inertia * values[rotor.path]
            found[p.path] = (scale[0] * whole - inertia * rotor.high, scale[1] * whole - inertia * rotor.low)
    return found


def of_load(nominal: JointModel) -> list[str]:
    """Numbers of a load's inertia; that of a rotor is among them where it is not the same as the link's."""
    return [f"load.{key}" for key in nominal.load.inertia_ranges(nominal.chain.armature())]
