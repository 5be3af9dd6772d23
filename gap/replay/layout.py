"""The runs of one joint as flat columns, one sample behind the other.

The temperature of a motor is known between the steps of its column, from the heat that its current brings.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...actuators.stages.motor import Thermal
from ..checks.signal import ERROR_BLOCK
from ..load.load import bench_parameters
from ..log.parts import LEAST_START, WARM_UP, Unit, known_commands
from ..log.types import LogError, MeasuredRun
from .simulator import CHANNELS

GROUP = (
    0.025  # [s] duty and current are compared as means over this long: a command that arrives a sample early is no gap
)
ROOM = Thermal.temperature  # [degC] of a motor whose temperature was not logged
COARSE = 0.5  # [K] step of a column from which the current tells more than the column
MOST_RANGE = 8.0  # [K] of a column; one that goes further shows the warming itself
TIMES = (3.0, 6.0, 12.0, 25.0, 50.0, 100.0, 200.0, 400.0)  # [s] in which heat leaves: of motors of servos, assumed
WITHIN = 0.6  # rms of the difference to the column, in parts of its step; rounding alone leaves 0.29
SHORTEST = 2.0  # [s] of a run below which nothing warms


@dataclass(frozen=True, eq=False)
class Layout:
    """Units of one joint as flat columns: attributes of :class:`sealegs.gap.replay.problem.JointProblem`."""

    units: tuple[Unit, ...]
    params: tuple[dict[str, float], ...]
    time: np.ndarray
    goal: np.ndarray
    on: np.ndarray
    temperature: np.ndarray
    starts: np.ndarray
    states: np.ndarray
    measured: np.ndarray
    judged: np.ndarray
    block: np.ndarray
    group: np.ndarray
    reliability: np.ndarray


def lay_out(runs: Sequence[MeasuredRun], joint: str, units: Sequence[Unit], told: str = "goal") -> Layout:
    """Lay the runs of one joint out.

    Args:
        runs, units: of :func:`sealegs.gap.log.parts.cut`.
        joint: its name.
        told: column of its command: ``goal``, ``goal_velocity`` or ``torque_command``.

    Raises:
        LogError: the joint has no commands.
    """
    units = sorted(units, key=lambda unit: (unit.run, unit.start))
    forgotten = (
        LEAST_START if told == "torque_command" else WARM_UP
    )  # a joint that follows torques begins anew behind a gap
    time, goal, on, temperature, measured, judged, block, group = ([] for _ in range(8))
    starts, blocks, groups = [0], 0, 0
    for unit in units:
        log, clock = runs[unit.run].joints[joint], runs[unit.run].time
        command = getattr(log, told)
        if command is None:
            missing = "goal to replay" if told == "goal" else f"'{joint}.{told}', which its chain takes"
            if told == "goal" and log.goal_velocity is not None:
                missing = "goals but goal_velocity; give it a chain that is told speeds, such as sts3215_wheel"
            raise LogError(f"{runs[unit.run].name}: joint '{joint}' has no {missing}.")
        part = slice(unit.start, unit.stop)
        count = unit.stop - unit.start
        time.append(clock[part] - clock[0])
        goal.append(command[part])
        on.append(np.ones(count, bool) if log.enabled is None else log.enabled[part] > 0.5)
        warm = np.full(count, ROOM) if log.temperature is None else heated(clock, log.temperature, log.current)[part]
        temperature.append(_without_gaps(clock[part], warm))
        judged.append((np.arange(count) >= unit.judged) & known_commands(clock, command, forgotten)[part])
        since = clock[part] - clock[unit.start]
        number = (since / ERROR_BLOCK).astype(int)
        block.append(number + blocks)
        blocks += int(number[-1]) + 1
        number = (since / GROUP).astype(int)
        group.append(np.where(judged[-1] & on[-1], number + groups, -1))
        groups += int(number[-1]) + 1
        missing = np.full(count, np.nan)
        signals = [getattr(log, channel) for channel in CHANNELS]
        measured.append(np.stack([missing if signal is None else signal[part] for signal in signals], axis=1))
        starts.append(starts[-1] + count)
    return Layout(
        units=tuple(units),
        params=tuple(bench_parameters(run.robot_params, run.name) if run.robot == "bench" else {} for run in runs),
        time=np.concatenate(time),
        goal=np.concatenate(goal),
        on=np.concatenate(on),
        temperature=np.concatenate(temperature),
        starts=np.array(starts),
        states=np.array([unit.state for unit in units]),
        measured=np.concatenate(measured),
        judged=np.concatenate(judged),
        block=np.concatenate(block),
        group=np.concatenate(group),
        reliability=np.ones((starts[-1], len(CHANNELS))),
    )


def moved(time: np.ndarray, starts: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Position, speed and acceleration (n, 3) [rad, rad/s, rad/s2] of units (u + 1,) from positions (n,)."""
    out = np.empty((len(time), 3))
    for a, b in itertools.pairwise(starts):
        speed = np.gradient(position[a:b], time[a:b])
        out[a:b] = np.stack([position[a:b], speed, np.gradient(speed, time[a:b])], axis=1)
    return out


def covariates(
    motion: np.ndarray, goal: np.ndarray, duty: np.ndarray, temperature: np.ndarray
) -> dict[str, np.ndarray]:
    """Signals (n,) that errors of a joint may depend on, by name, from its motion (n, 3) and its drive."""
    position, speed, acceleration = motion.T
    return {
        "position": position,
        "speed": speed,
        "acceleration": acceleration,
        "goal": goal,
        "duty": duty,
        "temperature": temperature,
    }


def _without_gaps(time: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    """A temperature (n,) without the steps of its resolution; what was polled less often than the rest lies between."""
    read = np.isfinite(temperature)
    if not read.any():
        return np.full(len(time), ROOM)
    return between_steps(time, np.interp(time, time[read], temperature[read]))


def between_steps(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A slow signal (n,) without the steps of its resolution: straight lines between the middles of its changes."""
    change = np.flatnonzero(np.diff(values))
    if len(change) == 0 or len(change) > len(values) // 10:
        return values
    middle = 0.5 * (values[change] + values[change + 1])
    return np.interp(time, 0.5 * (time[change] + time[change + 1]), middle)


def heated(time: np.ndarray, temperature: np.ndarray, current: np.ndarray | None) -> np.ndarray:
    """The temperature (n,) [degC] with what rounding hid of it, where current and column agree.

    The winding takes heat with the square of the current and loses it to its surroundings: ``dT/dt = a i^2 - (T - T0) /
    tau``. ``a``, ``T0`` and the start are fitted to the column, for each of a few ``tau``.

    Args:
        time: of the samples (n,) [s].
        temperature: as logged, in steps (n,) [degC].
        current: of the motor (n,) [A]; None where it was not logged.
    """
    if current is None or time[-1] - time[0] < SHORTEST:
        return temperature
    read, known = np.isfinite(temperature), np.isfinite(current)
    if read.sum() < 100 or known.mean() < 0.5:
        return temperature
    levels = np.unique(temperature[read])
    step = float(np.min(np.diff(levels))) if len(levels) > 1 else 1.0
    if step < COARSE or len(levels) < 2 or np.ptp(levels) > MOST_RANGE:
        return temperature
    heat = np.interp(time, time[known], current[known]) ** 2
    best, least = temperature, WITHIN * step
    for tau in TIMES:
        warm, start = _filtered(time, heat, tau), np.exp(-(time - time[0]) / tau)
        terms = np.stack([warm, np.ones(len(time)), start], axis=1)
        scale = np.maximum(np.abs(terms).max(axis=0), 1e-12)
        size = np.linalg.lstsq(terms[read] / scale, temperature[read], rcond=1e-6)[0] / scale
        estimate = terms @ size
        error = float(np.sqrt(np.mean((estimate - temperature)[read] ** 2)))
        if size[0] > 0.0 and error < least:
            best, least = estimate, error
    return best


def _filtered(time: np.ndarray, heat: np.ndarray, tau: float) -> np.ndarray:
    """Warming (n,) by heat (n,) that leaves within ``tau`` [s], from none."""
    kept = np.exp(-np.diff(time) / tau)
    out = np.zeros(len(time))
    level = 0.0
    for k, share in enumerate(kept):
        level = share * level + (1.0 - share) * heat[k]
        out[k + 1] = level
    return out
