"""The tasks of any robot as Gymnasium environments."""

from __future__ import annotations

from ..engine.single import SingleEnv
from ..engine.vector import BatchVectorEnv
from .reach import ReachTask
from .track import TrackTask
from .walk import WalkTask


class TrackEnv(SingleEnv, task=TrackTask):
    r"""
    ## Description
    Any robot with k driven joints follows trajectories: each joint a sum of two sines, drawn anew in every episode. `robot`
    is a name (`bench`, `hopper`, ...) or the file of a robot (`my_arm.yaml`, or an MJCF or URDF).

    ## Action Space
    The action space is a `Box(-1, 1, (k,), float32)`: the position goals of the joints, in the order of the robot's file.

    | Num      | Action        | Min | Max | Goal at -1                  | Goal at 1           | Type (Unit)                    |
    |----------|---------------|-----|-----|-----------------------------|---------------------|--------------------------------|
    | 0 to k-1 | Goal of joint | -1  | 1   | lower end of joint's range  | upper end of it     | angle (rad), or distance (m)   |

    With `correction` above 0 an action corrects the trajectory instead: the goal is the target plus the action times
    `correction` times half of the joint's range.

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

    | Parameter         | Type              | Default      | Description |
    |-------------------|-------------------|--------------|---------------------------------------------------------------|
    | `robot`           | str or path       | `'bench'`    | a name, or the robot's `.yaml`, `.xml` or `.urdf` |
    | `actuator`        | str, list or dict | `None`       | chain: a name in `configs/actuator`, a path or stages; `None`: the robot's own |
    | `randomization`   | dict or path      | `None`       | what every episode draws anew, see `envs/engine/randomization.py` |
    | `params`          | dict              | `None`       | numbers of the robot other than its own, such as `forearm_mass` |
    | `control_rate`    | float             | `50.0`       | actions per second [Hz] |
    | `action_delay`    | float             | `0.0`        | from an observation to its goal [s]; a whole number of physics steps |
    | `amplitude`       | float             | `0.8`        | see Starting State |
    | `frequency`       | float or pair     | `(0.2, 0.8)` | of the sines, or from which to which [Hz] |
    | `preview`         | float             | `0.06`       | how far ahead the later target is [s] |
    | `correction`      | float             | `0.0`        | see Action Space |
    | `tolerance`       | float             | `0.05`       | see Rewards: scale of an error, as a share of half the range |
    | `tracking_weight` | float             | `1.0`        | see Rewards |
    | `smooth_weight`   | float             | `0.05`       | see Rewards |
    | `energy_weight`   | float             | `0.0`        | see Rewards [1/W] |
    | `start_noise`     | float             | `0.02`       | see Starting State |
    | `width`, `height` | int               | `640, 480`   | of the picture [px] |

    ## Version History
    * v0: initial version.
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

    | Parameter         | Type              | Default    | Description |
    |-------------------|-------------------|------------|---------------------------------------------------------------|
    | `robot`           | str or path       | `'bench'`  | a name, or the robot's `.yaml`, `.xml` or `.urdf` |
    | `actuator`        | str, list or dict | `None`     | chain: a name in `configs/actuator`, a path or stages; `None`: the robot's own |
    | `randomization`   | dict or path      | `None`     | what every episode draws anew, see `envs/engine/randomization.py` |
    | `params`          | dict              | `None`     | numbers of the robot other than its own, such as `forearm_mass` |
    | `control_rate`    | float             | `50.0`     | actions per second [Hz] |
    | `action_delay`    | float             | `0.0`      | from an observation to its goal [s]; a whole number of physics steps |
    | `reach`           | float             | `0.8`      | see Starting State |
    | `tolerance`       | float             | `0.05`     | see Rewards: scale of an error, as a share of half the range |
    | `tracking_weight` | float             | `1.0`      | see Rewards |
    | `smooth_weight`   | float             | `0.05`     | see Rewards |
    | `energy_weight`   | float             | `0.0`      | see Rewards [1/W] |
    | `start_noise`     | float             | `0.02`     | see Starting State |
    | `width`, `height` | int               | `640, 480` | of the picture [px] |

    ## Version History
    * v0: initial version.
    """  # noqa: E501


class ReachVectorEnv(BatchVectorEnv, task=ReachTask):
    """Many :class:`ReachEnv` side by side, with the same arguments."""


class WalkEnv(SingleEnv, task=WalkTask):
    r"""todo"""


class WalkVectorEnv(BatchVectorEnv, task=WalkTask):
    """Many :class:`WalkEnv` side by side, with the same arguments."""
