"""Machines as they may be, within what a diagnosis knows: for training on all of them in place of the likeliest one.

Each draw is one machine. Numbers of a joint are drawn together, with the correlation of its fit, as wide as their 95 %
intervals. What joints share (bodies, a payload, the latency of the bus) is drawn once for all of them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...actuators import Chain
from ...actuators.layout import P_STATE_SIZE
from ...common.errors import SealegsError
from ...envs.extended import Draws, Extended
from ...envs.robots import get_robot
from ..checks.bootstrap import Z95
from ..log.parts import FIT_A, FIT_B
from ..log.types import MeasuredSet
from ..measure.case import ROBOT
from ..replay.parameters import Parameter, numbers
from ..search.fit import Fit, merge
from ..search.intervals import intervals, linearised
from ..verdict.verdict import JointDiagnosis
from .extension import Taken, extended_of

DRAWN_MACHINES = 32
BUILD_TRIES = 8  # of a machine that cannot be built, or whose chain has another law


@dataclass(frozen=True, eq=False)
class Spread:
    """How well the numbers of a joint are known, in the coordinates of its fit.

    Attributes:
        parameters: that were fitted.
        centre: where they are (p,).
        sizes: standard deviations (p,).
        root: of their correlation: root times its transpose (p, p).
    """

    parameters: tuple[Parameter, ...]
    centre: np.ndarray
    sizes: np.ndarray
    root: np.ndarray

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Values by path, within the bounds of each."""
        u = self.centre + self.sizes * (self.root @ rng.standard_normal(len(self.centre)))
        return {p.path: p.from_fit(x) for p, x in zip(self.parameters, u, strict=True)}


def spread_of(diagnosis: JointDiagnosis, seed: int = 0) -> Spread | None:
    """How well the numbers of a joint's model are known; None where it is as believed."""
    replay, search = diagnosis.case.replay, diagnosis.search
    if replay is None or search is None:
        return None
    wide = replay.wide if diagnosis.model == "refitted" else ()
    known = {p.path: p for p in merge(search.parameters(), wide)}
    parameters = [known[path] for path in diagnosis.values if path in known]
    if not parameters:
        return None
    fitted = replay.fitting.part(FIT_A, FIT_B)
    values = {p.path: min(max(diagnosis.values[p.path], p.low), p.high) for p in parameters}
    found = Fit(values, fitted.simulate([values])[0], 0.0)
    halves = search.fits if diagnosis.model == "extended" else ()
    ends = intervals(fitted, parameters, found, seed, halves)
    centre = np.array([p.to_fit(values[p.path]) for p in parameters])
    half = [0.5 * (p.to_fit(ends[p.path][1]) - p.to_fit(ends[p.path][0])) for p in parameters]
    correlation = linearised(fitted, parameters, found).correlation()
    sizes, vectors = np.linalg.eigh(correlation)
    root = vectors * np.sqrt(np.maximum(sizes, 0.0))
    return Spread(tuple(parameters), centre, np.array(half) / Z95, root)


def with_draws(
    extended: Extended, diagnoses: Sequence[JointDiagnosis], data: MeasuredSet, taken: Taken, seed: int = 0
) -> Extended:
    """The model that is handed over, with machines as it may be.

    Args:
        extended: the model.
        diagnoses, data, taken: what it is of, as of :func:`.extension.extended_of`.
        seed: of the draws.
    """
    spreads = {one.joint: spread_of(one, seed) for one in diagnoses}
    rng = np.random.default_rng(seed)
    machines: list[dict[tuple[str, ...], float]] = []
    for _ in range(DRAWN_MACHINES):
        for _ in range(BUILD_TRIES):
            drawn = extended_of(_drawn(diagnoses, spreads, rng), data, taken)
            if drawn is not None and _like(drawn, extended):
                machines.append(drawn.numbers())
                break
    return dataclasses.replace(extended, draws=_varying(extended.numbers(), machines))


def _drawn(
    diagnoses: Sequence[JointDiagnosis], spreads: Mapping[str, Spread | None], rng: np.random.Generator
) -> list[JointDiagnosis]:
    """The diagnoses of a machine that may be the one that was measured."""
    shared = {  # of all chains, such as the latency
        number: rng.normal() * 0.5 * (value.high - value.low) / Z95
        for one in diagnoses
        if one.joint == ROBOT
        for cause in one.causes
        for number, value in cause.parameters.items()
    }
    found = []
    for one in diagnoses:
        spread = spreads[one.joint]
        if spread is None:
            found.append(one)
            continue
        values = dict(one.values) | spread.draw(rng)
        path_of, nominal = numbers(values), None if one.problem is None else one.problem.models[0]
        for number in one.shared:
            path = path_of.get(number)
            if path is None or nominal is None or number not in shared:
                continue
            unit = nominal.value(number) if path != number else 1.0
            low = min(1e-9, one.values[path])
            values[path] = max(one.values[path] + shared[number] / unit, low)
        found.append(one.changed(values=values))
    return found


def _like(drawn: Extended, extended: Extended) -> bool:
    """Whether a drawn machine has the laws of the model, and can be: a body with a negative inertia is none."""
    if drawn.numbers().keys() != extended.numbers().keys():
        return False
    for joint, variants in extended.chains.items():
        for one, other in zip(variants, drawn.chains[joint], strict=True):
            if _law(one.chain) != _law(other.chain):
                return False
    if not any(change.owner == "robot" for change in extended.changes):
        return True
    try:
        robot = get_robot(drawn.robot)
        drawn_on = drawn.chains_on(robot), drawn.params_on(robot, told=False)
    except SealegsError:
        return True  # the model itself is refused there, with a sentence
    try:
        robot.drivetrain(*drawn_on)
    except (SealegsError, ValueError):
        return False
    return True


def _law(chain: Chain) -> tuple[bool, int, int]:
    program = chain.program()
    return chain.friction_needs_law(), len(program), int(program[P_STATE_SIZE])


def _varying(model: Mapping[tuple[str, ...], float], machines: Sequence[Mapping[tuple[str, ...], float]]) -> Draws:
    varying = [key for key, value in model.items() if any(one[key] != value for one in machines)]
    return Draws(tuple(varying), tuple(tuple(one[key] for key in varying) for one in machines))
