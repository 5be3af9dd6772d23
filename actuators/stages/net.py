"""Actuator net: a small network from the history of position error and speed to torque.

It samples at the rate that it was trained at. ``train_net.py`` makes one from measured logs.
"""

from __future__ import annotations

import functools
import itertools
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ...common.documents import DocumentError, load_arrays
from ..compiled import compiled
from ..layout import S_GOAL, S_OUT_OF_RANGE, S_READING, S_SPEED
from .base import ChainError, Law, Quantity, Stage, parameter, register
from .parity import EVEN, ODD

SIZE = 2**28  # [B] of a net at most
FORMAT = "sealegs actuator net 1"
REQUIRED = (
    "format",
    "period",
    "history",
    "input_mean",
    "input_std",
    "input_low",
    "input_high",
    "torque_scale",
    "weights",
    "layers",
)


@functools.lru_cache(maxsize=32)
def read_net(path: Path, modified: float) -> dict[str, np.ndarray]:
    """Arrays of a net file (``.npz``), keyed as in :data:`REQUIRED`. ``modified`` only makes a changed file a new one.

    Raises:
        ChainError: the file is no actuator net.
    """
    del modified
    try:
        net = {key: value for key, value in load_arrays(path, SIZE).items() if value is not None}
    except DocumentError as error:
        raise ChainError(
            f"{path} is not a readable actuator net: it {error.problem}; train one with train_net.py."
        ) from None
    missing = [key for key in REQUIRED if key not in net]
    if missing or str(net["format"]) != FORMAT:
        raise ChainError(f"{path} is not an actuator net of the format '{FORMAT}'; train one with train_net.py.")
    if (fault := _fault(net)) is not None:
        raise ChainError(f"{path} is a damaged actuator net: {fault}; train it again with train_net.py.")
    return net


def _fault(net: dict[str, np.ndarray]) -> str | None:
    """What makes a net unusable, in words; None for a sound one."""
    for key in REQUIRED[1:]:
        if net[key].dtype.kind not in "iuf" or not np.isfinite(net[key]).all():
            return f"'{key}' holds something that is no finite number"
        if net[key].size != 1 and key in ("period", "history", "torque_scale"):
            return f"'{key}' is not one number"
    layers, history = [int(size) for size in np.ravel(net["layers"])], int(net["history"])
    if float(net["period"]) <= 0.0 or history < 1:
        return f"its period is {float(net['period']):g} s and its history {history} samples, which must be positive"
    if len(layers) < 2 or min(layers) < 1 or layers[0] != 2 * history or layers[-1] != 1:
        return f"its layers are {layers}, but a history of {history} needs {2 * history} inputs, and one output"
    weights = sum((wide + 1) * high for wide, high in itertools.pairwise(layers))
    if net["weights"].size != weights:
        return f"its layers {layers} need {weights} weights, but it has {net['weights'].size}"
    for key in ("input_mean", "input_std", "input_low", "input_high"):
        if net[key].size != layers[0]:
            return f"'{key}' has {net[key].size} numbers for {layers[0]} inputs"
    if (net["input_std"] <= 0.0).any():
        return "'input_std' must be positive"
    return None


@register
@dataclass(frozen=True, kw_only=True)
class Net(Stage):
    """Torque from a trained network.

    The sample period is the net's own: the engine calls it at those times, whatever its step.
    """

    name: ClassVar[str] = "net"
    after: ClassVar[str] = "derivative"
    derived: ClassVar[tuple[str, ...]] = ("period", "history", "torque_scale", "layers")
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.POSITION_GOAL,)
    gives: ClassVar[Quantity | None] = Quantity.TORQUE

    file: str = field(metadata={"parity": EVEN})
    """Path of the net (.npz); a relative path is looked for beside the chain's file, then from the checkout."""
    direction: float = parameter(
        1.0,
        "-",
        -1.0,
        1.0,
        "-1: turned, for an angle that counts against that of its training",
        parity=ODD,
        in_law=False,
    )
    rate: float = parameter(
        0.0, "Hz", 0.0, 1e5, "rate the user expects; 0: that of the training", parity=EVEN, in_law=False
    )
    armature: float = parameter(0.0, "kg.m2", 0.0, 1e3, "rotor inertia at the joint", parity=EVEN, in_law=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if abs(self.direction) != 1.0:
            raise ChainError(f"net.direction is {self.direction:g}; it must be 1 or -1.")
        trained = 1.0 / self.period()
        if self.rate > 0.0 and abs(trained - self.rate) > 0.01 * trained:
            raise ChainError(
                f"{self.file} was trained at {trained:g} Hz but the chain asks for {self.rate:g} Hz; "
                f"train a net at {self.rate:g} Hz or remove 'rate' to run it at its own."
            )

    def period(self) -> float:
        """Sample period of the net [s]."""
        return float(self.arrays()["period"])

    def arrays(self) -> dict[str, np.ndarray]:
        """The net's file as arrays."""
        path = Path(self.file)
        if not os.path.isfile(path):
            raise ChainError(f"there is no actuator net at {path}; train one with train_net.py or correct 'file'.")
        return read_net(path, path.stat().st_mtime)

    def law_values(self, chain: Any) -> dict[str, float]:
        del chain
        net = self.arrays()
        values = {name: float(net[name]) for name in ("period", "history", "torque_scale")}
        values["torque_scale"] *= self.direction
        return {**values, "layers": float(len(net["layers"]))}

    def law_tail(self) -> list[float]:
        """Sizes of the layers, then statistics of the inputs, then weights.

        Turned, the net gives minus the torque that it gives for minus its inputs: their statistics and the weights of
        the first layer change sign, as the torque does in :meth:`law_values`. That is exact, to the last bit.
        """
        net = self.arrays()
        keys = ("layers", "input_mean", "input_std", "input_low", "input_high", "weights")
        layers, mean, std, low, high, weights = (np.ravel(net[key]).astype(float) for key in keys)
        if self.direction < 0.0:
            mean, low, high = -mean, -high, -low
            first = int(layers[0] * layers[1])
            weights = np.concatenate([-weights[:first], weights[first:]])
        return np.concatenate([layers, mean, std, low, high, weights]).tolist()

    def memory_size(self) -> int:
        net = self.arrays()
        history = int(net["history"])
        widest = max(int(size) for size in net["layers"])
        return 2 + 2 * history + 2 * widest


NET = Net.offsets()
TAIL = len(NET)  # where the tail starts in the record


@compiled()
def start_net(p, i, s, m, goal):
    """Forget the past: error and speed have always been what they are."""
    s[m] = -1e30  # time of the next sample
    s[m + 1] = 0.0
    history = int(p[i + NET.history])
    for k in range(history):
        s[m + 2 + k] = goal - s[S_READING]
        s[m + 2 + history + k] = s[S_SPEED]
    return goal


@compiled(fastmath=True)
def sample_net(p, i, s, m, time, goal):
    """Sample the inputs and evaluate the net, if its time has come. Newest sample first, errors before speeds."""
    if s[m] > -1e29 and time < s[m] - 1e-9:
        return
    history, period = int(p[i + NET.history]), p[i + NET.period]
    due = (s[m] if s[m] > -1e29 else time) + period
    s[m] = due if due > time else time + period
    for k in range(history - 1, 0, -1):
        s[m + 2 + k] = s[m + 1 + k]
        s[m + 2 + history + k] = s[m + 1 + history + k]
    s[m + 2] = goal - s[S_READING]
    s[m + 2 + history] = s[S_SPEED]
    layers = int(p[i + NET.layers])
    sizes = i + TAIL
    inputs = int(p[sizes])
    mean = sizes + layers
    now = m + 2 + 2 * history
    widest = 0
    for k in range(layers):
        widest = max(widest, int(p[sizes + k]))
    other = now + widest
    strange = 0.0
    for k in range(inputs):
        value = s[m + 2 + k]
        if value < p[mean + 2 * inputs + k] or value > p[mean + 3 * inputs + k]:
            strange = 1.0
        s[now + k] = (value - p[mean + k]) / p[mean + inputs + k]
    s[S_OUT_OF_RANGE] += strange
    weight = mean + 4 * inputs
    for layer in range(layers - 1):
        wide, high = int(p[sizes + layer]), int(p[sizes + layer + 1])
        for row in range(high):
            at = weight + row * wide
            total = p[weight + high * wide + row]
            for k in range(wide):
                total += p[at + k] * s[now + k]
            s[other + row] = total / (1.0 + abs(total)) if layer < layers - 2 else total
        weight += high * wide + high
        now, other = other, now
    s[m + 1] = s[now] * p[i + NET.torque_scale]


@compiled()
def net_torque(p, i, s, m, time, value, first):
    """Torque of the net at its latest sample, for the goal ``value`` [N.m]."""
    s[S_GOAL] = value
    if first:
        sample_net(p, i, s, m, time, value)
    return s[m + 1]


Net.law = Law(start=start_net, act=net_torque)
