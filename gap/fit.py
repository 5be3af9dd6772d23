"""Three numbers from a log, for people who want no diagnosis: values that fit best, each with its interval."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..common.errors import SealegsError, nearest
from .causes import Cause, JointModel, Parameter, factor
from .log.reader import InMemory
from .replay.comparison import rms

Bounds = tuple[float, float] | None


@dataclass(frozen=True)
class FittedValue:
    """One number.

    Attributes:
        value: that fits best.
        low, high: ends of its 95 % interval.
        unit: of all of them.
        believed: value of the model before; 0 where it lacks the effect.
        at_bound: whether the fit would go beyond the bounds.
    """

    value: float
    low: float
    high: float
    unit: str
    believed: float
    at_bound: bool = False


@dataclass(frozen=True)
class Fitted:
    """What :func:`fit` found.

    Attributes:
        joint: whose numbers they are.
        values: by the names that were asked for.
        signal: column that was fitted most, such as ``servo.position``.
        unit: of the errors.
        error_before, error: root of the mean squared error of that column with the numbers as believed, and as fitted.
    """

    joint: str
    values: Mapping[str, FittedValue]
    signal: str
    unit: str
    error_before: float
    error: float

    def __str__(self) -> str:
        rows = [
            f"{name} = {v.value:.4g} ({v.low:.4g} to {v.high:.4g}) {v.unit}{', at its bound' if v.at_bound else ''}"
            for name, v in self.values.items()
        ]
        return "\n".join([*rows, f"error of {self.signal}: {self.error_before:.3g} to {self.error:.3g} {self.unit}"])


def fit(
    log: str | Path | InMemory,
    parameters: str | Sequence[str] | Mapping[str, Bounds],
    *,
    joint: str | None = None,
    sidecar: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None,
    seed: int = 0,
) -> Fitted:
    """Fit numbers of a joint's model to a measured log, by the error of its simulation; all others stay as believed.

    Nothing is searched, chosen or judged: what the model lacks goes into the numbers. :func:`sealegs.diagnose` tells
    whether these are the ones that are wrong.

    Args:
        log: a file or a folder of them, or columns in memory, as :func:`sealegs.diagnose` takes them.
        sidecar: for columns in memory, the content of the YAML beside a log.
        parameters: names as in ``diagnosis.json``, such as ``friction.coulomb``, ``delay.seconds`` or
            ``load.payload``; or by name the least and the largest value. Without bounds (None), a number that the model
            has is tried up to fivefold either way, and one that it lacks as the catalogue of causes tries it.
        joint: its name; None: the only one that the log commands.
        seed: of the bootstrap behind the intervals.

    Raises:
        SealegsError: the log cannot be read or replayed, or there is no such joint or number.
    """
    from .finder.diagnosis import prepared
    from .log.types import MeasuredSet
    from .prepare.columns import commanded
    from .prepare.request import Request
    from .search.fit import fit as fitted_to
    from .search.intervals import intervals

    if isinstance(log, str | Path):
        from .checks.long import read_bounded

        data: MeasuredSet = read_bounded(Path(log), progress=lambda text: None)
    else:
        from .log.reader import measured_set

        data = measured_set(log, sidecar)
    if isinstance(parameters, str):
        parameters = [parameters]
    known = commanded(data.runs)
    if joint is None and len(known) != 1:
        raise SealegsError(f"the log commands {', '.join(known)}: say which with joint=.")
    name = joint if joint is not None else known[0]
    if name not in known:
        raise SealegsError(f"the log commands no joint '{name}'{nearest(name, known)}; there are {', '.join(known)}.")
    replay = prepared(data, name, Request(seed=seed))
    problem = replay.problem
    assert problem.joint is not None
    nominal = problem.joint.models[0]
    asked = parameters if isinstance(parameters, Mapping) else dict.fromkeys(parameters)
    if not asked:
        raise SealegsError("parameters= names no number; give such as ['friction.coulomb', 'friction.viscous'].")
    turned = {path: _parameter(path, bounds, nominal, replay.causes) for path, bounds in asked.items()}
    numbers = {p.number for p in turned.values()}
    chosen = [*turned.values(), *(p for p in nominal.unknown if p.number not in numbers)]  # which nobody knows
    first = fitted_to(replay.fitting, chosen)
    found = fitted_to(problem, chosen, first.values)
    ends, values = intervals(problem, chosen, found, seed), {}
    for path, p in turned.items():
        value, low, high = (p.physical(x, nominal) for x in (found.values[p.path], *ends[p.path]))
        unit = nominal.unit(p.number) if p.factor else p.unit
        values[path] = FittedValue(value, low, high, unit, nominal.value(p.number), p.path in found.at_bound)
    column, unit = problem.signal
    before, after = (rms(problem.position_error(row)) for row in (problem.simulate([{}])[0], found.simulated))
    return Fitted(name, values, f"{name}.{column}", unit, before, after)


def _parameter(
    path: str, bounds: tuple[float, float] | None, nominal: JointModel, causes: Sequence[Cause]
) -> Parameter:
    """What a fit turns for the number ``path``."""
    from .search.settings import DEFAULT

    try:
        believed = nominal.value(path)
    except (SealegsError, AttributeError, LookupError, StopIteration) as error:
        raise SealegsError(
            f"parameters: the joint has no number '{path}'; names are as in docs/actuators.md and diagnosis.json."
        ) from error
    if bounds is not None:
        low, high = (float(end) for end in bounds)
        if not low < high:
            raise SealegsError(f"parameters: {path} has the bounds {low:g} and {high:g}; the lower one comes first.")
        start = min(max(believed, low + 0.1 * (high - low)), high - 0.1 * (high - low))
        return Parameter(path, nominal.unit(path), low, high, start, 0.1 * (high - low))
    if believed > 0.0:
        most = 1.0 + DEFAULT.refitted_by
        return factor(path, 1.0 / most, most, 0.15)
    tried = [p for cause in causes for variant in cause.variants for p in variant if path in (p.number, p.path)]
    if not tried:
        raise SealegsError(f"parameters: the model has no '{path}', which would say how large it may be; give bounds.")
    return tried[0]
