"""Hostile documents: how valid ones are spoiled, and the watch under which they are read.

A document is spoiled by a few :class:`Change`, which hypothesis draws and shrinks. Under the watch, whatever a reader
does that no reader may do ends the test: run or import what lies in the folder, start a process, open a socket, read a
file outside of the folders that it was given, write one, take more than 10 s of the processor, or end in anything but
one sentence.
"""

from __future__ import annotations

import contextlib
import copy
import datetime
import json
import math
import os
import resource
import signal
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml
from hypothesis import strategies as st
from sealegs.actuators.compiled import folder as compiled_folder
from sealegs.common.errors import SealegsError

LONGEST = 10.0  # [s] of the processor
MEMORY = 4 * 2**30  # [B] beyond what the process has
SECRET = "a5ecret"
ROOT = Path(__file__).resolve().parent.parent

PATHS = (
    "/etc/passwd", "../../../../etc/passwd", "/dev/zero", "/dev/stdin", "/proc/kcore", "/dev/tty", "", ".", "/", "~",
    "pipe", "pipe.yaml", "pipe.xml", "pipe.stl", "pipe.png", "pipe.npz", "pipe.urdf", "folder", "folder.yaml",
    "folder.xml", "task.py", "task.py:Task", "bam:/etc/passwd", "bam:pipe", "bam:bam.json", "../outside/secret",
    "../outside/secret.yaml", "../outside/secret.xml", "../outside/secret.json", "loop.xml", "loop.yaml", "a\0b",
    "package://x/../../etc/passwd", "file:///etc/passwd", "http://127.0.0.1:9/x.yaml", "x" * 5000, "a" * 255 + ".yaml",
)  # fmt: skip
WORDS = (
    "__import__('os').system('touch ran')", "eval('1')", "${oc.env:HOME}", "${a}", "{{7*7}}", "%s%n%x", "\u202e\u0007",
    "\ud7ff\ufffe", "\U0001f916", "a" * 10_000, "'\"`;|&$(touch ran)`", "null", "~", "nan", "inf", "1e400", "-0",
    "0x" + "f" * 400, "1_0", "<<", "*", "?", "a.b.c", "..", "robot", "joint", "time", "**", "(" * 60, "[" * 60,
)  # fmt: skip
NUMBERS = (
    0, 1, -1, 2, 3, 1.5, -0.0, 1e-320, 1e-9, 1e9, 1e30, 1e308, -1e308, math.inf, -math.inf, math.nan, 2**31, 2**63,
    2**64, -(2**63) - 1, 10**30, 10**299, 10**9, 10**6, 4096, 65536, True, False,
)  # fmt: skip
SHAPES = (
    None, [], {}, [[]], [{}], {"": ""}, [None], [1, 2, 3], ["a", "a"], {"a": {"b": {"c": {}}}}, datetime.date(1, 1, 1),
    datetime.datetime(2024, 2, 29), {None: 1}, {2: 2, 1.5: 3, True: 4}, [0.0] * 300, {str(k): k for k in range(300)},
    [[[[[[[[[[[[1]]]]]]]]]]]], [math.nan, math.inf],
)  # fmt: skip
EXTREMES = (*PATHS, *WORDS, *NUMBERS, *SHAPES)
ALIASES = "&a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{b}: &{b} [{','.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
TEXTS = (
    "\0", "\t", "\n", "\r", "\ufeff", ",", ":", "- ", "{", "}", "[", "]", "'", '"', "#", "&a ", "*a", "!!binary ", "|",
    "!!python/object/apply:os.system [touch ran]", "<<: ", "---\n", "...", "%YAML 9", "[" * 3000, "{a: " * 3000,
    f"\na: {ALIASES}", "? ", "<a>" * 3000, '<!DOCTYPE a [<!ENTITY b "c">]>', "&b;", "<!--", "]]>", "1e400", "9" * 5000,
    "nan", "-inf",
    "9" * 40_000 + "x", "a" * 40_000 + "!",
    "é", "\u2028", "x" * 20_000, ";", "\x1b[2J", "0,0,0\n", "True", "\ud83d\ude00",
)  # fmt: skip


@dataclass(frozen=True)
class Change:
    """One change of a document: what is done, where, and with which of the extremes."""

    way: int
    place: int
    what: int


CHANGES = st.lists(
    st.builds(Change, st.integers(0, 11), st.integers(0, 2**16), st.integers(0, 2**16)), min_size=1, max_size=4
)


def spoiled(document: Any, changes: list[Change]) -> Any:
    """A document of mappings and lists with some of its entries replaced, left out, renamed, moved or repeated."""
    document = copy.deepcopy(document)
    for change in changes:
        places = list(_places(document))
        if not places:
            return EXTREMES[change.what % len(EXTREMES)]
        holder, key = places[change.place % len(places)]
        extreme = copy.deepcopy(EXTREMES[change.what % len(EXTREMES)])
        match change.way:
            case 0:
                del holder[key]
            case 1:
                holder[key] = [holder[key]]
            case 2:
                holder[key] = {"a": holder[key]}
            case 3 if isinstance(holder, dict):
                name = extreme if isinstance(extreme, str | int | float) else str(extreme)
                holder[name] = holder.pop(key)
            case 4:
                other, at = places[change.what % len(places)]
                holder[key] = copy.deepcopy(other[at])
            case 5 if isinstance(holder, list) and len(holder) < 100:
                holder *= 1 + change.what % 50
            case 6 if isinstance(holder[key], dict):
                holder[key][str(extreme)] = extreme
            case 7:
                holder[key] = NUMBERS[change.what % len(NUMBERS)]
            case 8:
                holder[key] = str(holder[key])
            case 9:
                holder[key] = PATHS[change.what % len(PATHS)]
            case _:
                holder[key] = extreme
    return document


def _places(document: Any) -> Iterator[tuple[Any, Any]]:
    """Every entry of a document, as what holds it and its key there."""
    keys = range(len(document)) if isinstance(document, list) else list(document) if isinstance(document, dict) else ()
    for key in keys:
        yield document, key
        yield from _places(document[key])


def torn(text: str, changes: list[Change]) -> str:
    """A text with pieces put in, left out, and repeated."""
    for change in changes:
        at = change.place % (len(text) + 1)
        match change.way:
            case 0 | 1:
                text = text[:at] + text[at + 1 + change.what % 40 :]
            case 2:
                text = text[:at]
            case 3:
                text = text[:at] + text[at : at + 30] * (change.what % 50) + text[at:]
            case 4:
                text = text[:at] + str(EXTREMES[change.what % len(EXTREMES)])[:1000] + text[at + 4 :]
            case _:
                text = text[:at] + TEXTS[change.what % len(TEXTS)] + text[at:]
    return text


def bitten(data: bytes, changes: list[Change]) -> bytes:
    """Bytes with some changed, left out and repeated."""
    for change in changes:
        at = (change.place * 31) % (len(data) + 1)
        match change.way:
            case 0:
                data = data[:at]
            case 1:
                data = data[:at] + data[at + 1 + change.what % 40 :]
            case 2:
                data = data[:at] + data[at : at + 30] * (change.what % 20) + data[at:]
            case 3:
                data = data[:at] + b"\xff" * 8 + data[at + 8 :]
            case 4:
                data = data[:at] + b"\0" * 8 + data[at + 8 :]
            case _:
                data = data[:at] + bytes([change.what % 256]) + data[at + 1 :]
    return data


def as_yaml(document: Any, changes: list[Change], text: list[Change]) -> str:
    """A spoiled document as YAML, its text torn, too."""
    return torn(yaml.safe_dump(spoiled(document, changes), sort_keys=False, allow_unicode=True), text)


def as_json(document: Any, changes: list[Change], text: list[Change]) -> str:
    """A spoiled document as JSON, its text torn, too."""
    return torn(json.dumps(spoiled(document, changes), default=str, skipkeys=True), text)


XML_VALUES = (
    *PATHS, *WORDS, *map(str, NUMBERS), "0 0 0", "1 1 1 1 1 1", "nan nan nan", "1e308 1e308 1e308", "0 0", "true",
    "auto", "1000000 1000000", "1000 1000 1000", "-1 -1 -1", "0 0 0 0", "1 " * 3000,
)  # fmt: skip
XML_TAGS = (
    "include", "attach", "frame", "replicate", "composite", "flexcomp", "plugin", "extension", "asset", "mesh", "body",
    "texture", "hfield", "skin", "material", "model", "size", "option", "compiler", "joint", "freejoint", "geom",
    "site", "inertial", "link", "robot", "mujoco", "mujocoinclude", "default", "equality", "tendon", "fixed", "spatial",
    "key", "keyframe", "sensor",
    "user", "contact", "exclude", "pair", "custom", "numeric", "tuple", "transmission", "mimic",
    "limit", "dynamics", "safety_controller", "axis", "origin", "collision", "visual", "geometry", "box", "general",
)  # fmt: skip
XML_KEYS = (
    "file", "name", "count", "meshdir", "texturedir", "assetdir", "model", "body", "joint", "pos", "size", "type",
    "mass", "width",
    "height", "nrow", "ncol", "memory", "nkey", "nuserdata", "njmax", "nconmax", "nstack", "timestep", "range",
    "axis", "filename", "link", "offset", "euler", "sep", "prefix", "childclass", "class", "builtin", "elevation",
    "dim", "mesh", "hfield", "vertex", "face", "spacing", "plugin", "instance", "nuser_body", "data", "gear", "kp",
    "armature", "damping", "quat", "fromto", "lower", "upper", "effort", "velocity", "user", "integrator", "iterations",
    "inertia",
)  # fmt: skip


BOMBS = tuple(
    ElementTree.fromstring(bomb)
    for bomb in (
        '<replicate count="100000000" offset="1 0 0"><body><joint/><geom size="1"/></body></replicate>',
        '<replicate count="900"><replicate count="900"><replicate count="900"><geom size="1"/></replicate></replicate>'
        "</replicate>",
        '<flexcomp type="grid" name="f" dim="3" count="3000 3000 3000" spacing=".1 .1 .1"/>',
        '<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>',
        '<asset><texture type="2d" name="t" builtin="checker" width="200000" height="200000"/></asset>',
        '<asset><mesh name="m" file="/dev/zero"/><mesh name="n" file="pipe.stl"/></asset>',
        '<asset><model name="m" file="loop.xml"/></asset>',
        '<size nkey="2000000000"/>',
        '<size nuser_body="2000000000" memory="100T"/>',
        '<include file="loop.xml"/>',
        '<include file="../outside/secret"/>',
    )
)
"""What makes MuJoCo work or take memory without an end, or look where it may not."""


def as_xml(text: str, changes: list[Change], tears: list[Change]) -> str:
    """An XML with elements and attributes changed, left out, moved and repeated, and its text torn."""
    root = ElementTree.fromstring(text)
    for change in changes:
        parents = [(holder, k) for holder in root.iter() for k in range(len(holder))]
        if not parents:
            break
        holder, k = parents[change.place % len(parents)]
        item = holder[k]
        keys = sorted(item.attrib) or ["name"]
        value = (
            XML_VALUES[change.what % len(XML_VALUES)].replace("\0", " ").replace("\ufffe", " ").replace("\u0007", " ")
        )
        match change.way:
            case 0:
                holder.remove(item)
            case 1:
                for _ in range(change.what % 20):
                    holder.append(copy.deepcopy(item))
            case 2:
                item.tag = XML_TAGS[change.what % len(XML_TAGS)]
            case 3:
                inner, at = parents[change.what % len(parents)]
                item.append(copy.deepcopy(inner[at]))
            case 4:
                item.attrib.pop(keys[change.what % len(keys)], None)
            case 5 | 6:
                tag, key = XML_TAGS[change.what % len(XML_TAGS)], XML_KEYS[change.place % len(XML_KEYS)]
                ElementTree.SubElement(item, tag, {key: value, XML_KEYS[change.what % len(XML_KEYS)]: "5"})
            case 7 | 8:
                item.set(XML_KEYS[(change.what // 7) % len(XML_KEYS)], value)
            case 9:
                holder.append(copy.deepcopy(BOMBS[change.what % len(BOMBS)]))
            case 10:
                root.append(copy.deepcopy(BOMBS[change.what % len(BOMBS)]))
            case _:
                item.set(keys[change.place % len(keys)], value)
    return torn(ElementTree.tostring(root, encoding="unicode"), tears)


# --- the watch -----------------------------------------------------------------------------------------------------


class Caught(BaseException):
    """What no reader may do; no ``except Exception`` of a reader hides it."""


@dataclass
class Watch:
    """What is allowed at the moment.

    Attributes:
        on: whether anything is looked at.
        folder: of the documents, in which files are read, but none is run.
        found: the first thing that was done and may not be.
    """

    on: bool = False
    folder: str = ""
    found: str = ""


WATCH = Watch()
READ = tuple(
    str(Path(path).resolve())
    for path in (
        ROOT, sys.prefix, sys.base_prefix, *filter(None, sys.path),
        *sysconfig.get_paths().values(), compiled_folder(),
        "/usr", "/lib", "/sys",
        "/proc/self", "/proc/cpuinfo", "/proc/meminfo", "/etc/localtime", "/dev/null", "/dev/urandom",
    )
)  # fmt: skip
KEPT = (str(compiled_folder().resolve()), "/dev/null", tempfile.gettempdir() + "/__never__")
STARTS = ("os.system", "os.exec", "os.posix_spawn", "os.fork", "os.forkpty", "subprocess.Popen", "pty.spawn")
SOCKETS = ("socket.connect", "socket.bind", "socket.getaddrinfo", "urllib.Request", "ftplib.connect")
CHANGED = ("os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.link", "os.symlink", "os.truncate", "os.chmod",
           "shutil.rmtree", "shutil.move")  # fmt: skip
UNPICKLED = ("os", "posix", "nt", "subprocess", "runpy", "pty", "shutil", "importlib", "socket")


def _audit(event: str, given: tuple[Any, ...]) -> None:
    if not WATCH.on:
        return
    said = _refused(event, given)
    if said:
        WATCH.found = WATCH.found or said
        raise Caught(said)


def _refused(event: str, given: tuple[Any, ...]) -> str:
    """What is wrong with an event of the interpreter; empty where it is allowed."""
    if event in STARTS or event in SOCKETS:
        return f"{event}{given!r}"
    if event == "pickle.find_class" and (given[0] in UNPICKLED or given[1] in ("eval", "exec", "getattr")):
        return f"unpickled {given[0]}.{given[1]}"
    if event == "exec" and str(getattr(given[0], "co_filename", "")).startswith(WATCH.folder):
        return f"ran {given[0].co_filename}"
    if event == "import" and given[1] and str(given[1]).startswith(WATCH.folder):
        return f"imported {given[1]}"
    if event in CHANGED and not _within(given[0], KEPT):
        return f"{event}({given[0]!r})"
    if event == "open" and isinstance(given[0], str | bytes | os.PathLike):
        path, mode, flags = given
        writes = any(sign in str(mode) for sign in "wax+") if mode else bool(flags & (os.O_WRONLY | os.O_RDWR))
        if writes and not _within(path, KEPT):
            return f"wrote {os.fsdecode(path)}"
        if os.fsdecode(path).endswith(".py") and _within(path, (WATCH.folder,)):
            return f"read code in {os.fsdecode(path)}"
        if not writes and not _within(path, (*READ, WATCH.folder)) and not _named(path):
            return f"read {os.fsdecode(path)}"
    return ""


def _within(path: Any, folders: tuple[str, ...]) -> bool:
    if isinstance(path, int):
        return True
    whole = os.path.realpath(os.fsdecode(path))
    return any(whole == folder or whole.startswith(folder + os.sep) for folder in folders)


def _named(path: Any) -> bool:
    """Whether a file beside the folder is of a kind that a document may name: robots share chains and meshes."""
    beside = str(Path(WATCH.folder).parent / "outside")
    return _within(path, (beside,)) and os.path.splitext(os.fsdecode(path))[1] in (".yaml", ".xml", ".json", ".urdf")


sys.addaudithook(_audit)


def prepare(folder: Path) -> None:
    """Lay out what hostile documents name: pipes, folders, code that must not run, and secrets beside the folder."""
    outside = folder.parent / "outside"
    for path in (folder, outside, folder / "folder", folder / "folder.yaml", folder / "folder.xml"):
        path.mkdir(parents=True, exist_ok=True)
    for name in ("pipe", "pipe.yaml", "pipe.xml", "pipe.stl", "pipe.png", "pipe.npz", "pipe.urdf"):
        os.mkfifo(folder / name)
    (folder / "task.py").write_text("open(__file__ + '.ran', 'w')\n")
    (folder / "loop.xml").write_text('<mujoco><include file="loop.xml"/></mujoco>')
    (folder / "loop.yaml").write_text("model: loop.yaml\n")
    (folder / "bam.json").write_text("[]")
    for name in ("secret", "secret.yaml", "secret.xml", "secret.json"):
        (outside / name).write_text(f"{SECRET}: [{SECRET}\n")


def put(folder: Path, name: str, said: str | bytes) -> Path:
    """Write a document, which is no doing of its reader."""
    on, WATCH.on = WATCH.on, False
    path = folder / name
    path.write_bytes(said if isinstance(said, bytes) else said.encode("utf-8", "surrogatepass"))
    WATCH.on = on
    return path


@contextlib.contextmanager
def watched(folder: Path, longest: float = LONGEST) -> Iterator[None]:
    """Read documents of a folder under the watch; a sentence ends the reading as it should.

    Args:
        folder: of the documents.
        longest: that the reading may take [s of the processor].
    """

    def late(*_: Any) -> None:
        raise Caught(f"took more than {longest:g} s of the processor")

    limits = resource.getrlimit(resource.RLIMIT_AS)
    before = signal.signal(signal.SIGPROF, late)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MEMORY, limits[1]))
    signal.setitimer(signal.ITIMER_PROF, longest)
    WATCH.on, WATCH.folder, WATCH.found = True, str(folder), ""
    try:
        with open(os.devnull, "w") as nowhere, contextlib.redirect_stderr(nowhere), contextlib.redirect_stdout(nowhere):
            yield
    except SealegsError as error:
        _check_sentence(str(error))
    finally:
        WATCH.on = False
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
        resource.setrlimit(resource.RLIMIT_AS, limits)
    assert not WATCH.found, WATCH.found


def _check_sentence(said: str) -> None:
    assert said.strip(), "an empty sentence"
    assert "Traceback" not in said
    assert SECRET not in said, f"tells what stands in another's file: {said[:300]}"
