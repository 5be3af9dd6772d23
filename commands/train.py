"""Train a policy with PPO or SAC on a robot with any actuator chain.

    sealegs train                                       the hopper with its own servos
    sealegs train env=hopper actuator=ideal agent=sac   with ideal motors, by another algorithm
    sealegs train extended=diagnosis                    the machine as sealegs diagnose found it
    sealegs train agent.learning_rate=lin_1e-3 n_envs=16 seed=3 name=first
    sealegs train seeds=5 name=mine                     five runs, their interquartile mean and its interval
    sealegs train resume=runs/first                     go on after a stop, a crash or a kill -9
    sealegs train from=runs/first extended=diagnosis    begin with the policy of another run, on another model
    sealegs train resume=runs/first total_timesteps=2e6 go on for longer
    sealegs train --multirun agent.gamma=0.9,0.95       a run for each, see sealegs sweep --help
    sealegs train resume=runs/mine env=mine.py:Mine     of a task in a file of one's own: it is run, so name it

A run writes one folder: resolved config, versions and git revision, TensorBoard logs, evaluations, checkpoints, best
and final policy, video. Ctrl-C saves a checkpoint first.
"""

from __future__ import annotations


def main(arguments: list[str]) -> None:
    """Start or resume the run that the command line describes."""
    if {"-m", "--multirun"} & set(arguments):
        from .sweep import main as sweep

        return sweep([word for word in arguments if word not in ("-m", "--multirun")])
    from ..agents.config import read_config  # here, so that --help does not wait for torch
    from ..agents.training import train

    train(read_config(arguments))
