"""The causes that a torque balance can show, chosen one at a time on stretches of the log that no fit has seen.

The balance is linear in what it may have wrong: each cause adds one column to what the believed numbers predict.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..checks.bootstrap import block_weights
from ..checks.torque_balance import TorqueBalance
from ..search.settings import DEFAULT
from .decide import confidence, standing
from .verdict import NamedCause, Value

HALF = 4  # blocks that follow each other in one half of the data
MOST = 4  # causes
DRAWS = 1000


@dataclass(frozen=True)
class Term:
    """One cause: its number, and which terms of the balance it changes by how much of what is believed.

    Attributes:
        name, sentence, number, unit, kind: of the cause.
        terms: indices of :data:`sealegs.gap.checks.torque_balance.TERMS`; none for all of them as believed.
        relative: whether the number is a factor, so that doing nothing is 1.
    """

    name: str
    sentence: str
    number: str
    unit: str
    terms: tuple[int, ...]
    kind: str = "number"
    relative: bool = False


TERMS = (
    Term("load.mass", "The load is lighter or heavier than believed.", "load.mass_factor", "1", (0, 1), relative=True),
    Term("load.inertia", "The load has another inertia than its mass and length give.", "load.inertia_factor", "1",
         (0,), relative=True),
    Term("load.centre_of_mass", "The load's centre of mass sits at another distance.", "load.gravity_factor", "1",
         (1,), relative=True),
    Term("friction.coulomb", "Dry friction differs from what the model has.", "friction.coulomb", "N.m", (2,)),
    Term("friction.viscous", "Friction that grows with speed differs from what the model has.", "friction.viscous",
         "N.m.s/rad", (3,)),
    Term("sensor.offset", "The torque column is shifted by a constant.", "torque.offset", "N.m", (4,), "data"),
    Term("sensor.scale", "The torque column reads more or less than the torque.", "torque.scale", "1", (), "data",
         relative=True),
)  # fmt: skip


def torque_causes(
    balance: TorqueBalance, believed: np.ndarray, shift: int, noise: float, joint: str
) -> tuple[NamedCause, ...]:
    """The causes that the stretches to fit on show, largest share first.

    Args:
        balance: of the stretches to fit on.
        believed: numbers of the nominal model for the terms (5,), inertia and gravity as factors of one.
        shift: index of the shift at which the torque is taken.
        noise: of an averaged torque [N.m].
        joint: its name.
    """
    base = balance.terms @ believed
    wanted = balance.torques[:, shift] - base
    columns = {term.name: _column(term, balance, base) for term in TERMS}
    accepted: list[Term] = []
    found: list[tuple[Term, float, tuple[str, ...], float]] = []
    loss = _crossed(balance, [], wanted)
    first = max(float(loss.sum()), 1e-30)
    while len(accepted) < MOST:
        rest = [term for term in TERMS if term not in accepted]
        tried = np.stack([_crossed(balance, [columns[t.name] for t in (*accepted, term)], wanted) for term in rest])
        order = np.argsort(tried.sum(axis=1))
        best, better = _win_rates(tried[order], loss)
        term, after = rest[order[0]], tried[order[0]]
        size, spread = _size(balance, [columns[t.name] for t in (*accepted, term)], wanted)
        pays = loss.sum() - after.sum() > DEFAULT.least_gain * loss.sum() and better > DEFAULT.least_certainty
        if not pays or (accepted and best[0] < DEFAULT.least_win_rate) or abs(size[-1]) < 1.96 * spread[-1]:
            break
        rivals = tuple(rest[k].name for k, won in zip(order[1:], best[1:], strict=True) if won > DEFAULT.rival_win_rate)
        found.append((term, float(min(best[0], better)), rivals, float(loss.sum() - after.sum())))
        accepted.append(term)
        loss = after
    size, spread = _size(balance, [columns[t.name] for t in accepted], wanted)
    left = max(float(loss.sum()) - noise**2 * len(wanted), 0.0)
    named = []
    for k, (term, win_rate, rivals, removed) in enumerate(found):
        sure = confidence(win_rate, removed, left)
        none = 1.0 if term.relative else float(believed[term.terms[0]])
        reach = 1.96 * float(spread[k])
        value = Value(
            none + float(size[k]), none + float(size[k]) - reach, none + float(size[k]) + reach, term.unit, none
        )
        named.append(
            NamedCause(
                term.name, term.sentence, joint, removed / first, sure, {term.number: value},
                1.0 - float(np.sqrt(max(1.0 - removed / first, 0.0))), term.kind, "response", rivals,
                standing(sure, rivals),
            )
        )  # fmt: skip
    return tuple(sorted(named, key=lambda cause: -cause.share))


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


def _win_rates(tried: np.ndarray, before: np.ndarray) -> tuple[np.ndarray, float]:
    """How often each candidate (c, b) is the best in resampled blocks (c,), and how often the first beats none."""
    rng = np.random.default_rng(0)
    weights = block_weights(len(before), DRAWS, rng)
    totals = weights @ tried.T
    better = float((totals[:, 0] < weights @ before).mean())
    totals = totals + DEFAULT.shared_error * tried.sum(axis=1).min() * rng.normal(size=totals.shape)
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
