"""Forward selection: screen, fit, and choose one cause at a time on data that its fit did not see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..log.progress import Milestone
from . import decide
from .exchange import NEVER, exchanged
from .pairs import paired
from .record import SearchRecord, Step
from .result import Round, Search
from .rounds import Rounds
from .state import Found
from .subsets import Subset
from .usual import begin_with

NUMERICAL = (np.linalg.LinAlgError, ArithmeticError)


@dataclass
class Searcher(Rounds):
    """A search in progress over one problem; :class:`.rounds.Rounds` has its attributes.

    Attributes:
        begun: what was found of the problem, from which :func:`.seek.from_usual` goes on; None where nothing was.
    """

    begun: Search | None = None

    def run(
        self, usual: Subset | None = None, *, begun: Search | None = None, single: bool = False, asked: bool = True
    ) -> Search:
        """Search until no further cause pays, or until numbers fail it: what was found until then is kept.

        Args:
            usual: causes that it begins with, in place of none.
            begun: what was found beginning with them, which is taken up: others are still to be sought in its places.
            single: end with the first cause.
            asked: whether others are sought in the places of what was found.
        """
        if begun is None:
            self.progress("tuning the nominal model")
        base = self.judged(self.fit_both(self.tuned, self.start) if begun is None else begun.base)
        found, fault = Found(base), ""
        led = bool(self.led)  # what one run of many showed first is little of the loss of all of them
        try:
            if begun is not None:
                self.resume(found, begun)
            else:
                if usual is not None:
                    begin_with(self, found, usual)
                if single:
                    self.step(found)
                else:
                    self.forward(found)
            while asked and not (led or single) and (exchanged(self, found) or paired(self, found)):
                self.forward(found)
        except NUMERICAL as error:
            fault = f"the search for a further cause failed numerically ({type(error).__name__}: {error})"
            self.progress(fault)
        return Search(
            self.tuned, accepted=tuple(found.accepted), rounds=tuple(found.rounds),
            counts=self.counts, base=base.fits, causes=self.considered, settings=self.settings,
            record=SearchRecord(self.seed, tuple(found.steps)), fault=fault, usual=usual,
        )  # fmt: skip

    def resume(self, found: Found, begun: Search) -> None:
        """Take up a search where its last cause was accepted."""
        found.accepted, found.rounds, found.steps = [*begun.accepted], [*begun.rounds], [*begun.record.steps]
        last = next((step for step in reversed(found.steps) if step.winner), None)
        if last is not None:
            found.put(self.of(found.accepted[-1]), "" if last.round.led else str(last.winner))

    def forward(self, found: Found) -> None:
        """Add one cause after the other, until none pays."""
        while len(found.accepted) < self.settings.most_causes and (self.step(found) or self.unled(found)):
            pass

    def unled(self, found: Found) -> bool:
        """Whether causes led the last round, and none of them paid: now all are tried in its place."""
        if not self.led:
            return False
        self.led = ()
        over = found.steps.pop().round
        if found.rounds and found.rounds[-1].excess == over.excess and not found.rounds[-1].accepted:
            found.rounds.pop()
        return True

    def step(self, found: Found) -> bool:
        """One round of the selection, which changes what was found; whether another is to follow."""
        accepted, rounds, steps, current = found.accepted, found.rounds, found.steps, found.current
        begin = self.excess(current.fits)
        over = decide.finished(begin, self.settings)
        fitted, promise = ([], NEVER) if over and not self.look_on else self.fit_round(accepted, current, begin)
        record, current = self.recorded(accepted, fitted, current, begin, promise)
        steps.append(Step(record))
        if over:
            return False
        worth = decide.promising(begin, promise, self.settings)
        order, candidates = self.standings(record, fitted) if worth else ([], [])
        pays = decide.one_pays(record, order, self.settings, further=bool(accepted))
        rounds.append(Round(record.before, tuple(candidates), pays, begin))
        if not pays:
            return False
        winner = candidates[0]
        accepted[:] = [*(winner.beside or accepted), winner]
        found.current = self.of(winner)
        self.progress(Milestone(f"found {winner.cause.key} (removes {100 * winner.gain:.0f} % of what was left)"))
        steps[-1] = Step(record, winner.cause.key)
        found.settled = winner.cause.key
        return True
