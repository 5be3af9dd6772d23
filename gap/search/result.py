"""What a search found: its candidates, round by round."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..causes.cause import Cause
from ..replay.parameters import Parameter
from .fit import Fit, merge
from .record import Evidence, SearchRecord
from .settings import DEFAULT, SearchSettings
from .subsets import Subset

NOTHING = SearchRecord(0, ())


@dataclass(frozen=True, eq=False)
class Candidate:
    """A cause fitted on top of what is already accepted.

    Attributes:
        cause: of the catalogue.
        variant: the parameters that it turns.
        fits: on the two parts, each judged on the other.
        evidence: what is decided on.
        better: share of bootstrap draws in which it lowers the loss at all.
        best: share of draws in which it is the best of the round (win rate).
        gain: share of the excess loss that it removes, at most 1: the excess is an estimate.
        beside: what was accepted, where it takes another form beside this one.
    """

    cause: Cause
    variant: tuple[Parameter, ...]
    fits: tuple[Fit, Fit]
    evidence: Evidence
    better: float = 0.0
    best: float = 0.0
    gain: float = 0.0
    beside: tuple[Candidate, ...] = ()

    @property
    def blocks(self) -> np.ndarray:
        """Loss of each block under the fit that did not see it (b,)."""
        return self.evidence.blocks

    @property
    def flexibility(self) -> int:
        """Parameters that it is charged for; a missing effect counts as one more."""
        return self.evidence.flexibility


@dataclass(frozen=True, eq=False)
class Round:
    """One step of the forward selection; of an accepted cause, the last one that asked about its place.

    Attributes:
        before: loss of each block without any of the candidates (b,).
        candidates: the best variant of each cause, best first.
        accepted: whether the first one is named.
        excess: loss per value beyond that of the noise when the round began.
    """

    before: np.ndarray
    candidates: tuple[Candidate, ...]
    accepted: bool
    excess: float = 0.0


@dataclass(frozen=True, eq=False)
class Search:
    """What a search found.

    Attributes:
        tuned: parameters of the nominal model that are always tuned within their tolerance (nuisance parameters).
        accepted: causes in the order they were accepted.
        rounds: all rounds, the last one without a winner.
        counts: judged values per block (b,), to make means of ``blocks``.
        base: fits of ``tuned`` alone.
        causes: that were considered.
        settings: its thresholds.
        record: what it decided on.
        fault: why it ended early; empty where it did not.
        loose: whether ``tuned`` were refitted, by more than their tolerance (:mod:`sealegs.gap.search.loose`).
        led: by the key of each cause that one run of many showed first, the loss per value that it removes there
            (:mod:`sealegs.gap.search.led`).
        leader: number of that run.
        usual: causes that it began with; None where it began with nothing.
    """

    tuned: tuple[Parameter, ...]
    accepted: tuple[Candidate, ...]
    rounds: tuple[Round, ...]
    counts: np.ndarray
    base: tuple[Fit, Fit]
    causes: tuple[Cause, ...] = ()
    settings: SearchSettings = DEFAULT
    record: SearchRecord = NOTHING
    fault: str = ""
    loose: bool = False
    led: Mapping[str, float] = field(default_factory=dict)
    leader: int | None = None
    usual: Subset | None = None

    @property
    def fits(self) -> tuple[Fit, Fit]:
        """Fits with all that was found."""
        return self.accepted[-1].fits if self.accepted else self.base

    def parameters(self, without: str | None = None) -> list[Parameter]:
        """All parameters of the extended model, or of the one that lacks a cause, given by its key."""
        groups: list[Sequence[Parameter]] = [c.variant for c in self.accepted if c.cause.key != without]
        return merge(self.tuned, *groups)

    def rivals(self, which: int) -> tuple[str, ...]:
        """Names of the causes that do about as well in the place of an accepted one, given by its number.

        One that is accepted, too, stands beside it and not in its place.
        """
        cause = self.accepted[which].cause
        close = [c.cause for c in self.close([r for r in self.rounds if r.accepted][which])]
        # a rival of the same name is another body's
        return tuple(dict.fromkeys(other.key if other.name == cause.name else other.name for other in close))

    def close(self, step: Round) -> list[Candidate]:
        """Candidates of a round that do about as well as its best, less those that are accepted."""
        named = {candidate.cause.key for candidate in self.accepted}
        return [c for c in step.candidates[1:] if c.best > self.settings.rival_win_rate and c.cause.key not in named]

    def less(self, keys: Collection[str]) -> Search:
        """The search without some of the causes that it accepted; its record stays."""
        rounds = [r for r in self.rounds if r.accepted]
        kept = [(c, r) for c, r in zip(self.accepted, rounds, strict=True) if c.cause.key not in keys]
        others = [r for r in self.rounds if not r.accepted]
        return replace(self, accepted=tuple(c for c, _ in kept), rounds=(*(r for _, r in kept), *others))
