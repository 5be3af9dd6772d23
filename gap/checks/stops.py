"""Stops, read off the log: where a joint stays while its goal goes on.

A stop is a property of the machine, in the frame of its encoder, and is there whatever a model makes of it. Read off
before anything is fitted, it is told in that frame, is a start for the fit, and bounds every motion that is proposed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..log.finding import Finding
from ..log.types import MeasuredRun
from .context import JointContext, joint_contexts
from .motion import MIN_GOAL_MOTION
from .signal import MIN_SAMPLES, MIN_STAY_SECONDS

STOP_PUSH = 0.05  # [rad] that the goal must go beyond a stop: less may be friction or gravity under a soft controller
STOP_FOLLOWING = 0.15  # change of the angle over that of the goal: a joint that is free follows with about 1
STOP_NEAR_SHARE = 0.01  # of the range of motion that counts as at its end
FREE_FOLLOWING = 0.5  # the same ratio that the joint must show elsewhere for its not following to mean anything


@dataclass(frozen=True)
class Stop:
    """A stop of one joint.

    Attributes:
        angle: as the log reads it [rad].
        side: 1 for an upper one, -1 for a lower one.
        beyond: how far the goal went beyond it [rad].
        seconds: against it, in all.
    """

    angle: float
    side: int
    beyond: float
    seconds: float


def stops_of(runs: Sequence[MeasuredRun], joint: str, reach: float = 1.0) -> tuple[Stop, ...]:
    """The stops that runs show of a joint, the lower one first.

    Args:
        runs: of one machine.
        joint: its name.
        reach: how far a slide goes where a servo turns by a radian [m]; 1 of a hinge.
    """
    contexts = (context for run in runs for context in joint_contexts(run))
    return read_stops([context for context in contexts if context.name == joint], reach)


def read_stops(joints: Sequence[JointContext], reach: float = 1.0) -> tuple[Stop, ...]:
    """The stops that the runs of one joint show, the lower one first."""
    rows = [_rows(joint) for joint in joints if joint.log.goal is not None and not joint.still]
    if not rows:
        return ()
    goal, position, slow, period = (np.concatenate(part) for part in zip(*rows, strict=True))
    noise = float(np.median([joint.noise for joint in joints]))
    found = (_stop(side * goal, side * position, slow, period, noise, reach) for side in (-1, 1))
    return tuple(
        Stop(side * stop.angle, side, stop.beyond, stop.seconds)
        for side, stop in zip((-1, 1), found, strict=True)
        if stop is not None
    )


def _rows(joint: JointContext) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Goal, angle, whether the joint is slow, and sample period, where the drive is on and nothing touches it."""
    goal = joint.log.goal if joint.log.goal_alone is None else joint.log.goal_alone
    assert goal is not None
    on = joint.on & np.isfinite(goal)
    if joint.log.touched is not None:
        on &= joint.log.touched < 0.5
    return goal[on], joint.log.position[on], ~joint.moving[on], np.full(int(on.sum()), joint.period)


def _stop(
    goal: np.ndarray, position: np.ndarray, slow: np.ndarray, period: np.ndarray, noise: float, reach: float
) -> Stop | None:
    """The upper stop, if there is one."""
    if len(position) < MIN_SAMPLES:
        return None
    if not slow.any():
        return None
    # where it rests: a joint that comes fast goes further into what stops it
    top, span = float(np.quantile(position[slow], 0.999)), float(np.ptp(position))
    near = position > top - max(6.0 * noise, STOP_NEAR_SHARE * span)
    against = near & slow & (goal > position + STOP_PUSH * reach)
    if period[against].sum() < MIN_STAY_SECONDS or np.ptp(goal[against]) < MIN_GOAL_MOTION * reach:
        return None
    elsewhere = slow & ~near
    if (
        follows(goal[against], position[against]) > STOP_FOLLOWING
        or follows(goal[elsewhere], position[elsewhere]) < FREE_FOLLOWING
    ):
        return None
    angle = float(np.median(position[against]))
    return Stop(angle, 1, float(np.max(goal[against])) - angle, float(period[against].sum()))


def follows(goal: np.ndarray, position: np.ndarray) -> float:
    """Change of the angle over that of the goal, by least squares."""
    spread = float(np.var(goal)) if len(goal) else 0.0
    return float(np.cov(goal, position)[0, 1] / spread) if spread > 0.0 else 0.0


def told_stops(stops: Sequence[Stop], joint: str, unit: str = "rad") -> tuple[Finding, ...]:
    """What is said of stops, in rad or m."""
    return tuple(
        Finding(
            "motion.stop", "note", joint, f"{joint}.position",
            f"'{joint}' stays at {stop.angle:.4g} {unit} for {stop.seconds:.2g} s in all while its goal goes up to "
            f"{stop.beyond:.2g} {unit} further: it stands against a stop there. No proposed motion goes beyond it.",
            value=stop.angle, cause="contact.blocked",
        )
        for stop in stops
    )  # fmt: skip
