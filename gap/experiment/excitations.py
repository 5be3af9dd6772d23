"""The library of excitations, and the limits of a joint that they keep."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...common.errors import SealegsError
from ..checks.motion import no_load_speed
from ..checks.stops import Stop
from ..log.parts import PIECE_LENGTH
from ..replay.joint_model import JointModel

EXCITATION_SECONDS = 2.0 * PIECE_LENGTH  # [s]
GOAL_RATE = 100.0  # [Hz] goals of an excitation
USUAL_REACH = 1.2  # [rad] either side of hanging, unless the log went further or limits are given
GRAVITY_STALL_SHARE = 0.6  # share of the stall torque that gravity may take at the ends of an excitation
SMOOTH_SPEED_SHARE = 0.8  # share of the no-load speed that a smooth goal may have
MIN_GOAL_RANGE = 0.1
"""[rad] range that gravity must leave: in less, backlash and friction hide what a motion would show."""
STOP_CLEARANCE = 0.03  # [rad] that a motion stays away from a stop
SMOOTH_KINDS = ("chirp", "fast chirp", "multisine", "slow triangle", "slow small triangle")


@dataclass(frozen=True)
class Limits:
    """Where goals may go.

    Attributes:
        lower, upper: of the goal, and of the position that the models predict [rad].
        speed: of the goal [rad/s]; infinite: steps are steps.
    """

    lower: float
    upper: float
    speed: float = math.inf

    def __post_init__(self) -> None:
        """Refuse limits that leave no room.

        Raises:
            SealegsError: lower is not below upper, or the speed is not positive.
        """
        if not (math.isfinite(self.lower) and math.isfinite(self.upper) and self.lower < self.upper):
            raise SealegsError(f"limits=[{self.lower:g},{self.upper:g}] must be two angles [rad], the lower one first.")
        if not self.speed > 0.0:
            raise SealegsError(f"speed_limit={self.speed:g} must be a speed above zero [rad/s].")

    @property
    def centre(self) -> float:
        """Middle of the range [rad]."""
        return 0.5 * (self.lower + self.upper)

    @property
    def reach(self) -> float:
        """Half the range [rad]."""
        return 0.5 * (self.upper - self.lower)


def default_limits(position: np.ndarray, speed: float = math.inf) -> Limits:
    """Limits where nobody gave any: :data:`USUAL_REACH` either side of hanging, or as far as the log went (n,)."""
    seen = position[np.isfinite(position)]
    return Limits(min(-USUAL_REACH, float(seen.min())), max(USUAL_REACH, float(seen.max())), speed)


def visited(position: np.ndarray) -> Limits | None:
    """Limits of a joint of a robot where nobody gave any: where the log (n,) [rad] went; None where that is nowhere."""
    seen = position[np.isfinite(position)]
    return Limits(float(seen.min()), float(seen.max())) if np.ptp(seen) > MIN_GOAL_RANGE else None


def within(limits: Limits, stops: Sequence[Stop]) -> Limits | None:
    """Limits less what lies behind stops, and :data:`STOP_CLEARANCE` of them; None where that leaves no room."""
    lower = max([limits.lower, *(stop.angle + STOP_CLEARANCE for stop in stops if stop.side < 0)])
    upper = min([limits.upper, *(stop.angle - STOP_CLEARANCE for stop in stops if stop.side > 0)])
    return replace(limits, lower=lower, upper=upper) if upper - lower > MIN_GOAL_RANGE else None


def library(centre: float, reach: float, seed: int | Sequence[int] = 0) -> dict[str, np.ndarray]:
    """Excitations within ``centre +- reach`` [rad], each (n,) at :data:`GOAL_RATE`.

    All but the chirps and triangles begin again after half of their duration with other numbers, and all of them keep
    to the range.
    """
    t = np.arange(0.0, EXCITATION_SECONDS, 1.0 / GOAL_RATE)
    rng = np.random.default_rng(seed)
    sweep = 2 * np.pi * (0.1 * t + (2.5 - 0.1) * t**2 / (2 * EXCITATION_SECONDS))
    fast = 2 * np.pi * (0.5 * t + (6.0 - 0.5) * t**2 / (2 * EXCITATION_SECONDS))
    multisine = sum(
        np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi)) / (1 + f) for f in (0.25, 0.5, 1.0, 1.75, 2.5)
    )
    held = _held(rng, t, 1.0)
    poses = np.linspace(-1.0, 1.0, 6)[[3, 0, 5, 2, 4, 1]]
    shapes = {
        "chirp": np.sin(sweep) * np.linspace(1.0, 0.4, len(t)),
        "fast chirp": 0.25 * np.sin(fast) * np.linspace(1.0, 0.4, len(t)),
        "multisine": multisine / np.abs(multisine).max(),
        "slow triangle": 4 * np.abs((t / 6.0) % 1.0 - 0.5) - 1.0,
        "slow small triangle": 0.1 * (4 * np.abs((t / 3.0) % 1.0 - 0.5) - 1.0),
        "steps": held,
        "fast steps": _held(rng, t, 0.4),
        "small steps": 0.12 * _held(rng, t, 0.5),
        "hold": poses[np.minimum((t / 2.0).astype(int), 5)],
        "hold and release": np.where((t % 4.0) < 2.0, 1.0, 0.0) * np.where(t < EXCITATION_SECONDS / 2, 1.0, -1.0),
    }
    return {name: centre + reach * shape for name, shape in shapes.items()}


def _held(rng: np.random.Generator, t: np.ndarray, period: float) -> np.ndarray:
    """A new random level in -1..1 every ``period`` seconds (n,)."""
    levels = rng.uniform(-1, 1, int(np.ceil(EXCITATION_SECONDS / period)) + 1)
    return levels[(t / period + 1e-9).astype(int)]


def excitations(
    limits: Limits, nominal: JointModel, params: Mapping[str, float], seed: int = 0
) -> dict[str, np.ndarray]:
    """The library within the limits and within what the servo can do with this load, each (n,) at :data:`GOAL_RATE`.

    Smooth motions that the motor could not follow are made smaller; nothing goes where gravity takes more than
    :data:`GRAVITY_STALL_SHARE` of the stall torque.

    Returns:
        By name; none where that leaves less than :data:`MIN_GOAL_RANGE` of the limits.
    """
    stall, no_load = abilities(nominal)
    gravity = nominal.load.planned_gravity(params)
    lower, upper = limits.lower, limits.upper
    if GRAVITY_STALL_SHARE * stall < gravity:
        most = math.asin(GRAVITY_STALL_SHARE * stall / gravity)
        lower, upper = max(lower, -most), min(upper, most)
        if upper - lower < min(MIN_GOAL_RANGE, 2.0 * limits.reach):
            return {}
    centre, reach = 0.5 * (lower + upper), 0.5 * (upper - lower)
    fastest = min(limits.speed, SMOOTH_SPEED_SHARE * no_load)
    found = {}
    for name, goal in library(centre, reach, seed).items():
        speed = float(np.abs(np.diff(goal)).max() * GOAL_RATE)
        if name in SMOOTH_KINDS and speed > fastest:
            goal = centre + (goal - centre) * (fastest / speed)
        found[name] = np.clip(slewed(goal, limits.speed), lower, upper)  # whatever the library does: this moves metal
    return found


def abilities(nominal: JointModel) -> tuple[float, float]:
    """Stall torque [N.m] and no-load speed [rad/s] of a joint; infinite where its chain has no motor to say so."""
    chain = nominal.chain
    motor, supply = chain.find("dc_motor"), chain.find("supply")
    if motor is None or supply is None:
        return math.inf, math.inf
    constant = chain.gear_ratio() * motor.motor_constant
    return constant * supply.volts / motor.resistance, no_load_speed(chain) or math.inf


def slewed(goal: np.ndarray, speed: float) -> np.ndarray:
    """Goals (n,) that follow ``goal`` no faster than ``speed`` [rad/s]."""
    if not math.isfinite(speed):
        return goal
    out, most = goal.copy(), speed / GOAL_RATE
    for k in range(1, len(out)):
        out[k] = out[k - 1] + min(max(goal[k] - out[k - 1], -most), most)
    return out
