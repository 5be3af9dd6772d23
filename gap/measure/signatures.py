"""Signatures: what a cause does to one feature of the motion, read from the log and from each model alike.

A fit may lower the error and be wrong about the physics. So each cause of friction, delay and play names a feature that
it must bring to where it was measured: how far the joint lags on either side of a reversal, how late it follows at low
and at high speed and frequency, how late its duty follows, what it does when the teeth change sides, how far it coasts,
which duty a speed takes. A feature is read as a difference to what was measured, with the
measured motion as the covariate of all models, so that noise biases none.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..checks.signal import derivatives
from ..replay.problem import Problem
from ..search.settings import threshold

AGREES, SILENT, DISAGREES = "agrees", "silent", "disagrees"
PLAY_SECONDS = 0.15  # [s] after the drive pushes the other way in which play shows
MIN_PIECE_SAMPLES = 60  # samples of a piece, those that are judged
MIN_COAST_SECONDS = 0.1  # [s] with the drive off from which a joint coasts


@dataclass(frozen=True, kw_only=True)
class SignatureLimits:
    """When a feature agrees with what was measured, and when it disagrees."""

    sure: float = threshold(2.5, "Standard errors, over the pieces of the log, from which a difference is significant.")
    close: float = threshold(0.35, "Share of the nominal model's difference up to which the extended model agrees.")
    hardly: float = threshold(
        0.7, "Share of the nominal model's difference that the extended model must still have to disagree."
    )
    away: float = threshold(
        2.0,
        "Times the detection limit, and times the nominal model's difference, from which an extended model that is "
        "worse than the nominal one disagrees.",
    )
    least_lag: float = threshold(
        4e-4, "Lag [s] below which a difference may come from the sampling of command and position."
    )
    least_angle: float = threshold(0.15, "Angle, in noise floors, below which a difference is no feature.")
    least_duty: float = threshold(5e-3, "Duty per speed [s/rad] below which a difference is no feature.")
    fewest: int = threshold(5, "Least number of pieces of a log for which the spread can be estimated.")


SIGNATURE_LIMITS = SignatureLimits()


@dataclass(frozen=True)
class Signature:
    """One feature, as differences of the models to what was measured.

    Attributes:
        name: of the feature, for people.
        unit: of the differences.
        nominal, extended: of the tuned nominal and of the extended model.
        nominal_error, extended_error: their standard errors over the pieces of the log.
        verdict: :data:`AGREES`, :data:`SILENT` (the nominal model shows the feature as measured) or :data:`DISAGREES`.
    """

    name: str
    unit: str
    nominal: float
    extended: float
    nominal_error: float
    extended_error: float
    verdict: str


@dataclass(frozen=True, eq=False)
class Piece:
    """A unit of a problem, along the measured motion; arrays are (n,)."""

    time: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    direction: np.ndarray  # from -1 to 1
    judged: np.ndarray
    error: np.ndarray  # measured position less that of a model
    duty: np.ndarray  # of the model
    duty_error: np.ndarray  # measured less that of the model
    slow: float  # speed below which the joint counts as at rest [rad/s]
    on: np.ndarray  # whether the drive was on


Feature = Callable[[Piece], float]


def _solved(columns: list[np.ndarray], values: np.ndarray, keep: np.ndarray) -> np.ndarray:
    terms = np.stack([column[keep] for column in columns], axis=1)
    scale = np.maximum(np.abs(terms).max(axis=0), 1e-12)
    return np.linalg.lstsq(terms / scale, values[keep], rcond=None)[0] / scale


def _reversal_step(piece: Piece) -> float:
    """By how much the error differs between the two directions of motion, halved [rad]: dry friction."""
    one = np.ones(len(piece.time))
    return float(_solved([piece.direction, piece.speed, piece.acceleration, one], piece.error, piece.judged)[0])


def _lateness(piece: Piece, keep: np.ndarray) -> float:
    """By how much the measured motion is later than the model's [s], at some samples (n,)."""
    if keep.sum() < 40:
        return float("nan")
    one = np.ones(len(piece.time))
    return -float(_solved([piece.speed, piece.direction, piece.acceleration, one], piece.error, keep)[0])


def _lag(piece: Piece, *, fast: bool) -> float:
    """By how much the measured motion is later than the model's [s], at the faster or the slower half of speeds."""
    size = np.abs(piece.speed)
    moving = piece.judged & (size > 0.1 * np.quantile(size[piece.judged], 0.98))
    middle = float(np.median(size[moving])) if moving.any() else 0.0
    return _lateness(piece, moving & ((size >= middle) if fast else (size <= middle)))


def _lag_by_frequency(piece: Piece, *, fast: bool) -> float:
    """By how much the measured motion is later than the model's [s], where it changes faster or slower than usual."""
    width = max(round(0.5 / float(np.median(np.diff(piece.time)))), 1)
    kernel = np.ones(width) / width
    speed, change = (np.convolve(x**2, kernel, mode="same") for x in (piece.speed, piece.acceleration))
    moving = piece.judged & (speed > 4.0 * piece.slow**2)
    frequency = np.sqrt(change / np.maximum(speed, 1e-12))  # [rad/s]
    middle = float(np.median(frequency[moving])) if moving.any() else 0.0
    return _lateness(piece, moving & ((frequency >= middle) if fast else (frequency <= middle)))


def coasted(piece: Piece) -> float:
    """How much farther than the model the joint turns with its drive off [rad]."""
    ends = np.flatnonzero(np.diff(np.concatenate([[True], piece.on, [True]]).astype(int)))
    ways = []
    for a, b in zip(ends[::2], ends[1::2], strict=True):
        last = b - 1
        if (
            piece.time[last] - piece.time[a] >= MIN_COAST_SECONDS
            and piece.judged[a]
            and abs(piece.speed[a]) > 3.0 * piece.slow
        ):
            ways.append(float(np.sign(piece.speed[a]) * (piece.error[last] - piece.error[a])))
    return float(np.mean(ways)) if ways else float("nan")


def _duty_per_speed(piece: Piece) -> float:
    """Duty that a speed takes beyond that of the model at constant velocity [s/rad]."""
    size = np.abs(piece.speed)
    fast, change = (float(np.quantile(np.abs(x[piece.judged]), 0.98)) for x in (piece.speed, piece.acceleration))
    keep = piece.judged & piece.on & (size > 0.1 * fast) & (np.abs(piece.acceleration) < 0.2 * change)
    keep &= np.isfinite(piece.duty_error) & (np.abs(piece.duty) < 0.9 * np.max(np.abs(piece.duty)))
    if keep.sum() < 40:
        return float("nan")
    return float(_solved([piece.speed, piece.direction, np.ones(len(size))], np.nan_to_num(piece.duty_error), keep)[0])


def _duty_lag(piece: Piece) -> float:
    """By how much the measured duty is later than the model's [s]."""
    keep = piece.judged & np.isfinite(piece.duty_error)
    if keep.sum() < 100 or not np.isfinite(piece.duty).all():
        return float("nan")
    width = max(round(0.025 / float(np.median(np.diff(piece.time)))), 1)
    kernel = np.ones(width) / width

    def smooth(values: np.ndarray) -> np.ndarray:
        return np.convolve(np.nan_to_num(values), kernel, mode="same")

    rate = np.gradient(smooth(piece.duty), piece.time)
    inside = keep.copy()
    inside[:width], inside[-width:] = False, False
    if np.ptp(rate[inside]) == 0.0:
        return float("nan")
    one = np.ones(len(rate))
    return -float(_solved([rate, piece.duty, piece.speed, one], smooth(piece.duty_error), inside)[0])


def _after_unloading(piece: Piece) -> float:
    """How much larger the error is just after the drive pushes the other way [rad, rms]: there teeth change sides."""
    turns = np.flatnonzero(np.diff(np.sign(piece.duty)) != 0) + 1
    soon = np.zeros(len(piece.time), bool)
    for turn in turns:
        soon[turn : int(np.searchsorted(piece.time, piece.time[turn] + PLAY_SECONDS))] = True
    soon, rest = piece.judged & soon, piece.judged & ~soon
    if soon.sum() < 20 or rest.sum() < 20:
        return float("nan")
    return float(np.sqrt(np.mean(piece.error[soon] ** 2)) - np.sqrt(np.mean(piece.error[rest] ** 2)))


FEATURES: dict[str, tuple[tuple[str, str, Feature], ...]] = {
    "reversal": (
        ("lag on either side of a reversal", "rad", _reversal_step),
        ("angle coasted with the drive off", "rad", coasted),
    ),
    "lag": (
        ("lateness at low speed", "s", lambda piece: _lag(piece, fast=False)),
        ("lateness at high speed", "s", lambda piece: _lag(piece, fast=True)),
        ("lateness at low frequency", "s", lambda piece: _lag_by_frequency(piece, fast=False)),
        ("lateness at high frequency", "s", lambda piece: _lag_by_frequency(piece, fast=True)),
        ("lateness of the duty", "s", _duty_lag),
    ),
    "speed": (
        ("angle coasted with the drive off", "rad", coasted),
        ("duty per speed at constant velocity", "s/rad", _duty_per_speed),
    ),
    "play": (("error after the drive pushes the other way", "rad", _after_unloading),),
}
"""Features by the key that a cause of the catalogue names."""


def signatures(key: str, problem: Problem, tuned: np.ndarray, extended: np.ndarray) -> tuple[Signature, ...]:
    """The features that a cause must bring to where they were measured; none where the replay is not free.

    Args:
        key: of the cause.
        problem: all data.
        tuned, extended: channels (n, 4) of the nominal model, tuned, and of the extended one.
    """
    if key not in FEATURES or problem.free_joint is None:
        return ()
    pieces = [_pieces(problem, channels) for channels in (tuned, extended)]
    found = []
    for name, unit, feature in FEATURES[key]:
        before, after = (np.array([feature(piece) for piece in of]) for of in pieces)
        good = np.isfinite(before) & np.isfinite(after)
        if good.sum() < SIGNATURE_LIMITS.fewest:
            continue
        least = {"s": SIGNATURE_LIMITS.least_lag, "s/rad": SIGNATURE_LIMITS.least_duty}.get(
            unit, SIGNATURE_LIMITS.least_angle / float(problem.weight[0])
        )
        unit = problem.free_joint.models[0].axis.unit(unit)
        found.append(_judged(name, unit, before[good], after[good], least))
    return tuple(found)


def _judged(name: str, unit: str, before: np.ndarray, after: np.ndarray, least: float) -> Signature:
    (nominal, nominal_error), (extended, extended_error) = (
        (float(np.mean(values)), float(np.std(values, ddof=1) / np.sqrt(len(values)))) for values in (before, after)
    )
    speaks = abs(nominal) > max(SIGNATURE_LIMITS.sure * nominal_error, least)
    detectable = max(SIGNATURE_LIMITS.sure * extended_error, least)
    stays = speaks and abs(extended) > max(detectable, SIGNATURE_LIMITS.hardly * abs(nominal))
    moved_away = not speaks and abs(extended) > SIGNATURE_LIMITS.away * max(detectable, abs(nominal))
    verdict = SILENT
    if stays or moved_away:
        verdict = DISAGREES
    elif speaks and abs(extended) < max(detectable, SIGNATURE_LIMITS.close * abs(nominal)):
        verdict = AGREES
    return Signature(name, unit, nominal, extended, nominal_error, extended_error, verdict)


def disagreeing(found: tuple[Signature, ...]) -> Signature | None:
    """The first feature that a cause leaves where it was, or moves away."""
    return next((signature for signature in found if signature.verdict == DISAGREES), None)


def _pieces(problem: Problem, channels: np.ndarray) -> list[Piece]:
    duty, on = problem.channels.index("duty"), None if problem.joint is None else problem.joint.on
    pieces = []
    for a, b in itertools.pairwise(problem.starts):
        time, position = problem.time[a:b], problem.measured[a:b, 0]
        if min(b - a, int(problem.judged[a:b].sum())) < MIN_PIECE_SAMPLES or not np.isfinite(position).all():
            continue
        _, speed, acceleration = derivatives(time, position)
        slow = max(0.05 * float(np.quantile(np.abs(speed), 0.99)), 1e-6)
        pieces.append(
            Piece(
                time,
                speed=speed,
                acceleration=acceleration,
                direction=np.tanh(speed / slow),
                judged=problem.judged[a:b],
                error=position - channels[a:b, 0],
                duty=channels[a:b, duty],
                duty_error=problem.measured[a:b, duty] - channels[a:b, duty],
                slow=slow,
                on=np.ones(b - a, bool) if on is None else on[a:b],
            )
        )
    return pieces
