"""The screen: which variants of which causes are worth a fit, to first order."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..causes.cause import Cause, Variant
from ..replay.parameters import Parameter, numbers
from ..replay.problem import Problem
from .bounded import solved
from .settings import SearchSettings

AT_ONCE = 16  # replays
STEP = 0.1  # of a nuisance parameter, in units of its scale


@dataclass(frozen=True)
class Screened:
    """Variants worth a fit, the best first, and how much loss per judged value the best of them promises to remove."""

    chosen: list[tuple[Cause, Variant]]
    promise: float


def screen(
    problem: Problem,
    causes: Sequence[Cause],
    extended: Sequence[Parameter],
    here: Mapping[str, float],
    settings: SearchSettings,
) -> Screened:
    """Screen causes on top of a model.

    Every variant is simulated once or twice at a plausible size. The residual is projected on what that changes,
    beside what the parameters of the model can change anyway.

    Args:
        problem: data that are fitted.
        causes: to choose from.
        extended: parameters of the model.
        here: their values.
    """
    steps = [{p.path: p.from_fit(p.to_fit(here[p.path]) + _inward(p, here[p.path]))} for p in extended]
    variants = [(cause, variant) for cause in causes for variant in cause.variants]
    known = numbers(here)
    sizes = [_sizes(variant, known) for _, variant in variants]
    error = _residuals(problem, here, [*steps, *(size for tried in sizes for size in tried)])
    rest, changes = error[0], error[1:] - error[0]
    clip = settings.screen_outlier * np.sqrt(np.mean(rest**2))
    rest = np.clip(rest, -clip, clip)
    tuned = changes[: len(extended)].T
    far = settings.screen_far * clip
    bent = np.clip(tuned, -far, far)
    ends = np.cumsum([len(extended), *(len(tried) for tried in sizes)])
    scores = []
    for (_, variant), first, end in zip(variants, ends[:-1], ends[1:], strict=True):
        columns = changes[first:end].T
        # the two phases of something periodic span all others; of two sizes one is taken
        groups = [columns] if is_periodic(variant) else [columns[:, k : k + 1] for k in range(columns.shape[1])]
        scores.append(min(_left(rest, bent, np.clip(group, -far, far), settings) for group in groups))
    order = np.argsort(scores)
    least = scores[order[0]] if len(order) else _left_after(rest, tuned)
    promise = (_left_after(rest, tuned) - least) / float(problem.blocks()[1].sum())
    return Screened(_shortlist(variants, order, settings), promise)


def is_periodic(variant: Variant) -> bool:
    """Whether a variant has a phase."""
    return any(p.phase for p in variant)


def _shortlist(
    variants: Sequence[tuple[Cause, Variant]], order: np.ndarray, settings: SearchSettings
) -> list[tuple[Cause, Variant]]:
    """The best few variants of the best causes."""
    chosen: list[tuple[Cause, Variant]] = []
    per_cause: dict[str, int] = {}
    for k in order:
        name = variants[k][0].key
        taken = per_cause.get(name, 0)
        if taken >= settings.screened_variants or (not taken and len(per_cause) >= settings.screened):
            continue
        per_cause[name] = taken + 1
        chosen.append(variants[k])
    return chosen


def _residuals(problem: Problem, here: Mapping[str, float], changes: Sequence[Mapping[str, float]]) -> np.ndarray:
    """Residuals of the model and of it with each change (1 + c, m)."""
    paths = numbers(here)
    rows: list[dict[str, float]] = [dict(here)]
    for change in changes:
        replaced = {paths.get(number) for number in numbers(change)}
        rows.append({**{path: value for path, value in here.items() if path not in replaced}, **change})
    parts = [rows[k : k + AT_ONCE] for k in range(0, len(rows), AT_ONCE)]
    return np.concatenate([problem.residual(problem.simulate(part)) for part in parts])


def _left(rest: np.ndarray, tuned: np.ndarray, columns: np.ndarray, settings: SearchSettings) -> float:
    """Squared residual that stays beside the best size of a variant and the best nuisance parameters."""
    basis = np.concatenate([tuned, columns], axis=1)
    gram = basis.T @ basis
    solution = np.linalg.lstsq(gram + 1e-9 * np.trace(gram) * np.eye(len(gram)), -(basis.T @ rest))[0]
    reach, (least, most) = settings.screen_tuned_reach, (settings.screen_least_size, settings.screen_most_size)
    solution[: tuned.shape[1]] = np.clip(solution[: tuned.shape[1]], -reach, reach)
    solution[tuned.shape[1] :] = np.clip(solution[tuned.shape[1] :], least, most)
    return float(((rest + basis @ solution) ** 2).sum())


def _left_after(rest: np.ndarray, tuned: np.ndarray) -> float:
    """Squared residual that stays beside the best nuisance parameters alone."""
    if tuned.shape[1] == 0:
        return float((rest**2).sum())
    step = solved(tuned.T @ tuned + 1e-9 * np.eye(tuned.shape[1]), -(tuned.T @ rest))
    return float(((rest + tuned @ step) ** 2).sum())


def _inward(parameter: Parameter, value: float) -> float:
    """A small step of a parameter that stays within its bounds, in the optimiser's coordinate."""
    return STEP if parameter.to_fit(value) + STEP <= parameter.to_fit(parameter.high) else -STEP


def _sizes(variant: Variant, known: Collection[str]) -> list[dict[str, float]]:
    """Plausible sizes at which a variant is tried: two, or two phases of something periodic.

    Of what comes with its first number, the model keeps the numbers that it has (``known``).
    """
    start = {p.path: p.start for p in variant if p is variant[0] or p.number not in known}
    if (phase := next((p for p in variant if p.phase), None)) is not None:
        return [start, {**start, phase.path: phase.start + np.pi / 2.0}]
    first = variant[0]
    return [start, {**start, first.path: first.from_fit(first.to_fit(first.start) + 1.0)}]
