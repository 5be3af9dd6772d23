"""The hexapod as Gymnasium environments."""

from __future__ import annotations

from ..engine.single import SingleEnv
from ..engine.vector import BatchVectorEnv
from .task import HexapodTask


class HexapodEnv(SingleEnv, task=HexapodTask):
    r"""
    ## Description
    The six-legged robot AMRU5 of paper 001 ("Dynamic simulation of six-legged robots with a focus on joint friction"):
    34 kg on six pantograph legs. Each leg turns about its upright axis, and a vertical and a horizontal ball screw move
    it, with 18 Maxon RE35 motors in all. The task is to walk forward at a commanded speed with little specific
    resistance (energy over weight and distance). The argument `actuator` chooses drives and joint friction.

    ## Action Space
    The action space is a `Box(-1, 1, (6,), float32)`: parameters of the tripod gait (`envs/hexapod/modulated_gait.py`),
    which at action 0 is the reference gait (`envs/hexapod/gait.py`). The parameters follow the action with a time
    constant of 1 s. The gait sets the goals of all joints every 10 ms; they pass the actuation chain (digital PI
    controller, motor, gears, friction) inside the physics engine.

    | Num | Action                                                   | At 0   | Per unit | Lowest | Highest | Unit            |
    |-----|----------------------------------------------------------|--------|----------|--------|---------|-----------------|
    | 0   | travel of the body per step cycle                        | 0.18   | 0.08     | 0.1    | 0.26    | m               |
    | 1   | double stance, twice in a cycle                          | 0.0833 | 0.125    | 0      | 0.2     | of the cycle    |
    | 2   | lift of a foot in the air                                | 0.04   | 0.05     | 0.005  | 0.08    | m               |
    | 3   | part in which it rises, and in which it sinks            | 0.3    | 0.2      | 0.1    | 0.5     | of the transfer |
    | 4   | width: how much farther out the feet at the sides land   | 0      | 0.15     | -0.1   | 0.1     | m               |
    | 5   | spread: how much farther from each other along the way   | 0      | 0.04     | -0.04  | 0.04    | m               |

    Joint k belongs to leg k // 3 and is its rotation, vertical or horizontal screw; leg 0 points forward, the others
    follow counter-clockwise every 60 degrees. Rotation turns a leg clockwise seen from above. A foot follows its
    horizontal screw outward 8 times as far, and its vertical screw downward 7 times.

    ## Observation Space
    The observation space is a `Box(-Inf, Inf, (69,), float32)` of what the on-board computer knows.

    | Num   | Observation                                  | Source                                                     | Unit       |
    | ----- | -------------------------------------------- | ---------------------------------------------------------- | ---------- |
    | 0     | commanded speed                              | command                                                    | m/s        |
    | 1     | height of the body                           | odometry over the standing legs, ideal                     | m          |
    | 2-4   | upward direction in the body                 | inertial unit, ideal                                       | -          |
    | 5-6   | heading of the body on the floor             | inertial unit, ideal                                       | -          |
    | 7-9   | velocity of the body, along the floor's axes | odometry, ideal                                            | m/s        |
    | 10-12 | turn rate of the body, about its own axes    | inertial unit, ideal                                       | rad/s      |
    | 13-30 | joints, from the middle of a stance          | motor encoders of the chain: ticks, offset, scale, latency | rad, m     |
    | 31-48 | speed of the joints                          | difference of 13-30 over the last control step             | rad/s, m/s |
    | 49-54 | foot on the floor                            | from the height of the body and 13-30, ideal               | -          |
    | 55-56 | clock of the gait, sine and cosine           | memory                                                     | -          |
    | 57-62 | parameters of the gait                       | memory                                                     | m, -       |
    | 63-68 | last action                                  | memory                                                     | -          |

    ## Rewards
    The reward is ***forward + alive + straight + resistance***; `info` holds each term.

    - *reward_forward*: $w_{forward} \max(1 - |v - v_{cmd}| / s, -1)$ with the mean forward speed $v$ of the body in the
      step and $s = \max(|v_{cmd}|, 0.01)$ m/s.
    - *reward_alive*: `alive_weight` in every step.
    - *reward_straight*: $-w_{straight} (\min(|v_y| / s, 1) + |h_y|)$ with the mean speed and the heading to the side.
    - *reward_resistance*: $-w_{resistance} \min(P / (m g s), 20)$ with the mean electrical power $P$ of the paper's
      motors, braking not counted: the specific resistance (35) of a robot that travels at the commanded speed.

    `info` also holds `net_out_of_range` (samples of this episode in which an actuator net's input was outside its training
    data) and `unstable` (the simulation diverged; the episode ends).

    ## Starting State
    The robot stands on six legs, sunk into the ground by as much as carries its weight. Each rotation and each horizontal
    screw is off the middle of its range by uniform noise of $\pm$ `start_noise` times half of that range. The tripod that
    goes first is drawn, and so is the commanded speed if `speed` is a range. Then `randomization` is drawn.

    ## Episode End
    ### Termination
    The body sinks below `healthy_height`, the cosine of its tilt falls below `healthy_upright`, or the simulation is
    unstable.

    ### Truncation
    After 30 steps (30 s).

    ## Arguments

    `gymnasium.make_vec("SeaLegs/Hexapod-v0", num_envs=64)` steps the simulations on all cores and starts new episodes in
    the same step; `sealegs.envs.engine.sb3.BatchVecEnv` does so for Stable-Baselines3. Equal seeds give bit-equal trajectories in
    all three.

    ## Version History
    * v0: initial version.

    ## References
    The action follows Iscen et al., "Policies Modulating Trajectory Generators" (CoRL 2018).
    """  # noqa: E501


class HexapodVectorEnv(BatchVectorEnv, task=HexapodTask):
    """Many :class:`HexapodEnv` side by side, with the same arguments."""
