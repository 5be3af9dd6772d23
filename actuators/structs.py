"""Where the fields of MuJoCo's C structs lie in memory, computed from MuJoCo's own description of them.

The laws read ``mjModel`` and ``mjData`` as C code does. MuJoCo ships a machine-readable copy of its headers
(``mujoco.introspect``); the C layout follows from it by the usual rules of alignment, and is checked against pointers
whose values Python can see, so that another MuJoCo version is refused instead of misread.
"""

from __future__ import annotations

import ctypes
import functools
from typing import Any

import mujoco
from mujoco.introspect import ast_nodes, structs

from ..common.errors import SealegsError

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
    """A ctypes structure laid out as MuJoCo's C struct of that name."""
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
