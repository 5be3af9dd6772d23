"""The flexible-joint arm as Gymnasium environments."""

from __future__ import annotations

from ..engine.single import SingleEnv
from ..engine.vector import BatchVectorEnv
from .task import ArmTask


class ArmEnv(SingleEnv, task=ArmTask):
    r"""
    ## Description
    An arm of three links of 8.9 kg without gravity, the SRLFJ of paper 002 ("Joints flexibility effect on the dynamic
    performance of robots"). Each joint has a spring between rotor and link and a damper between rotor and stator; the
    rotors are bodies of their own. The task is to move the tool along the paper's straight line, from the stretched arm
    to (-0.033, -0.372, 0.818) m in 5 s. The argument `actuator` chooses the servos.

    ## Action Space
    The action space is a `Box(-1, 1, (3,), float32)`: corrections of the servos' position goals. The goal at action 0 is
    the joint angle on the line, plus `lead` times its speed. Goals pass the actuation chain (controller, motor,
    friction, spring) inside the physics engine.

    | Num | Action               | Min | Max | Change of the goal at 1 | Coordinate | Type (Unit) |
    |-----|----------------------|-----|-----|-------------------------|------------|-------------|
    | 0   | Correction of joint1 | -1  | 1   | 0.02 x `correction`     | joint1     | angle (rad) |
    | 1   | Correction of joint2 | -1  | 1   | 0.02 x `correction`     | joint2     | angle (rad) |
    | 2   | Correction of joint3 | -1  | 1   | 0.02 x `correction`     | joint3     | angle (rad) |

    Angles are those of table I. With a `correction` of 0 the actions are goals, from -1 to 1 over (-pi, pi), (-0.5, 1.5)
    and (-0.5, 2.5) rad.

    ## Observation Space
    The observation space is a `Box(-Inf, Inf, (25,), float32)` of what the on-board computer knows.

    | Num     | Observation                           | Source                                                | Unit   |
    |---------|---------------------------------------|-------------------------------------------------------|--------|
    | 0       | elapsed share of the line's time      | clock                                                 | -      |
    | 1 - 3   | wanted angles of joints 1 to 3        | the line                                              | rad    |
    | 4 - 6   | wanted speeds                         | the line                                              | rad/s  |
    | 7 - 9   | wanted accelerations                  | the line                                              | rad/s2 |
    | 10 - 12 | angles of the links, less wanted      | link encoders, ideal                                  | rad    |
    | 13 - 15 | angles of the motors, less wanted     | motor encoder of the chain: its ticks, offset, scale  | rad    |
    | 16 - 18 | speeds of the links, less wanted      | differences of the link encoders                      | rad/s  |
    | 19 - 21 | speeds of the motors, less wanted     | differences of the motor encoders                     | rad/s  |
    | 22 - 24 | last actions                          | memory                                                | -      |

    ## Rewards
    The reward is ***tracking + fine + smooth***; `info` holds each term. $e$ is the distance of the tool from its place
    on the line, from the link encoders.

    - *reward_tracking*: $w_{tracking} (1 - \min(e / e_{range}, 1))$.
    - *reward_fine*: $w_{fine} \exp(-e / 0.5\,mm)$.
    - *reward_smooth*: $-w_{smooth} \sum (a_t - a_{t-1})^2$.

    `info` also holds `net_out_of_range` (samples of this episode in which an actuator net's input was outside its training
    data) and `unstable` (the simulation diverged; the episode ends).

    ## Starting State
    The arm is stretched and at rest, each joint off by up to `start_noise` rad; the goals are the joint angles. The
    duration of the line is drawn if `seconds` is a range. Then `randomization` is drawn.

    ## Episode End
    ### Termination
    The tool is further than `largest_error` from its place, or the simulation is unstable.

    ### Truncation
    After 500 steps (5 s).

    ## Arguments

    `gymnasium.make_vec("SeaLegs/Arm-v0", num_envs=64)` steps the simulations on all cores and starts new episodes in
    the same step; `sealegs.envs.engine.sb3.BatchVecEnv` does so for Stable-Baselines3. Equal seeds give bit-equal trajectories in
    all three.

    ## Version History
    * v0: initial version.
    """  # noqa: E501


class ArmVectorEnv(BatchVectorEnv, task=ArmTask):
    """Many :class:`ArmEnv` side by side, with the same arguments."""
