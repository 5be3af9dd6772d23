"""Runs the laws inside MuJoCo, through its callback for the bias of user-defined actuators.

Actuators of ours have ``biastype="user"`` and a program that starts with a magic number. The engine calls the law for them wherever it
computes actuator forces: in every Runge-Kutta stage, on every thread of a ``mujoco.batch.Batch``, with no Python between. Models
without such actuators never reach this code; user-defined actuators of others are passed on to the callback that was installed before.
"""

from __future__ import annotations

import ctypes
import functools
from typing import Any

import mujoco
import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from actuators.law import FIRST, RESTART, advance, begin, torque
from actuators.law import runge_kutta_stage as stage_of
from actuators.layout import (
    MAGIC,
    P_COEFFICIENT,
    P_DOF,
    P_FRICTION_ID,
    P_FRICTION_KIND,
    P_LENGTH,
    P_QPOS,
    P_STATE_ADDRESS,
    P_STATE_SIZE,
    P_TERMS,
    S_LIMIT,
)
from actuators.structs import check_layout, offset

SIGNATURE = types.float64(types.intp, types.intp, types.intc)
CALLBACK = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)


def _loader(llvm_type: Any, numba_type: Any) -> Any:
    @intrinsic
    def load(typingctx, address):  # type: ignore[no-untyped-def]
        def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
            return builder.load(builder.inttoptr(args[0], llvm_type.as_pointer()))

        return numba_type(types.intp), codegen

    return load


load_int = _loader(ir.IntType(32), types.int32)
load_double = _loader(ir.DoubleType(), types.float64)
load_address = _loader(ir.IntType(64), types.intp)


@intrinsic
def doubles(typingctx, address):  # type: ignore[no-untyped-def]
    """The address as a ``double*``."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.inttoptr(args[0], ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(types.intp), codegen


@functools.cache
def compiled_law() -> Any:
    """The law as a C function with the signature of ``mjfAct``."""
    check_layout()
    model_user, model_user_size = offset("mjModel", "actuator_user"), offset("mjModel", "nuser_actuator")
    integrator = offset("mjModel", "opt") + offset("mjOption", "integrator")
    runge_kutta = int(mujoco.mjtIntegrator.mjINT_RK4)
    at_time, at_qpos, at_qvel = offset("mjData", "time"), offset("mjData", "qpos"), offset("mjData", "qvel")
    at_ctrl, at_user = offset("mjData", "ctrl"), offset("mjData", "userdata")
    at_spring, at_applied, at_bias = (offset("mjData", f"qfrc_{name}") for name in ("spring", "applied", "bias"))
    at_equalities, at_frictions = offset("mjData", "ne"), offset("mjData", "nf")
    at_row_type, at_row_id, at_row_limit = (offset("mjData", f"efc_{name}") for name in ("type", "id", "frictionloss"))
    at_islands, at_island_row = offset("mjData", "nisland"), offset("mjData", "map_efc2iefc")
    at_island_limit = offset("mjData", "iefc_frictionloss")
    joint_row, tendon_row = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF), int(mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON)

    @numba.cfunc(SIGNATURE, cache=True)
    def bias(model, data, actuator):  # type: ignore[no-untyped-def]
        width = load_int(model + model_user_size)
        if width == 0:
            return 0.0
        address = load_address(model + model_user) + 8 * width * actuator
        if load_double(address) != MAGIC:
            return 0.0
        p = numba.carray(doubles(address), int(load_double(address + 8 * P_LENGTH)))
        s = numba.carray(
            doubles(load_address(data + at_user) + 8 * int(p[P_STATE_ADDRESS])),
            int(p[P_STATE_SIZE]),
        )
        qpos, qvel = doubles(load_address(data + at_qpos)), doubles(load_address(data + at_qvel))
        spring, applied = doubles(load_address(data + at_spring)), doubles(load_address(data + at_applied))
        gravity = doubles(load_address(data + at_bias))
        q, w, external = 0.0, 0.0, 0.0
        for k in range(int(p[P_TERMS])):
            c, dof = p[P_COEFFICIENT + k], int(p[P_DOF + k])
            q += c * qpos[int(p[P_QPOS + k])]
            w += c * qvel[dof]
            # of a belt over a joint, only the last joint moves when the motor turns
            external = (spring[dof] + applied[dof] - gravity[dof]) / c
        time = load_double(data + at_time)
        goal = doubles(load_address(data + at_ctrl))[actuator]
        stages = 4 if load_int(model + integrator) == runge_kutta else 1
        stage = stage_of(s, time, stages)
        if stage == RESTART:
            begin(p, s, time, goal, q, w)
        elif stage == FIRST:
            advance(p, s, time)
        force = torque(p, s, time, goal, q, w, external, stage == FIRST or stage == RESTART)
        if p[P_FRICTION_KIND] > 0.0:
            row_type, row_id = load_address(data + at_row_type), load_address(data + at_row_id)
            wanted_type = joint_row if p[P_FRICTION_KIND] == 1.0 else tendon_row
            wanted_id = int(p[P_FRICTION_ID])
            start = load_int(data + at_equalities)
            for row in range(start, start + load_int(data + at_frictions)):
                if load_int(row_id + 4 * row) == wanted_id and load_int(row_type + 4 * row) == wanted_type:
                    doubles(load_address(data + at_row_limit))[row] = s[S_LIMIT]
                    if load_int(data + at_islands) > 0:  # the solver then reads a copy sorted by island, made before this call
                        island_row = load_int(load_address(data + at_island_row) + 4 * row)
                        doubles(load_address(data + at_island_limit))[island_row] = s[S_LIMIT]
                    break
        return force

    return bias


class _Installed:
    """What keeps the callback alive: the C function, and whatever was installed before it."""

    ours: Any = None
    address: int = 0
    foreign: Any = None


def install() -> None:
    """Install the law as MuJoCo's actuator bias callback, once a process; another owner's callback still gets its own actuators."""
    current = mujoco.get_mjcb_act_bias()
    if _Installed.ours is not None and current is _Installed.ours:
        return
    law = compiled_law()
    if current is None:
        _Installed.foreign = None
        _Installed.ours = CALLBACK(law.address)
    else:
        _Installed.foreign = current
        _Installed.ours = _forwarding(law, current)
    mujoco.set_mjcb_act_bias(_Installed.ours)


def _forwarding(law: Any, foreign: Any) -> Any:
    """A callback that asks the program's magic number whom an actuator belongs to."""
    user, size = offset("mjModel", "actuator_user"), offset("mjModel", "nuser_actuator")
    call_law = CALLBACK(law.address)
    # a ctypes callback is given addresses; a Python callback wants MuJoCo's objects, which only MuJoCo can make
    if not isinstance(foreign, ctypes._CFuncPtr):  # type: ignore[attr-defined]
        from actuators.errors import SealegsError

        raise SealegsError(
            "another library has installed a Python function as mjcb_act_bias; install it as a C function, or after "
            "mujoco.set_mjcb_act_bias(None), so that both can run."
        )
    call_foreign = CALLBACK(ctypes.cast(foreign, ctypes.c_void_p).value or 0)

    def route(model: int, data: int, actuator: int) -> float:
        width = ctypes.c_int.from_address(model + size).value
        base = ctypes.c_size_t.from_address(model + user).value
        ours = width > 0 and ctypes.c_double.from_address(base + 8 * width * actuator).value == MAGIC
        return (call_law if ours else call_foreign)(model, data, actuator)

    return CALLBACK(route)


def program_of(model: mujoco.MjModel, actuator: int) -> np.ndarray:
    """The program of one of our actuators, a view into ``model.actuator_user``."""
    row = model.actuator_user[actuator]
    return row[: int(row[P_LENGTH])]
