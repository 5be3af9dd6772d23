"""Benches drawn from a wide prior: motors, gears, loads, rates, lengths and noise, hidden effects, faults of the log.

The machine is that of :mod:`.physics`; nearly all of its numbers are drawn. A case hides nothing, one effect, two, or
what no catalogue holds, and a fault of recording may lie on top. Sizes are drawn relative to the machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .excitation import EXCITATIONS, SEGMENT, trajectory
from .physics import AMBIENT, Machine, inertia_of, simulate
from .recording import Recording

JOINT = "servo"
UNCERTAIN = ("motor_constant", "resistance", "armature", "coulomb", "viscous", "command_delay")
NOMINAL_ERROR = 0.05
KINDS = (("null", 0.2), ("one", 0.45), ("two", 0.15), ("strangers", 0.2))
FAULT_SHARE = 0.3
DRIVEN_SHARE = 0.12
LATE_STAMPS = 0.008
"""Largest delay of a time stamp [s]: the host stamps a row when it gets to it."""


@dataclass(frozen=True)
class Recorder:
    """How runs are recorded.

    Attributes:
        period: of the samples [s].
        jitter: standard deviation of the sampling instants about their grid, as a share of the period.
        duration: of a run [s].
        runs: how many.
        noise: standard deviation of an angle before rounding [rad].
        ticks: of the encoder per turn.
        reach: factor on the amplitudes of the excitations.
        slow: factor on their durations.
        columns: that are logged beside goal and position.
        load_known: whether the sidecar says what hangs on the joint.
    """

    period: float
    jitter: float
    duration: float
    runs: int
    noise: float
    ticks: int
    reach: float
    slow: float
    columns: tuple[str, ...]
    load_known: bool = True

    @property
    def floor(self) -> float:
        """Rms error of a logged angle [rad]."""
        return math.hypot(self.noise, 2.0 * math.pi / self.ticks / math.sqrt(12.0))


@dataclass
class Hidden:
    """What a case hides.

    Attributes:
        machine: with all effects; ``true`` without any.
        nominal: what the sidecar believes.
        effects: value and size (rms change of the position over the noise floor) by name.
        latency: of the position's reading [s].
        filter: time constant of the low-pass filter that the host puts on the goal [s].
        gain_change: factor on the gain in every second run.
        fault: of the recording; empty for none.
    """

    machine: Machine
    true: Machine
    nominal: Machine
    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    latency: float = 0.0
    filter: float = 0.0
    gain_change: float = 1.0
    fault: str = ""


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def stall(m: Machine) -> float:
    """Stall torque [N.m]."""
    return m.motor_constant * m.volts / m.resistance


def drawn_machine(rng: np.random.Generator) -> Machine:
    """A servo with a pendulum that it can lift, and a position loop of usual damping."""
    volts = float(rng.choice([7.4, 12.0, 24.0]))
    constant = volts / log_uniform(rng, 3.5, 14.0)
    resistance = constant * volts / log_uniform(rng, 0.6, 15.0)
    damping = constant * constant / resistance
    torque = constant * volts / resistance
    m = Machine(
        volts=volts,
        motor_constant=constant,
        resistance=resistance,
        armature=log_uniform(rng, 0.015, 0.06) * damping,
        coulomb=log_uniform(rng, 0.008, 0.04) * torque,
        viscous=log_uniform(rng, 0.03, 0.2) * damping,
        command_delay=float(rng.uniform(0.001, 0.012)),
        duty_limit=float(rng.choice([0.8, 0.97, 1.0])),
        tooth_stiffness=450.0 * torque,
        tooth_damping=0.3 * torque,
        stop_stiffness=150.0 * torque,
        stop_damping=0.3 * torque,
    )
    length = log_uniform(rng, 0.06, 0.3)
    mass = log_uniform(rng, 0.04, 0.3) * torque / (9.81 * length)
    m = m._replace(length=length, mass=mass, arm_mass=0.06 * mass)
    whole = m.armature + inertia_of(m)
    ratio = rng.uniform(0.3, 0.8)
    return m._replace(gain=((damping + m.viscous) / (2.0 * ratio)) ** 2 / (whole * torque))


def drawn_recorder(rng: np.random.Generator) -> Recorder:
    """Short, coarse and slow logs among usual ones; none longer than 15,000 samples in all."""
    period = float(rng.choice([0.02, 0.01, 0.005, 0.005]))
    duration, runs = [(6.0, 4), (6.0, 12), (12.0, 3), (24.0, 3), (18.0, 4)][int(rng.integers(5))]
    columns = [("duty", "current"), ("duty", "current"), ("duty",), ("current",), ()][int(rng.integers(5))]
    return Recorder(
        period=period,
        jitter=float(rng.choice([0.0, 0.02, 0.06])),
        duration=duration,
        runs=runs,
        noise=log_uniform(rng, 1e-4, 1.2e-3),
        ticks=int(rng.choice([1024, 4096, 4096, 16384])),
        reach=float(rng.uniform(0.5, 1.1)),
        slow=float(rng.choice([1.0, 1.0, 2.0])),
        columns=columns,
        load_known=not (columns and rng.random() < DRIVEN_SHARE),
    )


Size = Callable[[Machine, np.random.Generator], float]
Apply = Callable[[Machine, float], Machine]


def _either(low: float, high: float) -> Size:
    """A factor that is as far below one as above it."""
    return lambda m, rng: float(rng.uniform(low, high)) ** float(rng.choice([-1.0, 1.0]))


def _plus(name: str, scale: Callable[[Machine], float], low: float, high: float) -> tuple[Size, Apply]:
    return (
        lambda m, rng: log_uniform(rng, low, high) * scale(m),
        lambda m, value: m._replace(**{name: getattr(m, name) + value}),
    )


def _becomes(name: str, scale: Callable[[Machine], float], low: float, high: float) -> tuple[Size, Apply]:
    return lambda m, rng: log_uniform(rng, low, high) * scale(m), lambda m, value: m._replace(**{name: value})


def _scaled(name: str, low: float, high: float) -> tuple[Size, Apply]:
    return _either(low, high), lambda m, value: m._replace(**{name: getattr(m, name) * value})


def _one(m: Machine) -> float:
    del m
    return 1.0


def _braking(m: Machine) -> float:
    return m.motor_constant**2 / m.resistance


EFFECTS: dict[str, tuple[Size, Apply]] = {
    "friction.coulomb": _plus("coulomb", stall, 0.006, 0.05),
    "friction.viscous": _plus("viscous", _braking, 0.08, 0.6),
    "friction.stribeck": _becomes("stribeck", stall, 0.02, 0.08),
    "friction.asymmetric": _becomes("asymmetry", lambda m: m.coulomb, 0.3, 0.9),
    "friction.load_dependent": _becomes("load_friction", _one, 0.04, 0.2),
    "drive.gain": _scaled("gain", 1.08, 1.5),
    "drive.delay": _plus("command_delay", _one, 0.002, 0.02),
    "drive.rate_limit": _becomes("goal_speed", lambda m: m.volts / m.motor_constant, 0.4, 2.0),
    "drive.goal_filter": (lambda m, rng: log_uniform(rng, 0.005, 0.1), lambda m, value: m),  # by the host
    "drive.deadband": _becomes("error_deadband", _one, 0.008, 0.04),
    "drive.saturation": _scaled("duty_limit", 0.6, 0.93),
    "drive.supply_sag": _becomes("supply_resistance", lambda m: m.resistance, 0.06, 0.4),
    "drive.motor_constant": _scaled("motor_constant", 1.1, 1.4),
    "drive.minimum_duty": _becomes("minimum_duty", _one, 0.04, 0.15),
    "transmission.backlash": _becomes("backlash", _one, 0.03, 0.25),
    "transmission.compliance": _becomes("joint_stiffness", stall, 1.5, 8.0),
    "load.mass": _scaled("mass", 1.15, 1.7),
    "load.inertia": _plus("extra_inertia", lambda m: m.armature, 0.15, 1.0),
    "sensor.offset": _becomes("encoder_offset", _one, 0.02, 0.12),
    "sensor.scale": _scaled("encoder_scale", 1.02, 1.1),
    "sensor.delay": (lambda m, rng: log_uniform(rng, 0.002, 0.015), lambda m, value: m),
    "contact.blocked": (lambda m, rng: float(rng.uniform(0.3, 0.6)), lambda m, value: m._replace(stop_angle=value)),
}
"""How large an effect is drawn, and what it does to the machine."""

STRANGERS: dict[str, tuple[Size, Apply]] = {
    "stranger.cable": _becomes("cable_stiffness", stall, 0.03, 0.15),
    "stranger.friction_drift": _becomes("friction_drift", lambda m: stall(m) / 24.0, 0.02, 0.08),
    "stranger.jams": _becomes("jam_torque", stall, 0.03, 0.12),
    "stranger.integral": _becomes("integral_gain", lambda m: m.gain, 0.5, 5.0),
    "stranger.gain_change": (lambda m, rng: float(rng.uniform(0.5, 0.8)), lambda m, value: m),
}
"""What no catalogue holds; the last two are of the firmware: an integral term and a gain that nobody logged."""

FAULTS = ("sign", "degrees", "held", "late stamps", "velocity unit", "columns behind", "unsigned current")
"""Of the recording, on top of what is hidden."""


def draw(seed: int) -> tuple[Hidden, Recorder, str]:
    """What a seed stands for: what is hidden, how it is recorded, and which kind of case it is."""
    rng = np.random.default_rng([seed, 5])
    nominal, recorder = drawn_machine(rng), drawn_recorder(rng)
    nominal = nominal._replace(encoder_ticks=float(recorder.ticks))
    factors = {name: 1.0 + NOMINAL_ERROR * float(rng.uniform(-1.0, 1.0)) for name in UNCERTAIN}
    kind = str(rng.choice([name for name, _ in KINDS], p=[share for _, share in KINDS]))
    names: list[str] = []
    if kind in ("one", "two"):
        names = [str(n) for n in rng.choice(list(EFFECTS), 1 + (kind == "two"), replace=False)]
    elif kind == "strangers":
        names = [str(n) for n in rng.choice(list(STRANGERS), int(rng.integers(1, 3)), replace=False)]
    if "drive.motor_constant" in names:  # what is believed is wrong by the factor that is hidden, and by no other
        factors["motor_constant"] = 1.0
    true = nominal._replace(**{name: getattr(nominal, name) * factor for name, factor in factors.items()})
    hidden = Hidden(true, true, nominal)
    for name in names:
        size, apply = (EFFECTS | STRANGERS)[name]
        value = size(hidden.machine, rng)
        if name == "drive.saturation":
            value = min(value, 1.0 / value)  # no firmware gives more than it has
        hidden.machine = apply(hidden.machine, value)
        hidden.effects[name] = {"value": value}
        hidden.latency += value if name == "sensor.delay" else 0.0
        hidden.filter = value if name == "drive.goal_filter" else hidden.filter
        hidden.gain_change = value if name == "stranger.gain_change" else hidden.gain_change
    if rng.random() < FAULT_SHARE:
        able = [f for f in FAULTS if not ("current" in f and "current" not in recorder.columns)]
        able = [f for f in able if not (f == "columns behind" and not recorder.columns)]
        hidden.fault = str(rng.choice(able))
    return hidden, recorder, kind


def record_wide(seed: int, *, fresh: bool = False) -> tuple[list[Recording], dict[str, Any]]:
    """Record the runs of a case.

    Args:
        seed: of everything; equal seeds give equal logs.
        fresh: record one further run instead, with other goals and without a fault of recording.

    Returns:
        The recordings, and the truth: ``kind``, ``effects``, ``fault``, ``noise_floor`` [rad] and how it was recorded.
        Each effect has the ``value`` that was drawn, the ``actual`` number of the machine, and ``noise_floors``, by
        which it moves the position.
    """
    hidden, recorder, kind = draw(seed)
    recordings = []
    for index in [99] if fresh else range(recorder.runs):
        log, time = _run(hidden, recorder, np.random.default_rng([seed, 6, index]), index)
        if hidden.fault and not fresh:
            log, time = _faulty(hidden.fault, log, time, recorder, np.random.default_rng([seed, 7, index]))
        m = hidden.nominal
        params = {"mass": m.mass, "length": m.length, "arm_mass": m.arm_mass}
        robot = "bench" if recorder.load_known else "unknown"
        recordings.append(
            Recording(
                f"run{index}", time, {JOINT: log}, {}, robot, params if recorder.load_known else {}, {JOINT: chain(m)}
            )
        )
    for name in hidden.effects:
        hidden.effects[name]["noise_floors"] = _size(hidden, recorder, name, seed)
        hidden.effects[name]["actual"] = actual(name, hidden.machine, hidden.nominal, hidden.filter, hidden.latency)
    truth = {
        "seed": seed, "kind": kind, "effects": hidden.effects, "fault": hidden.fault, "noise_floor": recorder.floor,
        "recorder": {**recorder.__dict__, "columns": list(recorder.columns)},
    }  # fmt: skip
    return recordings, truth


def chain(m: Machine) -> list[dict[str, dict[str, float]]]:
    """The chain that the sidecar believes in."""
    motor = {"motor_constant": m.motor_constant, "resistance": m.resistance, "armature": m.armature}
    return [
        {"delay": {"seconds": m.command_delay}},
        {"position_p": {"gain": m.gain}},
        {"duty_limit": {"limit": m.duty_limit}},
        {"supply": {"volts": m.volts, "resistance": 0.0}},
        {"dc_motor": motor},
        {"friction": {"coulomb": m.coulomb, "viscous": m.viscous}},
        {"encoder": {"ticks": int(m.encoder_ticks)}},
    ]


def _goals(recorder: Recorder, time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    count = max(math.ceil(recorder.duration / recorder.slow / SEGMENT), 1)
    names = tuple(str(n) for n in rng.permutation([n for n in EXCITATIONS if n != "hold"])[:count])
    return recorder.reach * trajectory(names, np.minimum(time / recorder.slow, SEGMENT * count), rng)


def _run(
    hidden: Hidden, recorder: Recorder, rng: np.random.Generator, index: int
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    count = int(recorder.duration / recorder.period)
    jitter = np.clip(rng.normal(0.0, recorder.jitter, count), -0.3, 0.3) * recorder.period
    time = recorder.period * (1.0 + np.arange(count)) + jitter
    goal = _goals(recorder, time, rng)
    record = _simulated(hidden, recorder, time, goal, rng, index)
    at, m = record[:, 0], hidden.machine
    held = np.clip(np.searchsorted(at, time, side="right") - 1, 0, len(at) - 1)
    seen = np.maximum(time - hidden.latency, 0.0)
    tick = 2.0 * math.pi / recorder.ticks
    angle = (
        m.encoder_scale * np.interp(seen, at, record[:, 1]) + m.encoder_offset + rng.normal(0, recorder.noise, count)
    )
    speed = m.encoder_scale * np.interp(seen, at, record[:, 2]) + rng.normal(0.0, 0.02, count)
    log = {"goal": goal, "position": tick * np.round(angle / tick), "velocity": 0.01 * np.round(speed / 0.01)}
    if "duty" in recorder.columns:
        log["duty"] = np.asarray(np.round(record[held, 4], 3), np.float64)
    if "current" in recorder.columns:
        step = 0.003 * m.volts / m.resistance
        log["current"] = step * np.round((record[held, 5] + rng.normal(0.0, step, count)) / step)
    return log, time


def _simulated(
    hidden: Hidden, recorder: Recorder, time: np.ndarray, goal: np.ndarray, rng: np.random.Generator, index: int
) -> np.ndarray:
    m = hidden.machine
    if index % 2:
        m = m._replace(gain=m.gain * hidden.gain_change)
    if hidden.filter > 0.0:
        goal = goal.copy()
        for k in range(1, len(goal)):
            share = -math.expm1(-(time[k] - time[k - 1]) / hidden.filter)
            goal[k] = goal[k - 1] + share * (goal[k] - goal[k - 1])
    jams = np.sort(rng.uniform(0.5, recorder.duration, max(int(recorder.duration / 2.0), 1)))
    return simulate(m, time, goal, jams, jams + rng.uniform(0.05, 0.4, len(jams)), time[-1] + 2e-3, AMBIENT)


def _size(hidden: Hidden, recorder: Recorder, name: str, seed: int) -> float:
    """Rms change of the first run's position when an effect alone is hidden, in parts of the noise floor."""
    _, apply = (EFFECTS | STRANGERS)[name]
    value = hidden.effects[name]["value"]
    alone = Hidden(apply(hidden.true, value), hidden.true, hidden.nominal)
    alone.latency = value if name == "sensor.delay" else 0.0
    alone.filter = value if name == "drive.goal_filter" else 0.0
    alone.gain_change = value if name == "stranger.gain_change" else 1.0
    plain = Hidden(hidden.true, hidden.true, hidden.nominal)
    seen = []
    for case in (alone, plain):
        rng = np.random.default_rng([seed, 8])
        time = recorder.period * (1.0 + np.arange(int(recorder.duration / recorder.period)))
        record = _simulated(case, recorder, time, _goals(recorder, time, rng), rng, 1)
        m = case.machine
        angle = np.interp(np.maximum(time - case.latency, 0.0), record[:, 0], record[:, 1])
        seen.append(m.encoder_scale * angle + m.encoder_offset)
    return float(np.sqrt(np.mean((seen[0] - seen[1]) ** 2))) / recorder.floor


def _faulty(
    fault: str, log: dict[str, np.ndarray], time: np.ndarray, recorder: Recorder, rng: np.random.Generator
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The run as a host with a fault recorded it."""
    log = dict(log)
    if fault == "sign":
        log["position"], log["velocity"] = -log["position"], -log["velocity"]
    elif fault == "degrees":
        log["position"] = np.degrees(log["position"])
    elif fault == "held":  # read at half the rate, logged at the full one
        for name in log.keys() - {"goal"}:
            log[name] = np.repeat(log[name][::2], 2)[: len(time)]
    elif fault == "late stamps":
        late = rng.uniform(0.0, min(LATE_STAMPS, 0.6 * recorder.period), len(time))
        time = np.maximum.accumulate(time + late) + 1e-7 * np.arange(len(time))
    elif fault == "velocity unit":
        log["velocity"] = log["velocity"] / (2.0 * math.pi)
    elif fault == "columns behind":
        for name in recorder.columns:
            log[name] = np.concatenate([log[name][:1], log[name][:-1]])
    elif fault == "unsigned current":
        log["current"] = np.abs(log["current"])
    return log, time


# --- what a catalogue would have to find of an effect, in the unit of the number that hides it -----------------------


NUMBERS = {
    "friction.coulomb": "coulomb",
    "friction.viscous": "viscous",
    "friction.stribeck": "stribeck",
    "friction.asymmetric": "asymmetry",
    "friction.load_dependent": "load_friction",
    "drive.gain": "gain",
    "drive.delay": "command_delay",
    "drive.rate_limit": "goal_speed",
    "drive.deadband": "error_deadband",
    "drive.saturation": "duty_limit",
    "drive.supply_sag": "supply_resistance",
    "drive.motor_constant": "motor_constant",
    "drive.minimum_duty": "minimum_duty",
    "transmission.backlash": "backlash",
    "transmission.compliance": "joint_stiffness",
    "load.inertia": "extra_inertia",
    "sensor.offset": "encoder_offset",
    "sensor.scale": "encoder_scale",
}
"""Number of the machine that an effect sets, where the machine has it."""


def actual(name: str, machine: Machine, nominal: Machine, filter_time: float, latency: float) -> float:
    """The number that an effect is; NaN for a stranger.

    Args:
        name: of the effect.
        machine: with all effects.
        nominal: as it is believed to be.
        filter_time: time constant of the filter that the host puts on the goal [s].
        latency: of the position's reading [s].
    """
    if name == "load.mass":  # as a factor
        return machine.mass / nominal.mass
    special = {"drive.goal_filter": filter_time, "sensor.delay": latency, "contact.blocked": machine.stop_angle}
    return float(getattr(machine, NUMBERS[name]) if name in NUMBERS else special.get(name, math.nan))
