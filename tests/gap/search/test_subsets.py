"""Of several causes the subset is found that the data need, whatever one of them alone stands in for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealegs.gap.causes.cause import Cause
from sealegs.gap.replay.parameters import Parameter, factor
from sealegs.gap.search.fit import fit
from sealegs.gap.search.subsets import Choice, Forms, best_subset, forms_of

NOISE = np.random.default_rng(3).standard_normal(400)
COLUMNS = np.random.default_rng(4).standard_normal((6, 400))
COLUMNS[0] = COLUMNS[1] + COLUMNS[2] + 0.5 * COLUMNS[0]  # the first cause stands in for the next two
NOTHING: Any = SimpleNamespace(value=lambda path: 0.0)


class Bent:
    """Data that bend a little with each number, and do not show the last one while it is small."""

    def __init__(self, truth: Mapping[int, float]) -> None:
        self.judged = np.ones(400, dtype=bool)
        self.measured = self._made(np.array([truth.get(k, 0.0) for k in range(6)])) + NOISE

    def _made(self, sizes: np.ndarray) -> np.ndarray:
        acting = np.where(np.arange(6) == 5, np.maximum(sizes - 5.0, 0.0), sizes)
        return (acting + 0.05 * acting**2) @ COLUMNS

    def simulate(self, rows: Sequence[Mapping[str, float]]) -> np.ndarray:
        sizes = [[row.get(f"load.n{k}", 0.0) for k in range(6)] for row in rows]
        return np.stack([self._made(np.array(row)) for row in sizes])[:, :, None]

    def residual(self, simulated: np.ndarray, every: int = 1) -> np.ndarray:
        return (simulated[:, :, 0] - self.measured)[:, ::every]


def chosen(truth: Mapping[int, float]) -> set[str]:
    """Causes that are found in data of some."""
    problem: Any = Bent(truth)
    numbers = [Parameter(f"load.n{k}", "1", -4.0, 4.0, 0.0, 0.5) for k in range(6)]
    forms: Forms = tuple((Cause("", "", ((p,),), error=True, name=p.number), (p,)) for p in numbers)
    choice = Choice(problem, (), forms, NOTHING, charge=0.02)
    found = best_subset(choice, fit(problem, numbers))
    assert set(found.fit.values) == {p.number for p in numbers if p.number in found.keys}
    return set(found.keys)


@pytest.mark.parametrize("truth", [{1: 1.0, 2: 1.0}, {1: 2.0, 2: 1.5, 3: -1.0}, {0: 1.0}, {3: 2.0}, {}], ids=str)
def test_the_causes_are_found_that_act_and_not_one_that_stands_in_for_two(truth: Mapping[int, float]) -> None:
    assert chosen(truth) == {f"load.n{k}" for k in truth}


def test_of_no_causes_none_are_chosen() -> None:
    problem: Any = Bent({})
    tuned = [Parameter("load.n0", "1", -4.0, 4.0, 0.0, 0.5)]
    found = best_subset(Choice(problem, tuned, (), NOTHING, charge=0.02), fit(problem, tuned))
    assert found.keys == frozenset() and set(found.fit.values) == {"load.n0"}


def fitted_with(truth: Mapping[int, float], tuned: Sequence[Parameter], numbers: Sequence[Parameter]) -> set[str]:
    """Causes that are found beside tuned numbers."""
    problem: Any = Bent(truth)
    forms: Forms = tuple((Cause("", "", ((p,),), error=True, name=p.number), (p,)) for p in numbers)
    choice = Choice(problem, tuned, forms, NOTHING, charge=0.02)
    return set(best_subset(choice, fit(problem, choice.parameters(forms))).keys)


def test_a_number_within_its_tolerance_is_no_cause_beside_another() -> None:
    """It was foreseen at exactly what is believed, where the fit without it turns it as it is tuned."""
    wide, tight = (Parameter("load.n3", "1", -ends, ends, 0.0, 0.5) for ends in (4.0, 0.3))
    cause = Parameter("load.n1", "1", -4.0, 4.0, 0.0, 0.5)
    assert fitted_with({1: 1.0, 3: 0.25}, [tight], [wide, cause]) == {"load.n1"}
    assert fitted_with({1: 1.0, 3: 1.0}, [tight], [wide, cause]) == {"load.n1", "load.n3"}


def test_a_cause_that_changes_nothing_leaves_its_number_to_be_tuned() -> None:
    """A delay within a sample did nothing, and its tuned factor was then asked for where no fit had turned it."""
    idle = Parameter("load.n5", "1", -4.0, 4.0, 0.0, 0.5)
    cause = Parameter("load.n1", "1", -4.0, 4.0, 0.0, 0.5)
    assert fitted_with({1: 1.0}, [factor("load.n5", 0.9, 1.1)], [idle, cause]) == {"load.n1"}


@pytest.mark.parametrize("acting", [1, 3])
def test_of_the_numbers_of_one_cause_the_one_that_is_wrong_is_chosen(acting: int) -> None:
    """A rotor's inertia was no choice beside that of the link, and a stop or another motor made up for it."""
    problem: Any = Bent({acting: 1.0, 2: 1.0})
    numbers = {k: Parameter(f"load.n{k}", "1", -4.0, 4.0, 0.0, 0.5) for k in (1, 2, 3)}
    inertia = Cause("", "", ((numbers[1],), (numbers[3],)), error=True, name="inertia")
    other = Cause("", "", ((numbers[2],),), error=True, name="other")
    choice = Choice(problem, (), (*forms_of(inertia), *forms_of(other)), NOTHING, charge=0.02)
    found = best_subset(choice, fit(problem, list(numbers.values())))
    assert {variant[0] for _, variant in found.forms} == {numbers[acting], numbers[2]}


@pytest.mark.parametrize(
    ("left", "causes"), [(np.inf, {"load.n2", "load.n3"}), (0.0, {"load.n3"})], ids=["all", "little"]
)
def test_a_further_cause_that_removes_little_of_much_is_a_guess(left: float, causes: set[str]) -> None:
    problem: Any = Bent({3: 3.0})
    problem.measured += 0.5 * COLUMNS[2] + 3.0 * np.random.default_rng(5).standard_normal(400)  # what no cause has
    numbers = [Parameter(f"load.n{k}", "1", -4.0, 4.0, 0.0, 0.5) for k in (2, 3)]
    forms: Forms = tuple((Cause("", "", ((p,),), error=True, name=p.number), (p,)) for p in numbers)
    choice = Choice(problem, (), forms, NOTHING, charge=0.02, open_excess=left, gain=0.3)
    assert best_subset(choice, fit(problem, numbers)).keys == causes
