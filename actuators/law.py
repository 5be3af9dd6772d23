"""The law of a chain: its stages' laws in order, as one compiled scalar function.

It is the same function for the engine (:mod:`actuators.engine`), for replays without an engine (``gap/``) and for
tests. A chain is data to it (see :mod:`sealegs.actuators.layout`), so no chain has to be compiled for itself.
"""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np

from .compiled import compiled
from .layout import (
    P_HEADER,
    P_LATENCY,
    P_SCALE,
    P_STATE_SIZE,
    S_GOAL,
    S_LOAD,
    S_READING,
    S_READY,
    S_SPEED,
    S_STAGE,
    S_TIME,
    S_TORQUE,
)
from .outside import FIRST as FIRST_OUTSIDE
from .outside import HALVES, address, caller
from .stages import OPCODES
from .stages.sensor import encoder_reading, late_position, record_latency, start_latency

FIRST, LATER, RESTART, REPEAT = 0, 1, 2, 3


def _by_opcode(half: str, otherwise: str) -> Any:
    """A compiled function ``(op, *arguments)`` that calls this half of the law of that opcode.

    It is written as one comparison after the other, which the compiler makes a jump table and inlines.

    Args:
        half: field of :class:`sealegs.actuators.stages.Law`.
        otherwise: what a law without that half returns.
    """
    lines, names = [f"def {half}(op, {HALVES[half]}):"], {"address": address, "outside": caller(half)}
    for law, opcode in OPCODES.items():
        if (function := getattr(law, half)) is not None:
            names[f"law_{opcode}"] = function
            taken = ", ".join(inspect.signature(function.py_func).parameters)
            lines += [f"    if op == {opcode}:", f"        return law_{opcode}({taken})"]
    lines += [
        f"    if op >= {FIRST_OUTSIDE}:",
        f"        at = address(op, {list(HALVES).index(half)})",
        "        if at != 0:",
        f"            {'return ' if otherwise != 'None' else ''}outside(at, {HALVES[half]})",
        f"    return {otherwise}",
    ]
    names["__name__"] = __name__
    exec(compile("\n".join(lines), __file__, "exec"), names)
    # inlined, as what calls it in a replay is: calls, and results through memory, were a third of its time
    return compiled(forceinline=half == "act")(names[half])


start_stage = _by_opcode("start", "goal")
advance_stage = _by_opcode("advance", "None")
act_of_stage = _by_opcode("act", "value")
idle_of_stage = _by_opcode("idle", "0.0")


def _having(half: str) -> np.ndarray:
    """Which opcodes have a half of a law (opcodes,)."""
    return np.array([False, *(getattr(law, half) is not None for law in sorted(OPCODES, key=OPCODES.__getitem__))])


HAS_ACT, HAS_ADVANCE = _having("act"), _having("advance")


@compiled()
def runge_kutta_stage(s, time, stages):
    """Which evaluation of a physics step this is; the engine does not say.

    Returns:
        FIRST of a new step, REPEAT of that first one at the same time (as ``mj_forward`` before ``mj_step``), LATER in
        a step of several ``stages``, or RESTART after a reset.
    """
    if s[S_READY] == 0.0 or time < s[S_TIME] - 1e-12:
        s[S_STAGE] = 0.0
        return RESTART
    if abs(time - s[S_TIME]) < 1e-12:
        s[S_STAGE] = 0.0
        return REPEAT
    if s[S_STAGE] >= stages - 1:
        s[S_STAGE] = 0.0
        return FIRST
    s[S_STAGE] += 1.0
    return LATER


@compiled()
def begin(p, s, time, goal, q, w):
    """Start the memory of a chain at rest: goal and position have always been what they are now."""
    for k in range(S_STAGE, int(p[P_STATE_SIZE])):
        s[k] = 0.0
    s[S_READY] = 1.0
    s[S_TIME] = time
    s[S_SPEED] = w
    s[S_READING] = encoder_reading(p, q)
    s[S_GOAL] = goal
    if p[P_LATENCY] > 0.0:
        start_latency(p, s, q)
    at = P_HEADER
    while p[at] > 0.0:
        goal = start_stage(int(p[at]), p, at + 3, s, int(p[at + 2]), goal)
        at += int(p[at + 1])


@compiled(allocates=True)
def stages_of(p, half):
    """The stages of a chain that have a half of their own: how many, then opcode, record and memory of each.

    A loop that evaluates a law thousands of times reads them once, instead of walking from record to record.

    Args:
        p: program of the chain.
        half: ``HAS_ACT`` or ``HAS_ADVANCE``, which opcodes have it.
    """
    table = np.zeros(1 + 3 * len(p), np.int64)
    at = P_HEADER
    while p[at] > 0.0:
        op = int(p[at])
        if op >= FIRST_OUTSIDE or half[op]:
            k = 1 + 3 * table[0]
            table[k], table[k + 1], table[k + 2] = op, at + 3, int(p[at + 2])
            table[0] += 1
        at += int(p[at + 1])
    return table


@compiled()
def advance(p, s, time):
    """Carry the memory of a chain over the physics step that ends at ``time``.

    What must see the new motion follows in ``torque``.
    """
    at = P_HEADER
    while p[at] > 0.0:
        advance_stage(int(p[at]), p, at + 3, s, int(p[at + 2]), time)
        at += int(p[at + 1])
    s[S_TIME] = time


@compiled()
def advance_stages(stages, p, s, time):
    """:func:`advance` with the stages of :func:`stages_of`."""
    for k in range(stages[0]):
        advance_stage(stages[1 + 3 * k], p, stages[2 + 3 * k], s, stages[3 + 3 * k], time)
    s[S_TIME] = time


@compiled()
def torque(p, s, time, goal, q, w, external, first):
    """Torque of a chain on its coordinate, viscous and rigid dry friction excluded [N.m].

    Args:
        p: program of the chain.
        s: its state; its slots are filled with what the stages computed.
        time: of this evaluation [s].
        goal: command as sent [rad].
        q, w: position and speed of the motor side [rad, rad/s].
        external: torque of everything else on the coordinate, without what accelerations need [N.m].
        first: whether this evaluation opens a physics step, where commands are recorded and samples taken.
    """
    sense(p, s, q, w, external)
    value = goal
    at = P_HEADER
    while p[at] > 0.0:
        value = act_of_stage(
            int(p[at]), p, at + 3, s, int(p[at + 2]), time, value, q=q, w=w, external=external, first=first
        )
        at += int(p[at + 1])
    return concluded(p, s, time, q, value, first)


@compiled(forceinline=True)
def torque_of_stages(stages, p, s, time, goal, q, w, external, first):
    """:func:`torque` with the stages of :func:`stages_of`."""
    sense(p, s, q, w, external)
    value = goal
    for k in range(stages[0]):
        op, i, m = stages[1 + 3 * k], stages[2 + 3 * k], stages[3 + 3 * k]
        value = act_of_stage(op, p, i, s, m, time, value, q=q, w=w, external=external, first=first)
    return concluded(p, s, time, q, value, first)


@compiled()
def sense(p, s, q, w, external):
    """Fill what the stages of a chain read of the motion."""
    s[S_READING] = encoder_reading(p, q)
    s[S_SPEED] = p[P_SCALE] * w
    s[S_LOAD] = external


@compiled()
def concluded(p, s, time, q, value, first):
    """Keep the torque of a chain, and what its encoder will say later of this moment."""
    s[S_TORQUE] = value
    if first and p[P_LATENCY] > 0.0:
        record_latency(p, s, time, q)
    return value


@compiled()
def idle_torque(p, s, q, w, external):
    """Torque of a chain whose drive is off, viscous and rigid dry friction excluded [N.m]: an open bridge, so that no
    current flows and nothing brakes. The limit of dry friction is left in the state.
    """
    value = 0.0
    at = P_HEADER
    while p[at] > 0.0:
        value += idle_of_stage(int(p[at]), p, at + 3, s, q, w, external)
        at += int(p[at + 1])
    return value


@compiled()
def host_reading(p, s, time, q):
    """Position as the host receives it at ``time`` [rad], with the encoder's latency, ticks, offset and scale."""
    if p[P_LATENCY] > 0.0:
        q = late_position(p, s, time, q)
    return encoder_reading(p, q)


__all__ = [
    "FIRST",
    "HAS_ACT",
    "HAS_ADVANCE",
    "LATER",
    "REPEAT",
    "RESTART",
    "advance",
    "advance_stages",
    "begin",
    "host_reading",
    "idle_torque",
    "runge_kutta_stage",
    "stages_of",
    "torque",
    "torque_of_stages",
]
