"""Many machines of one robot, of which every episode draws one: as a diagnosis leaves it open which of them it is.

chains: {hip: {friction.coulomb: [0.051, 0.049]}}   numbers of the chain of a coordinate, machine by machine
robot:  {foot_payload: [0.02, 0.05]}                numbers of the robot, machine by machine
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from mujoco.batch import MODEL_FIELDS, Batch

from ...actuators import Chain, Drivetrain
from ...common.errors import SealegsError, nearest

KINDS = ("chains", "robot")
Build = Callable[[Mapping[str, Chain], Mapping[str, float]], Drivetrain]
"""Makes the robot with chains, and with numbers in place of those that it has otherwise."""


class Machines:
    """Models of the machines, as what of each differs from the robot's own.

    Attributes:
        count: of the machines.
    """

    def __init__(self, drivetrain: Drivetrain, source: Mapping[str, Any], build: Build) -> None:
        """Build each machine.

        Args:
            drivetrain: of the robot itself.
            source: as in the module's docstring.
            build: makes a machine.

        Raises:
            SealegsError: the source is none, or a machine cannot be built or has another law.
        """
        chains, numbers = _checked(source, drivetrain.chains)
        self.count = len(next(iter((*numbers.values(), *(v for own in chains.values() for v in own.values())))))
        own = drivetrain.model
        self._fields: dict[str, np.ndarray] = {}
        for k in range(self.count):
            driven = dict(drivetrain.chains)
            for name, paths in chains.items():
                for path, values in paths.items():
                    driven[name] = driven[name].with_value(path, values[k])
            model = build(driven, {name: values[k] for name, values in numbers.items()}).model
            if (model.nq, model.nv, model.nu, model.nuserdata) != (own.nq, own.nv, own.nu, own.nuserdata):
                raise SealegsError(
                    f"machine {k + 1} of randomization.machines has other joints or another memory than the robot: "
                    "values must not reach to where a stage does nothing."
                )
            for name in MODEL_FIELDS:
                mine, other = _value(own, name), _value(model, name)
                if not isinstance(mine, np.ndarray) or mine.shape != np.shape(other) or np.array_equal(mine, other):
                    continue
                if name not in self._fields:
                    self._fields[name] = np.repeat(mine[None], self.count, axis=0)
                self._fields[name][k] = other

    def apply(self, batch: Batch, simulations: np.ndarray, random: np.ndarray) -> np.ndarray:
        """Let some simulations be of machines that are drawn by uniform numbers in [0, 1) (m,); which ones (m,)."""
        which = np.minimum((random * self.count).astype(int), self.count - 1)
        for name, values in self._fields.items():
            batch.expand(name)[simulations] = values[which].reshape(len(which), *batch.expand(name).shape[1:])
        return which


def _value(model: Any, name: str) -> Any:
    owner, key = (model.opt, name[4:]) if name.startswith("opt.") else (model, name)
    value = getattr(owner, key, None)
    return value if value is None or isinstance(value, np.ndarray) else np.asarray(value)


def _checked(
    source: Mapping[str, Any], chains: Mapping[str, Chain]
) -> tuple[dict[str, dict[str, list[float]]], dict[str, list[float]]]:
    """Numbers of chains and of the robot, of as many machines each."""
    if not isinstance(source, Mapping) or not source:
        raise SealegsError("randomization.machines must be the folder of a diagnosis, or numbers of chains and robot.")
    for kind in source:
        if kind not in KINDS:
            raise SealegsError(
                f"randomization.machines has no '{kind}'{nearest(kind, KINDS)}; there are chains, robot."
            )
    found, numbers = dict(source.get("chains") or {}), dict(source.get("robot") or {})
    for name in found:
        if name not in chains:
            raise SealegsError(
                f"randomization.machines.chains: the robot drives no '{name}'{nearest(name, chains)}; it drives "
                f"{', '.join(chains)}."
            )
    rows = {f"chains.{name}.{path}": row for name, own in found.items() for path, row in own.items()}
    rows |= {f"robot.{name}": row for name, row in numbers.items()}
    for where, row in rows.items():
        if not (isinstance(row, list | tuple) and row and all(_is_number(value) for value in row)):
            raise SealegsError(f"randomization.machines.{where} must be a list of numbers, one for each machine.")
    if len({len(row) for row in rows.values()}) != 1:
        counts = ", ".join(f"{where} {len(row)}" for where, row in rows.items())
        raise SealegsError(f"randomization.machines must have as many values of each number; there are: {counts}.")
    plain = {name: {path: list(map(float, row)) for path, row in own.items()} for name, own in found.items()}
    return plain, {name: list(map(float, row)) for name, row in numbers.items()}


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
