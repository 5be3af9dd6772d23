"""Runs the laws inside MuJoCo, through its callback for the bias of user-defined actuators.

Actuators of ours have ``biastype="user"`` and a program that starts with a magic number. The engine calls the law for
them wherever it computes actuator forces: in every Runge-Kutta stage, on every thread of a ``mujoco.batch.Batch``, with
no Python between. Models without such actuators never reach this code; user-defined actuators of others are passed on
to the callback that was installed before, compiled or Python.
"""

from __future__ import annotations

import ctypes
import functools
import threading
from pathlib import Path
from typing import Any

import mujoco
import numba
from llvmlite import ir
from mujoco.introspect import ast_nodes, structs
from numba import types  # pyright: ignore[reportPrivateImportUsage]
from numba.extending import intrinsic

from ..common.errors import SealegsError
from .compiled import compiled
from .law import FIRST, LATER, RESTART, advance, begin, torque
from .law import runge_kutta_stage as stage_of
from .layout import (
    MAGIC,
    P_COEFFICIENT,
    P_DOF,
    P_FRICTION_ID,
    P_FRICTION_KIND,
    P_LOAD_FACTOR,
    P_LOAD_STATE,
    P_OWN_FRICTION,
    P_QPOS,
    P_SCALE,
    P_STATE_ADDRESS,
    P_SUPPLY,
    P_SUPPLY_NEXT,
    P_TERMS,
    P_VISCOUS,
    S_BESIDE,
    S_CURRENT,
    S_DRAWN,
    S_DUTY,
    S_KNOWN,
    S_LIMIT,
    S_PRESSED,
    S_REST,
    S_ROW_ACCELERATION,
    S_ROW_INERTIA,
    S_SPEED,
    S_STEP,
    S_TORQUE,
)

_SCALARS = {
    "int": ctypes.c_int,
    "float": ctypes.c_float,
    "double": ctypes.c_double,
    "mjtNum": ctypes.c_double,
    "mjtByte": ctypes.c_uint8,
    "mjtBool": ctypes.c_bool,
    "mjtSize": ctypes.c_int64,
    "size_t": ctypes.c_size_t,
    "uintptr_t": ctypes.c_size_t,
    "uint64_t": ctypes.c_uint64,
    "int64_t": ctypes.c_int64,
    "char": ctypes.c_char,
    "unsigned char": ctypes.c_uint8,
    "unsigned int": ctypes.c_uint,
}


def _c_type(node: Any) -> Any:
    if isinstance(node, ast_nodes.PointerType):
        return ctypes.c_void_p
    if isinstance(node, ast_nodes.ArrayType):
        inner = _c_type(node.inner_type)
        for extent in reversed(node.extents):
            inner = inner * extent
        return inner
    if isinstance(node, ast_nodes.AnonymousStructDecl | ast_nodes.AnonymousUnionDecl):
        base = ctypes.Union if isinstance(node, ast_nodes.AnonymousUnionDecl) else ctypes.Structure
        members: Any = node.fields
        return type("anonymous", (base,), {"_fields_": [(member.name, _c_type(member.type)) for member in members]})
    name = getattr(node, "name", "").removeprefix("struct ")
    if name in _SCALARS:
        return _SCALARS[name]
    if name.endswith("_") and name[:-1] in structs.STRUCTS:
        name = name[:-1]
    if name in structs.STRUCTS:
        return struct_type(name)
    if name.startswith("mjt"):  # the enumerations
        return ctypes.c_int
    raise SealegsError(
        f"MuJoCo {mujoco.__version__} has a field type '{name}' that this version of sealegs does not know."
    )


@functools.cache
def struct_type(name: str) -> type[ctypes.Structure]:
    """A ctypes structure laid out as MuJoCo's C struct of that name, so that the laws read it as C code does.

    MuJoCo ships a machine-readable copy of its headers (``mujoco.introspect``); the C layout follows from it by the
    usual rules of alignment. It is checked against pointers whose values Python can see, so that another MuJoCo version
    is refused instead of misread.
    """
    described: Any = structs.STRUCTS[name]
    fields = [(field.name, _c_type(field.type)) for field in described.fields]
    return type(name, (ctypes.Structure,), {"_fields_": fields})


def offset(struct: str, field: str) -> int:
    """Bytes from the start of a struct to a field."""
    return getattr(struct_type(struct), field).offset


@functools.cache
def check_layout() -> None:
    """Compare the computed layout with memory.

    Raises:
        SealegsError: this MuJoCo lays its structs out in another way.
    """
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><size nuserdata='3'/><worldbody><body><joint name='j'/><geom size='1'/></body></worldbody>"
        "<actuator><motor joint='j' user='1 2'/></actuator></mujoco>"
    )
    data = mujoco.MjData(model)
    data.time = 1.25
    mujoco.mj_forward(model, data)
    c_model = struct_type("mjModel").from_address(model._address)
    c_data = struct_type("mjData").from_address(data._address)
    pointers = [(c_model, model, ("qpos0", "dof_armature", "actuator_user", "actuator_trnid"))]
    pointers += [(c_data, data, ("qpos", "qvel", "ctrl", "userdata", "qfrc_bias", "qfrc_spring", "qfrc_applied"))]
    same = all(getattr(c, key) == getattr(python, key).ctypes.data for c, python, keys in pointers for key in keys)
    same = same and (c_data.time, c_data.nefc, c_model.nuser_actuator) == (1.25, data.nefc, model.nuser_actuator)
    same = same and c_model.opt.timestep == model.opt.timestep and c_model.opt.integrator == model.opt.integrator
    if not same:
        raise SealegsError(
            f"MuJoCo {mujoco.__version__} lays out its structs in a way that sealegs cannot read; "
            "install the version in constraints.txt."
        )


SIGNATURE = types.float64(types.intp, types.intp, types.intc)


def _loader(llvm_type: Any, numba_type: Any) -> Any:
    @intrinsic
    def load(typingctx, address):  # type: ignore[no-untyped-def]
        def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
            return builder.load(builder.inttoptr(args[0], llvm_type.as_pointer()))

        return numba_type(types.intp), codegen

    return load


def _bias_caller() -> Any:
    @intrinsic
    def call(typingctx, function, model, data, actuator):  # type: ignore[no-untyped-def]
        def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
            word = ir.IntType(64)
            kind = ir.FunctionType(ir.DoubleType(), [word, word, ir.IntType(32)])
            return builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])

        return types.float64(types.intp, types.intp, types.intp, types.int32), codegen

    return call


def _pointer_maker() -> Any:
    @intrinsic
    def pointer(typingctx, address):  # type: ignore[no-untyped-def]
        def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
            return builder.inttoptr(args[0], ir.DoubleType().as_pointer())

        return types.CPointer(types.float64)(types.intp), codegen

    return pointer


# what numba lacks: reading at an address, an address as a double*, and a call of the C function (mjfAct) at an address
load_int = _loader(ir.IntType(32), types.int32)
load_double = _loader(ir.DoubleType(), types.float64)
load_address = _loader(ir.IntType(64), types.intp)
doubles = _pointer_maker()
call_bias = _bias_caller()


@functools.cache
def compiled_law() -> Any:
    """The law as a C function with the signature of ``mjfAct``."""
    check_layout()
    model_user, model_user_size = offset("mjModel", "actuator_user"), offset("mjModel", "nuser_actuator")
    integrator = offset("mjModel", "opt") + offset("mjOption", "integrator")
    timestep = offset("mjModel", "opt") + offset("mjOption", "timestep")
    runge_kutta = int(mujoco.mjtIntegrator.mjINT_RK4)
    at_time, at_qpos, at_qvel = offset("mjData", "time"), offset("mjData", "qpos"), offset("mjData", "qvel")
    at_ctrl, at_user, at_qacc = offset("mjData", "ctrl"), offset("mjData", "userdata"), offset("mjData", "qacc")
    at_warmstart, at_mass, at_dofs = offset("mjData", "qacc_warmstart"), offset("mjData", "M"), offset("mjModel", "nv")
    at_row_entries, at_row_start, at_column = (
        offset("mjModel", f"M_{name}") for name in ("rownnz", "rowadr", "colind")
    )
    at_spring, at_damper = offset("mjData", "qfrc_spring"), offset("mjData", "qfrc_damper")
    at_applied, at_bias = offset("mjData", "qfrc_applied"), offset("mjData", "qfrc_bias")
    at_equalities, at_frictions = offset("mjData", "ne"), offset("mjData", "nf")
    at_row_type, at_row_id, at_row_limit = (offset("mjData", f"efc_{name}") for name in ("type", "id", "frictionloss"))
    at_row_gains, at_row_stiffness = offset("mjData", "efc_KBIP"), offset("mjData", "efc_D")
    at_row_softness, at_row_aim = offset("mjData", "efc_R"), offset("mjData", "efc_aref")
    at_islands, at_island_row = offset("mjData", "nisland"), offset("mjData", "map_efc2iefc")
    at_island_limit, at_island_stiffness = offset("mjData", "iefc_frictionloss"), offset("mjData", "iefc_D")
    at_island_softness, at_island_aim = offset("mjData", "iefc_R"), offset("mjData", "iefc_aref")
    joint_row = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
    tendon_row = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON)

    @compiled()
    def friction_row(p, data):  # type: ignore[no-untyped-def]
        """Constraint row of the coordinate's dry friction, or -1."""
        row_type, row_id = load_address(data + at_row_type), load_address(data + at_row_id)
        wanted_type = joint_row if p[P_FRICTION_KIND] == 1.0 else tendon_row
        wanted_id = int(p[P_FRICTION_ID])
        start = load_int(data + at_equalities)
        for row in range(start, start + load_int(data + at_frictions)):
            if load_int(row_id + 4 * row) == wanted_id and load_int(row_type + 4 * row) == wanted_type:
                return row
        return -1

    @compiled()
    def inertial(model, data, dof, qacc):  # type: ignore[no-untyped-def]
        """Row ``dof`` of the mass matrix, times accelerations [N.m]."""
        entries = load_address(model + at_row_entries)
        start, column = load_address(model + at_row_start), load_address(model + at_column)
        mass = doubles(load_address(data + at_mass))
        at, depth, total = load_int(start + 4 * dof), load_int(entries + 4 * dof), 0.0
        for k in range(at, at + depth):
            total += mass[k] * qacc[load_int(column + 4 * k)]
        for other in range(dof + 1, load_int(model + at_dofs)):  # what hangs on it follows it, and has the other half
            k = load_int(start + 4 * other) + depth - 1
            if load_int(entries + 4 * other) < depth or load_int(column + 4 * k) != dof:
                break
            total += mass[k] * qacc[other]
        return total

    @compiled()
    def remainder(model, p, s, data, row, qacc):  # type: ignore[no-untyped-def]
        """What of the load no field of ``mjData`` says [N.m]: contacts, stops, other actuators, ``xfrc_applied``.

        It is what the latest evaluation's accelerations, which a simulation's own row of state holds, leave over once
        the actuator's torque, its dry friction by the law of its constraint row, and the known load are taken off.
        """
        last, acceleration = int(p[P_TERMS]) - 1, 0.0
        for k in range(last + 1):
            acceleration += p[P_COEFFICIENT + k] * qacc[int(p[P_DOF + k])]
        total = inertial(model, data, int(p[P_DOF + last]), qacc) / p[P_COEFFICIENT + last]
        speed = s[S_SPEED] / p[P_SCALE]
        if s[S_ROW_INERTIA] > 0.0:
            friction = -(acceleration - s[S_ROW_ACCELERATION]) * s[S_ROW_INERTIA]
        else:
            damping = doubles(load_address(data + at_row_gains))[4 * row + 1]
            friction = -(acceleration + damping * speed) * doubles(load_address(data + at_row_stiffness))[row]
        limit = s[S_LIMIT] + p[P_OWN_FRICTION]
        friction = min(max(friction, -limit), limit)
        return total - s[S_TORQUE] - friction - s[S_KNOWN] + p[P_VISCOUS] * speed

    @compiled()
    def drawn_beside(model, data, actuator, width):  # type: ignore[no-untyped-def]
        """What other motors on the same supply drew as their latest step began [A].

        One after the other, so that steps settle what they take from each other as Gauss and Seidel do.
        """
        programs, states = load_address(model + model_user), load_address(data + at_user)
        drawn, p = 0.0, doubles(programs + 8 * width * actuator)
        other = int(p[P_SUPPLY_NEXT])
        while other != actuator:
            p = doubles(programs + 8 * width * other)
            drawn += load_double(states + 8 * (int(p[P_STATE_ADDRESS]) + S_DRAWN))
            other = int(p[P_SUPPLY_NEXT])
        return drawn

    @compiled()
    def write_row(p, s, stiffness, softness, aim, frictionloss, row):  # type: ignore[no-untyped-def]
        """Give the constraint row of the dry friction what the law says of it."""
        doubles(frictionloss)[row] = s[S_LIMIT] + p[P_OWN_FRICTION]
        if s[S_ROW_INERTIA] > 0.0:
            doubles(stiffness)[row] = s[S_ROW_INERTIA]
            doubles(softness)[row] = 1.0 / s[S_ROW_INERTIA]
            doubles(aim)[row] = s[S_ROW_ACCELERATION]

    @compiled.callback(SIGNATURE)
    def bias(model, data, actuator):  # type: ignore[no-untyped-def]
        width = load_int(model + model_user_size)
        if width == 0:
            return 0.0
        address = load_address(model + model_user) + 8 * width * actuator
        if load_double(address) != MAGIC:
            return 0.0
        p = doubles(address)
        s = doubles(load_address(data + at_user) + 8 * int(p[P_STATE_ADDRESS]))
        qpos, qvel = doubles(load_address(data + at_qpos)), doubles(load_address(data + at_qvel))
        spring, applied = doubles(load_address(data + at_spring)), doubles(load_address(data + at_applied))
        damper, gravity = doubles(load_address(data + at_damper)), doubles(load_address(data + at_bias))
        q, w, known = 0.0, 0.0, 0.0
        for k in range(int(p[P_TERMS])):
            c, dof = p[P_COEFFICIENT + k], int(p[P_DOF + k])
            q += c * qpos[int(p[P_QPOS + k])]
            w += c * qvel[dof]
            # of a belt over a joint, only the last joint moves when the motor turns
            known = (spring[dof] + damper[dof] + applied[dof] - gravity[dof]) / c
        known += p[P_VISCOUS] * w  # the chain's own friction is no load
        time = load_double(data + at_time)
        goal = doubles(load_address(data + at_ctrl))[actuator]
        stage = stage_of(s, time, 4 if load_int(model + integrator) == runge_kutta else 1)
        row = friction_row(p, data) if p[P_FRICTION_KIND] > 0.0 else -1
        if row >= 0 and stage in (FIRST, LATER):
            # between steps, shared mjData may hold another simulation; within one, the state is that of its start
            latest = at_warmstart if stage == FIRST else at_qacc
            s[S_REST] = remainder(model, p, s, data, row, doubles(load_address(data + latest)))
        if stage == RESTART:
            begin(p, s, time, goal, q, w)
        elif stage == FIRST:
            advance(p, s, time)
        s[S_KNOWN], s[S_STEP] = known, load_double(model + timestep)
        if p[P_LOAD_FACTOR] != 0.0:
            pressing = load_double(load_address(data + at_user) + 8 * (int(p[P_LOAD_STATE]) + S_REST))
            s[S_PRESSED] = max(p[P_LOAD_FACTOR] * pressing, 0.0)
        supply, opens = int(p[P_SUPPLY]), stage in (FIRST, RESTART)
        if opens and supply > 0 and p[supply] > 0.0:
            s[S_BESIDE] = drawn_beside(model, data, actuator, width)
        force = torque(p, s, time, goal, q, w, known + s[S_REST], first=stage != LATER)
        if opens:
            s[S_DRAWN] = max(s[S_DUTY] * s[S_CURRENT], 0.0)
        if row >= 0:
            write_row(
                p,
                s,
                load_address(data + at_row_stiffness),
                load_address(data + at_row_softness),
                load_address(data + at_row_aim),
                load_address(data + at_row_limit),
                row,
            )
            if load_int(data + at_islands) > 0:  # the solver then reads a copy sorted by island, made before this call
                island_row = load_int(load_address(data + at_island_row) + 4 * row)
                write_row(
                    p,
                    s,
                    load_address(data + at_island_stiffness),
                    load_address(data + at_island_softness),
                    load_address(data + at_island_aim),
                    load_address(data + at_island_limit),
                    island_row,
                )
        return force

    return bias


class _Installed:
    """What must live as long as the process: the C functions that MuJoCo holds pointers to."""

    lock = threading.Lock()
    addresses: frozenset[int] = frozenset()
    kept: tuple[Any, ...] = ()


def install() -> None:
    """Install the law as MuJoCo's actuator bias callback.

    Another owner's callback, C or Python, still gets its own actuators.
    Call it again after a library has set ``mjcb_act_bias`` for itself (:class:`~actuators.drivetrain.Drivetrain` does):
    a callback set later takes our place, and MuJoCo then computes no torque for our actuators.
    """
    with _Installed.lock:
        slot = _callback_slot()
        current = slot.value or 0
        if current in _Installed.addresses:
            return
        function = compiled_law() if current == 0 else _router(compiled_law().address, current)
        _Installed.kept = (*_Installed.kept, function)
        _Installed.addresses = _Installed.addresses | {function.address}
        slot.value = function.address


def installed() -> bool:
    """Whether MuJoCo calls our law now."""
    return (_callback_slot().value or 0) in _Installed.addresses


@functools.cache
def _callback_slot() -> ctypes.c_void_p:
    """The C variable ``mjcb_act_bias`` itself.

    Not ``mujoco.set_mjcb_act_bias``: that would make a Python callback of another library unreachable, which MuJoCo
    calls through a C function of its own.
    """
    for pattern in ("libmujoco*", "mujoco*.dll"):
        for path in Path(mujoco.__file__).parent.glob(pattern):
            try:
                return ctypes.c_void_p.in_dll(ctypes.CDLL(str(path)), "mjcb_act_bias")
            except (OSError, ValueError):
                continue
    raise SealegsError(
        f"this MuJoCo ({mujoco.__version__}) shows no callback for actuators; install the version in constraints.txt."
    )


def _router(ours: int, foreign: int) -> Any:
    """A C function that asks the program's magic number whom an actuator belongs to."""
    model_user, model_user_size = offset("mjModel", "actuator_user"), offset("mjModel", "nuser_actuator")

    @numba.cfunc(SIGNATURE)  # not cached: the addresses are those of this process
    def route(model, data, actuator):  # type: ignore[no-untyped-def]
        width = load_int(model + model_user_size)
        if width > 0 and load_double(load_address(model + model_user) + 8 * width * actuator) == MAGIC:
            return call_bias(ours, model, data, actuator)
        return call_bias(foreign, model, data, actuator)

    return route
