"""Run the hidden bench and log it as a real one would: jittered clock, quantised and noisy sensors, nominal sidecar."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from .effects import EFFECTS, MAGNITUDES, STRANGERS, Effect
from .excitation import DEFAULT_SCHEDULES, SEGMENT, trajectory
from .physics import AMBIENT, Machine, simulate
from .recording import Recording

JOINT = "servo"
SAMPLE_PERIOD = 0.005
JITTER = 3e-4
"""Standard deviation of the sampling instants about their grid [s]."""
ENCODER_NOISE = 3.9e-4
"""Standard deviation of the angle noise before quantisation [rad]."""
TICK = 2 * np.pi / 4096
NOISE_FLOOR = float(np.hypot(ENCODER_NOISE, TICK / np.sqrt(12)))
"""Rms error of a logged position [rad]: 0.59 mrad."""
VELOCITY_NOISE = 0.02
CURRENT_STEP = 0.0065
VOLTAGE_STEP = 0.1

LOADS: dict[str, tuple[float, float, float]] = {
    "light": (0.25, 0.10, 0.03),
    "medium": (0.50, 0.12, 0.03),
    "heavy": (0.70, 0.15, 0.04),
}
"""Mass [kg], length [m] and arm mass [kg] of the pendulum."""

SPRING = (12.0, 0.02)
"""Series spring [N.m/rad] and its damping [N.m.s/rad] of the machine that ``spring.stiffness`` is hidden in."""

Schedule = tuple[str, ...] | Callable[[np.ndarray], np.ndarray]
"""Names of excitations one after the other, or goals [rad] as a function of the sample times [s]."""

UNCERTAIN = ("motor_constant", "resistance", "armature", "coulomb", "viscous", "command_delay")
"""What the nominal model may have wrong without anything being hidden."""


def nominal_chain(machine: Machine | None = None) -> list[dict[str, dict[str, float]]]:
    """The chain that the sidecar believes in: STS3215-like, with a series spring where ``machine`` has one."""
    nominal = Machine()
    chain: list[dict[str, dict[str, float]]] = [
        {"delay": {"seconds": nominal.command_delay}},
        {"position_p": {"gain": nominal.gain}},
        {"duty_limit": {"limit": nominal.duty_limit}},
        {"supply": {"volts": nominal.volts, "resistance": 0.0}},
        {
            "dc_motor": {
                "motor_constant": nominal.motor_constant,
                "resistance": nominal.resistance,
                "armature": nominal.armature,
            }
        },
        {"friction": {"coulomb": nominal.coulomb, "viscous": nominal.viscous}},
        {"encoder": {"ticks": int(nominal.encoder_ticks)}},
    ]
    if machine is not None and np.isfinite(machine.joint_stiffness):
        chain.insert(6, {"spring": {"stiffness": SPRING[0], "damping": SPRING[1]}})
    return chain


def record_bench(
    effects: dict[str, dict[str, float] | str | float] | None = None,
    seed: int = 0,
    load: str | tuple[str, ...] = "medium",
    *,
    runs: int = 3,
    duration: float = 24.0,
    nominal_error: float = 0.05,
    schedules: tuple[Schedule, ...] = DEFAULT_SCHEDULES,
    link_encoder: bool = False,
    constants: Mapping[str, float] | None = None,
) -> tuple[list[Recording], dict[str, Any]]:
    """Record runs of a bench that hides ``effects``.

    Args:
        effects: cause (or stranger) name to ``clear``, ``moderate``, ``faint``, a value of its parameter, or
            ``{parameter: value}``; nothing hides nothing.
        seed: of everything random; equal seeds give equal logs.
        load: name in `LOADS`, or one name per run in turn.
        runs: number of runs.
        duration: of each run [s].
        nominal_error: largest relative error of the sidecar's servo parameters.
        schedules: excitation names, or goals over time, per run, in turn.
        link_encoder: also log the link side.
        constants: further numbers of the machine, by name.

    Returns:
        The recordings, and the truth: ``seed``, ``effects`` (name to parameter, value, unit, magnitude), ``machines``
        (one per run), ``nominal_factors`` (true over nominal), ``noise_floor`` [rad] and ``clean_position`` (per run,
        the noiseless angle).
    """
    effects = dict(effects or {})
    rng = np.random.default_rng(seed)
    factors = {name: 1.0 + nominal_error * rng.uniform(-1.0, 1.0) for name in UNCERTAIN}
    base = Machine()
    base = base._replace(**{name: getattr(base, name) * factor for name, factor in factors.items()})
    base = base._replace(**(constants or {}))
    if "spring.stiffness" in effects:
        base = base._replace(joint_stiffness=SPRING[0], joint_damping=SPRING[1])
        link_encoder = True
    chain = nominal_chain(base)

    truth: dict[str, Any] = {
        "seed": seed,
        "effects": {},
        "machines": [],
        "nominal_factors": factors,
        "noise_floor": NOISE_FLOOR,
        "clean_position": [],
    }
    machine, latency = base, 0.0
    for name, size in effects.items():
        effect, value = _sized(name, size)
        machine = effect.apply(machine, value)
        latency += value if name == "sensor.delay" else 0.0
        truth["effects"][name] = {
            "parameter": effect.parameter,
            "value": value,
            "unit": effect.unit,
            "magnitude": size if isinstance(size, str) else None,
        }

    loads = (load,) if isinstance(load, str) else tuple(load)
    recorded = []
    for index in range(runs):
        name = loads[index % len(loads)]
        mass, length, arm_mass = LOADS[name]
        hanging = Machine()._replace(mass=mass, length=length, arm_mass=arm_mass)
        scale = machine.mass / Machine().mass  # a hidden load.mass is a factor on whatever hangs there
        loaded = machine._replace(mass=hanging.mass * scale, length=length, arm_mass=arm_mass)
        log, time, clean = run_machine(
            loaded, schedules[index % len(schedules)], duration, np.random.default_rng([seed, index]),
            latency=latency, link_encoder=link_encoder,
        )  # fmt: skip
        truth["machines"].append(loaded)
        truth["clean_position"].append(clean)
        recorded.append(
            Recording(
                name=f"run{index}",
                time=time,
                joints={JOINT: log},
                base={},
                robot="bench",
                robot_params={"mass": mass, "length": length, "arm_mass": arm_mass},
                actuators={JOINT: chain},
            )
        )
    return recorded, truth


def record_again(
    truth: Mapping[str, Any],
    believed: Mapping[str, float],
    chain: list[dict[str, dict[str, float]]],
    goals: Callable[[np.ndarray], np.ndarray],
    load: Mapping[str, float],
    *,
    duration: float,
    runs: int = 3,
    seed: int = 0,
    link_encoder: bool = False,
) -> list[Recording]:
    """Record further runs of a machine, with other goals and perhaps another load.

    Args:
        truth: of :func:`record_bench`.
        believed: robot parameters of its first run.
        chain: nominal chain.
        goals: goals [rad] at sample times (n,) [s].
        load: ``mass`` [kg], ``length`` [m] and ``arm_mass`` [kg] as whoever hangs it believes.
        duration: of each run [s].
        runs: how many.
        seed: of noise and jitter.
        link_encoder: also record the link side.
    """
    machine = truth["machines"][0]
    scale = machine.mass / believed["mass"]  # a hidden load.mass is a factor on whatever hangs there
    loaded = machine._replace(mass=load["mass"] * scale, length=load["length"], arm_mass=load["arm_mass"])
    latency = truth["effects"].get("sensor.delay", {"value": 0.0})["value"]
    recorded = []
    for index in range(runs):
        rng = np.random.default_rng([seed, 77, index])
        log, time, _ = run_machine(loaded, goals, duration, rng, latency=latency, link_encoder=link_encoder)
        params = {key: load[key] for key in ("mass", "length", "arm_mass")}
        recorded.append(Recording(f"again{index}", time, {JOINT: log}, {}, "bench", params, {JOINT: chain}))
    return recorded


def run_machine(
    machine: Machine,
    schedule: Schedule,
    duration: float,
    rng: np.random.Generator,
    *,
    latency: float = 0.0,
    link_encoder: bool = False,
) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Drive one machine through a schedule of excitations.

    Returns:
        The joint's signals, the sample times (n,) [s] and the noiseless motor-side angle at them (n,) [rad].
    """
    count = int(duration / SAMPLE_PERIOD)
    jitter = np.clip(rng.normal(0.0, JITTER, count), -0.3 * SAMPLE_PERIOD, 0.3 * SAMPLE_PERIOD)
    time = SAMPLE_PERIOD * (1.0 + np.arange(count)) + jitter
    if callable(schedule):
        goal = schedule(time)
    else:
        goal = trajectory(schedule, np.minimum(time, SEGMENT * len(schedule)), rng)
    jams = np.sort(rng.uniform(0.5, duration, max(int(duration / 2.0), 1)))
    jam_end = jams + rng.uniform(0.05, 0.4, len(jams))
    ambient = AMBIENT + rng.uniform(0.0, 10.0)
    record = simulate(machine, time, goal, jams, jam_end, time[-1] + 2e-3, ambient)

    at = record[:, 0]
    held = np.clip(np.searchsorted(at, time, side="right") - 1, 0, len(at) - 1)
    seen = np.maximum(time - latency, 0.0)
    angle = np.interp(time, at, record[:, 1])
    clean = np.interp(seen, at, machine.encoder_scale * record[:, 1] + machine.encoder_offset)
    velocity = machine.encoder_scale * np.interp(seen, at, record[:, 2]) + rng.normal(0.0, VELOCITY_NOISE, count)
    signals = {
        "goal": goal,
        "position": _ticks(clean + rng.normal(0.0, ENCODER_NOISE, count)),
        "velocity": np.round(velocity / TICK) * TICK,
    }
    if link_encoder:
        link = np.interp(time, at, record[:, 3])
        signals["link_position"] = _ticks(link + rng.normal(0.0, ENCODER_NOISE, count))
    signals["duty"] = np.round(record[held, 4], 3)
    signals["voltage"] = np.round(record[held, 6] / VOLTAGE_STEP) * VOLTAGE_STEP
    signals["current"] = (
        np.round((record[held, 5] + rng.normal(0.0, CURRENT_STEP, count)) / CURRENT_STEP) * CURRENT_STEP
    )
    signals["temperature"] = np.round(record[held, 7])
    return signals, time, angle


def _ticks(angle: np.ndarray) -> np.ndarray:
    return np.round(angle / TICK) * TICK


def _sized(name: str, size: dict[str, float] | str | float) -> tuple[Effect, float]:
    effect = (EFFECTS | STRANGERS).get(name)
    if effect is None:
        raise KeyError(f"the hidden bench knows no effect {name!r}; it knows {sorted(EFFECTS | STRANGERS)}")
    if isinstance(size, dict):
        return effect, float(size[effect.parameter])
    if isinstance(size, str):
        return effect, effect.sizes[MAGNITUDES.index(size)]
    return effect, float(size)
