"""The leg as Gymnasium environments."""

from __future__ import annotations

from ..engine.single import SingleEnv
from ..engine.vector import BatchVectorEnv
from .task import LegTask


class LegEnv(SingleEnv, task=LegTask):
    r"""
    ## Description
    One leg of the quadruped SILO4 of paper 000 ("On finding the relevant dynamics for model based controlling walking
    robots"), on a stand. It has three joints, and DC motors behind planetary and skew-axis gears of 246:1 and 287:1, whose
    friction is larger than any torque that the leg's own mass requires. The task is to move the foot to and fro along a
    line, bang-bang in acceleration. The argument `actuator` chooses the drives.

    ## Action Space
    The action space is a `Box(-1, 1, (3,), float32)`: corrections of the joints' goals, which are the joint angles of the
    path, every 2 ms. The correction follows the action with a time constant of `correction_time`. Goals pass the
    actuation chain (digital PID, bridge, motor, gears with meshing friction) inside the physics engine.

    | Num | Action                  | Min | Max | Correction at -1 | Correction at 1 | Joint   | Type (Unit) |
    |-----|-------------------------|-----|-----|------------------|-----------------|---------|-------------|
    | 0   | correction of joint 1   | -1  | 1   | -0.004           | 0.004           | joint_1 | angle (rad) |
    | 1   | correction of joint 2   | -1  | 1   | -0.004           | 0.004           | joint_2 | angle (rad) |
    | 2   | correction of joint 3   | -1  | 1   | -0.004           | 0.004           | joint_3 | angle (rad) |

    Joint 1 turns the leg about the vertical, joint 2 lifts link 2 from the horizontal, joint 3 lifts link 3 from the
    line of link 2; goals stay within -1.2 to 1.2, -0.7 to 0.9 and -2.3 to -0.5 rad.

    ## Observation Space
    The observation space is a `Box(-Inf, Inf, (21,), float32)` of what the on-board computer knows; each row has all three
    joints, in order.

    | Num   | Observation                  | Source                                                           | Unit   |
    |-------|------------------------------|------------------------------------------------------------------|--------|
    | 0-2   | reference                    | path, `preview` ahead                                            | rad    |
    | 3-5   | reference speed              | path, over the next 10 ms                                        | rad/s  |
    | 6-8   | reference acceleration       | path, over the next 20 ms                                        | rad/s2 |
    | 9-11  | reference less reading       | motor encoder of the chain: its ticks, offset, scale and latency | rad    |
    | 12-14 | speed                        | difference of the reading over the last control step             | rad/s  |
    | 15-17 | correction                   | memory                                                           | rad    |
    | 18-20 | last action                  | memory                                                           | -      |

    ## Rewards
    The reward is ***tracking - energy***; `info` holds each term, and the flags `net_out_of_range` and `unstable` (see
    `HopperEnv`).

    - *reward_tracking*: $w_{tracking} (1 - \min(|p - p_{path}| / 0.001, 1))$ with the position $p$ of the foot [m].
    - *reward_energy*: $-w_{energy}$ times the mean power that the motors give [W].

    ## Starting State
    The leg is at rest at the start of the path, with uniform noise of $\pm$ `start_noise` rad on the joint angles. Start and
    end of the path are uniform in a box of 12 x 24 x 14 cm below the level of the first joint; the mean speed of the foot
    is drawn from `speed`. Then `randomization` is drawn.

    ## Episode End
    ### Termination
    Only if the simulation is unstable.

    ### Truncation
    After 400 steps (4 s).

    ## Arguments

    ## Version History
    * v0: initial version.
    """  # noqa: E501


class LegVectorEnv(BatchVectorEnv, task=LegTask):
    """Many :class:`LegEnv` side by side, with the same arguments."""
