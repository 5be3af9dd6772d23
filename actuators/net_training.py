"""Trains an actuator net from recorded runs: history of position error and speed to torque.

Where no torque was measured, the net is fitted to the motion it must have caused, with the known inertia and gravity of
the load: over a window of ``2 K`` samples the second difference of the position is an exactly weighted sum of torques,

    q[n+K] - 2 q[n] + q[n-K] = sum_j T^2 (K - |j + 1/2|) (torque[n+j] - gravity[n+j]) / inertia,  j = -K .. K - 1,

for torques held over a sample period T, as the net's are. No velocity or acceleration is made from noisy positions.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.atomic import written
from ..common.errors import SealegsError
from ..common.extras import needed_for
from .stages.net import FORMAT

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


MARGIN = 0.05  # share of the training range that inputs may exceed it by without a flag (assumed)
JUMP = 0.05  # [rad] smallest change of a goal from one sample to the next that counts as a step (assumed)
SEGMENT = 64  # windows that are trained on together, because they share samples


@dataclass(frozen=True, eq=False)
class TrainingRun:
    """One recording of one joint; arrays of shape (n,).

    Attributes:
        name: for messages.
        time: [s].
        goal: commanded position [rad].
        position: of the motor side [rad].
        velocity: [rad/s]; None: from the positions.
        torque: at the shaft [N.m]; None: the motion is the target.
        inertia: of the load [kg.m2], where no torque was measured.
        gravity: torque of the load at a quarter turn [N.m]; 0 rad hangs.
        armature: inertia that the simulation will have at the joint beside the net [kg.m2].
        usable: samples that count, such as those with the drive on; None: all.
    """

    name: str
    time: Array
    goal: Array
    position: Array
    velocity: Array | None = None
    torque: Array | None = None
    inertia: float = 0.0
    gravity: float = 0.0
    armature: float = 0.0
    usable: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class Settings:
    """How a net is trained.

    Attributes:
        rate: samples per second [Hz]; None: that of the runs.
        history: samples of error and of speed that the net sees.
        hidden: sizes of the hidden layers.
        window: half the time over which motion is matched [s].
        validation: share of the runs that training never sees.
        epochs: most passes over the training runs.
        patience: passes without a better validation after which training stops.
        batch: segments of windows per gradient step.
        learning_rate: of Adam, falling to a hundredth over the epochs.
        seed: of the split, the first weights and the order.
    """

    rate: float | None = None
    history: int = 4
    hidden: tuple[int, ...] = (32, 32)
    window: float = 0.03
    validation: float = 0.25
    epochs: int = 200
    patience: int = 30
    batch: int = 16
    learning_rate: float = 5e-3
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Prepared:
    """A run as the net is trained on it: inputs at the net's rate, and weighted sums of torques to match.

    Attributes:
        name: of the run.
        inputs: (n, 2 history), errors before speeds, newest first.
        weights: (k,) of the torques in a window.
        target: (n - k + 1,) weighted torque of each window [N.m].
        kept: windows that count.
        time: middle of each window [s].
    """

    name: str
    inputs: Array
    weights: Array
    target: Array
    kept: NDArray[np.bool_]
    time: Array


@dataclass(eq=False)
class TrainedNet:
    """A net with the figures of its training.

    Attributes:
        arrays: content of the net's file.
        validation: runs that training never saw.
        rms: of the torque on them [N.m].
        r2: share of their torque's variance that the net explains.
        epochs: passes done.
        stopped: whether a person stopped it.
        history: (train, validation) rms of each epoch [N.m].
    """

    arrays: dict[str, np.ndarray]
    validation: list[Prepared]
    rms: float
    r2: float
    epochs: int
    stopped: bool
    history: list[tuple[float, float]] = field(default_factory=list)


def common_rate(runs: Sequence[TrainingRun]) -> float:
    """Sample rate of most runs [Hz], rounded to whole numbers."""
    return float(max(1, round(1.0 / float(np.median([np.median(np.diff(run.time)) for run in runs])))))


def prepare(run: TrainingRun, settings: Settings, rate: float) -> Prepared:
    """Bring a run to the net's rate and set up what it must match.

    Raises:
        SealegsError: the run is too short, too slow or lacks what the target is made of.
    """
    period = 1.0 / rate
    if float(np.median(np.diff(run.time))) > 1.5 * period:
        own = 1.0 / float(np.median(np.diff(run.time)))
        raise SealegsError(
            f"{run.name} was sampled at {own:.0f} Hz, which cannot train a net of {rate:g} Hz; lower the rate."
        )
    if run.torque is None and run.inertia + run.armature <= 0.0:
        raise SealegsError(
            f"{run.name} has neither a torque column nor the inertia of its load; a net needs one of them."
        )
    pointwise = run.torque is not None and run.armature == 0.0
    reach = 0 if pointwise else max(2, round(settings.window * rate))
    count = int((run.time[-1] - run.time[0]) * rate + 1e-6) + 1
    if count < settings.history + 2 * reach + 8:
        raise SealegsError(f"{run.name} is too short to train on: {count} samples at {rate:g} Hz.")
    time = run.time[0] + period * np.arange(count)
    before = np.clip(np.searchsorted(run.time, time + 1e-9, side="right") - 1, 0, len(run.time) - 1)
    goal, position = run.goal[before], np.interp(time, run.time, run.position)
    velocity = np.gradient(position, period) if run.velocity is None else np.interp(time, run.time, run.velocity)
    error = goal - position
    lags = np.maximum(np.arange(count)[:, None] - np.arange(settings.history)[None], 0)
    inputs = np.concatenate([error[lags], velocity[lags]], axis=1)
    usable = np.ones(count, bool) if run.usable is None else run.usable[before].copy()
    usable &= time - run.time[before] < 3.0 * period  # not across a gap in the log
    weights, target = _target(run, time, position, reach, period)
    kept = np.array([usable[k : k + len(weights) + 1].all() for k in range(len(target))])
    if run.torque is not None:  # half of a held torque lies behind the next goal, which no net can foresee
        change = np.diff(goal)
        sudden = np.abs(change) > np.maximum(JUMP, 2.0 * np.abs(np.append(0.0, change[:-1])))
        kept &= ~sudden[reach : reach + len(target)]
    middle = time[reach : reach + len(target)]
    return Prepared(run.name, inputs[: len(target) + len(weights) - 1], weights, target, kept, middle)


def _target(run: TrainingRun, time: Array, position: Array, reach: int, period: float) -> tuple[Array, Array]:
    """Weights of the torques in a window, and the weighted torque that the run shows."""
    if run.torque is not None:
        torque = np.interp(time, run.time, run.torque)
        held = 0.5 * (torque[1:] + torque[:-1])  # mean over the period in which the net will hold its output
    else:
        middle = 0.5 * (position[1:] + position[:-1])
        held = run.gravity * np.sin(middle)
    if reach == 0:
        return np.ones(1), held
    j = np.arange(-reach, reach)
    weights = (reach - np.abs(j + 0.5)) / reach**2
    bend = position[2 * reach :] - 2.0 * position[reach:-reach] + position[: -2 * reach]
    acceleration = bend / (reach * period) ** 2
    moved = run.armature if run.torque is not None else run.inertia + run.armature
    return weights, np.convolve(held, weights[::-1], mode="valid") + moved * acceleration


def predict(arrays: dict[str, np.ndarray], run: Prepared) -> Array:
    """What a net makes of a prepared run: weighted torque of each window [N.m]."""
    return np.convolve(evaluate(arrays, run.inputs), run.weights[::-1], mode="valid")


def train(
    runs: Sequence[TrainingRun],
    settings: Settings,
    progress: Callable[[int, float, float], None] | None = None,
) -> TrainedNet:
    """Train a net; Ctrl-C ends the training and keeps the best net so far.

    Args:
        runs: at least two.
        settings: of net and training.
        progress: called after each epoch with its number and the rms on training and validation runs [N.m].

    Raises:
        SealegsError: the runs do not suffice, or torch is missing.
        KeyboardInterrupt: Ctrl-C came before the end of the first epoch.
    """
    torch = require_torch()
    if len(runs) < 2:
        raise SealegsError(
            "a net needs at least two runs: one of them is kept to test it on; record more, or split it."
        )
    rate = settings.rate or common_rate(runs)
    rng = np.random.default_rng(settings.seed)
    prepared = [prepare(run, settings, rate) for run in runs]
    order = rng.permutation(len(prepared))
    held_out = min(max(1, round(settings.validation * len(prepared))), len(prepared) - 1)
    validation, training = [prepared[k] for k in order[:held_out]], [prepared[k] for k in order[held_out:]]
    inputs = np.concatenate([run.inputs for run in training])
    targets = np.concatenate([run.target[run.kept] for run in training])
    if len(targets) < 10 * SEGMENT or np.ptp(targets) == 0.0:
        raise SealegsError(
            "the training runs hold too little usable motion to train a net; record longer or livelier ones."
        )
    mean, scale = inputs.mean(axis=0), float(targets.std())
    std = np.maximum(inputs.std(axis=0), 1e-9)
    torch.manual_seed(settings.seed)
    torch.set_default_dtype(torch.float64)  # as the compiled law computes
    try:
        net = build(torch, inputs.shape[1], settings.hidden)
        best, history, stopped = _optimise(
            torch,
            net,
            training,
            validation=validation,
            settings=settings,
            scales=(mean, std, scale),
            rng=rng,
            progress=progress,
        )
    finally:
        torch.set_default_dtype(torch.float32)
    net.load_state_dict(best)
    span = np.ptp(inputs, axis=0) * MARGIN
    arrays = {
        "format": np.array(FORMAT),
        "period": np.array(1.0 / rate),
        "history": np.array(settings.history),
        "layers": np.array([inputs.shape[1], *settings.hidden, 1]),
        "input_mean": mean,
        "input_std": std,
        "input_low": inputs.min(axis=0) - span,
        "input_high": inputs.max(axis=0) + span,
        "torque_scale": np.array(scale),
        "weights": flat_weights(net),
        "training_runs": np.array([run.name for run in training]),
        "validation_runs": np.array([run.name for run in validation]),
    }
    truth = np.concatenate([run.target[run.kept] for run in validation])
    guess = np.concatenate([predict(arrays, run)[run.kept] for run in validation])
    rms = float(np.sqrt(np.mean((guess - truth) ** 2)))
    arrays["validation_rms"] = np.array(rms)
    variance = float(np.var(truth))
    r2 = 1.0 - rms**2 / variance if variance > 0.0 else 0.0
    return TrainedNet(arrays, validation, rms, r2, len(history), stopped, history)


def _optimise(
    torch: Any, net: Any, training: Any, validation: Any, settings: Any, scales: Any, rng: Any, progress: Any
) -> Any:
    """Adam with early stopping; returns the best weights, the rms of each epoch, and whether a person stopped it."""
    mean, std, scale = scales

    def tensors(run: Prepared) -> tuple[Any, Any]:
        starts = np.arange(0, len(run.target) - SEGMENT + 1, SEGMENT)
        starts = [k for k in starts if run.kept[k : k + SEGMENT].any()]
        wide = SEGMENT + len(run.weights) - 1
        x = (
            np.stack([(run.inputs[k : k + wide] - mean) / std for k in starts])
            if starts
            else np.empty((0, wide, len(mean)))
        )
        y = np.stack([np.where(run.kept, run.target, np.nan)[k : k + SEGMENT] for k in starts]) if starts else None
        y = np.empty((0, SEGMENT)) if y is None else y
        return torch.tensor(x), torch.tensor(y / scale)

    def residual(x: Any, y: Any, weights: Any) -> Any:
        torque = net(x)[..., 0].unfold(1, len(weights), 1) @ weights
        return (torque - y)[~torch.isnan(y)]

    sets = []
    for group in (training, validation):
        kernels = {run.weights.tobytes(): torch.tensor(run.weights.copy()) for run in group}
        sets.append([(*tensors(run), kernels[run.weights.tobytes()]) for run in group])
    optimiser = torch.optim.Adam(net.parameters(), lr=settings.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(
        optimiser, settings.epochs, eta_min=0.01 * settings.learning_rate
    )
    best = {key: value.clone() for key, value in net.state_dict().items()}
    best_error, waited, history, stopped = math.inf, 0, [], False
    batches = [(run, k) for run, (x, _, _) in enumerate(sets[0]) for k in range(0, len(x), settings.batch)]
    orders = [rng.permutation(len(x)) for x, _, _ in sets[0]]
    try:
        for epoch in range(settings.epochs):
            squares, count = 0.0, 0
            for run, k in [batches[n] for n in rng.permutation(len(batches))]:
                x, y, weights = sets[0][run]
                rows = torch.tensor(orders[run][k : k + settings.batch])
                difference = residual(x[rows], y[rows], weights)
                if len(difference) == 0:
                    continue
                loss = (difference**2).mean()
                optimiser.zero_grad()
                loss.backward()
                optimiser.step()
                squares, count = squares + float((difference.detach() ** 2).sum()), count + len(difference)
            schedule.step()
            with torch.no_grad():
                unseen = torch.cat([residual(*run) for run in sets[1]])
                error = float((unseen**2).mean().sqrt()) if len(unseen) else math.sqrt(squares / max(count, 1))
            history.append((scale * math.sqrt(squares / max(count, 1)), scale * error))
            waited += 1
            if error < best_error:
                best_error, waited = error, 0
                best = {key: value.clone() for key, value in net.state_dict().items()}
            if progress is not None:
                progress(epoch + 1, *history[-1])
            if waited >= settings.patience:
                break
    except KeyboardInterrupt:
        if not history:  # the net is still as it was drawn
            raise
        stopped = True
    return best, history, stopped
