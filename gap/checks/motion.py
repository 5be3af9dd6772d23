"""Checks of goal and position: motion at all, units, wrap-around, excitation, saturation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...actuators.chain import Chain
from ..log.finding import Finding, Severity
from ..log.parts import gaps
from ..log.types import FACTOR, TURN_IN_UNITS
from .context import JointContext
from .signal import FOLLOWS_SHARE, MIN_SAMPLES, same_unit

DEGREES_PER_RADIAN = 180.0 / np.pi
FULL_TURN = 2.0 * np.pi
MIN_GOAL_MOTION = 0.02  # [rad] that a goal must move for the way of its joint to tell a unit
DIRECTION_WAY_RATIO = 5.0  # times as far as its goal, or as little, that a joint may move for its direction to be told
MAX_GEARED_SPEED = 60.0
"""Speed [rad/s] that no geared joint reaches; a motor without a gear does."""
BEYOND_MODEL = 2.0
"""Times the range or the no-load speed of its model that a joint may go: its numbers are off, or its load drives it."""
VELOCITY_UNITS = {
    "rad/s": 1.0,
    "degrees per second": 1.0 / FACTOR["deg/s"],
    "revolutions per minute": 1.0 / FACTOR["rpm"],
    "revolutions per second": 1.0 / FACTOR["turn/s"],
}
"""How many of each are one rad/s."""
UNIT_TOLERANCE = 0.05  # of a ratio: a gear of another ratio is none
WHOLE_TURN_MARGIN = 0.5
"""Angle [rad] around whole turns within which a joint is where it was sent, on another turn."""
MAX_STOPPED_ANGLE = 10.0
"""Angle [rad] that a joint with end stops does not reach."""


def check_motion(joint: JointContext) -> Iterator[Finding]:
    """Yield what is wrong with the motion of a joint."""
    goal = joint.log.goal
    if joint.still:
        asked = goal is not None and np.ptp(goal) > max(10.0 * joint.noise, 5.0 * joint.step, 1e-6)
        yield joint.remark(
            "motion.none", "error", "position", joint.span,
            f"Joint {joint.name} does not move ({joint.span:.2g} {joint.unit} in all)"
            + (" although its goal does: check power, torque enable and the position column." if asked else
               ": nothing can be learnt from it; record a motion."),
            data_error=bool(asked),
        )  # fmt: skip
        return
    if joint.radians and (ticks := list(_ticks(joint))):
        yield from ticks  # of raw counts, every other check would say something wrong
        return
    if joint.slides and joint.unit == "m" and (lengths := list(check_lengths(joint))):
        yield from lengths
        return
    yield from _wraps(joint)
    if joint.radians:
        if goal is not None:
            yield from _goal_wraps(joint, goal)
        yield from _degrees(joint)
    if goal is not None:
        yield from _goal(joint, goal)
    yield from _link_sign(joint)
    yield from _excitation(joint)
    yield from _saturation(joint)
    if joint.log.enabled is not None and (joint.log.enabled < 0.5).any():
        off = joint.log.enabled < 0.5
        yield joint.remark(
            "drive.off", "note", "enabled", float(off.mean()),
            f"The drive of {joint.name} is off in {off.mean():.0%} of the samples, from "
            f"{joint.time[off.argmax()]:.3g} s: the joint moves freely there.",
        )  # fmt: skip


def _ticks(joint: JointContext) -> Iterator[Finding]:
    """Raw counts of an encoder: whole numbers, farther than degrees reach or than degrees could move."""
    for signal, followed in (("position", "goal"), ("goal", "position"), ("link_position", "position")):
        values, other = getattr(joint.log, signal), getattr(joint.log, followed)
        if values is None or not np.isfinite(values).all() or (values != np.round(values)).any():
            continue
        span, reach = float(np.ptp(values)), float(np.abs(values).max())
        moved = float(np.ptp(other)) if other is not None and np.isfinite(other).all() else 0.0
        ratio = span / moved if moved > 0.0 else 1.0
        if ratio > 2.0 * DEGREES_PER_RADIAN or (reach > 360.0 and ratio < 0.3 * DEGREES_PER_RADIAN):
            yield joint.fault(
                "unit.ticks", "error", signal, reach,
                f"is in encoder ticks, not in radians: whole numbers from {values.min():.0f} to {values.max():.0f}; "
                "subtract the ticks of its zero and multiply by 2 pi over the ticks of a turn (4096 of a Feetech STS "
                "servo).",
            )  # fmt: skip


def _wraps(joint: JointContext) -> Iterator[Finding]:
    for signal in ("position", "link_position"):
        values = getattr(joint.log, signal)
        if values is None or not np.isfinite(values).all():
            continue
        change = np.diff(values)
        length = np.abs(change)
        usual, slow = np.quantile(length, (0.99, 0.9))
        whole = (np.abs(length / FULL_TURN - 1.0) < 0.2) & (length > 12.0 * slow)  # however often
        one_turn = np.ptp(values) < 1.1 * FULL_TURN  # in degrees it would be a lot more
        far = (length > 1.0) & (length > 12.0 * usual)
        far[gaps(joint.time)] = False  # it moved meanwhile
        jumps = np.flatnonzero(far | (whole & one_turn))
        if not len(jumps):
            yield from _other_turn(joint, signal)
            continue
        size = float(np.median(length[jumps]))
        back = np.isin(jumps + 1, jumps) & (
            np.sign(change[jumps]) != np.sign(change[np.minimum(jumps + 1, len(change) - 1)])
        )
        spikes = int(back.sum())
        where = f"first at {joint.time[jumps[0] + 1]:.4g} s"
        if spikes * 2 >= len(jumps):
            yield joint.fault(
                f"{signal}.spikes", "error", signal, size,
                f"has {max(spikes, 1)} isolated wrong reading{'s' * (spikes > 1)} of about {size:.3g} rad, {where}; "
                "remove these samples.",
            )  # fmt: skip
        else:
            turns = " (one turn)" if abs(size / FULL_TURN - 1) < 0.05 else ""
            yield joint.fault(
                f"{signal}.wrap", "error", signal, size,
                f"jumps by {size:.4g} rad{turns} between neighbouring samples {len(jumps)} "
                f"time{'s' * (len(jumps) > 1)}, {where}: the encoder wraps around; unwrap the column.",
            )  # fmt: skip


def _goal_wraps(joint: JointContext, goal: np.ndarray) -> Iterator[Finding]:
    """Goals that jump by a turn where the joint goes on, as a joint without end is told to."""
    position = joint.log.position
    jumps = int((np.abs(np.abs(np.diff(goal)) / FULL_TURN - 1.0) < 0.2).sum())
    if not jumps or np.ptp(goal) > 1.1 * FULL_TURN or not (np.isfinite(goal).all() and np.isfinite(position).all()):
        return
    whole = unwrapped(position)
    as_it_is, without = (_apart(values, whole) for values in (goal, unwrapped(goal)))
    if without < 0.5 * as_it_is:
        yield joint.fault(
            "goal.wrap", "error", "goal", FULL_TURN,
            f"jumps by a turn between neighbouring samples {jumps} time{'s' * (jumps > 1)} where the joint goes on: "
            "goals wrap around; unwrap the column.",
        )  # fmt: skip


def unwrapped(angle: np.ndarray) -> np.ndarray:
    """An angle without jumps of about a turn; shorter ones are steps."""
    return np.unwrap(angle, discont=0.8 * FULL_TURN)


def on_turn_of(angle: np.ndarray, other: np.ndarray, period: float = FULL_TURN) -> np.ndarray:
    """An angle on the turn of another one that goes with it."""
    return angle - period * np.round(np.median(angle - other) / period)


def _apart(angle: np.ndarray, other: np.ndarray) -> float:
    """How far two angles are apart (rms), whole turns aside."""
    return float(np.sqrt(np.mean((on_turn_of(angle, other) - other) ** 2)))


def _other_turn(joint: JointContext, signal: str) -> Iterator[Finding]:
    """An encoder that wrapped before the run began: all of it lies whole turns from what it follows."""
    followed = "goal" if signal == "position" else "position"
    values, other = getattr(joint.log, signal), getattr(joint.log, followed)
    if other is None or not joint.radians or not np.isfinite(other).all():
        return
    turns = round(float(np.median(values - other)) / FULL_TURN)
    alike = np.ptp(values) < np.ptp(other) + 2.0 * WHOLE_TURN_MARGIN  # neither is in degrees
    if turns and alike and float(np.median(np.abs(values - other - turns * FULL_TURN))) < WHOLE_TURN_MARGIN:
        yield joint.fault(
            f"{signal}.wrap", "error", signal, FULL_TURN,
            f"lies {abs(turns)} whole turn{'s' * (abs(turns) > 1)} from {joint.column(followed)}: the encoder wrapped "
            "around before the log began; subtract the turns.",
        )  # fmt: skip


def _degrees(joint: JointContext) -> Iterator[Finding]:
    position, goal = joint.log.position, joint.log.goal
    wrong: dict[str, str] = {}
    fast: dict[str, str] = {}
    reach, top = float(np.abs(position).max()), float(np.quantile(np.abs(joint.velocity), 0.995))
    # An encoder has a power of two of steps per turn, so its step betrays the unit whatever the motion.
    if "deg" in (steps := steps_of_a_turn(joint.step)):
        wrong["position"] = f"its step of {joint.step:.4g} is a whole turn of 360 divided by {steps['deg']}"
    elif reach > MAX_STOPPED_ANGLE and top > MAX_GEARED_SPEED:
        _told_by_speed(joint, "position", f"{reach:.3g} at {top:.3g} per second", top, wrong, fast)
    for signal, values in (("position", position), ("goal", goal)):
        if values is not None and signal not in wrong and (reason := _beyond_degrees(joint, values)):
            wrong[signal] = reason
    if goal is not None and np.ptp(goal) > 0:
        ratio = float(np.ptp(position) / np.ptp(goal))
        size = float(np.quantile(np.abs(goal), 0.98))
        if same_unit(ratio / DEGREES_PER_RADIAN) and np.ptp(goal) > MIN_GOAL_MOTION and nearer(position, goal):
            wrong["position"] = f"it moves {ratio:.3g} times as far as the goal"
            wrong.pop("goal", None)
        elif same_unit(ratio * DEGREES_PER_RADIAN) and size > MAX_STOPPED_ANGLE * 0.5:
            wrong["goal"] = f"it moves {1 / ratio:.3g} times as far as the position"
            wrong.pop("position", None)
        elif "position" in wrong:
            wrong["goal"] = "it moves as far as the position"
        elif np.abs(goal).max() > MAX_STOPPED_ANGLE and (speed := _slope_speed(joint, goal)) > MAX_GEARED_SPEED:
            _told_by_speed(joint, "goal", f"{np.abs(goal).max():.3g}", speed, wrong, fast)
    link = joint.log.link_position
    if link is not None and np.isfinite(link).any():
        ratio = float((np.nanmax(link) - np.nanmin(link)) / np.ptp(position))
        if "position" in wrong and same_unit(ratio):
            wrong["link_position"] = "it moves as far as the position"
        elif "position" not in wrong and same_unit(ratio / DEGREES_PER_RADIAN) and np.ptp(position) > MIN_GOAL_MOTION:
            wrong["link_position"] = f"it moves {ratio:.3g} times as far as the position"
    for signal, reason in wrong.items():
        yield joint.fault(
            "unit.degrees", "error", signal, DEGREES_PER_RADIAN,
            f"is in degrees, not in radians: {reason}; multiply it by pi/180.",
        )  # fmt: skip
    for signal, doubt in fast.items():
        if wrong or (signal == "goal" and "position" in fast):
            continue  # of the unit of a joint something better is known, or it is said already
        column = joint.column(signal)
        yield joint.remark(
            f"{signal}.fast", "warning", signal, None,
            f"{column} {doubt}. If it is in degrees, multiply it by pi/180; if it is not, say so in the sidecar, "
            f"units: {{{column}: rad}}.",
        )  # fmt: skip


def steps_of_a_turn(step: float) -> dict[str, int]:
    """Units in which a step is that of an encoder, a turn by a power of two, and that number; 0: no step shows."""
    bits = {unit: float(np.log2(turn / step)) for unit, turn in TURN_IN_UNITS.items()} if step > 0.0 else {}
    return {unit: 2 ** round(n) for unit, n in bits.items() if 8 <= n <= 24 and abs(n - round(n)) < 1e-3}


def _told_by_speed(
    joint: JointContext, signal: str, reached: str, speed: float, wrong: dict[str, str], fast: dict[str, str]
) -> None:
    """Take an angle that is too fast for a geared joint for degrees, or for a doubt where the joint may be so fast."""
    units = joint.run.meta.get("units") or {}
    stated = not units.keys().isdisjoint((joint.column(signal), signal, joint.column("position"), "position"))
    free = None if joint.chain is None else no_load_speed(joint.chain)
    why = ""
    if free is not None and speed <= BEYOND_MODEL * free:
        why = f"its motor turns {free:.3g} rad/s without a load"
    elif free is None and (stated or _goes_with_velocity(joint)):
        why = "its velocity goes with it"
    if not why:
        wrong[signal] = f"it reaches {reached}"
    elif not stated:  # of a unit that is said there is no doubt
        fast[signal] = f"reaches {reached}, more than a geared joint does in radians, and is left so, for {why}"


def no_load_speed(chain: Chain) -> float | None:
    """Speed at which the motor of a chain has no torque left [rad/s at the joint]; None where it has no such limit."""
    limit = chain.find("duty_limit")
    duty = 1.0 if limit is None else limit.limit
    motor, supply, line = chain.find("dc_motor"), chain.find("supply"), chain.find("regression")
    if motor is not None and supply is not None:
        return duty * supply.volts / (motor.back_emf * chain.gear_ratio() * chain.magnetisation())
    if line is not None and line.speed_torque < 0.0:
        return abs(line.duty_torque) * duty / (-line.speed_torque * chain.gear_ratio())
    return None


def _goes_with_velocity(joint: JointContext) -> bool:
    """Whether a velocity is the derivative of the position if that is in radians: in degrees it would be another unit,
    or the whole log is in degrees."""
    velocity = joint.log.velocity
    known = np.zeros(0, bool) if velocity is None else np.isfinite(velocity)
    if velocity is None or known.mean() < 0.5 or np.ptp(velocity[known]) == 0.0:
        return False
    logged, derived = velocity[known], joint.velocity[known]
    if float(np.corrcoef(logged, derived)[0, 1]) ** 2 < FOLLOWS_SHARE:
        return False
    return bool(velocity_unit(float(np.std(logged) / np.std(derived))))


def velocity_unit(ratio: float) -> str | None:
    """The unit of a velocity that is so many times the derivative of an angle in rad; None: none of these."""
    return next((unit for unit, per in VELOCITY_UNITS.items() if abs(abs(ratio) / per - 1.0) < UNIT_TOLERANCE), None)


def nearer(position: np.ndarray, goal: np.ndarray) -> bool:
    """Whether a position is nearer to its goal once it is taken as degrees: a joint that is held only shakes more."""
    return float(np.median(np.abs(position / DEGREES_PER_RADIAN - goal))) < float(np.median(np.abs(position - goal)))


def _beyond_degrees(joint: JointContext, values: np.ndarray) -> str:
    """Why a column that no joint of the model could go through is in degrees; empty where it is not so."""
    way = float(np.ptp(np.nanquantile(values, (0.01, 0.99))))
    if joint.reach is None or not np.isfinite(way) or way < BEYOND_MODEL * joint.reach + FULL_TURN:
        return ""  # a wrong zero is no wrong unit
    fits = way / DEGREES_PER_RADIAN <= 2.0 * joint.reach
    return f"it goes over {way:.3g}, and the joint of the model reaches {joint.reach:.3g} rad" if fits else ""


def _slope_speed(joint: JointContext, goal: np.ndarray) -> float:
    # Steps have any speed; the smooth part of a goal shows its unit.
    return float(np.quantile(np.abs(np.diff(goal)) / np.diff(joint.time), 0.9))


def _goal(joint: JointContext, goal: np.ndarray) -> Iterator[Finding]:
    if np.ptp(goal) <= 1e-9:
        yield joint.remark(
            "goal.still", "warning", "goal", 0.0,
            f"The goal of {joint.name} never moves, so what the drive does with a command cannot be seen.",
        )  # fmt: skip
        return
    yield from _sign(joint, "position", "error", joint.log.position, "its goal", goal)


def _link_sign(joint: JointContext) -> Iterator[Finding]:
    link, position = joint.log.link_position, joint.log.position
    if link is None:
        return
    good = np.isfinite(link)
    if good.sum() < MIN_SAMPLES or np.ptp(link[good]) == 0.0:
        return
    # a jump of an encoder that wraps is another fault
    angles = np.unwrap(link[good]), np.unwrap(position[good])
    yield from _sign(joint, "link_position", "warning", angles[0], "the position", angles[1])


def _sign(
    joint: JointContext, signal: str, severity: Severity, values: np.ndarray, of_what: str, other: np.ndarray
) -> Iterator[Finding]:
    # a joint whose drive is off goes where it likes
    on = joint.on if len(values) == len(joint.on) and joint.on.sum() >= MIN_SAMPLES else np.ones(len(values), bool)
    if np.ptp(other[on]) == 0.0 or np.ptp(values[on]) == 0.0:
        return
    ways = float(np.ptp(values[on]) / np.ptp(other[on]))
    if not 1.0 / DIRECTION_WAY_RATIO < ways < DIRECTION_WAY_RATIO:
        return  # a joint that is held, and that its load moves
    correlation = float(np.corrcoef(other[on], values[on])[0, 1])
    turned = float(np.median(np.abs(-values[on] - other[on]))) < float(np.median(np.abs(values[on] - other[on])))
    if correlation < -0.5 and not turned:
        yield joint.remark(
            f"{signal}.against", "warning", signal, correlation,
            f"{joint.column(signal)} moves against {of_what} (correlation {correlation:.2f}), and would lie further "
            "from it with the other sign: its zero and direction differ, or it is held and its load moves it.",
        )  # fmt: skip
    elif correlation < -0.5:
        yield joint.fault(
            f"{signal}.sign", severity, signal, correlation,
            f"moves against {of_what} (correlation {correlation:.2f}): one of the two has the wrong sign.",
        )  # fmt: skip


def _excitation(joint: JointContext) -> Iterator[Finding]:
    speed = joint.velocity[joint.moving]
    reversals = int(np.count_nonzero(np.diff(np.sign(speed)))) if len(speed) else 0
    top = float(np.quantile(np.abs(joint.velocity), 0.99))
    reasons = []
    if joint.short:
        reasons.append(
            f"moves over {joint.span:.2g} {joint.unit} only, {joint.span / max(joint.noise, 1e-12):.0f} times its noise"
        )
    if reversals < 2:
        reasons.append(f"reverses {reversals} time{'s' * (reversals != 1)}")
    if joint.seldom:
        reasons.append(f"moves in {joint.moving.mean():.1%} of the samples")
    if reasons:
        yield joint.remark(
            "excitation.little", "warning", "position", top,
            f"Joint {joint.name} {' and '.join(reasons)}: friction, delay and backlash cannot be told apart from it.",
        )  # fmt: skip


def _saturation(joint: JointContext) -> Iterator[Finding]:
    duty = joint.log.duty
    if duty is None:
        return
    size = np.abs(duty[np.isfinite(duty)])
    if not len(size) or size.max() < 0.3:
        return
    limit = float(size.max())
    at_limit = size >= 0.999 * limit
    share = float(at_limit.mean())
    both = min(float((duty >= 0.999 * limit).mean()), float((duty <= -0.999 * limit).mean()))
    # A pose held by a constant duty looks like a limit, but on one side only.
    if share > 0.01 and (limit > 0.9 or both > 0.003):
        yield joint.remark(
            "duty.saturated", "note", "duty", share,
            f"The duty of {joint.name} is at its limit of {limit:.3g} in {share:.1%} of the samples: motor and supply "
            "show there, gains do not.",
        )  # fmt: skip


MILLIMETRES_PER_METRE = 1.0 / FACTOR["mm"]
OTHER_LENGTH_UNITS = {"cm": 100.0}
"""Other units that people measure slides in and a sidecar can say, and how many of them are a metre."""
MAX_SLIDE_SPEED = 20.0
"""Speed [m/s] that no slide of a robot reaches; it tells the unit where the model gives no range."""


def check_lengths(joint: JointContext) -> Iterator[Finding]:
    """Yield what is wrong with the unit of a slide: a factor of a thousand can be mended, any other cannot.

    Nor can that one where another unit fits the range of the model as well.
    """
    for signal in ("position", "goal", "link_position"):
        values = getattr(joint.log, signal)
        if values is None or not np.isfinite(values).any():
            continue
        size = float(np.nanquantile(np.abs(values), 0.98))
        far, reason = _too_far(joint, np.asarray(values), size)
        if far is None:
            continue
        column = joint.column(signal)
        if far and (fit := [unit for unit, per in OTHER_LENGTH_UNITS.items() if _fits(joint, size / per)]):
            yield joint.fault(
                "unit.length", "error", signal, None,
                f"is not in metres: {reason}; {' or '.join([*fit, 'mm'])} would fit. Say which it is in the sidecar, "
                f"units: {{{column}: {fit[0]}}}.",
            )  # fmt: skip
        elif far:
            yield joint.fault(
                "unit.millimetres", "error", signal, MILLIMETRES_PER_METRE,
                f"is in millimetres, not in metres: {reason}; divide it by 1000.",
            )  # fmt: skip
        else:
            yield joint.fault(
                "unit.length", "error", signal, None,
                f"is not in metres: {reason}; convert it, or correct the range in the model.",
            )  # fmt: skip


def _too_far(joint: JointContext, values: np.ndarray, size: float) -> tuple[bool | None, str]:
    """Whether a column further than the joint can go is in millimetres, and why; None where it is not too far."""
    if joint.reach is None:
        speed = float(np.nanquantile(np.abs(np.diff(values)) / np.diff(joint.time), 0.9))
        return (True if speed > MAX_SLIDE_SPEED else None), f"it moves by {speed:.3g} per second"
    if size <= BEYOND_MODEL * joint.reach:
        return None, ""
    reason = f"it reaches {size:.3g}, and the joint of the model {joint.reach:.3g} m"
    return size / MILLIMETRES_PER_METRE <= BEYOND_MODEL * joint.reach, reason


def _fits(joint: JointContext, metres: float) -> bool:
    """Whether a column that reaches so far stays in the model's range, covering much of it."""
    return joint.reach is not None and metres <= joint.reach and same_unit(metres / joint.reach)
