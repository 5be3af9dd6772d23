"""An IMU held against itself: its turn rate is the derivative of its orientation, whatever the robot does.

Swapped axes, a sign, a unit, an inverse quaternion and an orientation that comes late follow from the log alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...envs.engine import turns
from ...envs.engine.imu import COLUMNS, PREFIX
from ..log.finding import Finding
from ..log.parts import SPEED_REACH
from ..log.types import Array, MeasuredRun
from .columns import LAG_TOLERANCE
from .signal import BOOTSTRAP_DRAWS, ERROR_BLOCK, LAG_STEP, OTHER_ERROR_RATIO, same_unit

IMU = "imu"
RATE_HALF_WINDOW = 2.0 * SPEED_REACH
"""[s] to both sides of a moment, over which a turn rate is told by the turns between samples."""
IMU_LAG_REACH = 0.15  # [s] by which one signal is sought to be later than another
AXES = "xyz"


@dataclass(frozen=True, eq=False)
class ImuLog:
    """What an IMU said in one run.

    Attributes:
        time: as each sample came (n,) [s].
        orientation: quaternion of the base (n, 4).
        turn_rate: about its axes (n, 3) [rad/s].
        switches: 1 where a contact switch on its board is closed, else 0 (n,), by name.
    """

    time: Array
    orientation: Array
    turn_rate: Array
    switches: Mapping[str, Array] = field(default_factory=dict)

    @property
    def period(self) -> float:
        """Between samples [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def gap(self) -> float:
        """Between samples that follow one another, in nine of ten at most [s]."""
        return float(np.quantile(np.diff(self.time), 0.9))

    def cut(self, kept: np.ndarray) -> ImuLog:
        """The samples of a mask (n,)."""
        switches = {name: values[kept] for name, values in self.switches.items()}
        return replace(
            self,
            time=self.time[kept],
            orientation=self.orientation[kept],
            turn_rate=self.turn_rate[kept],
            switches=switches,
        )


def imu_of(run: MeasuredRun) -> ImuLog | None:
    """The samples of a run; None where it has no IMU, or fewer samples than a second's."""
    if any(name not in run.base for name in COLUMNS[:-1]):
        return None
    values = np.stack([run.base[name] for name in COLUMNS[:-1]], axis=1)
    age = run.base.get(COLUMNS[-1], np.zeros(len(run.time)))
    good = np.isfinite(values).all(axis=1) & np.isfinite(age)
    rows = np.flatnonzero(good)
    rows = rows[np.diff((run.time - age)[rows], prepend=-np.inf) > 1e-6]
    time, values = (run.time - age)[rows], values[rows]
    if len(time) < 20 or time[-1] - time[0] < ERROR_BLOCK:
        return None
    size = np.linalg.norm(values[:, :4], axis=1, keepdims=True)
    switches = {name[len(PREFIX) :]: column[rows] for name, column in run.base.items() if name.startswith(PREFIX)}
    return ImuLog(time, values[:, :4] / np.maximum(size, 1e-9), values[:, 4:], switches)


@dataclass(frozen=True, eq=False)
class Match:
    """How one turn rate (n, 3) follows from another.

    Attributes:
        lag: by which the first is later [s].
        low, high: 95 % interval of that [s].
        correlation: of the axes of the first (rows) with those of the second, at that lag (3, 3).
        sizes: of the axes of both (2, 3).
        explained: share of the variance of the first that the second explains.
    """

    lag: float
    low: float
    high: float
    correlation: np.ndarray
    sizes: np.ndarray
    explained: float

    @property
    def ratio(self) -> float:
        """Of the sizes of both."""
        first, second = np.linalg.norm(self.sizes, axis=1)
        return float(first / second)

    @property
    def axes(self) -> tuple[tuple[int, int], ...] | None:
        """For each axis of the first that can be told: number and sign of the axis of the second that it is.

        None where none can; (k, 0) for one that cannot. Of a robot that turns little about an axis, crosstalk follows
        another one as well: so axes are other than they are believed where that leaves half of the error or less.
        """
        orders = itertools.permutations(range(3))
        best = max(orders, key=lambda order: sum(abs(self.correlation[k, order[k]]) for k in range(3)))
        moved = [k for k in range(3) if best[k] != k]
        if sum(self._left(k, best[k]) for k in moved) > OTHER_ERROR_RATIO * sum(self._left(k, k) for k in moved):
            best = (0, 1, 2)
        found = []
        for k, other in enumerate(best):
            along = self.correlation[k, other]
            found.append((other, int(np.sign(along))) if along**2 >= 1.0 - OTHER_ERROR_RATIO else (k, 0))
        return tuple(found) if any(sign for _, sign in found) else None

    def _left(self, k: int, other: int) -> float:
        """Squared error that an axis of the second leaves of one of the first, in one unit and whatever its sign."""
        first, second = self.sizes[0, k] / self.ratio, self.sizes[1, other]
        return float(first**2 + second**2 - 2.0 * abs(self.correlation[k, other]) * first * second)


def match(
    pairs: Sequence[tuple[Array, Array, Array]], least: float = -IMU_LAG_REACH, most: float = IMU_LAG_REACH
) -> Match | None:
    """How well a turn rate follows from another, and by how much it is later.

    Args:
        pairs: of each run the times (n,) [s], the turn rate (n, 3), and the one that it may follow from (n, 3).
        least, most: between which the lag is sought [s].

    Returns:
        None where there is no motion to tell by, or the best lag is at an end.
    """
    lags = np.arange(least, most + 0.5 * LAG_STEP, LAG_STEP)
    grams = np.concatenate([_grams(*pair, lags, max(abs(least), abs(most))) for pair in pairs], axis=1)
    if grams.shape[1] == 0 or not np.isfinite(grams).all():
        return None

    def best(blocks: np.ndarray) -> tuple[float, np.ndarray]:
        total = grams[:, blocks].sum(axis=1)
        left = _left(total)
        k = int(np.argmin(left))
        lag = lags[k]
        if 0 < k < len(lags) - 1:
            below, here, above = left[k - 1 : k + 2]
            lag += 0.5 * LAG_STEP * (below - above) / max(below - 2.0 * here + above, 1e-300)
        return float(lag), total[k]

    count = grams.shape[1]
    lag, gram = best(np.arange(count))
    first, both, second = gram[:3, :3], gram[:3, 3:], gram[3:, 3:]
    sizes = np.sqrt(np.outer(np.diag(first), np.diag(second)))
    total = float(np.trace(first))
    if total <= 0.0 or np.trace(second) <= 0.0 or not least + LAG_STEP < lag < most - LAG_STEP:
        return None
    random = np.random.default_rng(0)
    drawn = [best(random.integers(0, count, count))[0] for _ in range(BOOTSTRAP_DRAWS)] if count > 1 else [lag]
    low, high = np.quantile(drawn, (0.025, 0.975))
    share = 1.0 - float(_left(gram)) / total
    correlation = both / np.maximum(sizes, 1e-300)
    sizes = np.sqrt([np.diag(first), np.diag(second)])
    return Match(lag, float(low), float(high), correlation, sizes, share)


def _grams(time: Array, first: Array, second: Array, lags: np.ndarray, edge: float) -> np.ndarray:
    """Products of both signals, the first at later times, in blocks of the run (lags, blocks, 6, 6)."""
    step = float(np.median(np.diff(time)))
    grid = np.arange(time[0] + edge, time[-1] - edge, step)
    blocks = max(int(len(grid) * step / ERROR_BLOCK), 1)
    if len(grid) < 10:
        return np.empty((len(lags), 0, 6, 6))
    still = _at(time, second, grid)
    found = np.empty((len(lags), blocks, 6, 6))
    for k, lag in enumerate(lags):
        both = np.concatenate([_at(time, first, grid + lag), still], axis=1)
        for n, part in enumerate(np.array_split(both, blocks)):
            found[k, n] = part.T @ part
    return found


def _at(time: Array, values: Array, grid: Array) -> Array:
    return np.stack([np.interp(grid, time, column) for column in values.T], axis=1)


def _left(gram: np.ndarray) -> np.ndarray:
    """What the second signal does not explain of the first (...), by any axes, from products of both (..., 6, 6)."""
    first, both, second = gram[..., :3, :3], gram[..., :3, 3:], gram[..., 3:, 3:]
    ridge = 1e-9 * np.trace(second, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)
    told = both @ np.linalg.solve(second + ridge, np.swapaxes(both, -1, -2))
    return np.trace(first, axis1=-2, axis2=-1) - np.trace(told, axis1=-2, axis2=-1)


def rates_of_turns(time: Array, orientation: Array) -> Array:
    """Turn rate about the axes of a body (n, 3) [rad/s], by a line through the turns to the samples around each."""
    return _slopes(
        time, lambda at, to: turns.to_vector(turns.multiply(turns.inverse(orientation[at]), orientation[to]))
    )


def smoothed(log: ImuLog) -> Array:
    """The turn rate (n, 3) [rad/s], seen over the same moments as that of an orientation."""
    change = 0.5 * (log.turn_rate[1:] + log.turn_rate[:-1]) * np.diff(log.time)[:, None]
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(change, axis=0)])
    return _slopes(log.time, lambda at, to: total[to] - total[at])


def _slopes(time: Array, turned: Callable[[np.ndarray, np.ndarray], Array]) -> Array:
    """Slopes of lines through what is ``turned`` from each sample to those around it (n, 3)."""
    half = max(round(RATE_HALF_WINDOW / float(np.median(np.diff(time)))), 2)
    at = np.arange(len(time))
    others = [np.clip(at + away, 0, len(at) - 1) for away in range(-half, half + 1)]
    moment = np.stack([time[other] - time for other in others])
    vector = np.stack([turned(at, other) for other in others])
    moment = moment - moment.mean(axis=0)
    return (moment[..., None] * vector).sum(axis=0) / np.maximum((moment**2).sum(axis=0), 1e-300)[:, None]


def check_imu(runs: Sequence[MeasuredRun]) -> tuple[list[Finding], bool]:
    """What an IMU says that contradicts itself, and whether it turned far enough to tell."""
    logs = [log for run in runs if (log := imu_of(run)) is not None]
    if not logs:
        return [], False
    gyroscopes = [smoothed(log) for log in logs]

    def matched(inverted: bool) -> Match | None:
        rows = []
        for log, gyroscope in zip(logs, gyroscopes, strict=True):
            turned = turns.inverse(log.orientation) if inverted else log.orientation
            rows.append((log.time, rates_of_turns(log.time, turned), gyroscope))
        return match(rows)

    plain, inverse = matched(False), matched(True)
    if plain is None or inverse is None or max(plain.explained, inverse.explained) < 1.0 - OTHER_ERROR_RATIO:
        return [], False
    if inverse.explained > 0.5 * (1.0 + max(plain.explained, 0.0)):
        sentence = (
            "The quaternion of the IMU (base.imu.w to .z) turns the world into the base: its turn rate is the "
            "derivative of the inverse. Change the signs of x, y and z."
        )
        return [_finding("imu.inverse", "base.imu.w", sentence)], True
    return list(_of_match(plain, max(log.gap for log in logs))), True


def _of_match(found: Match, gap: float) -> Iterator[Finding]:
    """Of the orientation's derivative by the turn rate: axes, sign, unit and lag.

    When a foot lands the turn rate jumps, and samples do not tell where in the ``gap`` between them [s]; in a gait that
    they keep pace with it is the same place in each step.
    """
    axes = found.axes
    if axes is not None and (sentence := told_axes(_inverse(axes), "turn rate", "its orientation")):
        swapped = any(other != k for k, (other, sign) in enumerate(axes) if sign)
        yield _finding("imu.axes" if swapped else "imu.sign", "base.imu.turn_x", sentence)
    if not same_unit(found.ratio):
        times = 1.0 / found.ratio
        unit = ": it is in deg/s" if 40.0 < times < 80.0 else ""
        sentence = f"The turn rate of the IMU is {times:.3g} times the derivative of its orientation{unit}."
        yield _finding("imu.unit", "base.imu.turn_x", sentence, value=times)
    if abs(found.lag) > max(2.0 * LAG_TOLERANCE, 0.5 * gap) and found.low * found.high > 0.0:
        late, early = ("orientation", "turn rate") if found.lag > 0.0 else ("turn rate", "orientation")
        sentence = (
            f"The {late} of the IMU is {1e3 * abs(found.lag):.3g} ms later than its {early} "
            f"({_span(found)} ms): its filter, or how the two are sent."
        )
        column = "base.imu.w" if found.lag > 0.0 else "base.imu.turn_x"
        yield _finding(
            "imu.lag", column, sentence, value=found.lag, low=found.low, high=found.high, cause="sensor.delay"
        )


def _inverse(axes: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """The same axes, told for those of the other signal."""
    found = [(k, 0) for k in range(3)]
    for k, (other, sign) in enumerate(axes):
        if sign:
            found[other] = (k, sign)
    return found


def told_axes(axes: Sequence[tuple[int, int]], what: str, of: str) -> str:
    """A sentence about axes that are not where they are believed; "" where all that can be told are."""
    wrong = [(k, other, sign) for k, (other, sign) in enumerate(axes) if sign and (other, sign) != (k, 1)]
    if not wrong:
        return ""
    rows = [f"about {AXES[k]} is that about {'-' * (sign < 0)}{AXES[other]}" for k, other, sign in wrong]
    kind = "axes are swapped" if any(k != other for k, other, _ in wrong) else "sign is wrong"
    return f"The {what} of the IMU {', '.join(rows)} of {of}: its {kind}."


def _span(found: Match) -> str:
    low, high = sorted((abs(found.low), abs(found.high)))
    return f"{1e3 * low:.3g} to {1e3 * high:.3g}"


def _finding(
    code: str,
    column: str,
    sentence: str,
    value: float | None = None,
    low: float | None = None,
    high: float | None = None,
    cause: str | None = None,
) -> Finding:
    return Finding(
        code, "warning", IMU, column, sentence, value=value, low=low, high=high, cause=cause, data_error=True
    )
