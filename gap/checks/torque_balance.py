"""The torque that a measured motion needs against the torque that was logged, and how far the two are apart in time.

The equation of motion is tested in its weak form: both sides are averaged with a smooth window, and derivatives are
moved from the noisy position onto the window by partial integration, so nothing measured is ever differentiated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..load.load import PendulumLoad, completed
from ..load.resting import REVERSAL_SPEED
from ..log.finding import Finding
from ..log.torque_side import numbers_and_spread, said_side, side_by_load
from ..log.types import Array
from .context import JointContext
from .signal import BOOTSTRAP_DRAWS, OTHER_ERROR_RATIO, block_weights

GRID_STEP = 1e-3  # [s] grid that logs are brought to
WEAK_FORM_WINDOW = 0.12  # [s] of the weak form: short against the motion, long against the noise of positions
SHIFT_REACHES = (0.04, 0.1, 0.2)
"""Largest shifts tried [s]: a further one only where the best lies at the end of the last. In a wide range alone, the
next swing of a periodic motion may fit better than the true shift; buffers of more than 0.2 s are assumed away."""
WEAK_FORM_BLOCK = 0.5  # [s] rows closer than this are one observation
SHIFT_BIAS = 2e-3
"""What the shift is off by on perfect data [s] (simulated logs: smoothing moves the reversals of friction)."""
MAX_BRIDGED_GAP = WEAK_FORM_WINDOW / 4
"""[s] without torque, or without any sample, that a straight line bridges."""
ROW_STRIDE = 5  # grid points between two rows: neighbours within the window say the same
BALANCE_TERMS = (
    "inertia [believed]",
    "gravity torque [believed]",
    "coulomb [N.m]",
    "viscous [N.m.s/rad]",
    "offset [N.m]",
)


@dataclass(frozen=True, eq=False)
class TorqueBalance:
    """Rows of the balance ``torques = terms @ numbers`` of one or several runs.

    Attributes:
        terms: torque of the believed inertia and of the believed gravity [N.m], direction, speed and one, averaged
            (m, 5).
        torques: logged torque, averaged, at every shift (m, shifts).
        block: number of the block of each row (m,), counted from zero.
        run: index of the run of each row (m,).
        time: of each row since the start of its run (m,) [s].
        shifts: that were tried (shifts,) [s]: the motion of now against the torque of that much earlier.
    """

    terms: Array
    torques: Array
    block: np.ndarray
    run: np.ndarray
    time: Array
    shifts: Array

    @property
    def at_once(self) -> int:
        """Index of no shift."""
        return len(self.shifts) // 2

    def only(self, rows: np.ndarray) -> TorqueBalance:
        """The balance of some rows: what is not in it cannot be seen by accident."""
        _, block = np.unique(self.block[rows], return_inverse=True)
        return replace(
            self,
            terms=self.terms[rows],
            torques=self.torques[rows],
            block=block,
            run=self.run[rows],
            time=self.time[rows],
        )

    def fit(self, shift: int) -> Array:
        """Numbers of :data:`BALANCE_TERMS` that explain the torque at a shift best (5,)."""
        return np.asarray(np.linalg.lstsq(self.terms, self.torques[:, shift], rcond=None)[0], dtype=np.float64)

    def r2(self, shift: int) -> float:
        """Share of the torque's variance that the best numbers explain at a shift."""
        torque = self.torques[:, shift]
        rest = torque - self.terms @ self.fit(shift)
        return 1.0 - float(np.var(rest) / max(np.var(torque), 1e-300))


@dataclass(frozen=True)
class Shift:
    """How far the torque column is apart from the motion columns.

    Attributes:
        seconds: positive where the column is ahead of the motion, negative where it is late [s].
        low, high: 95 % interval from resampled blocks [s].
        index: of the nearest shift that was tried.
        least: whether the shift, or where its sign is sure its interval, ends where the search did: it may be more.
    """

    seconds: float
    low: float
    high: float
    index: int
    least: bool = False

    @property
    def size(self) -> tuple[float, float]:
        """95 % interval of the absolute value, widened by :data:`SHIFT_BIAS` and open where it may be more [s].

        It does not cover the choice of :data:`WEAK_FORM_WINDOW`.
        """
        low, high = sorted((abs(self.low), abs(self.high)))
        least = max(low - SHIFT_BIAS, 0.0) if self.low * self.high > 0.0 else 0.0
        return least, math.inf if self.least else high + SHIFT_BIAS


def every_row(balance: TorqueBalance) -> np.ndarray:
    """All rows of a balance (m,)."""
    return np.ones(len(balance.run), dtype=bool)


def shifted_balance(
    runs: Sequence[tuple[Array, Array, Array]],
    loads: Sequence[tuple[float, float]],
    seen: Callable[[TorqueBalance], np.ndarray] = every_row,
) -> tuple[TorqueBalance, Shift] | None:
    """Return the balance of all runs together and its shift, looked for as far as :data:`SHIFT_REACHES` and runs allow.

    Args:
        runs, loads: as of :func:`torque_balance`.
        seen: the rows of a balance that may choose the shift (m,).

    Returns:
        None where all runs are too short.
    """
    balance = torque_balance(runs, loads)
    if balance is None:
        return None
    found = torque_shift(balance.only(seen(balance)))
    for reach in SHIFT_REACHES[1:]:
        further = torque_balance(runs, loads, reach) if found.least else None
        if further is None or set(further.run) != set(balance.run):  # some runs are too short for that
            break
        balance, found = further, torque_shift(further.only(seen(further)))
    return balance, found


def torque_balance(
    runs: Sequence[tuple[Array, Array, Array]], loads: Sequence[tuple[float, float]], reach: float = SHIFT_REACHES[0]
) -> TorqueBalance | None:
    """Return the balance of all runs together.

    Args:
        runs: time [s], position [rad] and torque [N.m] of each, all (n,); torque is NaN where none was logged, and no
            row reaches into more than :data:`MAX_BRIDGED_GAP` of that, nor into a gap of the clock.
        loads: believed inertia [kg.m2] and gravity torque at a quarter turn [N.m] of each.
        reach: largest shift that is tried [s].

    Returns:
        None where all runs are too short.
    """
    steps = np.arange(-round(reach / GRID_STEP), round(reach / GRID_STEP) + 1)
    shortest = 4.0 * (WEAK_FORM_WINDOW + len(steps) * GRID_STEP)
    pieces = {
        k: _weak_form(*run, *load, steps)
        for k, (run, load) in enumerate(zip(runs, loads, strict=True))
        if run[0][-1] - run[0][0] > shortest
    }
    if not any(len(piece[2]) for piece in pieces.values()):
        return None
    terms, torques = (np.concatenate([piece[k] for piece in pieces.values()]) for k in (0, 1))
    _, block = np.unique(np.concatenate([p[2] + 100_000 * k for k, p in pieces.items()]), return_inverse=True)
    run = np.repeat(list(pieces), [len(piece[2]) for piece in pieces.values()])
    time = np.concatenate([piece[3] for piece in pieces.values()])
    return TorqueBalance(terms, torques, block, run, time, np.asarray(steps * GRID_STEP, dtype=np.float64))


def torque_shift(balance: TorqueBalance) -> Shift:
    """Return the shift between torque and motion: the centre of what resampled blocks say, since one pass over a few
    seconds hangs on single manoeuvres.
    """
    rng, shifts = np.random.default_rng(0), balance.shifts
    count = int(balance.block.max()) + 1
    order = np.argsort(balance.block, kind="stable")
    ends = np.searchsorted(balance.block[order], np.arange(count))[1:]
    parts = [np.split(rows[order], ends) for rows in (balance.terms, balance.torques)]
    inner = np.stack([terms.T @ terms for terms in parts[0]])
    cross = np.stack([terms.T @ torques for terms, torques in zip(*parts, strict=True)])
    size = np.stack([(torques**2).sum(axis=0) for torques in parts[1]])
    drawn = np.array(
        [
            shifts[_best_shift(*(np.tensordot(weight, sums, 1) for sums in (inner, cross, size)))]
            for weight in block_weights(count, BOOTSTRAP_DRAWS, rng)
        ]
    )
    seconds = float(np.median(drawn))
    low, high = np.percentile(drawn, [2.5, 97.5])
    furthest = max(abs(low), abs(high)) if low * high > 0.0 else abs(seconds)
    least = bool(furthest > shifts[-2])
    return Shift(seconds, float(low), float(high), int(np.argmin(np.abs(shifts - seconds))), least)


def _best_shift(inner: Array, cross: Array, size: Array) -> int:
    """Index of the shift that leaves least of the torque's own size.

    Args:
        inner, cross, size: sums of products of the terms (5, 5), of terms and torques (5, shifts), and of the squares
            of the torques (shifts,).
    """
    scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    inner = inner / np.outer(scale, scale) + 1e-9 * np.eye(len(BALANCE_TERMS))
    cross, size = cross / scale[:, None], np.maximum(size, 1e-300)
    explained = (cross * np.linalg.solve(inner, cross)).sum(axis=0)
    return int(np.argmin((size - explained) / size))


def _kernels() -> tuple[Array, Array, Array]:
    """The window of the weak form, its first and its second derivative, at the points of the grid (n,)."""
    half = int(WEAK_FORM_WINDOW / GRID_STEP / 2)
    s = np.linspace(-1.0, 1.0, 2 * half + 1)
    width = half * GRID_STEP
    first = -8 * s * (1 - s**2) ** 3 / width
    second = (-8 * (1 - s**2) ** 3 + 48 * s**2 * (1 - s**2) ** 2) / width**2
    return (1 - s**2) ** 4, first, second


def acceleration_noise(noise: float, period: float) -> float:
    """Noise of an averaged acceleration [rad/s2], from that of a position sample [rad] and the sampling period [s]."""
    window, _, second = _kernels()
    held = max(period / GRID_STEP, 1.0)  # points of the grid that share the error of one sample
    return noise * float(np.sqrt(held) * np.linalg.norm(second) / window.sum())


@dataclass(frozen=True, eq=False)
class WeakForm:
    """A run on an even grid, averaged; arrays are (g,).

    Attributes:
        time: of the grid points since the start of the run [s].
        angle, sine, cosine: of the position [rad], [1], [1].
        speed: [rad/s].
        acceleration: [rad/s2].
        torque: as logged [N.m], NaN where it or the clock has a gap.
    """

    time: Array
    angle: Array
    sine: Array
    cosine: Array
    speed: Array
    acceleration: Array
    torque: Array

    @classmethod
    def of(cls, time: Array, position: Array, torque: Array) -> WeakForm:
        """Of a run (n,) [s], [rad], [N.m]."""
        torque = _bridged(time, torque)
        grid = np.arange(time[0], time[-1], GRID_STEP)
        angle = np.interp(grid, time, position)
        _, first, second = _kernels()
        waits = np.diff(time)  # across a gap neither torque nor motion is known; a slow clock has none for that
        lost = (waits > max(MAX_BRIDGED_GAP, 2.0 * float(np.median(waits))))[
            np.searchsorted(time[1:-1], grid, side="right")
        ]
        return cls(
            grid - grid[0],
            averaged(angle),
            averaged(np.sin(angle)),
            averaged(np.cos(angle)),
            -averaged(angle, first),
            averaged(angle, second),
            averaged(np.where(lost, np.nan, np.interp(grid, time, torque))),  # what a missing one touches is NaN
        )

    def inside(self, margin: float) -> np.ndarray:
        """Grid points, :data:`ROW_STRIDE` apart, whose window and so much more [s] to both sides is in the run (m,)."""
        edge = round((0.5 * WEAK_FORM_WINDOW + margin) / GRID_STEP)
        return np.arange(edge, len(self.time) - edge, ROW_STRIDE)


def averaged(values: Array, kernel: Array | None = None) -> Array:
    """Values on the grid (g,), averaged by the window of the weak form, or by a derivative of it."""
    window = _kernels()[0]
    return np.convolve(values, (window if kernel is None else kernel)[::-1], "same") / window.sum()


def _weak_form(
    time: Array, position: Array, torque: Array, inertia: float, gravity: float, steps: np.ndarray
) -> tuple[Array, Array, np.ndarray, Array]:
    """Terms (m, 5), torque at every shift of so many steps (m, shifts), block (m,) and time (m,) of one run."""
    form = WeakForm.of(time, position, torque)
    columns = [
        inertia * form.acceleration,
        gravity * form.sine,
        averaged(np.tanh(form.speed / REVERSAL_SPEED)),
        form.speed,
        np.ones_like(form.time),
    ]
    inside = form.inside(len(steps) * GRID_STEP)
    shifted = form.torque[inside[:, None] - steps]
    good = np.isfinite(shifted).all(axis=1)
    inside, shifted = inside[good], shifted[good]
    time = form.time[inside]
    return np.stack(columns, axis=1)[inside], shifted, (time / WEAK_FORM_BLOCK).astype(int), time


def _bridged(time: Array, torque: Array) -> Array:
    """The torque (n,) with straight lines over missing values, NaN beyond :data:`MAX_BRIDGED_GAP`."""
    known = np.flatnonzero(np.isfinite(torque))
    if len(known) == len(torque):
        return torque
    before = np.searchsorted(known, np.arange(len(torque)), side="right") - 1
    after = np.searchsorted(known, np.arange(len(torque)))
    near = (before >= 0) & (after < len(known))
    length = np.full(len(torque), np.inf)
    length[near] = time[known[after[near]]] - time[known[before[near]]]
    bridge = near & (length <= MAX_BRIDGED_GAP)  # a known value lies between itself and itself
    out = np.full(len(torque), np.nan)
    if bridge.any():
        out[bridge] = np.interp(time[bridge], time[known], torque[known])
    return out


# --- checks of the torque column of a bench against what the measured motion needs -----------------------------------

MIN_TORQUE_SHIFT = 2.0 * SHIFT_BIAS
"""Least shift between torque and motion that is worth a word [s]."""
TORQUE_RATIO_RANGE = (0.6, 1.67)
"""Ratio of logged to needed torque that wrong numbers of the load may make."""


def has_torque(joint: JointContext) -> bool:
    """Whether a torque column can be judged: a bench of known load that moves."""
    known = joint.run.robot == "bench" and {"mass", "length"} <= joint.run.robot_params.keys()
    torque = joint.log.torque
    return known and torque is not None and not joint.still and bool(np.isfinite(torque).any())


def check_torque(joints: Sequence[JointContext], run: str | None) -> Iterator[Finding]:
    """Yield what is wrong with the torque column of one joint in one or several runs, judged together."""
    joints = [joint for joint in joints if has_torque(joint)]
    load, loads = PendulumLoad(), [completed(j.run.robot_params) for j in joints]
    found = shifted_balance(
        [(j.time, j.log.position, j.log.torque) for j in joints if j.log.torque is not None],
        [(load.inertia(params), load.gravity_torque(params)) for params in loads],
    )
    if found is None:
        return
    balance, shift = found
    if (
        balance.r2(shift.index) < 1.0 - OTHER_ERROR_RATIO or not balance.terms[:, :2].any()
    ):  # an empty shaft needs nothing
        return
    joint = joints[0]
    armature, friction = _inside(balance, joints)
    needed, torque = balance.terms[:, :2].sum(axis=1), balance.torques[:, shift.index]
    side = said_side([each.run for each in joints], joint.name)
    if (side or side_by_load(torque, balance.terms[:, :2], armature, friction, balance.block)) == "drive":
        needed = needed + armature
    ratio, spread = _ratio(balance, shift, needed)
    if shift.least:
        pass  # further apart than any shift that was tried: their ratio says nothing
    elif not TORQUE_RATIO_RANGE[0] < abs(ratio) < TORQUE_RATIO_RANGE[1]:
        gear = 1.0 / ratio if abs(ratio) < 1.0 else ratio
        relation = f"1/{abs(gear):.3g}" if abs(ratio) < 1.0 else f"{abs(gear):.3g} times"
        yield joint.fault(
            "torque.gear_side", "error", "torque", ratio,
            f"is {relation} of what the motion needs, if the mass of {loads[0]['mass']:.3g} kg in the sidecar is "
            "right, with which the ratio goes: it belongs to the other side of a gear or to another unit.",
            low=ratio - 2.0 * spread, high=ratio + 2.0 * spread, cause="sensor.scale", run=run,
        )  # fmt: skip
    elif ratio < 0:
        what = f"has the wrong sign: it is {ratio:.3g} times what the motion needs."
        yield joint.fault("torque.sign", "error", "torque", ratio, what, run=run)
    if abs(shift.seconds) > MIN_TORQUE_SHIFT and shift.low * shift.high > 0:
        yield _shift_finding(joint, balance, shift, run)


def _inside(balance: TorqueBalance, joints: Sequence[JointContext]) -> tuple[Array, Array]:
    """Torques that armature and friction of the drive are believed to take (m,) [N.m]; 0 where no chain says it."""
    numbers = np.zeros((len(joints), 3))  # armature over inertia of the load, coulomb, viscous
    for k, joint in enumerate(joints):
        if joint.chain is not None:
            inertia, friction = PendulumLoad().inertia(completed(joint.run.robot_params)), joint.chain.find("friction")
            numbers[k, 0] = joint.chain.armature() / max(inertia, 1e-12)
            numbers[k, 1:] = (0.0, 0.0) if friction is None else (friction.coulomb, friction.viscous)
    torques = balance.terms[:, [0, 2, 3]] * numbers[balance.run]
    return torques[:, 0], torques[:, 1:].sum(axis=1)


def _ratio(balance: TorqueBalance, shift: Shift, needed: Array) -> tuple[float, float]:
    """Logged over needed torque (m,) of load and motion, and its standard deviation over blocks."""
    rows = np.column_stack([needed, balance.terms[:, 2:]])
    numbers, spread = numbers_and_spread(rows, balance.torques[:, shift.index], balance.block)
    return float(numbers[0]), float(spread[0])


def _shift_finding(joint: JointContext, balance: TorqueBalance, shift: Shift, run: str | None) -> Finding:
    late, size = shift.seconds < 0, abs(shift.seconds)
    low, high = shift.size
    interval = f"({low * 1e3:.0f} to {high * 1e3:.0f} ms)"
    return joint.fault(
        "torque.lag" if late else "torque.lead", "warning", "torque", size,
        f"is {f'at least {low * 1e3:.0f} ms' if shift.least else f'{size * 1e3:.0f} ms {interval}'} "
        + ("late of the motion" if late else "ahead of the motion, as if position and velocity were reported late")
        + f": shifting it raises the rigid-body fit's R2 from {balance.r2(balance.at_once):.3f} to "
        f"{balance.r2(shift.index):.3f}.",
        low=low, high=None if shift.least else high, cause="sensor.delay", run=run,
    )  # fmt: skip
