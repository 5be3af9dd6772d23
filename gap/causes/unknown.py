"""What a sidecar says was not measured, so that every fit may turn it: a number that nobody claimed cannot be wrong.

A bench whose encoder's zero was not aligned and whose chain has an assumed friction says ``unknown: [zero, friction]``
under ``meta``; an arm, where the load of each joint is the rest of the arm, ``unknown: [load]``.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from ...actuators import Chain
from ...common.errors import nearest
from ...envs.bench.robot import BARE
from ...envs.described.robot_file import is_robot_file
from ..load.load import Load, PendulumLoad
from ..log.types import LogError, MeasuredRun
from ..replay.parameters import Parameter, address, factor

POINT = PendulumLoad()  # the load of a bench
IN_UNIT = {"mass_factor": "1", "extra_inertia": "kg.m2"}
"""Unit by number of a load that a fit may turn where nobody measured it; a factor is moved as a logarithm."""


def _of_load(load: Load, chain: Chain | None = None) -> tuple[Parameter, ...]:
    """What is not known of a load that nobody measured."""
    ranges = load.unknown_ranges(0.0 if chain is None else chain.armature())
    return tuple(Parameter(f"load.{key}", unit, *ranges[key], logarithmic=unit == "1") for key, unit in IN_UNIT.items())


UNKNOWN: dict[str, tuple[Parameter, ...]] = {
    "zero": (Parameter("encoder.offset", "rad", -0.1, 0.1, 0.0, 0.01),),
    "friction": (factor("friction.coulomb", 0.02, 20.0, 0.2), factor("friction.viscous", 0.02, 20.0, 0.2)),
    "armature": (factor("dc_motor.armature", 0.2, 5.0, 0.1),),
    "motor": (factor("dc_motor.motor_constant", 0.4, 2.5, 0.1), factor("dc_motor.resistance", 0.4, 2.5, 0.1)),
    "load": (
        *_of_load(POINT),
        # where gravity pulls to; the zero of the encoder is a pose of the arm
        Parameter("encoder.offset", "rad", -math.pi, math.pi, 0.0, 0.2),
    ),
}
"""Parameters per word of the sidecar."""

POINT_MASS = {"mass": 0.2, "length": 0.1, **BARE}
"""Where the fit of an unknown load starts that nobody said anything of: a point mass [kg] at a distance [m]; assumed.
It has no arm, since no fit turns an arm: one that is not there would stay.
"""


def unknown_parameters(
    run: MeasuredRun, chain: Chain, words: Sequence[str] = (), load: Load = POINT
) -> tuple[Parameter, ...]:
    """What was not measured in a run of a joint with that chain.

    Args:
        run: whose sidecar says it.
        chain: of the joint.
        words: what the robot's file says beside it.
        load: of the joint.

    Raises:
        LogError: the sidecar uses a word that is not in :data:`UNKNOWN`, or one for a number that the chain lacks.
    """
    said = list(dict.fromkeys([*_words(run), *(word for word in words if word in UNKNOWN)]))
    for word in said:
        factors = [p.number for p in UNKNOWN[word] if p.factor]
        missing = [number for number in factors if not _has(chain, number)]
        if factors and len(missing) == len(factors):
            raise LogError(
                f"{run.name}: meta.unknown holds {word!r}, and the chain has no {' and no '.join(missing)} to start "
                "from; give the chain a guess of it, or take the word out."
            )
    known = {p.path: p for word in said for p in UNKNOWN[word]}
    if "load" in said:
        known |= {p.path: p for p in _of_load(load, chain)}
        if load.pose_known and "zero" not in said:
            del known["encoder.offset"]
    return tuple(p for p in known.values() if not p.factor or _has(chain, p.number))


def _has(chain: Chain, number: str) -> bool:
    at = address(number)
    stage = chain.find(at.owner)
    return stage is not None and getattr(stage, at.key) > 0.0


def with_believed_load(run: MeasuredRun) -> MeasuredRun:
    """The run as one of a bench, with a load to start from, where the sidecar says that its load is not known.

    Raises:
        LogError: as :func:`unknown_parameters`.
    """
    if "load" not in _words(run) or is_robot_file(run.robot):  # whose own file is where the search starts
        return run
    said = dict(run.robot_params)
    if "mass" in said:  # a bench that somebody described: what is left out is as on any bench
        return dataclasses.replace(run, robot="bench", robot_params={"length": POINT_MASS["length"], **said})
    return dataclasses.replace(run, robot="bench", robot_params={**POINT_MASS, **said})


def _words(run: MeasuredRun) -> list[str]:
    """``meta.unknown`` of a sidecar; a single word is a list of one."""
    said = run.meta.get("unknown") or []
    words = said if isinstance(said, list) else [said]
    for word in words:
        if not isinstance(word, str) or word not in UNKNOWN:
            raise LogError(
                f"{run.name}: meta.unknown holds {word!r}{nearest(str(word), UNKNOWN)}; it is a list of "
                f"{', '.join(UNKNOWN)}."
            )
    return words
