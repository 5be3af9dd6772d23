"""What is named, from what a search recorded and its thresholds alone.

The search itself decides with these functions, so a record decided again with the same settings gives the same names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..checks.signal import block_weights
from .record import TOGETHER, Evidence, RoundRecord, SearchRecord
from .settings import SearchSettings


@dataclass(frozen=True)
class Standing:
    """How a candidate stands in its round.

    Attributes:
        index: among the candidates of the record.
        better: share of bootstrap draws in which it lowers the loss at all.
        best: share of draws in which it is the best of the round (win rate).
        gain: share of the excess loss that it removes, at most 1: the excess is an estimate.
        removed: loss per judged value that it removes.
    """

    index: int
    better: float
    best: float
    gain: float
    removed: float


def finished(excess: float, settings: SearchSettings) -> bool:
    """Whether what is left beyond the noise is too little to look for another cause."""
    return not excess > settings.least_excess


def promising(excess: float, promise: float, settings: SearchSettings) -> bool:
    """Whether a round is worth its fits: a weak excess needs a promise of the screen."""
    return not (excess < settings.weak and promise < settings.least_promise)


def hopeless(
    cost: float,
    least: float,
    before: float,
    optimum: float,
    excess: float,
    settings: SearchSettings,
    *,
    further: bool = False,
) -> bool:
    """Whether a candidate's fit to a sketch of the data is enough to pass it over.

    Far behind the best it cannot win a draw that counts. Where much is left, one that removes not half of what a cause
    must remove, from data that its fit saw, cannot pay.

    Args:
        cost: of the candidate's fit.
        least: of the best candidate's so far.
        before: of the model without it, as its fits to the parts left it.
        optimum: the least known of that model.
        excess: of that model on data that no fit saw.
        settings: thresholds.
        further: whether `least_open_gain` is asked of it.
    """
    if before - least > settings.weak and before - cost < settings.hopeless_gain * (before - least):
        return True
    needed = settings.least_gain * (optimum - 1.0)
    if further:  # or it must leave no more than `open_excess`
        needed = max(needed, min(settings.least_open_gain * (optimum - 1.0), excess - settings.open_excess))
    return excess > settings.open_excess and optimum - cost < settings.hopeless_gain * needed


def ranked(candidates: Sequence[Evidence], settings: SearchSettings) -> list[int]:
    """Indices of the best variant of each cause that the log does not contradict, least charged loss first."""
    charged = [float(one.blocks.sum()) * (1.0 + settings.parameter_charge * one.flexibility) for one in candidates]
    # another form than the usual one fits more and extrapolates worse
    formed = [x * (1.0 if one.usual else settings.form_charge) for x, one in zip(charged, candidates, strict=True)]
    chosen: dict[str, int] = {}
    for k, candidate in enumerate(candidates):
        if candidate.contradicted <= settings.most_contradicted:
            rival = chosen.setdefault(candidate.name, k)
            chosen[candidate.name] = min(rival, k, key=formed.__getitem__)
    return sorted(chosen.values(), key=charged.__getitem__)


def standings(record: RoundRecord, settings: SearchSettings, seed: int) -> list[Standing]:
    """The candidates of a round, best first, with their win rates from a block bootstrap."""
    order = ranked(record.candidates, settings)
    if not order:
        return []
    table = np.stack([record.candidates[k].blocks for k in order])
    rng = np.random.default_rng(seed)
    weights = block_weights(len(record.before), settings.draws, rng)
    totals, count = weights @ table.T, float(record.counts.sum())
    better = (totals < (weights @ record.before)[:, None]).mean(axis=0)
    # of what does about as well, the simplest is meant
    totals *= [1.0 + settings.parameter_charge * record.candidates[k].parameters for k in order]
    # a loss below one a value says that the noise is less than believed, and not that causes are told apart by it
    totals += settings.shared_error * max(table.sum(axis=1).min(), count) * rng.normal(size=totals.shape)
    limits = [record.candidates[k].limit for k in order]
    names = [record.candidates[k].name for k in order]
    other = names.index(limits[0]) if limits[0] in names else 0
    # data that cannot tell a cause from its limit are poor: it is meant; of two that are each other's, the better
    alike = (totals[:, other] <= totals[:, 0]).mean() > settings.rival_win_rate
    if other and alike and limits[other] != names[0]:
        moved = [other, *(k for k in range(len(order)) if k != other)]
        order, table = [order[k] for k in moved], table[moved]
        better, totals = better[moved], totals[:, moved]
    best = np.bincount(totals.argmin(axis=1), minlength=len(order)) / settings.draws
    removed = (record.before.sum() - table.sum(axis=1)) / count
    gain = np.minimum(removed / max(record.left, 1e-9 / count), 1.0)
    return [Standing(k, *map(float, row)) for k, *row in zip(order, better, best, gain, removed, strict=True)]


def inconsistent(candidate: Evidence, settings: SearchSettings) -> str:
    """Why a parameter is no finding, in words that go on after its cause; empty where it is one.

    Both parts of the data must find it on the same side of doing nothing, about as far from it, far enough to matter.
    """
    a, b = candidate.distances
    if max(abs(a), abs(b)) * candidate.scale < settings.least_change:
        typical = "" if candidate.scale < 1.0 else " of a typical change"
        return f"it differs from no effect by less than {100 * settings.least_change:g} %{typical}"
    agree = a * b > 0.0 and settings.least_agreement < a / b < 1.0 / settings.least_agreement
    return "" if agree else "the two parts of the data disagree on its size"


@dataclass(frozen=True)
class Shortfall:
    """What a candidate lacks to be named: the name of the setting, and a sentence's part for people."""

    setting: str
    sentence: str


def pays(record: RoundRecord, first: Standing, settings: SearchSettings, *, further: bool) -> bool:
    """Whether the best candidate of a round is named; a further cause must also win most draws."""
    return not shortfalls(record, first, settings, further=further)


def one_pays(record: RoundRecord, order: list[Standing], settings: SearchSettings, *, further: bool) -> bool:
    """Whether a round names its best candidate: it pays, or shares its win with others that would pay as well, and
    removes so much that one of them must be meant. These are its rivals then, and its confidence is low.
    """
    if not order:
        return False
    if pays(record, order[0], settings, further=further):
        return True
    first = order[0]
    if not (further and first.gain > settings.shared_win_gain and first.removed > settings.weak):
        return False
    alike = [standing for standing in order if _only_shares(record, standing, settings, further=further)]
    return first in alike and sum(standing.best for standing in alike) > settings.least_win_rate


def _only_shares(record: RoundRecord, standing: Standing, settings: SearchSettings, *, further: bool) -> bool:
    """Whether a candidate lacks nothing, or nothing but to win most draws alone."""
    lacks = shortfalls(record, standing, settings, further=further)
    return all(lack.setting == "least_win_rate" for lack in lacks)


def shortfalls(
    record: RoundRecord, standing: Standing, settings: SearchSettings, *, further: bool
) -> tuple[Shortfall, ...]:
    """Everything that a candidate lacks to be named; nothing where it is."""
    candidate = record.candidates[standing.index]
    found: list[Shortfall] = []

    def lacks(setting: str, sentence: str) -> None:
        found.append(Shortfall(setting, sentence))

    share = f"it removes {100 * standing.gain:.0f} % of what is left"
    if not standing.gain > settings.least_gain:
        lacks("least_gain", share)
    elif further and not record.led and _is_guess(record, standing, settings):
        lacks("least_open_gain", share)
    if not standing.better > certainty_needed(candidate, standing, settings):
        lacks("least_certainty", f"it lowers the error in {100 * standing.better:.1f} % of the draws")
    if not standing.removed > settings.least_removed:
        lacks("least_removed", f"it removes {standing.removed:.2g} of the noise's squared error")
    if why := inconsistent(candidate, settings):
        lacks("least_agreement", why)
    often = f"it is the best in {100 * standing.best:.0f} % of the draws"
    if further and not standing.best > settings.least_win_rate:
        lacks("least_win_rate", often)
    if not standing.removed > settings.weak:  # little beyond the noise also means little to tell causes apart by
        if not further and standing.best < settings.least_win_rate:
            lacks("least_win_rate", often)
        seen = record.sampled - candidate.sampled > settings.least_sampled
        if not (seen or standing.removed > settings.least_removed_by_columns):
            lacks("least_sampled", "only duty and current show it")
        if record.left - candidate.excess < settings.least_fall * standing.removed:  # never where it was not asked
            lacks("least_fall", "what it removes is not what neighbouring errors have in common")
    return tuple(found)


def _is_guess(record: RoundRecord, standing: Standing, settings: SearchSettings) -> bool:
    """Whether a cause leaves so much more than it removes that what acts there may as well have made it look good."""
    leaves = record.left - standing.removed
    return leaves > settings.open_excess and not standing.gain > settings.least_open_gain


def certainty_needed(candidate: Evidence, standing: Standing, settings: SearchSettings) -> float:
    """Share of the draws in which a cause must lower the loss.

    Of few blocks, a bootstrap may draw mostly those that show little. Where a cause wins nearly all draws, removes most
    of what is left, and both parts of the data find the same size, that it needs every draw would be a rule made for
    longer logs.
    """
    a, b = candidate.distances
    same = a * b > 0.0 and settings.close_agreement < a / b < 1.0 / settings.close_agreement
    strong = standing.best > settings.strong_win_rate and standing.gain > settings.strong_gain
    return settings.least_certainty_agreeing if same and strong else settings.least_certainty


def is_near(lacks: tuple[Shortfall, ...], standing: Standing, settings: SearchSettings) -> bool:
    """Whether a candidate that is not named deserves a word: one or two rules short, seldom worse than nothing, and not
    always worse than another, which it may only imitate.
    """
    seldom_worse = standing.better > settings.near_certainty and standing.best > settings.rival_win_rate
    return 0 < len(lacks) <= 2 and seldom_worse


def in_place(record: RoundRecord, order: list[Standing], own: str, settings: SearchSettings) -> str | None:
    """The cause that stands in a place beside all the others; None where none is needed there.

    Another takes it that is the best in most draws, and pays, unless it stood there before.

    Args:
        record: of the round without the one that stands there, which is among its candidates.
        order: of its candidates.
        own: name of the one that stands there.
        settings: thresholds.
    """
    if not order or finished(record.excess, settings):
        return None
    first = record.candidates[order[0].index].name
    free = first != own and first not in record.barred
    if free and order[0].best > settings.least_win_rate and pays(record, order[0], settings, further=True):
        return first
    mine = next((one for one in order if record.candidates[one.index].name == own), None)
    return own if mine is not None and pays(record, mine, settings, further=False) else None


def rivals_of(record: RoundRecord, order: list[Standing], chosen: str, settings: SearchSettings) -> tuple[str, ...]:
    """Names of the causes that cannot be told from the one that was chosen."""
    names = [record.candidates[s.index].name for s in order if s.best > settings.rival_win_rate]
    return tuple(name for name in names if name != chosen)


@dataclass(frozen=True)
class Decision:
    """What a record says with some settings.

    Attributes:
        names: of the causes that are named, in the order in which they were accepted.
        rivals: of each of them.
        open: whether the search would have gone where nothing was recorded, so that more may have been named.
    """

    names: tuple[str, ...]
    rivals: tuple[tuple[str, ...], ...]
    open: bool = False


def decide(record: SearchRecord, settings: SearchSettings) -> Decision:
    """Decide a search again.

    The record has the rounds of the search that was run. Where other settings accept another cause, or go on where
    that search had ended, what follows was never fitted: the decision ends there and is open.
    """
    names: list[str] = []
    rivals: list[tuple[str, ...]] = []

    def decision(*, open: bool = False) -> Decision:
        return Decision(tuple(names), tuple(rivals), open)

    ended = False
    for step in record.steps:
        this, seen = step.round, step.round.candidates
        order = standings(this, settings, record.seed) if seen else []
        if step.place is not None:
            own = names[step.place]
            chosen = in_place(this, order, own, settings)
            if chosen != step.winner:
                return decision(open=True)
            here = slice(step.place, step.place + 1)
            stand = [] if chosen is None else chosen.split(TOGETHER)
            names[here] = stand
            rivals[here] = [rivals_of(this, order, str(chosen), settings)] * len(stand)
            ended = ended and chosen == own
            continue
        if ended:  # it went on to look
            break
        over = len(names) >= settings.most_causes or finished(this.excess, settings)
        over = over or not promising(this.excess, this.promise, settings)
        if not over and not seen:
            return decision(open=True)
        if over or not one_pays(this, order, settings, further=bool(names)):
            if step.winner is not None:
                return decision(open=this.led)  # others may have paid that were tried with it
            ended = True
            continue
        names.append(seen[order[0].index].name)
        rivals.append(rivals_of(this, order, names[-1], settings))
        if names[-1] != step.winner:
            return decision(open=True)
    return decision()
