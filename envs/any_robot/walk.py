"""Walk as commanded: forward, sideways, turning, or standing still, with any robot whose base is free."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from ...actuators import Drivetrain
from ...common.errors import SealegsError
from ..engine.batch import BatchEngine
from ..engine.robot import Robot
from ..engine.task import Motion, option
from ..robots import get_robot
from .stand import Standing, standing
from .task import Commanded, Numbers

COMMANDS = ("forward [m/s]", "sideways [m/s]", "turn [rad/s]")
SLOW = 0.04  # of the speed of a fall from its height: speed of a foot over the body that lifts it fully; assumed
RIM = 0.5  # of the height of the base: how far from its middle a sole that turns drags, for the same; assumed
SWING = 0.5  # of a cycle of the reference gait that a foot is in the air
AXES = ("x", "y", "z")
GRAVITY = 9.81  # [m/s2]
ON_TWO = 1.0 / 3.0  # of the speeds and heights, on two feet: what the small biped follows; assumed

TRIALS, TRIAL_TIME = 8, 4.0  # simulations of the gait that is tried, and how long [s]
HALVINGS = 2  # of the lift, at which a robot that falls is tried again
LEADS = (0.0, 0.06, 0.12)  # shares of a cycle that are tried: servos that carry weight are later than those that swing
SWAYS = (1.0, 4.0 / np.pi)
"""That are tried: the ground presses where the foot is in the middle of its turn, or in its turn's first harmonic."""
STRIDE_NAMES = ("forward_stride", "sideways_stride", "turn_stride")
TRIM_NAMES = ("forward_trim", "sideways_trim", "turn_trim")
PLAIN: dict[str, float] = {**dict.fromkeys(STRIDE_NAMES, 1.0), **dict.fromkeys(TRIM_NAMES, 0.0)}
"""With these the gait goes as the command says."""
STRIDE_TRIALS = 24  # simulations that tell strides: two legs do differently from start to start
LEAST_WAY = 0.25  # share of what is asked for, below which the gait makes no way that longer strides make up for
TRIMMED = 0.75  # of what the gait is off, or less, that trims must leave: a little of it is chance, from start to start
MOST_STRIDE = 2.0  # over what the command asks; and its inverse the least


@dataclass(frozen=True)
class Sizes:
    """Numbers of a walk that a robot's size decides, unless they are given: see :class:`WalkTask`."""

    forward: float | Sequence[float]
    sideways: float | Sequence[float]
    turn: float | Sequence[float]
    cadence: float
    lift: float
    tolerance: float
    turn_tolerance: float
    air_time: float
    energy_weight: float
    lead: float = 0.0

    @classmethod
    def of(cls, stance: Standing) -> Sizes:
        """Those of a robot that stands so, of two significant digits.

        Legs of any size walk alike at one share of the speed of a fall from their height (Froude). The shares are those
        of the quadruped, whose reference gait follows them; on two feet, of the small biped. What legs can do in part,
        or not at all, is asked for in part.
        """
        rate = float(np.sqrt(GRAVITY / stance.height))
        length = stance.height * (ON_TWO if len(stance.feet) == 2 else 1.0)
        speed = length * rate
        ahead, aside, turned = (round(float(share), 2) for share in stance.able)
        found: dict[str, float | tuple[float, ...]] = {
            "forward": (-0.159 * speed * ahead, 0.238 * speed * ahead),
            "sideways": (-0.079 * speed * aside, 0.079 * speed * aside),
            "turn": (-0.077 * rate * turned, 0.077 * rate * turned),
            "cadence": 0.322 * rate,
            "lift": 0.123 * length,
            "tolerance": 0.0634 * speed,
            "turn_tolerance": 0.0386 * rate,
            "air_time": 1.555 / rate,
            "energy_weight": 0.0326 / (stance.weight * stance.height * rate),
        }
        short: dict[str, Any] = {key: _short(value) for key, value in found.items()}
        return cls(**short)


class Tried(NamedTuple):
    """How a robot does by its reference gait alone: falls of some simulations, and how those that stood were off.

    In tolerances of the reward; and the shares of the way forward, sideways and about the vertical that they made (3,),
    1 where nothing is asked for, and what they made of it whatever was asked for (3,) [m/s, m/s, rad/s]. Standing still
    would be ``still`` tolerances off.
    """

    falls: int
    off: float
    way: tuple[float, ...]
    drift: tuple[float, ...]
    still: float

    def warning(self) -> str:
        """What is wrong with such a gait, for a sentence; "": nothing."""
        said = [f"falls in {self.falls} of {STRIDE_TRIALS} trials"] if self.falls else []
        if np.isfinite(self.off) and 0.0 < self.still <= self.off:
            said.append(f"is {self.off / self.still:.2g} times as far from what is asked for as standing still is")
        return " and ".join(said)


def tried(engine: BatchEngine) -> Tried:
    """Try the reference gait of an engine."""
    task = engine.task
    assert isinstance(task, WalkTask)
    engine.seed(0)
    engine.reset()
    none = np.zeros((engine.num_envs, len(engine.action_names)))
    fallen, seen = np.zeros(engine.num_envs, bool), []
    for step in range(round(TRIAL_TIME / engine.dt)):
        fallen |= engine.step(none).terminated
        if step * engine.dt >= 0.25 * TRIAL_TIME:
            velocity, turn, _ = task.velocity(engine.motion(none))
            seen.append(np.column_stack([velocity[:, :2], turn]))
    if fallen.all():
        return Tried(len(fallen), np.inf, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 0.0)
    asked, done = engine.motion(none).command[~fallen], np.mean(seen, axis=0)[~fallen]
    ranging = np.ptp(asked, axis=0) > 0.0  # of one command alone, nothing tells what is made whatever is asked for
    about = np.where(ranging, asked.mean(axis=0), 0.0)
    size = ((asked - about) ** 2).sum(axis=0)
    way = np.where(size > 0.0, ((asked - about) * done).sum(axis=0) / np.maximum(size, 1e-12), 1.0)
    drift = np.where(ranging | (size == 0.0), done.mean(axis=0) - way * asked.mean(axis=0), 0.0)
    tolerance = [task.sizes.tolerance, task.sizes.tolerance, task.sizes.turn_tolerance]
    off, still = (float(np.mean(np.abs(each) / tolerance)) for each in (done - asked, asked))
    return Tried(int(fallen.sum()), off, tuple(way.tolist()), tuple(drift.tolist()), still)


def _short(value: float | tuple[float, ...]) -> float | tuple[float, ...]:
    """A number, or several, with two significant digits."""
    return tuple(float(f"{item:.2g}") + 0.0 for item in value) if isinstance(value, tuple) else float(f"{value:.2g}")


@dataclass(frozen=True)
class WalkTask(Commanded):
    """The options of :class:`sealegs.envs.any_robot.env.WalkEnv`."""

    forward: float | Sequence[float] | None = option(
        None, "commanded speed, or from which to which; null: by the robot's size, as all that can be null", "m/s"
    )
    sideways: float | Sequence[float] | None = option(None, "the same to the left", "m/s")
    turn: float | Sequence[float] | None = option(None, "the same about the vertical", "rad/s")
    stand_share: float = option(0.1, "see Starting State")
    command_interval: float = option(0.0, "between commands of an episode; 0: it has one", "s")
    correction: float = option(0.25, "see Action Space")
    cadence: float | None = option(0.0, "cycles of the reference gait per second [Hz]; 0: none")
    lift: float | None = option(None, "of a foot, in the reference gait and the reward", "m")
    sway: float | None = option(
        None, "on two feet, in that gait: share of the way that takes the weight over the one that stands"
    )
    lead: float | None = option(None, "by which that comes before the feet, in cycles")
    forward_stride: float | None = option(1.0, "in that gait, over the command; null: as it follows best")
    sideways_stride: float | None = option(1.0, "the same to the side")
    turn_stride: float | None = option(1.0, "the same of turning")
    forward_trim: float | None = option(
        0.0, "added to a command in that gait; null: what it makes unasked, taken back", "m/s"
    )
    sideways_trim: float | None = option(0.0, "the same to the left", "m/s")
    turn_trim: float | None = option(0.0, "the same about the vertical", "rad/s")
    tolerance: float | None = option(None, "see Rewards", "m/s")
    sideways_tolerance: float | None = option(None, "to the side, see Rewards; null: as `tolerance`", "m/s")
    turn_tolerance: float | None = option(None, "see Rewards", "rad/s")
    tracking_weight: float = 2.0
    turn_weight: float = 1.0
    upright_weight: float = 2.0
    sway_weight: float = 0.05
    air_time_weight: float = 1.0
    air_time: float | None = option(None, "see Rewards", "s")
    slip_weight: float = 0.1
    clearance_weight: float = 0.1
    collision_weight: float = 0.5
    smooth_weight: float = 0.05
    duty_weight: float = 0.1
    energy_weight: float | None = option(None, "see Rewards", "1/W")
    stand_weight: float = 1.0
    healthy_tilt: float = option(0.7, "see Termination", "rad")
    healthy_height: float = option(0.5, "see Termination")
    start_noise: float = 0.05
    switches: bool = option(False, "whether contact switches of the robot are observed")

    robot = get_robot("quadruped")
    ranges = ("forward", "sideways", "turn")
    scales = ("tolerance", "sideways_tolerance", "turn_tolerance", "lift")
    per_joint = 1
    per_robot = len(COMMANDS) + 1
    sees = ("ground", "bodies")
    stance: ClassVar[Standing]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.switches and not self._switched():
            raise SealegsError(
                f"robot '{self.robot.name}' has no contact switches to observe (switches=true): name them in its file, "
                "such as imu: {switches: {fl_foot: {body: <its foot>}}}."
            )
        if self.cadence is not None and self.cadence < 0.0:
            raise SealegsError(f"cadence is {self.cadence:g} Hz; it must be above 0, or 0 for no reference gait.")
        height = type(self).standing_of().height
        if self.lift is not None and self.lift >= height:
            raise SealegsError(
                f"lift is {self.lift:g} m; no foot of {self.robot.name} is lifted as high as it stands, {height:.2g} "
                "m: give less, in metres."
            )

    @classmethod
    def on(cls, robot: Robot | str | Path) -> type[Self]:
        kind = super().on(robot)
        kind.standing_of()
        return kind

    @classmethod
    def standing_of(cls) -> Standing:
        """How the class's robot stands, found once.

        Raises:
            SealegsError: it has no free base, or no feet on a floor.
        """
        if "stance" not in vars(cls):
            cls.stance = standing(cls.robot)
        return cls.stance

    @cached_property
    def sizes(self) -> Sizes:
        """Numbers that were given, and of those left open what the robot's size says."""
        given = {item.name: getattr(self, item.name) for item in fields(Sizes)}
        return replace(Sizes.of(self.stance), **{key: value for key, value in given.items() if value is not None})

    def fitted(self, trial: Callable[[Self, int], Any]) -> Self:
        left_open = [name for name in PLAIN if getattr(self, name) is None]
        two = bool(self.stance.aside.any())
        sways = SWAYS if self.sway is None and two else [1.0 if self.sway is None else self.sway]
        sized = replace(self, **vars(self.sizes), sway=sways[0], **{name: PLAIN[name] for name in left_open})
        if not self.sizes.cadence > 0.0:
            return sized
        lifts = [self.sizes.lift / 2.0**k for k in range(HALVINGS + 1)] if self.lift is None else [self.lift]
        leads = LEADS if self.lead is None and two and sways[0] > 0.0 else [self.sizes.lead]
        best = sized
        if left_open or len(lifts) * len(leads) * len(sways) > 1:
            print(f"Trying the reference gait of {self.robot.name} (up to minutes) ...", file=sys.stderr, flush=True)
        for lift in lifts:
            tasks = [replace(sized, lift=lift, lead=lead, sway=sway) for sway in sways for lead in leads]
            if len(tasks) == 1 and lift == lifts[-1]:
                best = tasks[0]
                break
            trials = [tried(trial(task, TRIALS)) for task in tasks]
            found = min(trials)
            best = tasks[trials.index(found)]
            if found.falls == 0:
                break
        return best._strode(left_open, trial) if left_open else best

    def _of_gait(self, names: Sequence[str]) -> np.ndarray:
        """Numbers of the reference gait (3,), plain where they are open."""
        return np.array([PLAIN[name] if (given := getattr(self, name)) is None else given for name in names])

    def _strode(self, left_open: Sequence[str], trial: Callable[[Self, int], Any]) -> Self:
        """With strides and trims that make up for what the gait lacks, or has too much, if that does better."""
        found = tried(trial(self, STRIDE_TRIALS))
        wanted = self._of_gait(STRIDE_NAMES) / np.maximum(found.way, LEAST_WAY)
        strides = np.clip(wanted, 1.0 / MOST_STRIDE, MOST_STRIDE).round(2)
        trims = (self._of_gait(TRIM_NAMES) - strides * found.drift).round(3)
        kept = dict(zip(PLAIN, [*strides.tolist(), *trims.tolist()], strict=True))
        best = self
        for names, least in ((STRIDE_NAMES, 1.0), (PLAIN, TRIMMED)):
            task = replace(self, **{name: kept[name] for name in names if name in left_open})
            if task != best and (other := tried(trial(task, STRIDE_TRIALS))) < found._replace(off=least * found.off):
                best, found = task, other
        if warning := found.warning():
            print(
                f"{self.robot.name}: its reference gait {warning}. A lower cadence, smaller commands or the chain of "
                "its real servos may help; else train with a larger correction.",
                file=sys.stderr,
            )
        return best

    def averaged(self) -> float:
        return 1.0 / self.sizes.cadence if self.sizes.cadence > 0.0 else super().averaged()

    def span(self, name: str) -> float | Sequence[float]:
        return getattr(self.sizes, name)

    # --- what is asked for -------------------------------------------------------------------------------------

    def asked_names(self) -> tuple[str, ...]:
        return COMMANDS

    def place(
        self, drivetrain: Drivetrain, numbers: Numbers, random: np.ndarray, qpos: np.ndarray, qvel: np.ndarray
    ) -> np.ndarray:
        del numbers
        noise = self.start_noise * self.half * (2.0 * self.per_coordinate(random)[:, :, 0] - 1.0)
        return self.placed(drivetrain, self.centre + noise, qpos, qvel)

    def reference(
        self, time: np.ndarray, command: np.ndarray, numbers: Numbers
    ) -> tuple[np.ndarray, np.ndarray] | None:
        del numbers
        goals: Any = np.broadcast_to(self.centre, (len(time), len(self.centre)))
        if self.sizes.cadence > 0.0:
            goals = goals + self._gait(time, command)
        return goals, self.correction * self.half

    def _gait(self, time: np.ndarray, command: np.ndarray) -> Any:
        """Change of the goals (n, k): each foot in turn is lifted and swings ahead, as the command asks.

        Of two feet, one stands where the weight is not. So the base sways over it, as far as a pendulum on the ground
        must for the ground to press where that foot is.
        """
        stance, found, walking = self.stance, 0.0, 0.0
        slow = SLOW * float(np.sqrt(GRAVITY * stance.height))
        asked = np.hypot(command[:, 0], command[:, 1]) + np.abs(command[:, 2]) * RIM * stance.height
        walk = command * self._of_gait(STRIDE_NAMES)
        walk = walk + np.minimum(asked / slow, 1.0)[:, None] * self._of_gait(TRIM_NAMES)
        for foot, (place, turn) in enumerate(zip(stance.places, stance.turns, strict=True)):
            cycle = (self.sizes.cadence * time + 0.5 * float(turn)) % 1.0
            along, across = self._speed_of(walk, place)
            spinning = np.abs(command[:, 2]) * RIM * stance.height * float(stance.per_turn[foot].any())
            moving = np.minimum((np.sqrt(along * along + across * across) + spinning) / slow, 1.0)
            swinging = cycle < SWING
            ahead = np.where(swinging, -0.5 * np.cos(np.pi * cycle / SWING), 0.5 - (cycle - SWING) / (1.0 - SWING))
            up = self.sizes.lift * moving * np.where(swinging, np.sin(np.pi * cycle / SWING), 0.0)
            stride = (1.0 - SWING) / self.sizes.cadence  # [s] on the ground
            for axis, way in enumerate((stride * along * ahead, stride * across * ahead, up)):
                found = found + way[:, None] * stance.per_metre[foot, axis]
            found = found + (stride * walk[:, 2] * ahead)[:, None] * stance.per_turn[foot]
            walking = walking + moving / len(stance.feet)
        if self.sway == 0.0 or not stance.aside.any():
            return found
        rate = 2.0 * np.pi * self.sizes.cadence
        size = (1.0 if self.sway is None else self.sway) / (1.0 + rate * rate * stance.height / GRAVITY)
        sway = size * walking * np.sin(2.0 * np.pi * (self.sizes.cadence * time + self.sizes.lead))
        soles = -(stance.per_metre[:, :2] * stance.aside[:, None]).sum(axis=(0, 1))  # they move the other way
        return found + sway[:, None] * soles

    @staticmethod
    def _speed_of(command: np.ndarray, place: np.ndarray) -> tuple[Any, Any]:
        """Speed over the ground of a place of the body (n,) [m/s], as commanded."""
        forward, sideways, turn = command[:, 0], command[:, 1], command[:, 2]
        return forward - turn * float(place[1]), sideways + turn * float(place[0])

    # --- what the policy sees ----------------------------------------------------------------------------------

    def observation_names(self) -> tuple[str, ...]:
        return (
            *(f"commanded {name}" for name in COMMANDS),
            *(f"gravity along {axis} of the base" for axis in AXES),
            *(f"turn rate about {axis} of the base [rad/s]" for axis in AXES),
            *self.named(("motor reading from the stance", "{unit}"), ("motor speed", "{unit}/s")),
            *self.named(("last action", "-"), ("action before", "-")),
            *(("sine of the clock", "cosine of the clock") if self.sizes.cadence > 0.0 else ()),
            *(f"contact switch {name} [-]" for name in (self._switched() if self.switches else ())),
        )

    def _switched(self) -> tuple[str, ...]:
        """Names of the robot's contact switches."""
        return () if self.robot.imu is None else tuple(switch.name for switch in self.robot.imu.switches)

    def observe(self, motion: Motion) -> tuple[np.ndarray, ...]:
        m = motion
        parts = (m.command, m.gravity, m.turn_rate, m.reading - self.centre, m.reading_speed)
        parts = (*parts, m.action, m.previous_action)
        if self.sizes.cadence > 0.0:
            phase = 2.0 * np.pi * (self.sizes.cadence * m.time % 1.0)
            parts = (*parts, np.sin(phase), np.cos(phase))
        return (*parts, m.switches) if self.switches else parts

    def _upright(self, motion: Motion) -> np.ndarray:
        """Cosine of the tilt of the base from the stance (n,)."""
        return -(motion.gravity * self.stance.up).sum(axis=1)

    # --- what it is worth --------------------------------------------------------------------------------------

    def rewards(self, motion: Motion) -> dict[str, np.ndarray]:
        m = motion
        up = self._upright(m)
        change = m.action - m.previous_action
        still = (m.command == 0.0).all(axis=1)
        away = np.abs((m.reading - self.centre) / self.half).mean(axis=1)
        power = np.abs(m.torque * m.motor_speed).sum(axis=1)
        terms = {
            "reward_upright": -self.upright_weight * (1.0 - up**2),
            "reward_smooth": -self.smooth_weight * (change**2).mean(axis=1),
            "reward_energy": -self.sizes.energy_weight * power,
            "reward_stand": -self.stand_weight * still * away,
        }
        return terms | self._simulated(m, still) if m.world.simulated else terms

    def _simulated(self, motion: Motion, still: np.ndarray) -> dict[str, np.ndarray]:
        """Terms of what a machine does not measure."""
        m, stance, world = motion, self.stance, motion.world
        velocity, _, sway = self.velocity(m)
        speed, turn = self._off(m)
        widths = self.sizes.tolerance, self.sideways_tolerance or self.sizes.tolerance
        off, astray = ((speed / widths) ** 2).sum(axis=1), (turn / self.sizes.turn_tolerance) ** 2
        bounce = (velocity[:, 2] / self.sizes.tolerance) ** 2 + (sway / self.sizes.turn_tolerance) ** 2
        soles, speeds = self._soles(m)
        touching, landed = world.touching(stance.feet), world.landed(stance.feet)
        long = self.sizes.air_time
        aired = np.where(landed > 0.0, np.minimum(landed, 2.0 * long) - long, 0.0).sum(axis=1)
        sliding = (np.minimum(speeds / self.sizes.tolerance, 1.0) * touching).sum(axis=1)
        low = np.maximum(1.0 - (soles - soles.min(axis=1, keepdims=True)) / self.sizes.lift, 0.0)
        shuffling = (np.minimum(speeds / self.sizes.tolerance, 1.0) * low * ~touching).sum(axis=1)
        others = [name for name in world.touchable() if name not in stance.feet]
        return {
            "reward_tracking": self.tracking_weight * np.exp(-off),
            "reward_turn": self.turn_weight * np.exp(-astray),
            "reward_sway": -self.sway_weight * bounce,
            "reward_air_time": self.air_time_weight / long * aired * ~still,
            "reward_slip": -self.slip_weight * sliding,
            "reward_clearance": -self.clearance_weight * shuffling,
            "reward_collision": -self.collision_weight * world.touching(others).sum(axis=1),
            "reward_duty": -self.duty_weight * (m.duty**2).mean(axis=1),
        }

    def errors(self, motion: Motion) -> dict[str, np.ndarray]:
        off, astray = self._off(motion)
        return {"speed [m/s]": np.linalg.norm(off, axis=1), "turning [rad/s]": np.abs(astray)}

    def _off(self, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        """Mean speed (n, 2) [m/s] and turn (n,) [rad/s] less those that were asked for."""
        base, command = self.stance.base, motion.command
        speed = self.ahead(motion, motion.world.mean_velocity(base))[:, :2] - command[:, :2]
        return speed, motion.world.mean_turn_rate(base)[:, 2] - command[:, 2]

    def velocity(self, motion: Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the base: forward, sideways and up (n, 3) [m/s], turn (n,) [rad/s], and other turning (n,) [rad/s]."""
        at, rate, gravity = self.stance.dof, motion.turn_rate, motion.gravity
        turn = -(rate * gravity).sum(axis=1)
        other = np.sqrt(np.maximum((rate**2).sum(axis=1) - turn**2, 0.0))
        return self.ahead(motion, motion.qvel[:, at : at + 3]), turn, other

    def ahead(self, motion: Motion, velocity: np.ndarray) -> np.ndarray:
        """A velocity in the world (n, 3) as forward, sideways and up."""
        w, x, y, z = (motion.qpos[:, self.stance.qpos + 3 + k] for k in range(4))
        first, second, third = self.stance.forward
        ahead = (1.0 - 2.0 * (y * y + z * z)) * first + 2.0 * (x * y - w * z) * second + 2.0 * (x * z + w * y) * third
        aside = 2.0 * (x * y + w * z) * first + (1.0 - 2.0 * (x * x + z * z)) * second + 2.0 * (y * z - w * x) * third
        length = np.maximum(np.hypot(ahead, aside), 1e-9)
        ahead, aside = ahead / length, aside / length
        along, across, up = velocity.T
        return np.stack([along * ahead + across * aside, across * ahead - along * aside, up], axis=1)

    def _soles(self, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        """Height (n, f) [m] and horizontal speed (n, f) [m/s] of the soles."""
        world, pairs = motion.world, list(zip(self.stance.feet, self.stance.soles, strict=True))
        heights = np.stack([world.position(foot, sole)[:, 2] for foot, sole in pairs], axis=1)
        speeds = np.stack([np.hypot(*world.velocity(foot, sole)[:, :2].T) for foot, sole in pairs], axis=1)
        return heights, speeds

    def failed(self, motion: Motion) -> np.ndarray:
        fallen = self._upright(motion) < np.cos(self.healthy_tilt)
        if not motion.world.simulated:
            return fallen
        base = motion.qpos[:, self.stance.qpos + 2]
        low = base - self._soles(motion)[0].min(axis=1) < self.healthy_height * self.stance.height
        if self.stance.base in motion.world.touchable():
            low |= motion.world.touching([self.stance.base])[:, 0]
        return fallen | low
