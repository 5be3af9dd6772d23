"""What is measured on a walk: currents and voltages, rest, and errors of tracking (paper 001, 5.2 and 7.2)."""

from __future__ import annotations

import numpy as np

from ...envs.hexapod.parameters import LEGS
from ...envs.hexapod.robot import KINDS, VERTICAL
from .paper import PERIOD, Walk

SETTLED = 2.0  # [s] at the begin of a support that no figure looks at: six time constants of the integral that runs out
AT_REST = 0.05  # [A] below which a motor's current counts as none
STRIBECK = 1e-4  # [m/s] of a screw, [rad/s] of a rotation; 5.2
APART = 10.0  # times the Stribeck velocity that are well above it
CARRIES = 0.5  # share of its mean load in support from which on a foot that has landed carries


def settled(walk: Walk, leg: int = 0, number: int = -1, after: float = SETTLED) -> np.ndarray:
    """Samples of a cycle in which a leg has stood for so long [s]."""
    phase = walk.gait.phase(leg, walk.time[walk.cycle(number)])
    return (phase - walk.gait.transfer) * walk.gait.cycle > after


def motors(walk: Walk, leg: int = 0) -> dict[str, dict[str, float]]:
    """Currents [A] and voltages [V] of a leg in transfer and settled support of the last cycle, root mean square."""
    cycle = walk.cycle(-1)
    parts = {"transfer": walk.gait.in_transfer(leg, walk.time[cycle]), "support": settled(walk, leg)}
    return {
        f"{kind} {quantity}": {
            part: rms(walk.quantity(values, kind, leg)[cycle][chosen]) for part, chosen in parts.items()
        }
        for kind in KINDS
        for quantity, values in (("current", walk.current), ("voltage", walk.voltage))
    }


def drawing(walk: Walk, leg: int = 0, number: int = -1, after: float = SETTLED) -> float:
    """Share of a settled support in which the vertical motor draws more than :data:`AT_REST`."""
    current = walk.quantity(walk.current, VERTICAL, leg)[walk.cycle(number)]
    return float((np.abs(current[settled(walk, leg, number, after)]) > AT_REST).mean())


def heaviest(walk: Walk) -> float:
    """Largest load on a foot in the settled supports of the last cycle [N]."""
    return max(float(walk.contact[walk.cycle(-1)][settled(walk, leg), leg].max()) for leg in range(LEGS))


def breaking_loose(walk: Walk, number: int = -1) -> tuple[float, float, float]:
    """When the vertical motor of leg 0 draws more than :data:`AT_REST` in the settled support of a cycle.

    Returns:
        The share of the support in which it does, its largest current [A], and the load on the foot as it begins to,
        over the mean of the support; not a number if it never does.
    """
    cycle, support = walk.cycle(number), settled(walk, 0, number)
    current = np.abs(walk.quantity(walk.current, VERTICAL)[cycle][support])
    load, drawn = walk.contact[cycle][support, 0], current > AT_REST
    begins = float(load[np.argmax(drawn)] / load.mean()) if drawn.any() else float("nan")
    return float(drawn.mean()), float(current.max()), begins


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def speeds(walk: Walk, kind: str) -> np.ndarray:
    """How fast joints of this kind move in the last cycle, all legs (n, 6) [rad/s, m/s]."""
    return np.abs(np.gradient(walk.position[:, KINDS.index(kind) :: len(KINDS)], PERIOD, axis=0)[walk.cycle(-1)])


def in_air(walk: Walk) -> np.ndarray:
    """Which legs are in transfer, in the last cycle (n, 6)."""
    return np.stack([walk.gait.in_transfer(leg, walk.time[walk.cycle(-1)]) for leg in range(LEGS)], axis=1)


def slow(walk: Walk, kind: str) -> float:
    """Share of the last cycle in which joints of this kind are slower than the Stribeck velocity, all legs."""
    return float((speeds(walk, kind) < STRIBECK).mean())


def at_rest(walk: Walk, air: bool = False) -> float:
    """Share of all legs' support, or transfer, of the last cycle in which vertical joints are slower than that."""
    return float((speeds(walk, VERTICAL)[in_air(walk) == air] < STRIBECK).mean())


def near_stribeck(walk: Walk) -> float:
    """Share of the last cycle in which vertical joints are near the Stribeck velocity, by :data:`APART` either way."""
    times = speeds(walk, VERTICAL) / STRIBECK
    return float(((times > 1.0 / APART) & (times < APART)).mean())


def slip(walk: Walk) -> float:
    """Speed at which feet slip over the ground in settled support, root mean square of all legs [m/s]."""
    speed = np.linalg.norm(np.gradient(walk.feet, PERIOD, axis=0), axis=2)[walk.cycle(-1)]
    return rms(np.concatenate([speed[settled(walk, leg), leg] for leg in range(LEGS)]))


def landing(walk: Walk) -> float:
    """Time from a foot's first touch to where it carries, mean of all legs in the last cycle in which they land [s]."""
    found, half = [], round(0.5 * walk.gait.transfer * walk.gait.cycle / PERIOD)
    for leg in range(LEGS):
        load, air = walk.contact[:, leg], walk.gait.in_transfer(leg, walk.time)
        ends = np.flatnonzero(air[:-1] & ~air[1:]) + 1
        ends = ends[(ends >= half) & (ends < load.size - half)]  # a whole landing
        lands = load[ends[-1] - half : ends[-1] + half]
        carries = CARRIES * float(load[walk.cycle(-1)][settled(walk, leg)].mean())
        found.append(PERIOD * float(np.argmax(lands > carries) - np.argmax(lands > 0.0)))
    return float(np.mean(found))


def steepest(walk: Walk, within: float = 0.1) -> float:
    """Largest change of the load on a foot within a time [s], in the last cycle, over the mean load of a support."""
    steps, load = round(within / PERIOD), walk.contact[walk.cycle(-1)]
    mean = float(np.mean([load[settled(walk, leg), leg].mean() for leg in range(LEGS)]))
    return float(np.abs(load[steps:] - load[:-steps]).max()) / mean


def tracking(walk: Walk) -> dict[str, float]:
    """Error of the joints of each kind in the last cycle, root mean square of all legs [rad, m]."""
    error = (walk.goal - walk.position)[walk.cycle(-1)]
    return {kind: rms(error[:, k :: len(KINDS)]) for k, kind in enumerate(KINDS)}


def reversals(walk: Walk) -> int:
    """How often currents over :data:`AT_REST` of vertical motors change their sign in the support of the last cycle."""
    count = 0
    for leg in range(LEGS):
        drawn = walk.quantity(walk.current, VERTICAL, leg)[walk.cycle(-1)][settled(walk, leg)]
        count += int(np.count_nonzero(np.diff(np.sign(drawn[np.abs(drawn) > AT_REST]))))
    return count
