"""The layers of an actuator net in torch, and its file."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.atomic import written
from ..common.errors import SealegsError
from ..common.extras import needed_for

Array = NDArray[np.float64]


def require_torch() -> Any:
    """The torch module.

    Raises:
        SealegsError: it is not installed.
    """
    with needed_for("Training a net"):
        import torch
    return torch


def build(torch: Any, inputs: int, hidden: tuple[int, ...]) -> Any:
    """A torch net of the kind that :mod:`actuators.stages.net` evaluates: softsign layers, one linear output."""
    sizes = [inputs, *hidden]
    layers: list[Any] = []
    for wide, high in itertools.pairwise(sizes):
        layers += [torch.nn.Linear(wide, high), torch.nn.Softsign()]
    return torch.nn.Sequential(*layers, torch.nn.Linear(sizes[-1], 1))


def flat_weights(net: Any) -> Array:
    """Weights and biases of a torch net, layer by layer, as the compiled law reads them."""
    return np.concatenate([np.ravel(value.detach().numpy()) for value in net.parameters()]).astype(float)


def evaluate(arrays: dict[str, np.ndarray], inputs: Array) -> Array:
    """Torque of a net [N.m], (n,), for inputs (n, 2 history): errors before speeds, newest first."""
    x = (inputs - arrays["input_mean"]) / arrays["input_std"]
    sizes, at = [int(size) for size in arrays["layers"]], 0
    for layer, (wide, high) in enumerate(itertools.pairwise(sizes)):
        matrix = arrays["weights"][at : at + wide * high].reshape(high, wide)
        at += wide * high
        x = x @ matrix.T + arrays["weights"][at : at + high]
        at += high
        if layer < len(sizes) - 2:
            x = x / (1.0 + np.abs(x))
    return x[:, 0] * float(arrays["torque_scale"])


def write_net(arrays: dict[str, np.ndarray], path: Path) -> None:
    """Write a net's file, whole or not at all.

    Raises:
        SealegsError: the file exists already.
    """
    try:
        with written(path) as unfinished, unfinished.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)
    except FileExistsError:
        raise SealegsError(f"{path} exists already and nothing is overwritten; give another name.") from None
