"""A first look in a terminal: per joint what moves it most, provisional."""

from __future__ import annotations

from collections.abc import Iterator

from ..log.finding import MAX_TOLD
from ..robot.together import FirstLook, told
from ..search.look import Look
from ..search.structure import fine
from .numbers import number

MIN_TOLD_NOISES = 1.0  # by which a number must move a joint to be told
PROVISIONAL = (
    "A first look, provisional: all usual numbers turned together, and no data held back to judge them. "
    "The diagnosis without look=true does that."
)


def lines_of(found: FirstLook) -> Iterator[str]:
    """Lines to print: what all joints share, then each joint."""
    yield PROVISIONAL
    if found.latency is not None:
        yield ""
        yield f"All joints: {told(found.latency)}, at {', '.join(found.latency.joints)}"
    for joint, seen in found.joints.items():
        unit = seen.problem.signal[1]
        before, after, noise = (fine(error, unit) for error in (*seen.errors, seen.problem.noise))
        yield ""
        yield f"{joint}: error {before} as believed, {after} with these numbers (noise {noise})"
        yield from list(_numbers(seen, unit))[:MAX_TOLD] or ["  nothing that would move it by more than the noise"]


def _numbers(seen: Look, unit: str) -> Iterator[str]:
    nominal = seen.problem.models[0]
    by_path = {p.path: p for p in seen.parameters}
    for path, moved in seen.effects().items():
        if moved < MIN_TOLD_NOISES * seen.problem.noise:
            continue
        parameter = by_path[path]
        ends = (seen.found.values[path], *seen.bounds[path])
        value, low, high = (number(parameter.physical(x, nominal)) for x in ends)
        of = nominal.unit(parameter.number) if parameter.factor else parameter.unit
        size = f"{value}{'' if of == '1' else ' ' + of}"
        believed = number(nominal.value(parameter.number))
        yield (
            f"  {seen.causes[path]:25s} {parameter.number} = {size} ({low} to {high}, model {believed}): "
            f"moves it by {fine(moved, unit)}"
        )
