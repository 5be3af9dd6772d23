"""The biped as Gymnasium environments."""

from __future__ import annotations

from ..engine.single import SingleEnv
from ..engine.vector import BatchVectorEnv
from .task import BipedTask


class BipedEnv(SingleEnv, task=BipedTask):
    r"""
    ## Description
    MABEL, the planar biped of paper 003 ("Identification of a Bipedal Robot with a Compliant Drivetrain"): 1 m tall at
    the hip, 58 kg, guided by a boom. Through cable differentials, one motor of each leg drives its angle and one its
    shape (half the bend of the knee). The shape acts through a unilateral spring, and all four cables stretch. The task
    is to walk or to hop forward at a commanded speed. The argument `actuator` chooses the drives.

    ## Action Space
    The action space is a `Box(-1, 1, (4,), float32)`: position goals of the motors, in leg coordinates. They go through
    the actuation chain (position loop, amplifier, motor, friction, spring, cable) inside the physics engine.

    | Num | Action                   | Min | Max | Goal at -1 | Goal at 1 | Coordinate         | Type (Unit)  |
    |-----|--------------------------|-----|-----|------------|-----------|--------------------|--------------|
    | 0   | Goal of left leg angle   | -1  | 1   | -0.6       | 0.6       | `left_leg_angle`   | angle (rad)  |
    | 1   | Goal of left leg shape   | -1  | 1   | 0.0        | 0.6       | `left_leg_shape`   | angle (rad)  |
    | 2   | Goal of right leg angle  | -1  | 1   | -0.6       | 0.6       | `right_leg_angle`  | angle (rad)  |
    | 3   | Goal of right leg shape  | -1  | 1   | 0.0        | 0.6       | `right_leg_shape`  | angle (rad)  |

    Angles are counter-clockwise for a viewer who has forward to the right. A leg angle is the mean of thigh and shin
    against the torso, zero where the leg hangs down; a leg shape is half their difference, zero where the leg is
    straight.

    With a `correction`, actions correct a reference gait (`envs/biped/gait.py`), which depends on a clock only. The goal is
    the gait's plus the action times `correction` times half the range above, within that range. With the gait alone the
    robot falls after a few steps.

    ## Observation Space
    The observation space is a `Box(-Inf, Inf, (30,), float32)` of what the on-board computer knows.

    | Num | Observation                  | Source                                                           | Unit  |
    |-----|------------------------------|------------------------------------------------------------------|-------|
    | 0   | commanded speed              | command                                                          | m/s   |
    | 1   | height of the hip            | encoder of the boom, ideal                                       | m     |
    | 2   | pitch of the torso           | encoder of the boom, ideal                                       | rad   |
    | 3   | left leg angle               | joint encoders, ideal                                            | rad   |
    | 4   | left leg shape               | joint encoders, ideal                                            | rad   |
    | 5   | right leg angle              | joint encoders, ideal                                            | rad   |
    | 6   | right leg shape              | joint encoders, ideal                                            | rad   |
    | 7   | motor of left leg angle      | motor encoder of the chain: its ticks, offset, scale and latency | rad   |
    | 8   | motor of left leg shape      | as 7                                                             | rad   |
    | 9   | motor of right leg angle     | as 7                                                             | rad   |
    | 10  | motor of right leg shape     | as 7                                                             | rad   |
    | 11  | forward speed of the hip     | boom, ideal                                                      | m/s   |
    | 12  | upward speed of the hip      | boom, ideal                                                      | m/s   |
    | 13  | pitch speed of the torso     | boom, ideal                                                      | rad/s |
    | 14  | speed of left leg angle      | difference of 3 over the last control step                       | rad/s |
    | 15  | speed of left leg shape      | difference of 4                                                  | rad/s |
    | 16  | speed of right leg angle     | difference of 5                                                  | rad/s |
    | 17  | speed of right leg shape     | difference of 6                                                  | rad/s |
    | 18  | speed of left angle motor    | difference of 7                                                  | rad/s |
    | 19  | speed of left shape motor    | difference of 8                                                  | rad/s |
    | 20  | speed of right angle motor   | difference of 9                                                  | rad/s |
    | 21  | speed of right shape motor   | difference of 10                                                 | rad/s |
    | 22  | switch of left foot          | 1 where the sole is less than 2 mm over the floor                | -     |
    | 23  | switch of right foot         | as 22                                                            | -     |
    | 24  | last action, left angle      | memory                                                           | -     |
    | 25  | last action, left shape      | memory                                                           | -     |
    | 26  | last action, right angle     | memory                                                           | -     |
    | 27  | last action, right shape     | memory                                                           | -     |
    | 28  | sine of the clock            | time, `cadence` turns per second from the start                  | -     |
    | 29  | cosine of the clock          | as 28                                                            | -     |

    Motor angles are in leg coordinates, divided by the gear ratios. With a chain without springs (`ideal`), motor and link
    have the same angle.

    With `mirrored` 1 the policy sees the leg that swings where the table says left, and the other where it says right: in
    the second half of the clock's turn, 3 to 10, 14 to 23 and the action are those of the other leg, and the clock stands
    half a turn earlier. So what it learns for one leg holds for the other (the phase method of Abdolhosseini et al., "On
    learning symmetric locomotion", 2019). The last action is as the policy gave it.

    ## Rewards
    The reward is ***forward + alive + gait + upright - energy - slip - clearance***; `info` holds each term.

    - *reward_forward*: $w_{forward} \max(1 - |v - v_{cmd}| / \max(|v_{cmd}|, 0.2), -1)$ with the forward speed $v$ of
      the hip.
    - *reward_alive*: `alive_weight` in every step.
    - *reward_gait*: $w_{gait}$ times a height over `lift`, at most 1. With `hopping` 1 it is the height of the lower foot.
      With 0 (walking) it is how much higher the swing foot is than the other; the left foot swings in the first half of
      each turn of the clock.
    - *reward_upright*: $w_{upright} \cos 2 p$ with the torso's pitch $p$.
    - *reward_energy*: $-w_{energy} \sum |\tau \omega|$ of the motors [W].
    - *reward_slip*, where `slip_weight` is not 0: $-w_{slip}$ times the speed of the soles that touch the floor [m/s], at
      most 1 m/s each.
    - *reward_clearance*, where `clearance_weight` is not 0: $-w_{clearance} \sum_{soles} \max(h / lift - 1.6, 0)$ with
      the height $h$ of a sole: no foot is lifted further than it needs, so that both swing alike.

    `info` also holds `net_out_of_range` (samples of this episode in which an actuator net's input was outside its training
    data) and `unstable` (the simulation diverged; the episode ends).

    ## Starting State
    The robot stands with the legs 15 degrees apart (`leg_angle` of `params`, half to each side) and bent by 12 degrees
    (`leg_shape`). Springs are relaxed, and the lower foot is up to `start_noise` m above the floor. Angles [rad] and
    forward speed [m/s] have uniform noise of $\pm$ `start_noise`. The commanded speed is drawn if `speed` is a range.
    Then `randomization` is drawn.

    ## Episode End
    ### Termination
    The hip sinks below `healthy_height`, the torso pitches further than `healthy_pitch`, or the simulation is unstable.

    ### Truncation
    After 1000 steps (20 s).

    ## Arguments

    `gymnasium.make_vec("SeaLegs/Biped-v0", num_envs=64)` steps the simulations on all cores and starts new episodes in
    the same step; `sealegs.envs.engine.sb3.BatchVecEnv` does so for Stable-Baselines3. Equal seeds give bit-equal trajectories in
    all three.

    ## Version History
    * v0: initial version.
    """  # noqa: E501


class BipedVectorEnv(BatchVectorEnv, task=BipedTask):
    """Many :class:`BipedEnv` side by side, with the same arguments."""
