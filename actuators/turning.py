"""Tries whether a chain does what its parameters state of a turn: the same drive, its angle counted otherwise."""

from __future__ import annotations

import numpy as np

from .chain import Chain
from .law import advance, begin, idle_torque, torque
from .layout import P_STATE_SIZE, S_LIMIT

STEP = 2.0**-8  # [s] of the motion, exact in binary
STEPS = 200


def apart(chain: Chain, zero: float = 0.0, sign: float = -1.0) -> float:
    """How far the torques of a chain and of the same chain turned are apart, by the largest of them.

    Both follow one motion, which each sees in its own frame: goals that jump, ramp and rest, a joint that swings and
    stops, loads on both sides, the drive on and off. It is rounding, about 1e-12, where the parity of each parameter is
    stated right (:mod:`sealegs.actuators.stages.parity`). What the engine does itself (springs, play) is not tried.

    Args:
        chain: of any stages.
        zero: the angle that the turned chain counts as 0 [rad]; with an encoder's ticks a whole number of them.
        sign: of its direction.
    """
    own = _torques(chain, 0.0, 1.0)
    turned = _torques(chain.turned(zero, sign), zero, sign) * [sign, 1.0, sign, 1.0]
    return float(np.max(np.abs(turned - own)) / max(np.max(np.abs(own)), 1e-9))


def _torques(chain: Chain, zero: float, sign: float) -> np.ndarray:
    """Torque and limit of dry friction along the motion in a frame, with the drive on and off (2 STEPS, 4) [N.m]."""
    program = chain.program()
    state = np.zeros(int(program[P_STATE_SIZE]))
    rows, told_angles = [], chain.command == "goal"
    for k in range(2 * STEPS):
        time = 0.5 * k * STEP  # each step is evaluated at its start and in its middle
        goal = 0.3 * (time > 0.1) - 0.7 * (time > 0.3) + 0.4 * np.sin(9.0 * time) * (time > 0.5)
        moving = 1.0 if time < 0.6 else 0.0
        q, w = 0.35 * np.sin(7.0 * time * moving) + 0.02, 2.45 * np.cos(7.0 * time) * moving
        external = sign * 0.4 * np.sin(4.0 * time + 1.0)
        goal, q, w = sign * (goal - zero * told_angles), sign * (q - zero), sign * w
        if k == 0:
            begin(program, state, time, goal, q, w)
        elif k % 2 == 0:
            advance(program, state, time)
        driven = torque(program, state, time, goal, q, w, external, first=k % 2 == 0), state[S_LIMIT]
        rows.append((*driven, idle_torque(program, state, q, w, external), state[S_LIMIT]))
        state[S_LIMIT] = driven[1]
    return np.array(rows)
