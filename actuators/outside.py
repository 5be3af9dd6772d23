"""Laws of stages that others wrote: called by their address, so that a new one is compiled alone and in seconds.

The loops around the laws are compiled once, for the stages of this package, and kept. They call any other stage through
a table of C functions, which they find by its name as the code is loaded; so stages may come before them or after.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import llvmlite.binding
import numpy as np
from llvmlite import ir
from numba import types  # pyright: ignore[reportPrivateImportUsage]
from numba.core.errors import NumbaError
from numba.extending import intrinsic

from .compiled import compiled
from .stages.base import ChainError, Law

FIRST = 1000  # opcode of theirs; below it are those of this package
MOST = 256
HALVES = {
    "start": "p, i, s, m, goal",
    "advance": "p, i, s, m, time",
    "act": "p, i, s, m, time, value, q, w, external, first",
    "idle": "p, i, s, q, w, external",
}
"""What each half of a law may name, as :class:`sealegs.actuators.stages.Law` says."""
KINDS = {"p": types.CPointer(types.float64), "s": types.CPointer(types.float64), "i": types.intp, "m": types.intp}
KINDS["first"] = types.intp  # all others are numbers

_TABLE = np.zeros((MOST, len(HALVES)), np.int64)
_OPCODES: dict[Law, int] = {}
_KEPT: list[Any] = []  # what must live as long as the process: it is called by its address
_SYMBOL = "sealegs_laws_of_others"
llvmlite.binding.add_symbol(_SYMBOL, _TABLE.ctypes.data)


def opcode(law: Law, stage: str) -> int:
    """The opcode of a law that is not of this package, which is compiled here; ``stage`` is its name.

    Raises:
        ChainError: it does not compile, or names something that no law is given.
    """
    if law not in _OPCODES:
        if len(_OPCODES) == MOST:
            raise ChainError(f"there are {MOST} laws of others already; '{stage}' is one too many.")
        functions = [_c_function(getattr(law, half), stage, half) for half in HALVES]
        _TABLE[len(_OPCODES)] = [0 if function is None else function.address for function in functions]
        _KEPT.extend(functions)
        _OPCODES[law] = FIRST + len(_OPCODES)
    return _OPCODES[law]


def _kind(name: str) -> Any:
    return KINDS.get(name, types.float64)


def _signature(half: str) -> Any:
    return types.float64(*(_kind(name) for name in HALVES[half].split(", ")))


def _c_function(function: Any, stage: str, half: str) -> Any:
    """One half of a law as a function that C can call; None where the law lacks it."""
    if function is None:
        return None
    plain = getattr(function, "py_func", None)
    if plain is None:
        raise ChainError(
            f"the law of '{stage}' has a function '{half}' that is not compiled; put @compiled() of "
            "sealegs.actuators.compiled before it."
        )
    taken = list(inspect.signature(plain).parameters)
    if unknown := [name for name in taken if name not in HALVES[half].split(", ")]:
        raise ChainError(f"the law of '{stage}' takes '{unknown[0]}' in '{half}', which is given {HALVES[half]}.")
    name, file = f"{plain.__name__}_{half}", inspect.getfile(plain)
    call = f"law({', '.join(taken)})"
    body = f"{call}; return 0.0" if half == "advance" else f"return {call}"
    names: dict[str, Any] = {"law": function, "__name__": plain.__module__}
    exec(compile(f"def {name}({HALVES[half]}): {body}", file, "exec"), names)  # kept under what that file says
    try:
        return compiled.callback(_signature(half))(names[name])
    except NumbaError as error:
        lines = [line for line in str(error).splitlines() if line.strip()]
        raise ChainError(f"the law of '{stage}' does not compile in '{half}': {' '.join(lines[1:3])}") from error


# --- in compiled code ----------------------------------------------------------------------------------------------


@intrinsic
def address(typingctx: Any, op: Any, half: Any) -> Any:
    """Of the C function of a half of an opcode; 0: there is none, or this process does not know the stage."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        word = ir.IntType(64)
        row = builder.sub(args[0], ir.Constant(word, FIRST))
        at = builder.add(builder.mul(row, ir.Constant(word, len(HALVES))), args[1])
        return builder.load(builder.gep(context.get_c_value(builder, word, _SYMBOL), [at]))

    return types.intp(types.intp, types.intp), codegen


def caller(half: str) -> Callable[..., Any]:
    """A function ``(address, *arguments)`` for compiled code that calls a half of a law there."""
    signature = _signature(half)

    def call(given: tuple[Any, ...]) -> Any:
        def codegen(context: Any, builder: Any, called: Any, args: Any) -> Any:
            passed = []
            for value, have, want in zip(args[1:], called.args[1:], signature.args, strict=True):
                if isinstance(have, types.Array):
                    passed.append(context.make_array(have)(context, builder, value).data)
                else:
                    passed.append(context.cast(builder, value, have, want))
            kind = ir.FunctionType(ir.DoubleType(), [value.type for value in passed])
            return builder.call(builder.inttoptr(args[0], kind.as_pointer()), passed)

        return types.float64(*given), codegen

    names = f"at, {HALVES[half]}"
    space: dict[str, Any] = {"call": call, "__name__": __name__}
    exec(compile(f"def call_{half}(typingctx, {names}): return call(({names}))", __file__, "exec"), space)
    return intrinsic(space[f"call_{half}"])
