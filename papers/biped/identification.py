"""Staged identification of a drivetrain from its own encoders and commanded torques, after paper 003, III to VII.

No stage differentiates a position twice, and each takes what the stages before it found:

1. :func:`fit_pulleys`: one motor, springs blocked and legs off, under a chirp of growing magnitude. Inertia, viscous
   friction and amplifier bias of a chain of pulleys, each times the motor constant.
2. :func:`fit_motor`: from three such chains, motor constant and rotor inertia factor, (10) to (12).
3. :func:`fit_leg`: one coordinate with the legs on, the others locked: friction and bias by simulation error, (19);
   then both at once (``legs_together.py``), which validates them, (20).
4. :func:`fit_spring`: static, balancing on one leg: spring stiffness, (24).
5. :func:`fit_cable`: under heavy load, as in hopping: stiffness and damping of the
   cable, (25) to (27).

Any machine of motors, pulleys and cables can be taken through them; a :class:`Record` is all that a log must hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from ...common.errors import SealegsError


class IdentificationError(SealegsError):
    """Logs that a stage cannot use."""


@dataclass(frozen=True)
class Record:
    """One run of one motor, sampled evenly.

    Attributes:
        time: (n,) [s].
        command: torque (n,) [N.m at the motor].
        position: of the motor's encoder (n,) [rad at the motor].
    """

    time: np.ndarray
    command: np.ndarray
    position: np.ndarray

    @property
    def period(self) -> float:
        """Distance of the samples [s].

        Raises:
            IdentificationError: they are fewer than a hundred, or not evenly spaced.
        """
        steps = np.diff(self.time)
        if len(steps) < 99 or steps.min() <= 0.0 or np.ptp(steps) > 0.01 * steps.mean():
            raise IdentificationError(
                f"a record of {len(self.time)} samples cannot be used: at least 100, evenly spaced in time, are needed."
            )
        return float(steps.mean())


def chirp(
    magnitudes: tuple[float, float],
    frequencies: tuple[float, float] = (0.5, 50.0),
    steps: int = 17,
    cycles: int = 10,
    period: float = 1e-3,
) -> np.ndarray:
    """Commanded torque (n,) [N.m] of the paper's modified chirp (IV-C): each frequency for some cycles, the magnitude
    growing with it so that the motor never moves too little to be seen.

    Args:
        magnitudes: at the lowest and at the highest frequency [N.m].
        frequencies: lowest and highest [Hz].
        steps: frequencies in all, equal ratios apart.
        cycles: of each.
        period: of the samples [s].
    """
    parts = []
    for frequency, magnitude in zip(np.geomspace(*frequencies, steps), np.geomspace(*magnitudes, steps), strict=True):
        count = round(cycles / frequency / period)
        parts.append(magnitude * np.sin(2.0 * np.pi * frequency * period * np.arange(count)))
    return np.concatenate(parts)


# --- stage 1 and 2: motors and pulleys ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Pulleys:
    """What a chain of pulleys shows; all but the bias times the motor constant, as table III.

    Attributes:
        inertia: [kg.m2].
        friction: [N.m.s/rad].
        bias: of the amplifier, in commanded torque [N.m].
        residual: of the positions, rms [rad].
    """

    inertia: float
    friction: float
    bias: float
    residual: float


def fit_pulleys(record: Record) -> Pulleys:
    """Lumped inertia, friction and bias from one record of a motor with pulleys and nothing else: (7) and appendix A.

    The first-order system is simulated exactly between samples, over which the command is held, and compared with the
    positions themselves.

    Raises:
        IdentificationError: the record is too short or shows no motion.
    """
    period, command = record.period, record.command
    _check_motion(record)

    def simulated(decay: float) -> np.ndarray:
        """Positions under unit acceleration per command, under unit constant acceleration, of unit speed, and one."""
        kept = np.exp(-decay * period)
        speed, place = (1.0 - kept) / decay, (period - (1.0 - kept) / decay) / decay

        def positions(push: np.ndarray) -> np.ndarray:
            before = np.concatenate([[0.0], push[:-1]])
            speeds = lfilter([speed], [1.0, -kept], before)
            steps = place * before + speed * np.concatenate([[0.0], speeds[:-1]])
            return np.cumsum(steps)

        index = np.arange(len(command))
        coast = (1.0 - np.exp(-decay * period * index)) / decay
        ones = np.ones(len(command))
        return np.stack([positions(command), positions(ones), coast, ones], axis=1)

    def residuals(logarithm: np.ndarray) -> np.ndarray:
        columns = simulated(float(np.exp(logarithm[0])))
        found = np.linalg.lstsq(columns, record.position, rcond=None)[0]
        return columns @ found - record.position

    best = min((least_squares(residuals, [np.log(start)]) for start in (0.5, 5.0, 50.0)), key=lambda fit: fit.cost)
    decay = float(np.exp(best.x[0]))
    gain, constant, _, _ = np.linalg.lstsq(simulated(decay), record.position, rcond=None)[0]
    if gain <= 0.0:
        raise IdentificationError("the motor turns against its commands: check the sign of the torque or the encoder.")
    inertia = 1.0 / gain
    return Pulleys(float(inertia), float(decay * inertia), float(constant / gain), float(np.sqrt(np.mean(best.fun**2))))


def bias_by_arx(record: Record, period: float = 0.02) -> float:
    """Bias of an amplifier [N.m] from the speed of its motor: the two-input ARX model of appendix A, (31) to (33).

    The speed is the encoder differentiated over ``period``; the second input is a sequence of ones. The least squares
    are those of errors in the equation: noise of the speed pulls a_1 towards zero and with it the bias away from zero,
    so the period must be long for the encoder's step.

    Args:
        record: of a motor under a command without a mean.
        period: between two speeds [s].

    Raises:
        IdentificationError: the record is too short, shows no motion, or the model found is none.
    """
    _check_motion(record)
    stride = max(round(period / record.period), 1)
    edges = np.arange(0, len(record.time), stride)
    if len(edges) < 20:
        raise IdentificationError(f"a record of {len(record.time)} samples is too short for speeds over {period:g} s.")
    speed = np.diff(record.position[edges]) / (stride * record.period)
    command = np.add.reduceat(record.command, edges)[: len(speed)] / stride
    # the speed over an interval answers to the command of that interval and of the one before
    columns = np.stack([speed[:-1], 0.5 * (command[1:] + command[:-1]), np.ones(len(speed) - 1)], axis=1)
    _, gain, constant = np.linalg.lstsq(columns, speed[1:], rcond=None)[0]
    if gain <= 0.0:
        raise IdentificationError("the motor turns against its commands: check the sign of the torque or the encoder.")
    return float(constant / gain)


@dataclass(frozen=True)
class Motor:
    """Motor constant and rotor inertia factor, table IV.

    Attributes:
        constant: K_T, commanded by delivered torque.
        factor: alpha, true by given rotor inertia.
    """

    constant: float
    factor: float


def fit_motor(lumped: Sequence[float], pulleys: Sequence[float], rotor: float) -> Motor:
    """Solve (11) by (12) for motor constant and inertia factor.

    Args:
        lumped: inertias that :func:`fit_pulleys` found, one for each combination of pulleys [kg.m2].
        pulleys: the pulleys' and cables' own inertia in each, from drawings [kg.m2].
        rotor: inertia of the rotor as its maker gives it [kg.m2].

    Raises:
        IdentificationError: fewer than two combinations, or combinations that do not differ.
    """
    if len(lumped) != len(pulleys) or len(lumped) < 2 or np.ptp(pulleys) < 1e-9:
        raise IdentificationError("at least two combinations of pulleys with different known inertias are needed.")
    columns = np.stack([np.full(len(lumped), rotor), np.asarray(pulleys, float)], axis=1)
    scaled, constant = np.linalg.lstsq(columns / rotor, np.asarray(lumped, float) / rotor, rcond=None)[0]
    if constant <= 0.0 or scaled <= 0.0:
        raise IdentificationError("the inertias do not grow with the pulleys; check which record belongs to which.")
    return Motor(float(constant), float(scaled / constant))


# --- stage 3: legs ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Load:
    """What one coordinate moves while the others are locked: inertia a + b cos 2q, torque -(c sin q + d cos q).

    Attributes:
        inertia: a [kg.m2].
        inertia_second: b [kg.m2].
        sine: c [N.m].
        cosine: d [N.m].
    """

    inertia: float
    inertia_second: float
    sine: float
    cosine: float


@dataclass(frozen=True)
class Leg:
    """Friction and bias with the legs on, table V, at the motor.

    Attributes:
        friction: [N.m.s/rad].
        bias: in commanded torque [N.m].
        residual: of the positions, rms [rad at the motor].
        spread: of the recorded positions about their mean, rms [rad at the motor].
    """

    friction: float
    bias: float
    residual: float
    spread: float


def fit_leg(record: Record, load: Load, ratio: float, motor_constant: float, motor_inertia: float) -> Leg:
    """Friction and bias that make a simulation of one coordinate follow its record best: (19), and table V.

    Biases of both coordinates at once, (20), are :func:`sealegs.papers.biped.legs_together.fit_both`.

    Args:
        record: of the coordinate's motor; it starts at rest.
        load: of the coordinate, from drawings.
        ratio: motor turns per turn of the coordinate.
        motor_constant: from :func:`fit_motor`.
        motor_inertia: of rotor and pulleys at the motor [kg.m2].

    Raises:
        IdentificationError: the record is too short or shows no motion.
    """
    period = record.period
    _check_motion(record)
    constants = np.array([load.inertia + motor_inertia * ratio**2, load.inertia_second, load.sine, load.cosine])

    def positions(unknown: np.ndarray) -> np.ndarray:
        friction, bias, start = unknown
        torque = (record.command + bias) * ratio / motor_constant
        return ratio * _simulate(torque, period, constants, friction * ratio**2, start / ratio)

    first = float(record.position[0])
    fit = least_squares(
        lambda unknown: positions(unknown) - record.position,
        [5e-3, 0.0, first],
        bounds=([0.0, -np.inf, -np.inf], np.inf),
        x_scale=[1e-3, 1e-2, 1e-2],
        diff_step=1e-4,
    )
    friction, bias, _ = fit.x
    return Leg(float(friction), float(bias), float(np.sqrt(np.mean(fit.fun**2))), float(record.position.std()))


@numba.njit(cache=True)
def _simulate(torque, period, constants, friction, start):  # type: ignore[no-untyped-def]
    """Positions of a coordinate from rest, by Runge-Kutta, each torque held for a period."""
    a, b, sine, cosine = constants
    places = np.empty(len(torque))
    q, w = start, 0.0
    slope_q, slope_w = np.zeros(4), np.zeros(4)
    for k in range(len(torque)):
        places[k] = q
        for stage in range(4):
            share = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
            at = q + share * period * slope_q[max(stage - 1, 0)]
            speed = w + share * period * slope_w[max(stage - 1, 0)]
            push = torque[k] - friction * speed - sine * np.sin(at) - cosine * np.cos(at)
            slope_q[stage] = speed
            slope_w[stage] = (push + b * np.sin(2.0 * at) * speed * speed) / (a + b * np.cos(2.0 * at))
        q += period * (slope_q[0] + 2.0 * slope_q[1] + 2.0 * slope_q[2] + slope_q[3]) / 6.0
        w += period * (slope_w[0] + 2.0 * slope_w[1] + 2.0 * slope_w[2] + slope_w[3]) / 6.0
    return places


# --- stage 4: spring ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Spring:
    """Fig. 19.

    Attributes:
        stiffness: torque per deflection [N.m/rad].
        offset: torque at no deflection [N.m].
    """

    stiffness: float
    offset: float


def fit_spring(weight: np.ndarray, shape: np.ndarray, deflection: np.ndarray, ratio: float) -> Spring:
    """Line through spring torque, W sin(q_LS) / ratio, over deflection: (24).

    Args:
        weight: on the scale under the foot (n,) [N].
        shape: leg shape (n,) [rad].
        deflection: of the spring's pulley (n,) [rad].
        ratio: turns of the pulley per turn of the leg shape.

    Raises:
        IdentificationError: the deflections do not differ.
    """
    if len(deflection) < 2 or np.ptp(deflection) < 1e-4:
        raise IdentificationError("the spring was not loaded differently: take leg shapes from 10 to 30 degrees.")
    torque = weight * np.sin(shape) / ratio
    stiffness, offset = np.polyfit(deflection, torque, 1)
    return Spring(float(stiffness), float(offset))


def _check_motion(record: Record) -> None:
    if np.ptp(record.position) < 20.0 * max(float(np.diff(np.unique(record.position)).min(initial=np.inf)), 1e-6):
        raise IdentificationError("the motor moved by fewer than 20 steps of its encoder: command more torque.")


# --- the last stage of an identification: stretch of the cables under load (paper 003, (25) to (27)) -----------------


@dataclass(frozen=True)
class Cable:
    """Cable stretch model (27), at the motor.

    Attributes:
        stiffness: [N.m/rad].
        damping: [N.m.s/rad].
    """

    stiffness: float
    damping: float


def fit_cable(
    record: Record,
    stretch: np.ndarray,
    motor_constant: float,
    motor_inertia: float,
    friction: float,
    bias: float,
    window: float = 0.08,
) -> Cable:
    """Stiffness and damping from motor and stretch under load, without speeds: the motor's equation

        J q'' = (u + b) / K_T - mu q' - K s - D s'

    times smooth windows that begin and end at zero, integrated by parts until positions are left.

    Args:
        record: of the motor.
        stretch: of the cable (n,) [rad at the motor]: motor less what its joints say, (25).
        motor_constant: from :func:`sealegs.papers.biped.identification.fit_motor`.
        motor_inertia: of rotor and pulleys at the motor [kg.m2].
        friction: from :func:`sealegs.papers.biped.identification.fit_leg` [N.m.s/rad].
        bias: in commanded torque [N.m].
        window: length of a window [s]; about a swing of what is looked for.

    Raises:
        IdentificationError: the record is too short, or the cable hardly stretches.
    """
    period = record.period
    if len(stretch) != len(record.time) or np.std(stretch) < 1e-3:
        raise IdentificationError("the cable hardly stretches in this record: load it more, as by hopping.")
    span = round(window / period)
    x = np.linspace(0.0, 1.0, span + 1)
    length = span * period
    bump = np.sin(np.pi * x) ** 4
    slope = 4.0 * np.pi * np.sin(np.pi * x) ** 3 * np.cos(np.pi * x) / length
    bend = (12.0 * np.sin(np.pi * x) ** 2 * np.cos(np.pi * x) ** 2 - 4.0 * np.sin(np.pi * x) ** 4) * (
        np.pi / length
    ) ** 2

    def windowed(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return np.convolve(values, weights[::-1], mode="valid")[:: max(span // 4, 1)]

    # a command is held until the next sample, so it acts half a period later than its sample says
    delivered = (record.command + bias) / motor_constant
    held = 0.5 * (delivered + np.concatenate([delivered[:1], delivered[:-1]]))
    known = (
        windowed(held, bump)
        + friction * windowed(record.position, slope)
        - motor_inertia * windowed(record.position, bend)
    )
    columns = np.stack([windowed(stretch, bump), -windowed(stretch, slope)], axis=1)
    stiffness, damping = np.linalg.lstsq(columns, known, rcond=None)[0]
    return Cable(float(stiffness), float(damping))
