"""The causes that a torque balance can show, chosen one at a time on stretches of the log that no fit has seen.

The balance is linear in what it may have wrong: each cause adds one column to what the believed numbers predict.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...actuators.chain import load_chain
from ..causes.catalogue import catalogue, checked
from ..causes.cause import Cause
from ..causes.unknown import unknown_parameters
from ..checks.bootstrap import block_weights
from ..log.types import MeasuredRun
from ..measure.confidence import confidence, standing
from ..measure.named import NamedCause, Value
from ..measure.shares import owed_to
from ..prepare.request import Request
from ..replay.joint_model import JointModel
from ..search.settings import DEFAULT, SearchSettings
from .torque_model import Term, TorqueModel

SURE = 1.96  # standard deviations of half a 95 % interval
LIKE_ANY = "sts3215"
"""Servo that the catalogue is asked about where a log names none: its numbers are not used."""


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
        nominal: the joint, whose numbers a fit may turn; friction and armature only where the log names an actuator.
        settings: thresholds of the choice.
        seed: of the resampling.
    """

    joint: str
    causes: Mapping[str, Cause]
    nominal: JointModel
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
    nominal = JointModel(chain, unknown=unknown_parameters(run, chain))
    every = catalogue(nominal, request.causes)
    causes = {cause.name: cause for cause in every}
    faults = [term.name for term in TERMS if term.column and term.name in checked(request.causes)]
    causes |= {cause.name: cause for cause in catalogue(JointModel(chain), faults)}  # whatever is known of the encoder
    return Sought(joint, causes, nominal, request.search, request.seed)


def torque_causes(model: TorqueModel, shift: int, noise: float, sought: Sought) -> tuple[NamedCause, ...]:
    """The causes that the stretches to fit on show, in the order in which they were accepted, without their shares.

    Args:
        model: of the stretches to fit on.
        shift: index of the shift at which the torque is taken.
        noise: of an averaged torque [N.m].
        sought: what may be named.
    """
    settings = sought.settings
    accepted: list[Term] = []
    found: list[tuple[Term, float, tuple[str, ...], float]] = []
    loss = model.crossed([], shift)
    while len(accepted) < settings.most_torque_causes:
        rest = [term for term in sought.terms if term not in accepted]
        if not rest:
            break
        tried = np.stack([model.crossed([*accepted, term], shift) for term in rest])
        order = np.argsort(tried.sum(axis=1))
        best, better = _win_rates(tried[order], loss, settings, sought.seed)
        term, after = rest[order[0]], tried[order[0]]
        size = model.fit([*accepted, term], shift)[term.number]
        reach = SURE * model.spread([*accepted, term], shift)[-1]
        pays = loss.sum() - after.sum() > settings.least_gain * loss.sum() and better > settings.least_certainty
        if not pays or (accepted and best[0] < settings.least_win_rate) or abs(size) < reach:
            break
        rivals = tuple(
            rest[k].name for k, won in zip(order[1:], best[1:], strict=True) if won > settings.rival_win_rate
        )
        found.append((term, float(min(best[0], better)), rivals, float(loss.sum() - after.sum())))
        accepted.append(term)
        loss = after
    sizes, reaches = model.fit(accepted, shift), SURE * model.spread(accepted, shift)
    left = max(float(loss.sum()) - noise**2 * len(model.base), 0.0)
    named = []
    for (term, win_rate, rivals, removed), reach in zip(found, reaches, strict=True):
        sure = confidence(win_rate, removed, left)
        none = 1.0 if term.relative else float(model.numbers[term.terms[0]])
        size = none + sizes[term.number]
        value = Value(size, size - float(reach), size + float(reach), term.unit, none)
        cause = sought.causes[term.name]
        named.append(
            NamedCause(
                cause.name, term.column or cause.sentence, sought.joint, 0.0, sure, {term.number: value}, 0.0,
                term.kind, cause.picture, rivals, standing(sure, rivals),
            )
        )  # fmt: skip
    return tuple(named)


def terms_of(names: Sequence[str]) -> list[Term]:
    """The terms of causes; :data:`SHIFT` has none."""
    return [term for name in names for term in TERMS if term.name == name]


def with_shares(
    model: TorqueModel, shift: int, causes: Sequence[NamedCause], explained: float
) -> tuple[tuple[NamedCause, ...], float]:
    """The causes with share and gain, the largest first, and the share of the tuned numbers.

    Args:
        model: of the stretches to fit on.
        shift: index of the shift at which the torque is taken; without :data:`SHIFT` it is not shifted.
        causes: that are named.
        explained: share of the gap that the final model explains.
    """
    if not causes:
        return (), explained
    names = [cause.name for cause in causes]

    def loss(kept: Sequence[str], *, tuned: bool = True) -> float:
        at = model.balance.at_once if SHIFT in names and SHIFT not in kept else shift
        return float(model.crossed(terms_of(kept), at, tuned=tuned).sum())

    debts = owed_to(names, loss)
    shares, tuned_share = debts.shares(explained)
    whole = loss(names)
    gains = [1.0 - float(np.sqrt(min(whole / max(without, 1e-30), 1.0))) for without in debts.without]
    every = [replace(c, share=share, gain=gain) for c, share, gain in zip(causes, shares, gains, strict=True)]
    return tuple(sorted(every, key=lambda cause: -cause.share)), tuned_share


def _win_rates(tried: np.ndarray, before: np.ndarray, settings: SearchSettings, seed: int) -> tuple[np.ndarray, float]:
    """How often each candidate (c, b) is the best in resampled blocks (c,), and how often the first beats none."""
    rng = np.random.default_rng(seed)
    weights = block_weights(len(before), settings.verdict_draws, rng)
    totals = weights @ tried.T
    better = float((totals[:, 0] < weights @ before).mean())
    totals = totals + settings.shared_error * tried.sum(axis=1).min() * rng.normal(size=totals.shape)
    return np.bincount(totals.argmin(axis=1), minlength=len(tried)) / settings.verdict_draws, better
