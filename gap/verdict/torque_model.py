"""Models of a torque balance: what is believed, what a fit may turn of it, and what causes add.

A balance is linear in its numbers, so a model is a set of columns beside the believed torque, and a fit is one bounded
linear step.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...actuators import Chain
from ..checks.torque_balance import TorqueBalance
from ..load.pendulum import PendulumLoad, bench_parameters
from ..log.types import Array, LogError, MeasuredRun
from ..replay.parameters import Parameter
from ..search.bounded import bounded_step

TINY = 1e-12  # a load so small is none
HALF = 4  # blocks that follow each other in one half of the data


@dataclass(frozen=True)
class Believed:
    """What sidecar and chain say of a run, as far as it is in the torque column.

    Attributes:
        inertia: of load and armature [kg.m2].
        gravity: torque at a quarter turn [N.m].
        armature: of the motor [kg.m2]; 0 in a column taken at the shaft, as is friction.
        mass: inertia [kg.m2] and gravity torque [N.m] of the mass alone.
        coulomb, viscous: friction [N.m], [N.m.s/rad].
    """

    inertia: float
    gravity: float
    armature: float
    mass: tuple[float, float]
    coulomb: float
    viscous: float

    @classmethod
    def of(cls, run: MeasuredRun, joint: str, chain: Chain | None) -> Believed:
        """Of a joint of a run; without a chain, nothing is believed of friction and armature.

        Raises:
            LogError: it is not of a bench.
        """
        if run.robot != "bench":
            raise LogError(
                f"{run.name}: joint '{joint}' of {run.robot} was driven by torque; what it works against is known for "
                "a bench only."
            )
        load, twice = PendulumLoad(), PendulumLoad(mass_factor=2.0)
        params = bench_parameters(run.robot_params, run.name)
        armature, friction = (0.0, None) if chain is None else (chain.armature(), chain.find("friction"))
        return cls(
            load.inertia(params) + armature,
            load.gravity_torque(params),
            armature,
            (
                twice.inertia(params) - load.inertia(params),
                twice.gravity_torque(params) - load.gravity_torque(params),
            ),
            0.0 if friction is None else friction.coulomb,
            0.0 if friction is None else friction.viscous,
        )

    @property
    def at_shaft(self) -> Believed:
        """Without what lies on the drive's side of the shaft."""
        return replace(self, inertia=self.inertia - self.armature, armature=0.0, coulomb=0.0, viscous=0.0)


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


@dataclass(frozen=True, eq=False)
class Turned:
    """A number that a fit turns: by its path what a unit of change adds to the torque (m,), and its bounds."""

    path: str
    column: Array
    low: float = -math.inf
    high: float = math.inf


@dataclass(frozen=True, eq=False)
class TorqueModel:
    """A nominal model along the rows of a balance.

    Attributes:
        balance: the rows (m,).
        believed: of each run of the balance.
        tuned: numbers that every fit may turn, with their bounds.
    """

    balance: TorqueBalance
    believed: Sequence[Believed]
    tuned: Sequence[Parameter] = ()

    @property
    def numbers(self) -> Array:
        """Believed numbers of the terms (5,), inertia and gravity as factors of one."""
        return np.array([1.0, 1.0, self.believed[0].coulomb, self.believed[0].viscous, 0.0])

    @property
    def base(self) -> Array:
        """Believed torque (m,) [N.m]."""
        return self.balance.terms @ self.numbers

    def of_term(self, term: Term) -> Turned:
        """What a cause turns: of a machine down to none of it at all, of a column also to the other sign."""
        none = 1.0 if term.relative else float(self.numbers[term.terms[0]])
        low = -math.inf if term.column else -none
        if term.number == "load.mass_factor":
            column = self._mass
        elif term.number == "load.inertia_factor":  # of the load: the armature is the chain's
            column = self.balance.terms[:, 0] - self._armature
        else:
            column = self.balance.terms[:, list(term.terms)].sum(axis=1) if term.terms else self.base
        return Turned(term.number, column, low)

    def beside(self, terms: Iterable[Term]) -> list[Turned]:
        """The tuned numbers that none of these causes turns itself and that change the torque of these rows."""
        taken = {term.number for term in terms}
        kept = []
        for p in self.tuned:
            column = None if p.number in taken else self._column(p)
            if column is not None and column.any():
                start = 1.0 if p.factor or p.logarithmic else 0.0
                kept.append(Turned(p.path, column, p.low - start, p.high - start))
        return kept

    def _column(self, parameter: Parameter) -> Array | None:
        """What a unit of a tuned number adds (m,); None where a balance does not know it."""
        terms = self.balance.terms
        if parameter.number == "friction.coulomb":
            return terms[:, 2] * self.believed[0].coulomb
        if parameter.number == "friction.viscous":
            return terms[:, 3] * self.believed[0].viscous
        if parameter.number.endswith(".armature"):
            return self._armature
        if parameter.number == "load.extra_inertia":
            return terms[:, 0] / np.maximum(self._of_runs("inertia"), TINY)
        if parameter.number == "load.mass_factor":
            return self._mass
        return None

    def _of_runs(self, name: str) -> Array:
        """A believed number of the run of each row (m,)."""
        return np.array([getattr(one, name) for one in self.believed])[self.balance.run]

    @property
    def _armature(self) -> Array:
        """Torque that the armature takes (m,) [N.m]."""
        return self.balance.terms[:, 0] * self._of_runs("armature") / np.maximum(self._of_runs("inertia"), TINY)

    @property
    def _mass(self) -> Array:
        """Torque that the mass alone takes (m,) [N.m]."""
        terms, run = self.balance.terms, self.balance.run
        moved, held = (np.array([one.mass[k] for one in self.believed])[run] for k in (0, 1))
        inertia, gravity = (np.maximum(self._of_runs(name), TINY) for name in ("inertia", "gravity"))
        return terms[:, 0] * moved / inertia + terms[:, 1] * held / gravity

    @property
    def inside(self) -> tuple[Array, Array]:
        """Torques that armature and friction of the drive take (m,) [N.m]."""
        coulomb, viscous = self._of_runs("coulomb"), self._of_runs("viscous")
        return self._armature, self.balance.terms[:, 2] * coulomb + self.balance.terms[:, 3] * viscous

    @property
    def at_shaft(self) -> TorqueModel:
        """The same of a column that was taken at the shaft."""
        terms = self.balance.terms.copy()
        terms[:, 0] -= self._armature
        return replace(
            self, balance=replace(self.balance, terms=terms), believed=[one.at_shaft for one in self.believed]
        )

    def turned(self, terms: Sequence[Term], *, tuned: bool = True) -> list[Turned]:
        """All that a model with these causes turns, the causes last."""
        return [*(self.beside(terms) if tuned else ()), *(self.of_term(term) for term in terms)]

    def predicted(self, changes: Mapping[str, float], terms: Sequence[Term]) -> Array:
        """Torque (m,) with numbers changed, by path; one that was fitted elsewhere may do nothing in these rows."""
        columns = {item.path: item.column for item in self.turned(terms)}
        turned = (change * columns[path] for path, change in changes.items() if path in columns)
        return self.base + sum(turned, np.zeros(len(self.base)))

    def fit(self, terms: Sequence[Term], shift: int, *, tuned: bool = True) -> dict[str, float]:
        """Changes by path that explain the torque at a shift best."""
        items = self.turned(terms, tuned=tuned)
        sizes = solved_within(items, self.balance.torques[:, shift] - self.base)
        return {item.path: float(size) for item, size in zip(items, sizes, strict=True)}

    def crossed(self, terms: Sequence[Term], shift: int, *, tuned: bool = True) -> np.ndarray:
        """Squared error per block (b,), each half of the data under the fit to the other."""
        items, half = self.turned(terms, tuned=tuned), (self.balance.block // HALF) % 2
        wanted = self.balance.torques[:, shift] - self.base
        rest = wanted.copy()
        for part in (0, 1):
            seen, unseen = half != part, half == part
            if items and seen.any():
                sizes = solved_within(items, wanted, seen)
                rest[unseen] -= np.stack([item.column[unseen] for item in items], axis=1) @ sizes
        return np.bincount(self.balance.block, rest**2)

    def spread(self, terms: Sequence[Term], shift: int) -> Array:
        """Standard deviations over resampled blocks of what causes turn (k,), beside the tuned numbers."""
        items = self.turned(terms)
        if not terms:
            return np.zeros(0)
        wanted = self.balance.torques[:, shift] - self.base
        sizes = solved_within(items, wanted)
        rest = wanted - np.stack([item.column for item in items], axis=1) @ sizes
        causes = len(items) - len(terms)  # their intervals are wanted even where they stand at a bound
        free = [
            item for k, (item, size) in enumerate(zip(items, sizes, strict=True))
            if k >= causes or item.low < size < item.high
        ]  # fmt: skip
        table = np.stack([item.column for item in free], axis=1)
        score = table * rest[:, None]
        per_block = np.stack([np.bincount(self.balance.block, score[:, k]) for k in range(table.shape[1])], axis=1)
        inverse = np.linalg.pinv(table.T @ table)
        return np.sqrt(np.diag(inverse @ per_block.T @ per_block @ inverse))[-len(terms) :]


def solved_within(items: Sequence[Turned], wanted: Array, rows: np.ndarray | None = None) -> Array:
    """Changes (k,) within their bounds that come nearest to a torque (m,), on some of its rows."""
    if not items:
        return np.zeros(0)
    table = np.stack([item.column for item in items], axis=1)
    if rows is not None:
        table, wanted = table[rows], wanted[rows]
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-12)
    low, high = (np.array([getattr(item, end) for item in items]) * size for end in ("low", "high"))
    scaled = table / size
    return bounded_step(scaled.T @ scaled, -(scaled.T @ wanted), low, high) / size
