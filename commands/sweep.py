"""Search for the values that a training does best with: Hydra's multirun, with Optuna choosing.

    sealegs sweep env=bench agent.n_steps=16,32 agent.gamma=0.9,0.95        each combination once
    sealegs sweep env=bench "agent.learning_rate=tag(log,interval(1e-4,1e-2))" trials=30 workers=4 name=mine
    sealegs sweep env=bench agent.n_steps=16,32 seeds=3                     each trial is the mean of three seeds
    sealegs sweep resume=runs/mine                                          go on after a stop or a kill
    sealegs sweep resume=runs/mine trials=60                                go on for longer
    sealegs sweep resume=runs/mine env=mine.py:Mine         of a task in a file of one's own: it is run, so name it
    sealegs sweep env=bench agent.n_steps=16,32 cluster=ray                 on a Ray cluster
    sealegs train --multirun env=bench agent.n_steps=16,32                  the same as sealegs sweep

Every other key is one of sealegs train, with one value or several: a,b,c, choice(a,b), range(1,5), interval(0.9,0.99),
int(interval(1,9)), tag(log,interval(1e-4,1e-2)). A trial is a run of sealegs train in that folder. What counts is
the mean reward of its final policy, over the same episodes for all. A trial that is stopped or loses its machine goes
on from its checkpoint, one that failed is tried again by resume=, and one that is finished is never trained again.
trials.md has them all, the best first.
"""

from __future__ import annotations


def main(arguments: list[str]) -> None:
    """Begin or go on with the sweep that the command line describes."""
    from ..agents.sweep import read_sweep, sweep  # here, so that --help does not wait for torch

    sweep(read_sweep(arguments))
