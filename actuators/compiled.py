"""How the laws and the loops around them are compiled: by numba, once per version of what they say, kept on disk.

numba looks only at the file that a function stands in: a law that calls a changed stage would silently stay the old
one. So compiled code is kept under a digest of the function's module and of all modules of this package and of its own
folder that it imports, as syntax trees: what is said in comments and docstrings, and on which line, does not count.
That holds for the laws of others, too, in whatever file they are.

A package that compiles functions makes a :class:`Compiler` of its own, with the words that a person reads while the
first compilation lasts.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import hashlib
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numba
from numba import types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.ccallback import CFunc
from numba.core.dispatcher import Dispatcher
from numba.extending import intrinsic

from ..common.atomic import written
from ..common.documents import read_json

# error_model: a division by zero gives infinity as in C; the check for it would cost a branch at every division
PACKAGE = __name__.partition(".")[0]
OPTIONS: dict[str, Any] = {"error_model": "numpy"}


class Compiler:
    """A decorator that compiles functions of one package, as ``numba.njit`` does.

    Attributes:
        what: is compiled, as it stands in a sentence.
        how_long: that takes the first time, in words.
    """

    def __init__(self, what: str, how_long: str) -> None:
        self.what, self.how_long = what, how_long
        self._announced = False

    def __call__(self, *, allocates: bool = False, **options: Any) -> Callable[[Callable[..., Any]], Any]:
        """Compile a function when it is first called.

        Args:
            allocates: it makes arrays. One that does not counts no references to those that it is given, which is a
                quarter of the time of a replay.
            **options: of ``numba.njit``.
        """

        def decorate(function: Callable[..., Any]) -> Any:
            every: dict[str, Any] = {**OPTIONS, "_nrt": allocates, **options}
            dispatcher: Any = numba.njit(**every)(function)
            dispatcher._cache = _Cache(function, self)
            return dispatcher

        return decorate

    def callback(self, signature: Any) -> Callable[[Callable[..., Any]], Any]:
        """Compile a function now, to one that C code can call."""

        def decorate(function: Callable[..., Any]) -> Any:
            callback: Any = CFunc(function, (signature.args, signature.return_type), {}, {"nopython": True, **OPTIONS})
            callback._cache = _Cache(function, self)
            callback.compile()
            return callback

        return decorate

    def announce(self) -> None:
        """Say once that something is being compiled, where a person sees it and no program reads it."""
        if not self._announced:
            self._announced = True
            print(f"Compiling {self.what} once ({self.how_long}) ...", file=sys.stderr, flush=True)


compiled = Compiler("the actuator laws", "about a minute")


@intrinsic
def pointer(typingctx: Any, array: Any) -> Any:
    """An array as a pointer to its first number, which compiled functions index as they do the array.

    numba hands an array on in seven words and asks of each index whether it counts from the end: together half of the
    time of a law. It must be contiguous, and whoever made it must use it once more behind the last use of the pointer;
    numba frees it after what it knows to be the last.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return context.make_array(signature.args[0])(context, builder, args[0]).data

    return types.CPointer(array.dtype)(array), codegen


def folder() -> Path:
    """Where compiled code is kept: ``NUMBA_CACHE_DIR``, else beside this file, else in the user's cache."""
    if os.environ.get("NUMBA_CACHE_DIR"):
        return Path(os.environ["NUMBA_CACHE_DIR"])
    beside = Path(__file__).resolve().parent / "__pycache__"
    return beside if _writable(beside) else user_folder()


def user_folder() -> Path:
    """The user's cache folder of this package."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "sealegs"


@functools.cache
def _writable(path: Path) -> bool:
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError:
        return False
    return True


def digest(file: Path) -> str:
    """Of what a module says, with all that :func:`imported` finds."""
    said = hashlib.sha256(numba.__version__.encode())
    for path in sorted(imported(file)):
        said.update(path.name.encode() + _source(path).said.encode())
    return said.hexdigest()[:12]


def imported(file: Path) -> set[Path]:
    """A module and what it imports, directly or not, of this package and of its own folder; a package that is imported
    relatively stands for all its files.
    """
    found: set[Path] = set()
    left = [file.resolve()]
    while left:
        path = left.pop()
        if path not in found:
            found.add(path)
            left += _imports(path)
    return found


KEPT_AS = b"imports, absolute ones too"  # changes with what a kept source says


@dataclass(frozen=True)
class _Source:
    """What counts of a file: digest of its syntax without comments and docstrings, and its imports, each as level (0:
    absolute), module and names.
    """

    said: str
    imports: tuple[tuple[int, str, tuple[str, ...]], ...]


@functools.cache
def _source(path: Path) -> _Source:
    """Parsed once for each version of a file and kept beside the compiled code: parsing takes a third of a second."""
    text = path.read_bytes()
    kept = folder() / f"source-{hashlib.sha256(sys.version.encode() + KEPT_AS + text).hexdigest()[:16]}.json"
    with contextlib.suppress(ValueError, KeyError):
        found = read_json(kept)
        return _Source(found["said"], tuple((level, base, tuple(names)) for level, base, names in found["imports"]))
    parsed = _parsed(text)
    with contextlib.suppress(OSError):
        kept.parent.mkdir(parents=True, exist_ok=True)
        with written(kept, replace=True) as fresh:
            fresh.write_text(json.dumps({"said": parsed.said, "imports": parsed.imports}), encoding="utf-8")
    return parsed


def _parsed(text: bytes) -> _Source:
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node, False) is not None:
            node.body = node.body[1:]
    imports: list[tuple[int, str, tuple[str, ...]]] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            imports.append((node.level, node.module or "", tuple(alias.name for alias in node.names)))
        elif isinstance(node, ast.Import):
            imports += [(0, alias.name, ()) for alias in node.names]
    return _Source(hashlib.sha256(ast.dump(tree).encode()).hexdigest(), tuple(imports))


@functools.cache
def _imports(path: Path) -> list[Path]:
    found: list[Path] = []
    for level, module, names in _source(path).imports:
        if level == 0:
            found += _absolute(path, (module, *(f"{module}.{name}" for name in names)))
            continue
        base = path.parents[level - 1].joinpath(*module.split(".")) if module else path.parents[level - 1]
        for target in (base, *(base / name for name in names)):
            if target.with_suffix(".py").is_file():
                found.append(target.with_suffix(".py").resolve())
            elif target.is_dir() and target != path.parent:
                found += [file.resolve() for file in target.glob("*.py")]
    return found


def _absolute(path: Path, names: Iterable[str]) -> Iterator[Path]:
    """Files of the modules of these names that are of this package, or in the folder of ``path``; all are loaded."""
    for name in names:
        file = getattr(sys.modules.get(name), "__file__", None)
        if file is None or not file.endswith(".py"):
            continue
        if name.partition(".")[0] == PACKAGE or Path(file).resolve().is_relative_to(path.parent):
            yield Path(file).resolve()


class _Locator(_CacheLocator):
    """Where the compiled code of a function is kept, and what it is valid for."""

    def __init__(self, module: str, py_file: str) -> None:
        file = Path(py_file)
        self._py_file = py_file  # numba names it in warnings
        self._stamp = digest(file)
        # of others by the name of the module, under which what is kept looks for what it calls
        name = f"{file.parent.name}-{file.stem}" if module.partition(".")[0] == PACKAGE else module
        self._path = folder() / f"{name}-{self._stamp}"

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Locator:
        return cls(py_func.__module__, py_file)

    def get_cache_path(self) -> str:
        return str(self._path)

    def get_source_stamp(self) -> str:
        return self._stamp

    def get_disambiguator(self) -> str:
        return ""  # not the line: functions of a module have names of their own


class _Results(CompileResultCacheImpl):
    _locator_classes: ClassVar = [_Locator]


class _Cache(FunctionCache):
    """Compiled code of one function on disk."""

    _impl_class = _Results

    def __init__(self, function: Any, compiler: Compiler) -> None:
        super().__init__(function)
        self._compiler = compiler

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = super().load_overload(sig, target_context)
        if found is None:
            self._compiler.announce()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        with contextlib.suppress(OSError), _lock(Path(self.cache_path)):  # without a place to keep it, it still runs
            super().save_overload(sig, data)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """As numba's, but a compiled function in a closure counts by its name: its code is in the digest."""
        cells = [cell.cell_contents for cell in self._py_func.__closure__ or ()]
        closure = repr([item.__name__ if isinstance(item, Dispatcher) else item for item in cells])
        return sig, codegen.magic_tuple(), hashlib.sha256(self._py_func.__code__.co_code + closure.encode()).hexdigest()


@contextlib.contextmanager
def _lock(path: Path) -> Iterator[None]:
    """Let one process at a time write an index: two would give one name to two functions' code."""
    path.mkdir(parents=True, exist_ok=True)
    if sys.platform == "win32":  # numba's own guard has to do
        yield
        return
    import fcntl

    with (path / "lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
