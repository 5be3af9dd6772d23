"""The IMU of a robot: held against itself, and against how the legs must turn the base that they carry."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ...common.errors import SealegsError
from ...envs.described.robot_imu import with_imu
from ...envs.engine import turns
from ...envs.engine.base import BaseLayout
from ...envs.engine.imu import COLUMNS, Imu, Switches
from ...envs.engine.model_poses import in_turn, place_followers, stand
from ...envs.engine.robot import Robot
from ...envs.engine.turns import projected_gravity
from ..checks.imu import (
    IMU,
    IMU_LAG_REACH,
    ImuLog,
    Match,
    check_imu,
    imu_of,
    match,
    rates_of_turns,
    smoothed,
    told_axes,
)
from ..checks.signal import ERROR_BLOCK, derivatives
from ..ground.pieces import WITHOUT_END, made_heavy
from ..ground.tree_ground import robot_under
from ..ground.tree_model import PLANE, touching
from ..ground.tree_replay import shares
from ..load.robot import Frame
from ..log.finding import Finding
from ..log.parts import SPEED_REACH
from ..log.progress import Progress
from ..log.types import Array, LogError, MeasuredRun
from ..measure.case import Case
from ..measure.measured import Measured
from ..verdict.verdict import EXPLAINED as SAID
from ..verdict.verdict import NOT_IDENTIFIABLE, NOTHING, JointDiagnosis, Reason, Verdict, data_errors
from .switches import Switched

EARLIEST_LAG = -0.03  # [s] of its lag behind the legs: joints are read late, too
SOUGHT_FROM = EARLIEST_LAG + 1e-6  # [s] an interval that begins below it ends where the search does: it has no end
MIN_CARRIED_SHARE = 0.65  # share of the variance of the turn rate that the legs must explain in a run that is used
MIN_TURN_DEVIATIONS = 4.0
"""Standard deviations about an axis of the believed bias, from which a turn about any is worth a word."""
CONTACT_LAG_SPREAD = 0.004
"""Standard deviation of the lag that feet and floors of another softness make [s]: ten walks of 30 ms are told with one
of 3.7 ms (``benchmarks.hidden_imu``)."""
CONTACT_TURN_SPREAD = 0.005
"""Likewise of a turn about a level axis [rad]: walks whose IMU sits turned by 5 degrees are told with one of 0.004."""
MIN_EXTRA_DELAY = 3.0 * CONTACT_LAG_SPREAD  # [s] beyond the believed delay that is worth a word
TURN_DRAWS = 100


def beside(runs: Sequence[MeasuredRun], only: Sequence[str] | None = None) -> tuple[str, ...]:
    """What is diagnosed beside the joints: the IMU, where a run has its samples.

    Raises:
        LogError: it is one of those that ``only`` asks for, and no run has what it takes.
    """
    if any(imu_of(run) is not None for run in runs):
        return (IMU,)
    if only is not None and IMU in only and not any(IMU in run.joints for run in runs):
        lacking = [f"base.{name}" for name in COLUMNS[:-1] if not any(name in run.base for run in runs)]
        why = f"it lacks {', '.join(lacking)}" if lacking else "no run has 20 samples of it in a second or more"
        raise LogError(f"The log has no IMU that can be judged: {why}.")
    return ()


def diagnose_imu(runs: Sequence[MeasuredRun], frames: dict[str, Frame], progress: Progress) -> JointDiagnosis:
    """What is wrong with an IMU.

    Args:
        runs: of one machine.
        frames: of its joints.
        progress: is told what goes on.
    """
    progress("holding the IMU against itself")
    findings, told = check_imu(runs)
    against: list[Finding] = []
    legs = None
    if not findings:  # else nothing that it says can be held against anything
        robot = robot_under(runs[0])
        if robot is not None:
            progress("holding the IMU against the legs")
            legs = _against_legs(runs, robot, frames)
            against = [] if legs is None else legs.findings()
    every = (*findings, *against)
    errors = data_errors(every, IMU)
    if every:
        said = Verdict(SAID, " ".join(finding.sentence for finding in every))
    elif legs is not None:
        said = Verdict(NOTHING, f"Nothing to explain: the IMU agrees with itself and with the legs{legs.agreement()}.")
    elif told:
        why = Reason("imu", "The legs do not tell how the base turns: its delay and its mounting stay unknown.")
        said = Verdict(
            NOTHING, "Nothing to explain: the turn rate of the IMU is the derivative of its orientation.", (why,)
        )
    else:
        said = Verdict(
            NOT_IDENTIFIABLE, "The base hardly turns: the log tells nothing of its IMU. Rock it by its legs."
        )
    case = Case(IMU, every, "base.imu.turn", "rad/s")
    return JointDiagnosis(case, said, Measured(unexplained=0.0), data_errors=errors)


@dataclass(frozen=True, eq=False)
class Legs:
    """An IMU beside what the legs ask of the base.

    Attributes:
        rates: how its turn rate follows from theirs.
        turned: how the IMU sits against where it is believed, about the base's axes (3,) [rad].
        spread: standard deviation of that (3,) [rad].
        believed: delay [s], and standard deviation of the bias of its orientation [rad].
        switched: the contact switches on its board beside the feet; None: it has none.
    """

    rates: Match
    turned: np.ndarray
    spread: np.ndarray
    believed: tuple[float, float]
    switched: Switched | None = None

    def agreement(self) -> str:
        """How well it agrees, for a sentence."""
        rows = zip("xyz", np.degrees(self.turned), np.degrees(2.0 * self.spread), strict=True)
        turned = ", ".join(f"{value:+.2g} (to {known:.2g}) about {axis}" for axis, value, known in rows)
        switches = "" if self.switched is None else f", contact switches {100.0 * self.switched.agreement():.0f} %"
        return f": {1e3 * self.rates.lag:.3g} ms late, turned by {turned} [degrees]{switches}"

    def findings(self) -> list[Finding]:
        """What is wrong."""
        axes = self.rates.axes
        if axes is not None and (sentence := told_axes(axes, "turn", "the base that the legs carry")):
            more = f"{sentence} Turn rate and orientation agree: correct imu.site or imu.rotation."
            return [Finding("imu.mount", "warning", IMU, "base.imu.turn_x", more, data_error=True)]
        found = [] if self.switched is None else self.switched.findings()
        delay, bias = self.believed
        lag = self.rates.lag
        below, above = (np.hypot(lag - end, 2.0 * CONTACT_LAG_SPREAD) for end in (self.rates.low, self.rates.high))
        low, high = float(lag - below), float(lag + above)
        if self.rates.low > SOUGHT_FROM and abs(lag - delay) > MIN_EXTRA_DELAY and (low - delay) * (high - delay) > 0.0:
            found.append(
                Finding(
                    "imu.delay", "warning", IMU, "base.imu.age",
                    f"The IMU is {1e3 * lag:.3g} ms late ({1e3 * low:.3g} to {1e3 * high:.3g}), and "
                    f"{1e3 * delay:.3g} ms are believed (imu.delay).",
                    value=lag, low=low, high=high, cause="sensor.delay",
                )
            )  # fmt: skip
        far = np.abs(self.turned) > MIN_TURN_DEVIATIONS * np.maximum(max(bias, 1e-3), self.spread)
        if far.any():
            size = float(np.linalg.norm(self.turned[far]))
            spread = float(np.sqrt((self.turned[far] ** 2 * self.spread[far] ** 2).sum())) / size
            parts = ", ".join(
                f"{np.degrees(value):+.2g} about {axis}"
                for axis, value, certain in zip("xyz", self.turned, far, strict=True)
                if certain
            )
            found.append(
                Finding(
                    "imu.turned", "warning", IMU, "base.imu.w",
                    f"The IMU sits turned by {np.degrees(size):.2g} degrees ({np.degrees(size - 2 * spread):.2g} to "
                    f"{np.degrees(size + 2 * spread):.2g}; {parts} of the base): correct imu.rotation, or the floor "
                    "slopes.",
                    value=size, low=size - 2.0 * spread, high=size + 2.0 * spread,
                )
            )  # fmt: skip
        return found


def _against_legs(runs: Sequence[MeasuredRun], robot: Robot, frames: dict[str, Frame]) -> Legs | None:
    """The IMU beside what the legs ask of the base; None where they tell too little."""
    ways: list[list[_Beside]] = []
    delay, bias = _believed(runs[0], robot)
    robot = _switched(robot, runs[0])
    for run in runs:
        if (log := imu_of(run)) is not None:
            told = [way for base in carried(robot, run, frames) if (way := _beside(log, base, delay)) is not None]
            told.sort(key=lambda way: -way.explained)
            ways.append([way for way in told if 1.0 - way.explained <= ALIKE * (1.0 - told[0].explained)])
    ways = [told for told in ways if told]
    if not ways:
        return None

    def matched(grounds: Sequence[_Beside]) -> Match | None:
        pairs = [(one.log.time, one.rate, one.asked_rate) for one in grounds]
        return match(pairs, EARLIEST_LAG, delay + IMU_LAG_REACH)

    def blocks(grounds: Sequence[_Beside], lag: float) -> list[_Rows]:
        return [block for one in grounds for block in one.blocks(lag)]

    pairs, *others = [[told[k] if k < len(told) else told[0] for told in ways] for k in range(max(map(len, ways)))]
    best = matched(pairs)
    if best is None:
        return None
    elsewhere = [(found, grounds) for grounds in others if (found := matched(grounds)) is not None]
    near = (best.lag, best.lag - 0.5 * MIN_EXTRA_DELAY, best.lag + 0.5 * MIN_EXTRA_DELAY)
    turned = _turn([blocks(pairs, lag) for lag in near], [blocks(grounds, found.lag) for found, grounds in elsewhere])
    mean = float(np.mean([best.lag, *(found.lag for found, _ in elsewhere)]))
    later = mean - best.lag if best.low > SOUGHT_FROM else 0.0
    found = replace(best, lag=best.lag + later, low=best.low + later, high=best.high + later)
    names = [] if robot.imu is None else [switch.name for switch in robot.imu.switches]
    logged = bool(names) and all(name in one.log.switches for name in names for one in pairs)
    contacts = [block for one in pairs for block in one.contacts(best.lag, names)] if logged else []
    switched = Switched(names, contacts) if contacts else None
    return Legs(found, *turned, (delay, bias), switched)


def _beside(log: ImuLog, base: Carried, delay: float) -> _Beside | None:
    """An IMU beside the base as the legs carry it in one way; None where that tells too little of how it turns."""
    if len(base.time) < 2:
        return None
    log = log.cut((log.time > base.time[0]) & (log.time < base.time[-1]))
    if len(log.time) < 20 or log.time[-1] - log.time[0] < 2.0 * IMU_LAG_REACH + ERROR_BLOCK:
        return None
    at = np.clip(np.searchsorted(base.time, log.time), 1, len(base.time) - 1)
    share = ((log.time - base.time[at - 1]) / (base.time[at] - base.time[at - 1]))[:, None]
    turn = turns.between(base.orientation[at - 1], base.orientation[at], share)
    rate, seen = rates_of_turns(log.time, turn), smoothed(log)
    found = match([(log.time, seen, rate)], EARLIEST_LAG, delay + IMU_LAG_REACH)
    if found is None or found.explained <= MIN_CARRIED_SHARE:
        return None
    left = float(np.std(seen)) * np.sqrt(max(1.0 - found.explained, 1e-3))
    return _Beside(log, base, turn, seen / left, rate / left, found.explained)


def _switched(robot: Robot, run: MeasuredRun) -> Robot:
    """The robot with the contact switches that the sidecar says it had."""
    said = run.meta.get("imu")
    if not isinstance(said, dict) or not said.get("switches"):
        return robot
    try:
        return with_imu(robot, said)
    except SealegsError as error:
        raise SealegsError(f"{run.name}: meta.imu of its sidecar: {error}") from None


def _believed(run: MeasuredRun, robot: Robot) -> tuple[float, float]:
    """Delay [s], and standard deviation of the bias of the orientation [rad]."""
    said = run.meta.get("imu")
    assumed = robot.imu or Imu("")
    try:
        delay = float(said["delay"]) if said and "delay" in said else assumed.delay
        bias = float((said or {}).get("bias", {}).get("orientation", assumed.bias.orientation))
    except (TypeError, ValueError, AttributeError):
        raise SealegsError(
            f"{run.name}: meta.imu of its sidecar is {said!r}; it is the imu of a robot's file."
        ) from None
    return delay, bias


@dataclass(frozen=True, eq=False)
class _Rows:
    """Of a block of a run: what was measured and what the legs ask for, each (n, 3), in parts of what that leaves."""

    rate: Array
    asked_rate: Array
    down: Array
    asked_down: Array


@dataclass(frozen=True, eq=False)
class _Beside:
    """A run of an IMU beside what the legs ask for.

    Attributes:
        log: of the IMU.
        legs: the base as they carry it.
        asked: orientation of the base at its samples (n, 4).
        rate, asked_rate: turn rates there (n, 3), in parts of what one leaves of the other: a run in which the robot
            slips or trips tells less.
        explained: share of the variance of the turn rate that the legs explain.
    """

    log: ImuLog
    legs: Carried
    asked: Array
    rate: Array
    asked_rate: Array
    explained: float

    def blocks(self, lag: float) -> list[_Rows]:
        """The run in blocks, the IMU as much later than the legs."""
        time = self.log.time
        grid = time[(time - lag > time[0]) & (time - lag < time[-1])]

        def at(values: Array, when: Array) -> Array:
            return np.stack([np.interp(when, time, column) for column in values.T], axis=1)

        down = at(turns.projected_gravity(self.log.orientation), grid)
        asked = at(turns.projected_gravity(self.asked), grid - lag)
        left = max(float(np.std(down - asked, axis=0).mean()), 1e-4)
        parts = (at(self.rate, grid), at(self.asked_rate, grid - lag), down / left, asked / left)
        return [_Rows(*(part[rows] for part in parts)) for rows in _in_blocks(grid)]

    def contacts(self, lag: float, names: Sequence[str]) -> list[tuple[Array, Array]]:
        """What contact switches said in blocks, and whether their feet were down (n, s), the IMU as much later."""
        said = np.stack([self.log.switches[name] for name in names], axis=1)
        asked = self.log.time - lag
        known = np.isfinite(said).all(axis=1) & (asked >= self.legs.time[0]) & (asked <= self.legs.time[-1])
        said, asked = said[known], asked[known]
        down = self.legs.down[np.clip(np.searchsorted(self.legs.time, asked), 0, len(self.legs.time) - 1)]
        return [(said[rows], down[rows]) for rows in _in_blocks(asked)]


def _in_blocks(time: Array) -> list[np.ndarray]:
    """Numbers of the rows of each block of a run."""
    count = max(int((time[-1] - time[0]) / ERROR_BLOCK), 1) if len(time) else 0
    return np.array_split(np.arange(len(time)), count) if count else []


def _turn(lags: Sequence[list[_Rows]], elsewhere: Sequence[list[_Rows]]) -> tuple[np.ndarray, np.ndarray]:
    """The turn (3,) [rad] that makes what was measured what the legs ask for, and its standard deviation.

    About the vertical its deviation is the crosstalk of the level axes at least: where feet slip or the robot trips,
    what the legs ask for is off in many ways, of which a turn is only one. Where the base swings in circles, as it does
    while the robot turns, a lag looks like a turn, and is known only as well as feet and floor are. And a turn is known
    as well as those grounds agree that explain the IMU alike.

    Args:
        lags: blocks of all runs, at the lag that was found and at one and a half deviations of it to both sides.
        elsewhere: blocks on each further ground.
    """
    blocks, *others = lags
    random = np.random.default_rng(0)
    drawn = [_solved([blocks[k] for k in random.integers(0, len(blocks), len(blocks))]) for _ in range(TURN_DRAWS)]
    turned, spread = _solved(blocks), np.std(drawn, axis=0)
    early, late = (_solved(chosen) for chosen in others)
    ways = [turned, *map(_solved, elsewhere)]
    spread = np.sqrt(spread**2 + 0.25 * (early - late) ** 2 + np.var(ways, axis=0) + CONTACT_TURN_SPREAD**2)
    spread[2] = max(spread[2], _crosstalk(blocks))
    return -np.mean(ways, axis=0), spread


def _solved(blocks: Sequence[_Rows]) -> np.ndarray:
    """The turn (3,) [rad] of what the legs ask for that makes it what was measured.

    The turn rates tell it about all axes, gravity about the level ones, each weighed by what it leaves.
    """
    turned = np.zeros(3)
    for _ in range(4):
        turn = turns.of_vector(turned)
        slope, error = np.zeros((3, 3)), np.zeros(3)
        for measured, asked in (("rate", "asked_rate"), ("down", "asked_down")):
            first = np.concatenate([getattr(block, measured) for block in blocks])
            second = turns.applied(turn, np.concatenate([getattr(block, asked) for block in blocks]))
            left = first - second
            weight = 1.0 / max(float(np.mean(left**2)), 1e-12)
            # a further small turn d changes what is asked for by d x it
            size = (second**2).sum()
            slope += weight * (size * np.eye(3) - second.T @ second)
            error += weight * np.cross(second, left).sum(axis=0)
        turned = turns.to_vector(turns.multiply(turns.of_vector(np.linalg.solve(slope, error)), turn))
    return turned


def _crosstalk(blocks: Sequence[_Rows]) -> float:
    """How much of a rate about one level axis goes into the other beside what a turn makes of it [rad].

    It is that of the linear map which takes the rates that the legs ask for to what was measured.
    """
    measured, asked = (np.concatenate([getattr(block, name) for block in blocks]) for name in ("rate", "asked_rate"))
    mapped = np.linalg.lstsq(asked, measured, rcond=None)[0].T
    left, _, right = np.linalg.svd(mapped)
    stretch = (left @ right).T @ mapped
    return float(abs(stretch[0, 1]))


# --- how the base of a robot on legs must turn, from its joints alone: they move as measured, and it stands on them --
#
# Nothing that an IMU says is used, so that the IMU can be held against it. A joint is so heavy that only the force
# which makes it follow its path can move it, as in :mod:`sealegs.gap.ground.tree_replay`.

SETTLING_SECONDS, SPEED_UP_SECONDS = 0.5, 0.2  # that it settles in its first pose, and in which motion then sets in
GROUNDS = tuple(itertools.product((0.5, 0.75, 1.0, 1.5), (None, 10.0)))
"""Grounds on which it stands: friction in parts of its model's, and ``impratio`` (of an elliptic cone, on which feet
creep less; None: as in the model). Assumed.

On two diagonal feet a base falls from side to side, and which way depends on as little as that. Of two right models of
contact one told a right IMU that it sits turned by 4 degrees, so each run takes the one that explains it best, and
delay and turn are the mean over those that explain it alike.
"""
ALIKE = 1.5  # times what the best ground leaves of the turn rate's variance, that others leave which may be right, too
FALLEN_ANGLE = 0.7  # [rad] from upright: what it does then, its legs do not tell


@dataclass(frozen=True, eq=False)
class Carried:
    """How a base turns, in the axes of the model.

    Attributes:
        time: of the run, as far as it stands (n,) [s].
        orientation: quaternion (n, 4).
        down: 1 where a foot presses so that its contact switch closes, else 0 (n, s).
    """

    time: Array
    orientation: Array
    down: Array = field(default_factory=lambda: np.empty((0, 0)))


def carried(robot: Robot, run: MeasuredRun, frames: dict[str, Frame]) -> list[Carried]:
    """The base over a run, on each ground of :data:`GROUNDS` on which it stands.

    On none where the robot has no floor or feet to stand on, or its joints were not all logged.
    """
    names = [item.name for item in robot.coordinates]
    if any(name not in run.joints for name in names):
        return []
    found = [_carried_on(*ground, robot, run, names, frames) for ground in GROUNDS]
    return [way for way in found if way is not None]


def _carried_on(
    friction: float, impratio: float | None, robot: Robot, run: MeasuredRun, names: list[str], frames: dict[str, Frame]
) -> Carried | None:
    """The base over a run on one ground, a value of :data:`GROUNDS`."""
    try:
        drivetrain = robot.drivetrain(None, run.robot_params)
    except SealegsError:
        return None
    model = drivetrain.model
    place = BaseLayout.of_model(model, range(model.njnt)).base
    floors = [k for k in range(model.ngeom) if int(model.geom_type[k]) == PLANE]
    if place is None or not floors:
        return None
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    model.geom_friction[:, 0] *= friction
    model.pair_friction[:, :2] *= friction
    if impratio is not None:
        model.opt.cone, model.opt.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, max(model.opt.impratio, impratio)
    joints, motors = shares([drivetrain.terms(name) for name in names])
    step = float(model.opt.timestep)
    clock, angles = _paths(run, names, frames, step)
    position = angles @ motors.T
    moved = np.diff(position, axis=0, prepend=position[:1]) / step  # as the engine integrates: a speed first
    dofs = made_heavy(model, joints)
    places = [int(model.joint(name).qposadr[0]) for name in joints]
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)  # a foot bears on the floor with the whole robot, not as its own light body
    stand(model, robot.pose, data.qpos)
    data.qpos[places] = position[0]
    place_followers(model, in_turn(model), data.qpos)
    if not _put_down(model, data, floors[0], place[0]):
        return None
    upright = projected_gravity(np.array(data.qpos[place[0] + 3 : place[0] + 7]))
    turned, switches = np.empty((len(clock), 4)), Switches(model, () if robot.imu is None else robot.imu.switches)
    down = np.empty((len(clock), 0 if robot.imu is None else len(robot.imu.switches)))
    for k in range(len(clock)):
        data.qpos[places], data.qvel[dofs] = position[k], moved[k]
        turned[k], down[k] = data.qpos[place[0] + 3 : place[0] + 7], switches.closed(data.sensordata)
        if not np.isfinite(turned[k]).all() or projected_gravity(turned[k]) @ upright < np.cos(FALLEN_ANGLE):
            break
        if k + 1 < len(clock):
            data.qfrc_applied[dofs] = WITHOUT_END * (moved[k + 1] - moved[k]) / step
            mujoco.mj_step(model, data)
    else:
        k += 1
    kept = slice(int(np.searchsorted(clock[:k], run.time[0] + SPEED_UP_SECONDS)), k)
    return Carried(clock[kept], turned[kept], down[kept])


def _paths(run: MeasuredRun, names: list[str], frames: dict[str, Frame], step: float) -> tuple[Array, Array]:
    """Times of the run at steps of the engine, and the coordinates there (n, k), behind a rest in the first pose."""
    span = float(run.time[-1] - run.time[0])
    since = np.arange(-SETTLING_SECONDS, span, step)
    # the time of the run passes by and by: still at first, then ever faster, then as it did
    ramp = np.clip(since, 0.0, SPEED_UP_SECONDS)
    passed = np.where(since < SPEED_UP_SECONDS, 0.5 * ramp**2 / SPEED_UP_SECONDS, since - 0.5 * SPEED_UP_SECONDS)
    clock = run.time[0] + passed
    columns = []
    for name in names:
        frame, log = frames.get(name, Frame()), run.joints[name]
        good = np.isfinite(log.position)
        values = frame.to_model(np.interp(run.time, run.time[good], log.position[good]))
        smooth, rate, _ = derivatives(run.time, values, SPEED_REACH)
        columns.append(CubicHermiteSpline(run.time, smooth, rate)(clock))
    return clock, np.stack(columns, axis=1)


def _put_down(model: mujoco.MjModel, data: mujoco.MjData, floor: int, base: int) -> bool:
    """Set the robot onto its floor; whether there is anything that can stand on it."""
    mujoco.mj_kinematics(model, data)
    touch = touching(model, floor)
    nearest = min((mujoco.mj_geomDistance(model, data, floor, geom, 10.0, None) for geom in touch), default=np.inf)
    if not np.isfinite(nearest):
        return False
    data.qpos[base + 2] -= nearest
    return True
