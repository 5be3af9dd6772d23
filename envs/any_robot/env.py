"""The tasks of any robot as Gymnasium environments."""

from __future__ import annotations

from ..engine.vector import BatchVectorEnv, SingleEnv
from .drive import DriveTask
from .reach import ReachTask
from .track import TrackTask
from .walk import WalkTask


class TrackEnv(SingleEnv, task=TrackTask):
    r"""
    ## Description
    Any robot with k driven joints follows trajectories: each joint a sum of two sines, drawn anew in every episode. `robot`
    is a name (`bench`, `hopper`, ...) or the file of a robot (`my_arm.yaml`, or an MJCF or URDF).

    ## Action Space
    The action space is a `Box(-1, 1, (k,), float32)`: an action corrects the goals of the joints, in the order of the
    robot's file.

    | Num      | Action        | Min | Max | Goal at 0                             | Change per unit                 | Unit     |
    |----------|---------------|-----|-----|---------------------------------------|---------------------------------|----------|
    | 0 to k-1 | Goal of joint | -1  | 1   | the joint's trajectory `lead` from now | `correction` times half the range | rad or m |

    Goals keep to the joint's range. Without a `lead`, the environment measures by how much servos that are given the
    trajectory itself are late, on its own chains, and leads by that: an untrained policy follows as well as can be had
    without learning. With a `correction` of 0, actions of -1 and 1 are the ends of the joint's range, as in v0.

    ## Observation Space
    The observation space is a `Box(-Inf, Inf, (5 k,), float32)`.

    | Num        | Observation   | Source                                                           | Unit           |
    |------------|---------------|------------------------------------------------------------------|----------------|
    | 0 to k-1   | target        | trajectory at this moment                                        | rad or m       |
    | k to 2k-1  | later target  | trajectory, `preview` later                                      | rad or m       |
    | 2k to 3k-1 | motor reading | motor encoder of the chain: its ticks, offset, scale and latency | rad or m       |
    | 3k to 4k-1 | motor speed   | difference of the reading over the last control step             | rad/s or m/s   |
    | 4k to 5k-1 | last action   | memory                                                           | -              |

    ## Rewards
    The reward is ***tracking - smooth - energy***; `info` holds each term, and the flags `net_out_of_range` and
    `unstable` (see `HopperEnv`). $e_j$ is the error of joint j over half of its range.

    - *reward_tracking*: $w_{tracking}$ times the mean over joints of $\exp(-|e_j| / tolerance)$.
    - *reward_smooth*: $-w_{smooth}$ times the mean squared change of the action.
    - *reward_energy*: $-w_{energy} \sum |\tau_j \omega_j|$ of the motors [W].

    ## Starting State
    The robot is at rest on the trajectory, with uniform noise of $\pm$ `start_noise` times half of each joint's range.
    Trajectories are centred on the robot's start, but at least a quarter of the range from its ends, or on the start as
    it is of a robot with a `height`. Amplitudes, frequencies and phases are uniform; the two amplitudes add up to at most
    `amplitude` times a quarter of the range, or times the distance to its nearer end.
    Then `randomization` is drawn.

    ## Episode End
    ### Termination
    Only if the simulation is unstable.

    ### Truncation
    After 500 steps (10 s).

    ## Arguments

    ## Version History
    * v1: actions correct the trajectory, with a lead. Trained without, policies were bang-bang, and worse than none.
    * v0: actions are goals: `correction=0`, `lead=0`.
    """  # noqa: E501


class TrackVectorEnv(BatchVectorEnv, task=TrackTask):
    """Many :class:`TrackEnv` side by side, with the same arguments."""


class ReachEnv(SingleEnv, task=ReachTask):
    r"""
    ## Description
    Any robot with k driven joints brings them to a pose and holds it. `robot` is a name (`bench`, `hopper`, ...) or the
    file of a robot (`my_arm.yaml`, or an MJCF or URDF).

    ## Action Space
    The action space is a `Box(-1, 1, (k,), float32)`: the position goals of the joints, in the order of the robot's file.

    | Num      | Action        | Min | Max | Goal at -1                  | Goal at 1           | Type (Unit)                    |
    |----------|---------------|-----|-----|-----------------------------|---------------------|--------------------------------|
    | 0 to k-1 | Goal of joint | -1  | 1   | lower end of joint's range  | upper end of it     | angle (rad), or distance (m)   |

    ## Observation Space
    The observation space is a `Box(-Inf, Inf, (4 k,), float32)`.

    | Num        | Observation   | Source                                                           | Unit           |
    |------------|---------------|------------------------------------------------------------------|----------------|
    | 0 to k-1   | target        | command                                                          | rad or m       |
    | k to 2k-1  | motor reading | motor encoder of the chain: its ticks, offset, scale and latency | rad or m       |
    | 2k to 3k-1 | motor speed   | difference of the reading over the last control step             | rad/s or m/s   |
    | 3k to 4k-1 | last action   | memory                                                           | -              |

    ## Rewards
    The reward is ***tracking - smooth - energy***; `info` holds each term, and the flags `net_out_of_range` and
    `unstable` (see `HopperEnv`). $e_j$ is the distance of joint j from the target over half of its range.

    - *reward_tracking*: $w_{tracking}$ times the mean over joints of $\exp(-|e_j| / tolerance)$.
    - *reward_smooth*: $-w_{smooth}$ times the mean squared change of the action.
    - *reward_energy*: $-w_{energy} \sum |\tau_j \omega_j|$ of the motors [W].

    ## Starting State
    The robot is at rest at its start, with uniform noise of $\pm$ `start_noise` times half of each joint's range. The
    target is uniform in `reach` times the range, about its middle. Then `randomization` is drawn.

    ## Episode End
    ### Termination
    Only if the simulation is unstable.

    ### Truncation
    After 250 steps (5 s).

    ## Arguments

    ## Version History
    * v0: initial version.
    """  # noqa: E501


class ReachVectorEnv(BatchVectorEnv, task=ReachTask):
    """Many :class:`ReachEnv` side by side, with the same arguments."""


class WalkEnv(SingleEnv, task=WalkTask):
    r"""
    ## Description
    A robot with a free base walks as commanded: forward, sideways, turning, or it stands still. `robot` is a name
    (`quadruped`) or the file of a robot with a floor under it (`my_dog.yaml`, as `sealegs new-robot` writes it). The
    robot's forward is the world's x as it starts. Its feet are what touches the floor there.

    ## Action Space
    The action space is a `Box(-1, 1, (k,), float32)`, for k driven joints in the order of the robot's file. An action
    corrects the stance in which episodes start: with action 0 the robot stands.

    | Num      | Action                   | Min | Max | Correction at 1                    | Type (Unit)                  |
    |----------|--------------------------|-----|-----|------------------------------------|------------------------------|
    | 0 to k-1 | Correction of joint goal | -1  | 1   | `correction` x half of its range   | angle (rad), or distance (m) |

    With `cadence` above 0, actions correct a reference gait instead, which needs no learning: feet that are neighbours
    around the body take turns (a quadruped trots, a hexapod walks on tripods, a biped steps). In half of each cycle a
    foot is lifted by `lift` and swings ahead, in the other half it goes back on the ground, as fast as the command asks
    there, times `forward_stride`, `sideways_stride` and `turn_stride`, with `forward_trim`, `sideways_trim` and `turn_trim`
    added. The joints follow by the derivatives of the feet in the stance. At command 0 it stands.

    On two feet the base sways over the one that stands: with `sway` 1 by $y / (1 + \omega^2 h / g)$, where the feet are $y$
    from their middle and $\omega$ is that of the cycle. So a pendulum of height $h$ presses on the ground at that foot. It
    comes by the share `lead` of a cycle before the foot's turn.

    ## Observation Space
    The observation space is a `Box(-Inf, Inf, (9 + 4 k,), float32)`, two more with a gait, and one for each contact switch
    with `switches`: what servos and an IMU measure. The speed over the ground is not in it.

    | Num          | Observation   | Source                                                     | Unit              |
    |--------------|---------------|------------------------------------------------------------|-------------------|
    | 0 to 2       | command       | forward, sideways, turn                                    | m/s, m/s, rad/s   |
    | 3 to 5       | gravity       | its direction in the frame of the base                     | -                 |
    | 6 to 8       | turn rate     | about the axes of the base                                 | rad/s             |
    | 9 to 8+k     | motor reading | motor encoder of the chain, from the stance                | rad or m          |
    | 9+k to 8+2k  | motor speed   | difference of the reading over the last control step       | rad/s or m/s      |
    | 9+2k to 8+3k | last action   | memory                                                     | -                 |
    | 9+3k to 8+4k | action before | memory                                                     | -                 |
    | 9+4k, 10+4k  | clock         | sine and cosine of the gait's phase, with `cadence` above 0 | -                |
    | the last     | contact switches | 1 where one of the robot's file is closed, else 0       | -                 |

    ## Rewards
    The reward is the sum of these terms; `info` holds each, and the flags `net_out_of_range` and `unstable` (see
    `HopperEnv`). $v$ is the velocity of the base in its heading's frame, $\omega_z$ its turn about the vertical; a bar means
    the mean of the gait's last cycle, within which it sways; of 0.4 s without a gait.

    - *reward_tracking*: $w_{tracking} \exp(-|\bar v_{xy} - v_{cmd}|^2 / tolerance^2)$; to the side over
      `sideways_tolerance`, where that is given.
    - *reward_turn*: $w_{turn} \exp(-(\bar\omega_z - \omega_{cmd})^2 / tolerance_{turn}^2)$.
    - *reward_upright*: $-w_{upright} \sin^2$ of the tilt of the base from the stance.
    - *reward_sway*: $-w_{sway} ((v_z / tolerance)^2 + (\omega_{xy} / tolerance_{turn})^2)$.
    - *reward_air_time*: for each foot that lands $w_{air\_time} (\min(t / T, 2) - 1)$, after $t$ in the air, $T$ being
      `air_time`; 0 at command 0.
    - *reward_slip*: $-w_{slip}$ for each foot on the ground, times the speed of its sole over `tolerance`, at most 1.
    - *reward_clearance*: $-w_{clearance}$ for each foot in the air, times the same, times the share of `lift` by which
      its sole is too low.
    - *reward_collision*: $-w_{collision}$ for each other body that touches the ground.
    - *reward_smooth*: $-w_{smooth}$ times the mean squared change of the action.
    - *reward_duty*: $-w_{duty}$ times the mean squared duty of the drives: a servo that saturates has none left.
    - *reward_energy*: $-w_{energy} \sum |\tau_j \omega_j|$ of the motors [W].
    - *reward_stand*: at command 0, $-w_{stand}$ times the mean distance of the joints from the stance over half of their
      range.

    ## Starting State
    The robot stands, at rest, with uniform noise of $\pm$ `start_noise` times half of each joint's range. The command is
    uniform in its ranges; in a share `stand_share` of the episodes it is 0. With `command_interval` above 0, a new one is
    drawn after so many seconds, and again. Then `randomization` is drawn.

    ## Episode End
    ### Termination
    The base tilts further than `healthy_tilt`, touches the ground, or is lower over its lowest foot than
    `healthy_height` times its height in the stance; or the simulation is unstable.

    ### Truncation
    After 1000 steps (20 s).

    ## Size
    What of the commands, `cadence`, `lift`, the tolerances, `air_time` and `energy_weight` is null follows from the height $h$
    of the base over its feet and the mass $m$: speeds are shares of $\sqrt{g h}$, rates of $\sqrt{g / h}$, powers of
    $m g \sqrt{g h}$. For the quadruped, 0.16 m high, they are 0.3 m/s
    forward, 0.6 rad/s, 2.5 Hz and 0.02 m. On two feet, speeds and lift are a third.
    Legs that cannot step aside, or turn only in part, are asked for 0, or for that part.
    Where the reference gait alone falls, the lift is halved, up to twice. A `lead` that is null is 0, 0.06 or 0.12, whichever
    follows best there, and a `sway` that is null 1 or $4 / \pi$. A stride that is null makes up for what the gait lacks of
    the way, or has too much, and a trim that is null takes back what it makes whatever is asked for, where the robot
    follows better with them.

    ## Arguments

    ## Version History
    * v0: initial version.
    """  # noqa: E501


class WalkVectorEnv(BatchVectorEnv, task=WalkTask):
    """Many :class:`WalkEnv` side by side, with the same arguments."""


class DriveEnv(SingleEnv, task=DriveTask):
    r"""
    ## Description
    A robot on wheels drives as commanded: forward, turning, or it stands still. `robot` is a name (`rover`) or the file of
    a robot with a free base, a floor, and wheels whose chains are told speeds (`velocity_pi`), as `sealegs new-robot`
    writes it. The robot's forward is the world's x as it starts.

    ## Action Space
    The action space is a `Box(-1, 1, (k,), float32)`, for k driven joints in the order of the robot's file. An action
    corrects the speeds with which wheels that do not slip would carry the robot as commanded: with action 0 it drives
    already. Radius and place of each wheel are those of the model.

    | Num      | Action                      | Min | Max | Correction at 1                  | Type (Unit)           |
    |----------|-----------------------------|-----|-----|----------------------------------|-----------------------|
    | 0 to k-1 | Correction of a speed goal  | -1  | 1   | `correction` x half of its range | speed (rad/s)         |

    Joints that are no wheels keep their start; an action corrects it, as an angle (rad).

    ## Observation Space
    The observation space is a `Box(-Inf, Inf, (8 + 2 k,), float32)`: what servos and an IMU measure.

    | Num         | Observation  | Source                                               | Unit       |
    |-------------|--------------|------------------------------------------------------|------------|
    | 0, 1        | command      | forward, turn                                        | m/s, rad/s |
    | 2 to 4      | gravity      | its direction in the frame of the base               | -          |
    | 5 to 7      | turn rate    | about the axes of the base                           | rad/s      |
    | 8 to 7+k    | motor speed  | difference of the reading over the last control step | rad/s      |
    | 8+k to 7+2k | last action  | memory                                               | -          |

    ## Rewards
    The reward is ***tracking + turn - smooth - energy***; `info` holds each term, and the flags `net_out_of_range` and
    `unstable` (see `HopperEnv`). $v$ is the forward speed of the base, $\omega_z$ its turn about the vertical.

    - *reward_tracking*: $w_{tracking} \exp(-(v - v_{cmd})^2 / tolerance^2)$.
    - *reward_turn*: $w_{turn} \exp(-(\omega_z - \omega_{cmd})^2 / tolerance_{turn}^2)$.
    - *reward_smooth*: $-w_{smooth}$ times the mean squared change of the action.
    - *reward_energy*: $-w_{energy} \sum |\tau_j \omega_j|$ of the motors [W].

    ## Starting State
    The robot stands on its wheels, at rest. The command is uniform in its ranges; in a share `stand_share` of the episodes
    it is 0. With `command_interval` above 0, a new one is drawn after so many seconds. Then `randomization` is drawn.

    ## Episode End
    ### Termination
    The base tilts further than `healthy_tilt`; or the simulation is unstable.

    ### Truncation
    After 500 steps (10 s).

    ## Arguments

    ## Version History
    * v0: initial version.
    """  # noqa: E501


class DriveVectorEnv(BatchVectorEnv, task=DriveTask):
    """Many :class:`DriveEnv` side by side, with the same arguments."""
