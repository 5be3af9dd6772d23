"""The biped's task, walking or hopping at a commanded speed, and its Gymnasium environments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...actuators import Drivetrain
from ...common.errors import SealegsError
from ..engine.task import Motion, Task, drawn, option
from ..engine.vector import BatchVectorEnv, SingleEnv
from .drive import ANGLE, SHAPE
from .gait import HoppingGait, WalkingGait
from .kinematics import feet, place, segments
from .parameters import SIDES
from .robot import BIPED, GOAL_RANGE, coordinate

SLOWEST = 0.2  # [m/s] below this, errors of speed count in absolute terms
ENOUGH = 1.6  # times ``lift``: a foot that is higher lifts more than it needs
TOUCH = 2e-3  # [m] under which the switch of a foot says that it is on the floor
FORWARD, UP, PITCH = 0, 1, 2  # qpos and qvel of the torso
REACH = np.array([0.5 * (high - low) for low, high in (GOAL_RANGE[ANGLE], GOAL_RANGE[SHAPE])] * 2)  # of goals [rad]


@dataclass(frozen=True)
class BipedTask(Task):
    """The options of :class:`sealegs.envs.biped.env.BipedEnv`."""

    speed: float | Sequence[float] = option(0.6, "commanded speed, or the range it is drawn from", "m/s")
    hopping: float = option(0.0, "0: walk; 1: hop with both legs")
    cadence: float = option(1.0, "turns of the clock per second: two steps, or one hop", "Hz")
    correction: float = option(
        0.0, "0: actions are goals; else how far they correct the reference gait, as a share of half the range of goals"
    )
    forward_weight: float = 1.0
    alive_weight: float = 0.5
    gait_weight: float = 0.5
    upright_weight: float = 0.5
    energy_weight: float = option(3e-4, "see Rewards", "1/W")
    slip_weight: float = option(0.0, "see Rewards", "s/m")
    clearance_weight: float = 0.0
    lift: float = option(0.05, "height of a sole at which *reward_gait* is full", "m")
    healthy_height: float = option(0.65, "lowest height of the hip", "m")
    healthy_pitch: float = option(0.7, "largest pitch of the torso", "rad")
    mirrored: float = option(
        0.0,
        "1: the policy sees the swinging leg as the left one, see Observation Space; without effect where `hopping` is "
        "above 0",
    )
    start_noise: float = option(0.03, "see Starting State")

    robot = BIPED
    draws = 8
    ranges = ("speed",)

    def __post_init__(self) -> None:
        if not self.lift > 0.0:  # heights count as shares of it
            raise SealegsError(f"lift is {self.lift}; it must be a height above 0 m.")
        if self.mirrored not in (0.0, 1.0):
            raise SealegsError(f"mirrored is {self.mirrored}; it is 1 or 0.")

    def observation_names(self) -> tuple[str, ...]:
        names = [f"{side} leg {kind}" for side in SIDES for kind in ("angle", "shape")]
        return (
            "commanded speed [m/s]",
            "hip height [m]",
            "torso pitch [rad]",
            *(f"{name} [rad]" for name in names),
            *(f"{name} motor reading [rad]" for name in names),
            "forward speed [m/s]",
            "upward speed [m/s]",
            "torso pitch speed [rad/s]",
            *(f"{name} speed [rad/s]" for name in names),
            *(f"{name} motor speed [rad/s]" for name in names),
            *(f"{side} foot switch" for side in SIDES),
            *(f"last {name} action" for name in names),
            *(f"{function} of the clock" for function in ("sine", "cosine")),
        )

    def asked_names(self) -> tuple[str, ...]:
        return ("speed [m/s]",)

    def commands(self, random: np.ndarray) -> np.ndarray:
        return drawn(self.speed, random[:, :1])

    def place(
        self,
        drivetrain: Drivetrain,
        numbers: Mapping[str, float],
        random: np.ndarray,
        qpos: np.ndarray,
        qvel: np.ndarray,
    ) -> np.ndarray:
        noise = self.start_noise * (2.0 * random[:, 1:] - 1.0)
        half = 0.5 * numbers["leg_angle"]
        rest = np.array([-half, numbers["leg_shape"], half, numbers["leg_shape"]])
        goals = rest + noise[:, :4]
        for column, side in ((0, SIDES[0]), (2, SIDES[1])):
            drivetrain.set_position(coordinate(side, SHAPE), qpos, goals[:, column + 1])
            drivetrain.set_position(coordinate(side, ANGLE), qpos, goals[:, column])
        qpos[:, PITCH] = noise[:, 4]
        lowest = soles(numbers, np.zeros(len(qpos)), qpos[:, PITCH], goals).min(axis=1)
        qpos[:, UP] = np.abs(noise[:, 5]) - lowest  # dropped from a little above the floor
        qvel[:, FORWARD] = noise[:, 6]
        return goals

    def reference(
        self, time: np.ndarray, command: np.ndarray, numbers: Mapping[str, float]
    ) -> tuple[np.ndarray, np.ndarray] | None:
        if self.correction == 0.0:
            return None
        phase = self._phase(time)
        walking = WalkingGait().goals(phase, command[:, 0], self.cadence, numbers)
        goals = self.hopping * HoppingGait().goals(phase) + (1.0 - self.hopping) * walking
        return goals, self.correction * REACH

    def on_joints(self, time: np.ndarray, action: np.ndarray) -> np.ndarray:
        return self._sides(self._phase(time), action)

    @property
    def _mirrors(self) -> bool:
        """Legs that hop do not take turns: one of them is ahead all the time."""
        return self.mirrored == 1.0 and self.hopping == 0.0

    def _phase(self, time: np.ndarray) -> np.ndarray:
        """Of the clock (n,) [rad]; the left leg's turn to swing comes first."""
        return 2.0 * np.pi * (self.cadence * time % 1.0)

    def _sides(self, phase: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Values of both legs (n, 2 j), the swinging leg's first where the policy sees them so; its own inverse."""
        if not self._mirrors:
            return values
        half = values.shape[1] // 2
        swapped = np.concatenate([values[:, half:], values[:, :half]], axis=1)
        return np.where((phase < np.pi)[:, None], values, swapped)

    def observe(self, motion: Motion) -> tuple[np.ndarray, ...]:
        m = motion
        phase = self._phase(m.time)
        base, switches = m.qvel[:, : PITCH + 1], (_clearance(m) < TOUCH).astype(float)
        links, readings, switches = (
            [self._sides(phase, values) for values in part]
            for part in ((m.link, m.reading), (m.link_speed, m.reading_speed), (switches,))
        )
        turn = phase % np.pi if self._mirrors else phase
        clock = np.sin(turn), np.cos(turn)
        return m.command, m.qpos[:, UP : PITCH + 1], *links, base, *readings, *switches, m.action, *clock

    def rewards(self, motion: Motion) -> dict[str, np.ndarray]:
        speed, wanted = motion.qvel[:, FORWARD], motion.command[:, 0]
        error = np.abs(speed - wanted) / np.maximum(np.abs(wanted), SLOWEST)
        height = _clearance(motion) / self.lift
        left, right = np.clip(height, 0.0, 1.0).T
        swing = np.where(self._phase(motion.time) < np.pi, left - right, right - left)
        gait = self.hopping * np.minimum(left, right) + (1.0 - self.hopping) * swing
        power = np.abs(motion.torque * motion.motor_speed).sum(axis=1)
        costs = {}
        if self.slip_weight != 0.0:
            costs["reward_slip"] = -self.slip_weight * slipping(motion)
        if self.clearance_weight != 0.0:
            costs["reward_clearance"] = -self.clearance_weight * np.maximum(height - ENOUGH, 0.0).sum(axis=1)
        return costs | {
            "reward_forward": self.forward_weight * np.maximum(1.0 - error, -1.0),
            "reward_alive": np.full(len(speed), self.alive_weight),
            "reward_gait": self.gait_weight * gait,
            "reward_upright": self.upright_weight * np.cos(2.0 * motion.qpos[:, PITCH]),
            "reward_energy": -self.energy_weight * power,
        }

    def failed(self, motion: Motion) -> np.ndarray:
        fallen = motion.qpos[:, UP] < self.healthy_height
        return fallen | (np.abs(motion.qpos[:, PITCH]) > self.healthy_pitch)


def soles(numbers: Mapping[str, float], height: np.ndarray, pitch: np.ndarray, link: np.ndarray) -> np.ndarray:
    """Heights of both soles over the floor (n, 2) [m].

    Args:
        numbers: of the robot.
        height, pitch: of the torso (n,) [m, rad].
        link: angle and shape of the left, then of the right leg (n, 4) [rad].
    """
    return sole_places(numbers, np.zeros(len(height)), height, pitch, link)[..., 1]


def sole_places(
    numbers: Mapping[str, float], forward: np.ndarray, height: np.ndarray, pitch: np.ndarray, link: np.ndarray
) -> np.ndarray:
    """Where both soles are: forward, and over the floor (n, 2 sides, 2) [m]; arguments as of :func:`soles`.

    Args:
        numbers: of the robot.
        forward, height, pitch: of the torso (n,) [m, m, rad].
        link: angle and shape of the left, then of the right leg (n, 4) [rad].
    """
    angles = segments(pitch, link)
    ends = np.stack([place(end, angles) for end in feet(numbers)], axis=1)
    return ends + np.stack([forward, height - numbers["foot_radius"]], axis=1)[:, None, :]


def sole_speeds(
    numbers: Mapping[str, float],
    forward: np.ndarray,
    pitch: np.ndarray,
    link: np.ndarray,
    pitch_speed: np.ndarray,
    link_speed: np.ndarray,
) -> np.ndarray:
    """Forward speeds of both soles (n, 2) [m/s]: of the point of each round foot that touches the floor.

    Args:
        numbers: of the robot.
        forward: speed of the hip (n,) [m/s].
        pitch, pitch_speed: of the torso (n,) [rad, rad/s].
        link, link_speed: angle and shape of the left, then of the right leg (n, 4) [rad, rad/s].
    """
    angles, turning = segments(pitch, link), segments(pitch_speed, link_speed)
    found = []
    for side, end in enumerate(feet(numbers)):
        speed = np.zeros(len(forward))
        for segment, (ahead, up) in enumerate(end):
            sine, cosine = np.sin(angles[:, segment]), np.cos(angles[:, segment])
            speed = speed - (sine * ahead + cosine * up) * turning[:, segment]
        shin = turning[:, 2 + 2 * side]  # with which a round foot rolls
        found.append(forward + speed + numbers["foot_radius"] * shin)
    return np.stack(found, axis=1)


def slipping(motion: Motion) -> np.ndarray:
    """Speed of the soles over the floor, of feet that touch it, both together (n,) [m/s]; at most 1 each."""
    m = motion
    speeds = sole_speeds(m.numbers, m.qvel[:, FORWARD], m.qpos[:, PITCH], m.link, m.qvel[:, PITCH], m.link_speed)
    return np.where(_clearance(m) < TOUCH, np.minimum(np.abs(speeds), 1.0), 0.0).sum(axis=1)


def _clearance(motion: Motion) -> np.ndarray:
    return soles(motion.numbers, motion.qpos[:, UP], motion.qpos[:, PITCH], motion.link)


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
