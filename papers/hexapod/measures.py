"""What is measured on a walk: currents and voltages, rest, and errors of tracking (paper 001, 5.2 and 7.2)."""

from __future__ import annotations

import numpy as np

from ...envs.hexapod.parameters import LEGS
from ...envs.hexapod.robot import KINDS, VERTICAL
from .paper import PERIOD, Walk

SETTLED = 0.2  # share of the support at its begin that no figure looks at: the reference has just stopped
AT_REST = 0.05  # [A] below which a motor's current counts as none
STRIBECK = 1e-4  # [m/s] of a screw, [rad/s] of a rotation; 5.2


def motors(walk: Walk, leg: int = 0) -> dict[str, dict[str, float]]:
    """Currents [A] and voltages [V] of a leg in transfer and support of the last cycle: root mean square, and median of
    the size, which does not see the moments of lifting off and of a load beyond the breakaway force.
    """
    cycle = walk.cycle(-1)
    phase, air = walk.gait.phase(leg, walk.time[cycle]), walk.gait.transfer
    parts = {"transfer": phase < air, "support": phase > air + SETTLED * (1.0 - air)}
    rows: dict[str, dict[str, float]] = {}
    for kind in KINDS:
        for quantity, values in (("current", walk.current), ("voltage", walk.voltage)):
            column = walk.quantity(values, kind, leg)[cycle]
            rows[f"{kind} {quantity}"] = {
                f"{part} {label}": float(of(column[chosen]))
                for part, chosen in parts.items()
                for label, of in (("rms", rms), ("median", lambda x: np.median(np.abs(x))))
            }
    return rows


def breaking_loose(walk: Walk) -> tuple[float, float, float]:
    """When the vertical motor of leg 0 draws more than :data:`AT_REST` in the support of the last cycle.

    Returns:
        The share of the support in which it does, its largest current [A], and the mean load on the foot then, over
        that in the rest of the support.
    """
    cycle = walk.cycle(-1)
    phase, air = walk.gait.phase(0, walk.time[cycle]), walk.gait.transfer
    support = phase > air + SETTLED * (1.0 - air)
    current = np.abs(walk.quantity(walk.current, VERTICAL)[cycle][support])
    load, drawn = walk.contact[cycle][support, 0], current > AT_REST
    if drawn.all() or not drawn.any():
        return float(drawn.mean()), float(current.max()), float("nan")
    return float(drawn.mean()), float(current.max()), float(load[drawn].mean() / load[~drawn].mean())


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def slow(walk: Walk, kind: str) -> float:
    """Share of the last cycle in which joints of this kind are slower than the Stribeck velocity, all legs."""
    cycle = walk.cycle(-1)
    speed = np.abs(np.gradient(walk.position[:, KINDS.index(kind) :: len(KINDS)], PERIOD, axis=0)[cycle])
    return float((speed < STRIBECK).mean())


def at_rest(walk: Walk) -> float:
    """Share of all legs' support in the last cycle in which vertical joints are slower than the Stribeck velocity."""
    cycle, column = walk.cycle(-1), slice(KINDS.index(VERTICAL), None, len(KINDS))
    speed = np.abs(np.gradient(walk.position[:, column], PERIOD, axis=0)[cycle])
    support = np.stack([~walk.gait.in_transfer(leg, walk.time[cycle]) for leg in range(LEGS)], axis=1)
    return float((speed[support] < STRIBECK).mean())


def tracking(walk: Walk) -> dict[str, float]:
    """Error of the joints of each kind in the last cycle, root mean square of all legs [rad, m]."""
    error = (walk.goal - walk.position)[walk.cycle(-1)]
    return {kind: rms(error[:, k :: len(KINDS)]) for k, kind in enumerate(KINDS)}


def reversals(walk: Walk) -> int:
    """How often currents over :data:`AT_REST` of vertical motors change their sign in the support of the last cycle."""
    cycle, count = walk.cycle(-1), 0
    for leg in range(LEGS):
        phase, air = walk.gait.phase(leg, walk.time[cycle]), walk.gait.transfer
        drawn = walk.quantity(walk.current, VERTICAL, leg)[cycle][phase > air + SETTLED * (1.0 - air)]
        count += int(np.count_nonzero(np.diff(np.sign(drawn[np.abs(drawn) > AT_REST]))))
    return count
