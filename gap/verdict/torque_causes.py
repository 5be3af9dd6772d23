"""The causes that a torque balance can show, chosen one at a time on stretches of the log that no fit has seen.

The balance is linear in what it may have wrong: each cause adds one column to what the believed numbers predict.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...actuators.chain import load_chain
from ..causes.catalogue import catalogue, checked
from ..causes.cause import Cause
from ..causes.unknown import unknown_parameters
from ..checks.bootstrap import block_weights
from ..checks.torque_balance import AT_ONCE, TorqueBalance
from ..log.types import MeasuredRun
from ..replay.joint_model import JointModel
from ..search.settings import DEFAULT, SearchSettings
from .decide import confidence, standing
from .request import Request
from .shares import Owed
from .verdict import NamedCause, Value

HALF = 4  # blocks that follow each other in one half of the data
MOST = 4  # causes
DRAWS = 1000
LIKE_ANY = "sts3215"
"""Servo that the catalogue is asked about where a log names none: its numbers are not used."""


@dataclass(frozen=True)
class Term:
    """What one cause of the catalogue changes in the balance.

    Attributes:
        name, number, unit, kind: of the cause.
        terms: indices of :data:`sealegs.gap.checks.torque_balance.TERMS`; none for all of them as believed.
        relative: whether the number is a factor, so that doing nothing is 1.
        column: of a fault of the torque column, the sentence in place of the catalogue's, which is of the encoder.
    """

    name: str
    number: str
    unit: str
    terms: tuple[int, ...]
    kind: str = "number"
    relative: bool = False
    column: str = ""


TERMS = (
    Term("load.mass", "load.mass_factor", "1", (0, 1), relative=True),
    Term("load.inertia", "load.inertia_factor", "1", (0,), relative=True),
    Term("load.centre_of_mass", "load.gravity_factor", "1", (1,), relative=True),
    Term("friction.coulomb", "friction.coulomb", "N.m", (2,)),
    Term("friction.viscous", "friction.viscous", "N.m.s/rad", (3,)),
    Term("sensor.offset", "torque.offset", "N.m", (4,), "data", column="The torque column is shifted by a constant."),
    Term("sensor.scale", "torque.scale", "1", (), "data", relative=True,
         column="The torque column reads more or less than the torque."),
)  # fmt: skip
SHIFT = "sensor.delay"
"""Cause of a torque column that is out of step, which no term of the balance stands for."""


@dataclass(frozen=True, eq=False)
class Sought:
    """What is sought in a balance.

    Attributes:
        joint: its name.
        causes: of the catalogue that the joint can have and that were asked for, by name.
        settings: thresholds of the choice.
        seed: of the resampling.
    """

    joint: str
    causes: Mapping[str, Cause]
    settings: SearchSettings = DEFAULT
    seed: int = 0

    @property
    def terms(self) -> tuple[Term, ...]:
        """Terms of those causes."""
        return tuple(term for term in TERMS if term.name in self.causes)


def sought_in(run: MeasuredRun, joint: str, request: Request) -> Sought:
    """What may be sought in the torque of a joint.

    A torque log need not name an actuator. The catalogue is then asked what it has for a servo like any other.

    Raises:
        SealegsError: the catalogue has no such cause, or the chain lacks what the sidecar says is unknown.
    """
    chain = load_chain(run.actuators.get(joint, LIKE_ANY))
    every = catalogue(JointModel(chain, unknown=unknown_parameters(run, chain)), request.causes)
    causes = {cause.name: cause for cause in every}
    faults = [term.name for term in TERMS if term.column and term.name in checked(request.causes)]
    causes |= {cause.name: cause for cause in catalogue(JointModel(chain), faults)}  # whatever is known of the encoder
    return Sought(joint, causes, request.search, request.seed)


def torque_causes(
    balance: TorqueBalance, believed: np.ndarray, shift: int, noise: float, sought: Sought
) -> tuple[NamedCause, ...]:
    """The causes that the stretches to fit on show, in the order in which they were accepted, without their shares.

    Args:
        balance: of the stretches to fit on.
        believed: numbers of the nominal model for the terms (5,), inertia and gravity as factors of one.
        shift: index of the shift at which the torque is taken.
        noise: of an averaged torque [N.m].
        sought: what may be named.
    """
    settings = sought.settings
    base = balance.terms @ believed
    wanted = balance.torques[:, shift] - base
    columns = {term.name: _column(term, balance, base) for term in sought.terms}
    accepted: list[Term] = []
    found: list[tuple[Term, float, tuple[str, ...], float]] = []
    loss = _crossed(balance, [], wanted)
    while len(accepted) < MOST:
        rest = [term for term in sought.terms if term not in accepted]
        if not rest:
            break
        tried = np.stack([_crossed(balance, [columns[t.name] for t in (*accepted, term)], wanted) for term in rest])
        order = np.argsort(tried.sum(axis=1))
        best, better = _win_rates(tried[order], loss, settings, sought.seed)
        term, after = rest[order[0]], tried[order[0]]
        size, spread = _size(balance, [columns[t.name] for t in (*accepted, term)], wanted)
        pays = loss.sum() - after.sum() > settings.least_gain * loss.sum() and better > settings.least_certainty
        if not pays or (accepted and best[0] < settings.least_win_rate) or abs(size[-1]) < 1.96 * spread[-1]:
            break
        rivals = tuple(
            rest[k].name for k, won in zip(order[1:], best[1:], strict=True) if won > settings.rival_win_rate
        )
        found.append((term, float(min(best[0], better)), rivals, float(loss.sum() - after.sum())))
        accepted.append(term)
        loss = after
    size, spread = _size(balance, [columns[t.name] for t in accepted], wanted)
    left = max(float(loss.sum()) - noise**2 * len(wanted), 0.0)
    without = owed_by(balance, believed, shift, [term.name for term in accepted]).without
    named = []
    for k, (term, win_rate, rivals, removed) in enumerate(found):
        sure = confidence(win_rate, removed, left)
        none = 1.0 if term.relative else float(believed[term.terms[0]])
        reach = 1.96 * float(spread[k])
        value = Value(
            none + float(size[k]), none + float(size[k]) - reach, none + float(size[k]) + reach, term.unit, none
        )
        cause = sought.causes[term.name]
        gain = 1.0 - float(np.sqrt(min(loss.sum() / max(without[k], 1e-30), 1.0)))
        named.append(
            NamedCause(
                cause.name, term.column or cause.sentence, sought.joint, 0.0, sure, {term.number: value}, gain,
                term.kind, cause.picture, rivals, standing(sure, rivals),
            )
        )  # fmt: skip
    return tuple(named)


def owed_by(balance: TorqueBalance, believed: np.ndarray, shift: int, names: Sequence[str]) -> Owed:
    """What the balance owes to each of these causes: leave one out, refit the others, and see how the loss rises.

    The tuned numbers are all terms of the balance: they are left out in the loss of the causes alone.

    Args:
        balance, believed, shift: as of :func:`torque_causes`.
        names: of the causes; :data:`SHIFT` takes the torque at ``shift``, which otherwise is taken there anyway.
    """
    base = balance.terms @ believed
    by_name = {term.name: _column(term, balance, base) for term in TERMS}

    def loss(kept: Sequence[str], at: int) -> float:
        return float(_crossed(balance, [by_name[n] for n in kept if n != SHIFT], balance.torques[:, at] - base).sum())

    whole = loss(names, shift)
    without = tuple(
        loss([other for other in names if other != name], AT_ONCE if name == SHIFT else shift) for name in names
    )
    tuned = float(_crossed(balance, list(balance.terms.T), balance.torques[:, shift] - base).sum())
    return Owed(tuple(max(value - whole, 0.0) for value in without), max(whole - tuned, 0.0), without)


def _column(term: Term, balance: TorqueBalance, base: np.ndarray) -> np.ndarray:
    return balance.terms[:, list(term.terms)].sum(axis=1) if term.terms else base


def _crossed(balance: TorqueBalance, columns: Sequence[np.ndarray], wanted: np.ndarray) -> np.ndarray:
    """Squared error per block (b,), each half of the data under the fit to the other."""
    half = (balance.block // HALF) % 2
    rest = wanted.copy()
    if columns:
        table = np.stack(columns, axis=1)
        for part in (0, 1):
            if (half != part).any():
                size = np.linalg.lstsq(table[half != part], wanted[half != part], rcond=None)[0]
                rest[half == part] -= table[half == part] @ size
    return np.bincount(balance.block, rest**2)


def _win_rates(tried: np.ndarray, before: np.ndarray, settings: SearchSettings, seed: int) -> tuple[np.ndarray, float]:
    """How often each candidate (c, b) is the best in resampled blocks (c,), and how often the first beats none."""
    rng = np.random.default_rng(seed)
    weights = block_weights(len(before), DRAWS, rng)
    totals = weights @ tried.T
    better = float((totals[:, 0] < weights @ before).mean())
    totals = totals + settings.shared_error * tried.sum(axis=1).min() * rng.normal(size=totals.shape)
    return np.bincount(totals.argmin(axis=1), minlength=len(tried)) / DRAWS, better


def _size(balance: TorqueBalance, columns: Sequence[np.ndarray], wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sizes (k,) by least squares, and their standard deviations over resampled blocks (k,)."""
    if not columns:
        return np.zeros(0), np.zeros(0)
    table = np.stack(columns, axis=1)
    size = np.linalg.lstsq(table, wanted, rcond=None)[0]
    score = table * (wanted - table @ size)[:, None]
    per_block = np.stack([np.bincount(balance.block, score[:, k]) for k in range(table.shape[1])], axis=1)
    inverse = np.linalg.pinv(table.T @ table)
    return size, np.sqrt(np.diag(inverse @ per_block.T @ per_block @ inverse))
