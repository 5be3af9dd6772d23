"""The bench as Gymnasium environments."""

from __future__ import annotations

from ..engine.single import SingleEnv
from ..engine.vector import BatchVectorEnv
from .task import BenchTask


class BenchEnv(SingleEnv, task=BenchTask):
    r"""
    ## Description
    A servo on a stand turns a pendulum, a point mass at the end of a uniform rod. The task is to bring the pendulum to
    an angle and to hold it there, against gravity and the imperfections of the actuation chain.

    ## Action Space
    The action space is a `Box(-1, 1, (1,), float32)`: the position goal of the servo.

    | Num | Action            | Min | Max | Goal at -1 | Goal at 1 | Coordinate | Type (Unit) |
    |-----|-------------------|-----|-----|------------|-----------|------------|-------------|
    | 0   | Goal of the servo | -1  | 1   | -3.1416    | 3.1416    | joint      | angle (rad) |

    ## Observation Space
    The observation space is a `Box(-Inf, Inf, (6,), float32)`. Angles are counter-clockwise; at 0 the pendulum hangs.

    | Num | Observation        | Source                                                           | Unit  |
    |-----|--------------------|------------------------------------------------------------------|-------|
    | 0   | target             | command                                                          | rad   |
    | 1   | angle of pendulum  | link encoder, ideal                                              | rad   |
    | 2   | angle of motor     | motor encoder of the chain: its ticks, offset, scale and latency | rad   |
    | 3   | speed of pendulum  | difference of 1 over the last control step                       | rad/s |
    | 4   | speed of motor     | difference of 2 over the last control step                       | rad/s |
    | 5   | last action        | memory                                                           | -     |

    ## Rewards
    The reward is ***tracking - energy***; `info` holds each term, and the flags `net_out_of_range` and `unstable` (see
    `HopperEnv`).

    - *reward_tracking*: $w_{tracking} (1 - \min(|q - q_{target}|, 1))$.
    - *reward_energy*: $-w_{energy} |\tau \omega|$ of the motor [W].

    ## Starting State
    The pendulum hangs; its angle [rad] and speed [rad/s] have uniform noise of $\pm$ `start_noise`. The target is uniform in
    $\pm$ `target_range`. Then `randomization` is drawn.

    ## Episode End
    ### Termination
    Only if the simulation is unstable.

    ### Truncation
    After 250 steps (5 s).

    ## Arguments

    ## Version History
    * v0: initial version.
    """  # noqa: E501


class BenchVectorEnv(BatchVectorEnv, task=BenchTask):
    """Many :class:`BenchEnv` side by side, with the same arguments."""
