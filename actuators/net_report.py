"""What the training of an actuator net leaves behind: net, chain, figures and picture."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from ..common.atomic import write_text
from ..common.extras import needed_for
from .chain import Chain
from .net_training import TrainedNet, predict, write_net
from .stages import Stage
from .stages.net import Net

SHOWN = 10.0  # [s] of an unseen run in the picture


def chain_from(net: Path, armature: float, behind: tuple[Stage, ...]) -> Chain:
    """A chain of a net and what stands behind it (friction, encoder, ...)."""
    return Chain((Net(file=str(net), armature=armature), *behind), "trained net")


def report(trained: TrainedNet, out: Path, armature: float, behind: tuple[Stage, ...], source: str) -> None:
    """Write net.npz, chain.yaml, training.json and torque.png into a folder that exists, and print the figures."""
    write_net(trained.arrays, out / "net.npz")
    chain = chain_from(out / "net.npz", armature, behind)
    text = chain.to_yaml().replace(str(out / "net.npz"), "net.npz")  # beside the chain: the folder can be moved
    write_text(out / "chain.yaml", f"# Actuator net trained by train_net.py from {source}.\n{text}")
    period, layers = float(trained.arrays["period"]), [int(size) for size in trained.arrays["layers"]]
    document = {
        "source": source,
        "rate": 1.0 / period,
        "history": int(trained.arrays["history"]),
        "layers": layers,
        "epochs": trained.epochs,
        "stopped": trained.stopped,
        "validation": {"rms": trained.rms, "r2": trained.r2, "runs": [run.name for run in trained.validation]},
        "training_runs": [str(name) for name in trained.arrays["training_runs"]],
        "learning": [{"train": a, "validation": b} for a, b in trained.history],
        "units": {"rms": "N.m", "rate": "Hz", "train": "N.m", "validation": "N.m"},
    }
    write_text(out / "training.json", json.dumps(document, indent=1) + "\n")
    unseen = ", ".join(run.name for run in trained.validation)
    print(f"{1 / period:g} Hz, layers {' - '.join(map(str, layers))}, {trained.epochs} epochs")
    print(f"on unseen runs ({unseen}): rms {trained.rms:.4f} N.m, {100 * trained.r2:.2f} % of the torque's variance")
    draw(trained, out / "torque.png")
    print(f"Written: {out}/chain.yaml, net.npz, training.json, torque.png")
    print(f"Train with it: sealegs train actuator={out}/chain.yaml")


def draw(trained: TrainedNet, path: Path) -> None:
    """Predicted and measured torque over time on an unseen run, and against each other on all of them.

    Raises:
        SealegsError: matplotlib is missing.
    """
    with needed_for("A picture"):
        from matplotlib.figure import Figure
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    over_time, cloud = figure.subplots(1, 2, width_ratios=(2.2, 1.0))
    run = trained.validation[0]
    shown = run.time - run.time[0] < SHOWN
    guess = predict(trained.arrays, run)
    truth = np.where(run.kept, run.target, np.nan)
    over_time.plot(run.time[shown], truth[shown], color="0.55", linewidth=2.0, label="measured")
    over_time.plot(run.time[shown], guess[shown], color="C3", linewidth=0.9, label="net")
    over_time.set(xlabel="time [s]", ylabel="torque [N.m]", title=f"unseen run: {run.name}")
    over_time.legend(frameon=False, loc="upper right")
    for item in trained.validation:
        cloud.scatter(predict(trained.arrays, item)[item.kept], item.target[item.kept], s=2, alpha=0.3, linewidths=0)
    low, high = cloud.get_ylim()
    cloud.plot([low, high], [low, high], color="black", linewidth=0.8)
    cloud.set(xlabel="net [N.m]", ylabel="measured [N.m]", title=f"all unseen runs: rms {trained.rms:.3f} N.m")
    for axes in (over_time, cloud):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=140)
