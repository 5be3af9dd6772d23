"""What a round tries, and a few iterations of a fit for each: which of them is worth more is seen from these."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from ..causes.cause import Cause, Variant
from ..replay.parameters import Parameter
from ..replay.problem import Problem
from .fit import Fit, fit, merge
from .settings import SearchSettings


def to_try(
    chosen: Sequence[tuple[Cause, Variant]],
    shown: Sequence[Cause],
    numbers: Collection[str],
    *,
    blind: bool,
) -> list[tuple[Cause, Variant]]:
    """What the screen chose, with the usual form of each cause, and every wrong number of the nominal model.

    A number that is several times wrong is far from what a first order can foresee, and the likeliest error.
    Where the model is far from the data altogether, no order foresees anything: every cause is tried, in each of its
    forms.

    Args:
        chosen: by the screen, the best first.
        shown: causes that the data can show.
        numbers: that tuning turns.
        blind: whether the model is so far.
    """
    every = list(chosen)
    for cause in dict.fromkeys(cause for cause, _ in chosen):
        if not any(variant == cause.variants[0] for other, variant in chosen if other is cause):
            every.append((cause, cause.variants[0]))
    known = {cause.key for cause, _ in chosen}
    every += [(cause, cause.variants[0]) for cause in shown if cause.seen and cause.key not in known]
    for cause in shown:
        wrong = cause.error and cause.variants[0][0].number in numbers
        if wrong and cause.key not in known:
            every.append((cause, cause.variants[0]))
    if blind:
        left = [cause for cause in shown if not cause.seen]
        every += [(cause, form) for cause in left for form in cause.forms if (cause, form) not in every]
    return every


def rough_fits(
    sketch: Problem,
    chosen: Sequence[tuple[Cause, Variant]],
    extended: Sequence[Parameter],
    starts: Sequence[Mapping[str, float]],
    settings: SearchSettings,
    known: float | None = None,
) -> list[tuple[Fit, Cause, Variant]]:
    """A few iterations for each variant, least cost first; effects that are far behind get one.

    What stands in a place and what is tried there may do much the same, or nothing alike: the optimum of the model with
    it is a start, and that of the model without it another.

    Args:
        sketch: of the data.
        chosen: what is tried, the best of the screen first.
        extended: parameters of the model.
        starts: their values, of which each variant goes on from the one that leads further.
        settings: thresholds.
        known: cost of the cause in whose place they are tried, which effects are held against, too.
    """
    foreseen = {cause.key for cause, _ in chosen[: settings.foreseen]}
    rough: list[tuple[Fit, Cause, Variant]] = []
    first = [[fit(sketch, merge(extended, variant), here, 1) for here in starts] for _, variant in chosen]
    least = min((found.cost for each in first for found in each), default=0.0)
    least = least if known is None else min(least, known)
    for each, (cause, variant) in zip(first, chosen, strict=True):
        further = [
            fit(sketch, merge(extended, variant), found.values, settings.rough_iterations - 1)
            for found in each
            if found.cost < settings.hopeless_cost * least or cause.error or cause.key in foreseen
        ]
        rough.append((min(further or each, key=lambda one: one.cost), cause, variant))
    return sorted(rough, key=lambda row: charged(*row, settings))


def charged(found: Fit, cause: Cause, variant: Variant, settings: SearchSettings) -> float:
    """Cost of a fit, higher by ``form_charge`` for another than the usual form of its cause."""
    return found.cost * (1.0 if cause.is_usual(variant) else settings.form_charge)
