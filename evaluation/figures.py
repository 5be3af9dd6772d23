"""What one run of a robot comes to, on the machine or in a model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..hw.machine.robot import ServoRobot
from ..hw.run.simulated import Recording

SLOWEST = 0.3  # [Hz] below which nothing counts as a frequency


@dataclass(frozen=True)
class Contact:
    """How a contact switch of a model follows that of the machine, over windows as of :attr:`Figures.same_goals`.

    Attributes:
        agrees: share of the time in which both are closed, or both open.
        accounted: the same where model and machine are one.
        later: by which the model's closes, mean [s]; NaN where it does not within a window.
    """

    agrees: float
    accounted: float
    later: float


@dataclass(frozen=True)
class Figures:
    """What one run comes to.

    Attributes:
        seconds: run.
        reward: per second, from measured signals; NaN without a policy.
        terms: of the reward, per second.
        tracking: rms of goal minus position, over the joints that turn [rad]; NaN where none does.
        tracking_of_slides: the same of those that slide [m].
        frequency: strongest of the motion: of the base's height, else of the joint that moves most [Hz].
        height: of a hop, from lowest to highest point, mean over the hops [m]; NaN for robots without a base.
        energy: that the motors drew, electrical [J]; NaN where current or voltage is unknown.
        same_goals: rms of the model's position error over windows in which it starts where the machine was and is given
            the machine's goals, over the joints that turn [rad]; 0 for the machine, NaN where none does.
        same_goals_of_slides: the same of those that slide [m].
        accounted: what encoders, bus and windows make of it where model and machine are one [rad].
        accounted_of_slides: the same of those that slide [m].
        gap: the largest ratio of the two over joints and base that is beyond :data:`GAP` for sure; None: no gap.
        gap_at: where that is; None: no gap.
        departs: signal by which it first departs from the machine, None where none does.
        departs_at: when [s].
        departures: time at which each signal departs [s], those that do.
        contacts: of each contact switch, by name.
    """

    seconds: float
    reward: float
    terms: Mapping[str, float]
    tracking: float
    tracking_of_slides: float
    frequency: float
    height: float
    energy: float
    same_goals: float
    same_goals_of_slides: float
    accounted: float
    accounted_of_slides: float
    gap: float | None = None
    gap_at: str | None = None
    departs: str | None = None
    departs_at: float | None = None
    departures: Mapping[str, float] | None = None
    contacts: Mapping[str, Contact] = field(default_factory=dict)


def measure(run: Recording, robot: ServoRobot, **more: Any) -> Figures:
    """Figures of one run of a robot."""
    seconds = float(len(run.time) * run.period)
    terms = {name: float(values.sum() / seconds) for name, values in run.rewards.items()}
    power = np.abs(run.voltage * run.duty * run.current).sum(axis=1)
    height = run.base[:, 1] if run.base.shape[1] > 1 else None
    # a goal is answered by the position one cycle later
    turns, slides = rms_by_unit((run.goal[:-1] - run.position[1:]) ** 2, robot)
    nothing = rms_by_unit(np.zeros((1, len(robot.names))), robot)
    errors: dict[str, Any] = dict(zip(("same_goals", "same_goals_of_slides"), nothing, strict=True))
    errors |= dict(zip(("accounted", "accounted_of_slides"), nothing, strict=True))
    return Figures(
        seconds=seconds,
        reward=sum(terms.values()) if terms else math.nan,
        terms=terms,
        tracking=turns,
        tracking_of_slides=slides,
        frequency=strongest_frequency(height if height is not None else _liveliest(run.position), run.period),
        height=hop_height(height, run.period) if height is not None else math.nan,
        energy=float(power.sum() * run.period) if power.any() else math.nan,
        **(errors | more),
    )


def strongest_frequency(values: np.ndarray, period: float) -> float:
    """Frequency of the largest line of the spectrum [Hz]; NaN where nothing moves."""
    steps = np.arange(len(values))
    centred = (values - np.polyval(np.polyfit(steps, values, 1), steps)) * np.hanning(len(values))
    if np.ptp(values) < 1e-6 or len(values) < 16:
        return math.nan
    length = 8 * len(values)
    spectrum, grid = np.abs(np.fft.rfft(centred, length)), np.fft.rfftfreq(length, period)
    spectrum[grid < SLOWEST] = 0.0
    return float(grid[int(np.argmax(spectrum))])


def hop_height(height: np.ndarray, period: float) -> float:
    """Mean way from the lowest to the highest point of a hop [m]; NaN where there are no hops."""
    frequency = strongest_frequency(height, period)
    if not math.isfinite(frequency) or frequency <= 0.0:
        return math.nan
    length = max(round(1.0 / (frequency * period)), 2)
    pieces = [height[at : at + length] for at in range(0, len(height) - length + 1, length)]
    return float(np.mean([np.ptp(piece) for piece in pieces])) if pieces else math.nan


def _liveliest(position: np.ndarray) -> np.ndarray:
    return position[:, int(np.argmax(position.std(axis=0)))]


def rms_by_unit(squares: np.ndarray, robot: ServoRobot) -> tuple[float, float]:
    """Root of the mean of squares (n, k) over joints that turn [rad] and over those that slide [m]; NaN for none."""
    slides = np.array([unit == "m" for unit in robot.units])
    turns, ways = (float(np.sqrt(squares[:, kind].mean())) if kind.any() else math.nan for kind in (~slides, slides))
    return turns, ways


UNITS = {"mrad": "same_goals", "mm": "same_goals_of_slides"}
"""Units that people are told position errors in, a thousandth of the figure's own, and the figure of each."""


def told(turns: float | None, slides: float | None) -> str:
    """Errors of joints that turn [rad] and that slide [m], for people; those that there are: NaN, null for none."""
    sizes = zip(UNITS, (turns, slides), strict=True)
    return " and ".join(f"{1e3 * size:.3g} {unit}" for unit, size in sizes if size is not None and not math.isnan(size))


def told_error(figures: Mapping[str, Any]) -> str:
    """The model's position error on the machine's goals, of figures that were read from ``comparison.json``."""
    return told(*(figures.get(key) for key in UNITS.values()))
