"""Everyday machines drawn at random, and the logs that a hobbyist makes of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..recording import Recording
from .effects import EFFECTS, PAYLOAD, PAYLOAD_SIZES, SHARED, STRANGERS, true_number, with_effect
from .machines import BENCH, MACHINES, UNCERTAIN, Machine, links_of, mjcf, nominal_chain, servos_of
from .physics import TICK, Servos, simulate

NOMINAL_ERROR = 0.05  # of numbers and masses
CYCLE = ("bench", "pan_tilt", "leg", "gripper", "arm")
KINDS = ("known", "known", "null", "known", "known", "known", "stranger", "known", "known", "known")
"""Of the machines of one name in turn, each name from a place of its own."""
READING_NOISE = 4e-4  # [rad] before it is rounded
JITTER = 6e-4  # [s] of time stamps


@dataclass(frozen=True, eq=False)
class Drawn:
    """One machine with what it hides.

    Attributes:
        name: of the machine.
        seed: of everything random.
        kind: ``known``, ``null`` or ``stranger``.
        machine: as published.
        masses, tip_mass: as they are [kg].
        servos: as they are.
        effects: name, number of the joint (-1: all), size.
        rate: of the log [Hz].
        duration, runs: of each run [s], and how many.
        degrees: whether angles are logged in tenths of a degree, else in ticks.
        more: whether duty and voltage are logged, too.
    """

    name: str
    seed: int
    kind: str
    machine: Machine
    masses: np.ndarray
    tip_mass: float
    servos: Servos
    effects: tuple[tuple[str, int, float], ...]
    rate: float
    duration: float
    runs: int
    degrees: bool
    more: bool

    def with_effects(self, effects: tuple[tuple[str, int, float], ...]) -> tuple[Servos, float]:
        """Servos, and the mass at the tip, with some effects."""
        servos, tip = self.servos, self.tip_mass
        for name, joint, size in effects:
            if name == PAYLOAD:
                tip *= size
            else:
                servos = with_effect(servos, name, joint, size)
        return servos, tip

    def without(self, number: int) -> tuple[tuple[str, int, float], ...]:
        """All effects but one."""
        return tuple(effect for k, effect in enumerate(self.effects) if k != number)


def drawn(number: int, seed: int) -> Drawn:
    """The machine of a number of the bench.

    Args:
        number: tells its kind.
        seed: of everything random.
    """
    rng = np.random.default_rng([seed, 45])
    name = CYCLE[number % len(CYCLE)]
    kind = KINDS[(number // len(CYCLE) + 7 * (number % len(CYCLE))) % len(KINDS)]
    machine = MACHINES[name]
    count = len(machine.bodies)
    servos = servos_of(count)
    for key in UNCERTAIN:
        servos = servos._replace(**{key: getattr(servos, key) * _about(rng, count)})
    servos = servos._replace(latency=servos.latency * float(_about(rng, 1)[0]))
    masses = np.array([body.mass for body in machine.bodies]) * _about(rng, count)
    effects = _effects(machine, name, kind, rng)
    return Drawn(
        name, seed, kind, machine, masses, machine.tip_mass * float(_about(rng, 1)[0]), servos, tuple(effects),
        float(rng.choice((50.0, 100.0))), float(rng.uniform(10.0, 20.0)), 3, bool(rng.random() < 0.5),
        bool(rng.random() < 0.5) or any(effect[0] == "thermal" for effect in effects),
    )  # fmt: skip


def _about(rng: np.random.Generator, count: int) -> np.ndarray:
    return 1.0 + NOMINAL_ERROR * rng.uniform(-1.0, 1.0, count)


def _effects(machine: Machine, name: str, kind: str, rng: np.random.Generator) -> list[tuple[str, int, float]]:
    if kind == "null":
        return []
    count = len(machine.bodies)
    wanted = int(rng.integers(3, 7)) if count > 1 else int(rng.integers(3, 5))
    found: list[tuple[str, int, float]] = []
    for key, chance in (("latency", 0.6), (PAYLOAD, 0.45), ("sag", 0.35)):
        sizes = PAYLOAD_SIZES if key == PAYLOAD else SHARED[key].sizes
        size = float(rng.uniform(*sizes))
        if rng.random() < chance and not (name == "gripper" and key == PAYLOAD):
            found.append((key, -1, size))
    if kind == "stranger":
        key, joint = str(rng.choice(list(STRANGERS))), _loaded(machine, rng)
        size = float(rng.uniform(*STRANGERS[key].sizes))
        if key == "trip":  # of the stall torque
            size *= 7.4 / 2.7 * 1.2
        return [*found[:1], (key, joint, size)]
    own: set[tuple[str, int]] = set()
    most = 4 if count == 1 else 2  # of one joint's own
    while len(found) < wanted and len(own) < most * count:
        key, joint = str(rng.choice(list(EFFECTS))), int(rng.integers(count))
        at = [other for other, where in own if where == joint]
        if (key, joint) in own or len(at) >= most:
            continue
        size = float(rng.uniform(*EFFECTS[key].sizes))
        if key == "stop":
            size = machine.middle[joint] + size * machine.reach[joint]
        own.add((key, joint))
        found.append((key, joint, size))
    return found


def _loaded(machine: Machine, rng: np.random.Generator) -> int:
    """A joint that gravity acts on."""
    level = [k for k, body in enumerate(machine.bodies) if body.axis != (0.0, 0.0, 1.0)]
    return int(rng.choice(level))


def truth(case: Drawn) -> list[dict[str, Any]]:
    """What each effect is: name, joint (empty: all), causes, numbers, and what a number may be told as."""
    servos, tip = case.with_effects(case.effects)
    found = []
    for name, joint, size in case.effects:
        where = "" if joint < 0 else case.machine.joints[joint]
        if name == PAYLOAD:
            found.append({"name": name, "joint": "", "size": size, "cause": ["load.mass"], "mass": tip})
            continue
        hidden = (SHARED | EFFECTS | STRANGERS)[name]
        told = true_number(servos, name, max(joint, 0))
        found.append(
            {
                "name": name, "joint": where, "size": size, "cause": list(hidden.cause),
                "number": list(hidden.number), "values": list(told),
            }
        )  # fmt: skip
    return found


def effect_of_each(case: Drawn) -> np.ndarray:
    """How much each effect moves each joint (effects, joints), as the rms over all runs that are recorded [rad]."""
    squares = np.zeros((case.runs, len(case.effects), len(case.machine.bodies)))
    for run in range(case.runs):
        time, goal = _goals(case, run)
        whole = _positions(case, case.effects, time, goal)
        for k in range(len(case.effects)):
            moved = whole - _positions(case, case.without(k), time, goal)
            squares[run, k] = np.mean(moved**2, axis=0)
    return np.sqrt(squares.mean(axis=0))


def _positions(
    case: Drawn, effects: tuple[tuple[str, int, float], ...], time: np.ndarray, goal: np.ndarray
) -> np.ndarray:
    servos, tip = case.with_effects(effects)
    at, motors, links, *_ = simulate(links_of(case.machine, case.masses, tip), servos, time, goal, float(time[-1]))
    read = np.where(servos.output_side > 0.0, links, motors)
    return np.stack([np.interp(time, at, column) for column in read.T], axis=1)


def record_drawn(case: Drawn, folder: Path, *, fresh: bool = False) -> tuple[list[Recording], dict[str, Any]]:
    """Record the runs of a machine, and write the model file that is believed of it.

    Args:
        case: the machine.
        folder: where its model file goes.
        fresh: in place of these a run of another motion.
    """
    if fresh:
        case = replace(case, runs=1)
    robot, params = "bench", dict(BENCH)
    if case.name != "bench":
        robot, params = str(folder / "machine.xml"), {}
        (folder / "machine.xml").write_text(mjcf(case.machine), encoding="utf-8")
    chains: Mapping[str, Any] = {joint: nominal_chain() for joint in case.machine.joints}
    first = 100 if fresh else 0
    recordings = [
        Recording(f"run{k}", *_run(case, first + k), {}, robot, params, dict(chains)) for k in range(case.runs)
    ]
    return recordings, {"seed": case.seed, "effects": truth(case)}


def _run(case: Drawn, number: int) -> tuple[np.ndarray, dict[str, dict[str, np.ndarray]]]:
    rng = np.random.default_rng([case.seed, 46, number])
    time, goal = _goals(case, number)
    servos, tip = case.with_effects(case.effects)
    links = links_of(case.machine, case.masses, tip)
    at, motors, angles, duties, currents, heats, volts = simulate(links, servos, time, goal, float(time[-1]) + 2e-3)
    held = np.clip(np.searchsorted(at, time, side="right") - 1, 0, len(at) - 1)
    unit = np.radians(0.1) if case.degrees else TICK
    warm = any(name == "thermal" for name, _, _ in case.effects)
    joints = {}
    for j, name in enumerate(case.machine.joints):
        read = angles if servos.output_side[j] > 0.0 else motors
        clean = np.interp(time, at, read[:, j]) + rng.normal(0.0, READING_NOISE, len(time))
        position = unit * np.round(TICK * np.round(clean / TICK) / unit)
        signals = {"goal": goal[:, j], "position": position}
        if case.more:
            signals["duty"] = np.round(duties[held, j], 3)
            signals["voltage"] = np.round(volts[held], 1)
            amperes = currents[held, j] + rng.normal(0.0, 0.0065, len(time))
            signals["current"] = 0.0065 * np.round(amperes / 0.0065)
        if warm:
            signals["temperature"] = np.round(heats[held, j])
        joints[name] = signals
    return time, joints


# --- motions -------------------------------------------------------------------------------------------------------


def _goals(case: Drawn, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Times (k,) [s] and goals (k, n) [rad] of a run; those from 100 on are of another kind."""
    rng = np.random.default_rng([case.seed, 47, number])
    count = int(case.duration * case.rate)
    period = 1.0 / case.rate
    jitter = np.clip(rng.normal(0.0, JITTER, count), -0.3 * period, 0.3 * period)
    time = period * (1.0 + np.arange(count)) + jitter
    columns = []
    for k in range(len(case.machine.bodies)):
        kinds = (_gait,) if number >= 100 else (_swing, _poses, _ramps)
        parts = np.array_split(time, len(kinds)) if number < 100 else [time]
        order = np.roll(np.arange(len(kinds)), k + number)
        shape = np.concatenate([kinds[which](part - part[0], rng) for which, part in zip(order, parts, strict=True)])
        ease = np.minimum(time / 0.5, 1.0)
        columns.append(case.machine.middle[k] + case.machine.reach[k] * ease * shape)
    goal = np.stack(columns, axis=1)
    unit = np.radians(0.1) if case.degrees else TICK
    return time, unit * np.round(goal / unit)


def _swing(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Two or three sines, up to 2 Hz."""
    frequencies = rng.uniform(0.2, 2.0, 3)
    sizes = 1.0 / (1.0 + frequencies)
    total = (sizes * np.sin(2 * np.pi * np.outer(t, frequencies) + rng.uniform(0, 2 * np.pi, 3))).sum(axis=1)
    return total / sizes.sum()


def _poses(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A new pose every 0.8 s, gone to at once."""
    return rng.uniform(-1.0, 1.0, int(t[-1] / 0.8) + 2)[(t / 0.8).astype(int)]


def _ramps(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """From pose to pose at an even speed, 1.2 s each."""
    marks = np.arange(0.0, t[-1] + 2.4, 1.2)
    return np.interp(t, marks, rng.uniform(-1.0, 1.0, len(marks)))


def _gait(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A stride of 1 Hz and its harmonic, with a pose that drifts below it."""
    rate, phase = rng.uniform(0.7, 1.4), rng.uniform(0, 2 * np.pi, 3)
    stride = np.sin(2 * np.pi * rate * t + phase[0]) + 0.4 * np.sin(4 * np.pi * rate * t + phase[1])
    return 0.6 * stride / 1.4 + 0.4 * np.sin(2 * np.pi * 0.13 * t + phase[2])
