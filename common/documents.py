"""The one reader of YAML, JSON, XML and arrays that people give, within bounds: none, however made, hangs a command.

A document is data. Bounded are its size, its depth, the number of its entries with all that aliases repeat, and its
numbers; refused are devices and pipes, tags of YAML that stand for objects, and XML that declares entities. YAML in
which a key stands twice is refused, too: YAML itself keeps the last and drops the other.
"""

from __future__ import annotations

import codecs
import errno
import json
import os
import re
import stat
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.parsers.expat import ErrorString, errors

import numpy as np
import yaml

from .errors import SealegsError

YAML_SIZE = 2**20  # [B]; what people write has some kilobytes
JSON_SIZE = 2**26  # [B]; of what programs write
XML_SIZE = 2**25  # [B]; some robots have their meshes in the text
RECORDING = 2**30  # [B] of a recording that is read whole
DEPTH = 64
XML_DEPTH = 256
"""Of elements in each other: each link of a chain lies in the one before. MuJoCo itself takes 500."""
ENTRIES = 50_000
"""Of a YAML, repeated ones counted as often as they stand for something."""
ELEMENTS = 200_000
DIGITS = 300
"""Of a whole number: below it, each is a finite float."""
TAGS = ("map", "seq", "str", "int", "float", "bool", "null", "timestamp", "merge")
"""Of YAML, those that stand for plain data; a date is one where people write one."""
SURROGATE = re.compile(r"[\0\ud800-\udfff]")
ESCAPED = re.compile(r"\\u(?:[dD][89a-fA-F]|0000)")
PREFIXED = re.compile(rb"[\s</]([A-Za-z_][\w.-]*):[A-Za-z_]")
TAG = re.compile(rb"<[A-Za-z_][\w.-]*(?=[\s/>])([^<>]*)")
AMPERSAND = re.compile(rb"&(?!#\d+;|#x[0-9a-fA-F]+;|lt;|gt;|amp;|quot;|apos;)")
UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


class DocumentError(SealegsError):
    """A document cannot be read.

    Attributes:
        problem: what is wrong, to stand behind the name of the document, such as ``is not UTF-8 text``.
        line: where, from 1; None where it is not known.
        missing: there is no such file.
    """

    def __init__(self, where: object, problem: str, line: int | None = None, missing: bool = False) -> None:
        super().__init__(f"{where}{problem if problem.startswith(':') else f' {problem}'}")
        self.problem, self.line, self.missing = problem.removeprefix(": "), line, missing


# --- files ---------------------------------------------------------------------------------------------------------


def regular(path: str | Path, most: int = RECORDING, name: object = None) -> Path:
    """The path of a regular file that is not too large; nothing is opened.

    Args:
        path: of the file.
        most: size up to which it is taken [B].
        name: for the message, such as ``the calibration x.yaml``; None: its path.

    Raises:
        DocumentError: it is missing, too large, or a folder, a device or a pipe.
    """
    name = path if name is None else name
    try:
        found = os.stat(path)
    except OSError as error:
        raise _unopened(name, error) from None
    except ValueError:
        raise DocumentError(name, "is no path of a file") from None
    if stat.S_ISDIR(found.st_mode):
        raise DocumentError(name, f"cannot be read: {os.strerror(errno.EISDIR)}")
    if not stat.S_ISREG(found.st_mode):
        raise DocumentError(name, "is a device or a pipe; save what it gives as a file")
    if found.st_size > most:
        raise DocumentError(name, f"is larger than {_size(most)}, the most that is read")
    return Path(path)


def read_bytes(path: str | Path, most: int, name: object = None) -> bytes:
    """What a regular file holds; arguments and errors are those of :func:`regular`."""
    name = path if name is None else name
    regular(path, most, name)
    try:
        # what becomes a pipe between the two looks does not stop it either
        with open(os.open(path, os.O_RDONLY | os.O_CLOEXEC | getattr(os, "O_NONBLOCK", 0)), "rb") as file:
            data = file.read(most + 1)
    except OSError as error:
        raise _unopened(name, error) from None
    if data is None or len(data) > most:  # such as what the kernel shows of itself, whose size is told as 0
        raise DocumentError(name, f"is larger than {_size(most)}, the most that is read")
    return data


def read_text(path: str | Path, most: int, name: object = None) -> str:
    """The UTF-8 text of a regular file, without a byte order mark; see :func:`regular`."""
    try:
        return read_bytes(path, most, name).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise DocumentError(path if name is None else name, "is not UTF-8 text") from None


def _unopened(name: object, error: OSError) -> DocumentError:
    missing = isinstance(error, FileNotFoundError)
    return DocumentError(name, f"cannot be read: {error.strerror or error}", missing=missing)


def _size(most: int) -> str:
    return f"{most // 2**20} MiB"


# --- YAML ----------------------------------------------------------------------------------------------------------


def read_yaml(path: str | Path, name: object = None) -> Any:
    """What a YAML file holds: mappings, lists, words, numbers, dates.

    Args:
        path: of the file.
        name: for the message, such as ``the calibration x.yaml``; None: its path.

    Raises:
        DocumentError: it cannot be opened, is no YAML, has a key twice, or is beyond the bounds.
    """
    return parse_yaml(read_text(path, YAML_SIZE, name), path if name is None else name)


def read_mapping(path: str | Path) -> dict[str, Any]:
    """The mapping that a YAML file holds.

    Raises:
        DocumentError: as of :func:`read_yaml`, or it holds something else.
    """
    document = read_yaml(path)
    if not isinstance(document, dict):
        raise DocumentError(path, "holds no mapping")
    return document


def parse_yaml(text: str, name: object = "the text") -> Any:
    """What a YAML text holds; see :func:`read_yaml`."""
    if len(text) > YAML_SIZE:
        raise DocumentError(name, f"is larger than {_size(YAML_SIZE)}, the most that is read")
    loader: _Loader | None = None
    try:
        loader = _Loader(text)
        return loader.get_single_data()
    except _Fault as error:
        line = error.mark.line + 1
        raise DocumentError(name, f": {error}" if error.lines else f"in line {line} {error}", line) from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else None
        at = f" in line {line}" if line else ""
        raise DocumentError(name, f"is not valid YAML{at}: {error.problem or error.context}", line) from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise DocumentError(name, f"is not valid YAML in line {line}: {error.reason}", line) from None
    finally:
        if loader is not None:
            loader.dispose()


class _Fault(yaml.YAMLError):
    """What our own bounds say of a node; ``lines``: the message tells them itself."""

    def __init__(self, said: str, mark: yaml.Mark, lines: bool = False) -> None:
        super().__init__(said)
        self.mark, self.lines = mark, lines


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader, whose nodes are counted as they come."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = self._count = 0
        self._sizes: dict[int, int] = {}  # entries of whole nodes, by identity

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event: Any = self.peek_event()
        mark = event.start_mark
        if isinstance(event, yaml.AliasEvent):
            node = super().compose_node(parent, index)
            if id(node) not in self._sizes:
                raise _Fault(f"has *{event.anchor} within what it names", mark)
            self._counted(self._sizes[id(node)], mark)
            return node
        self._counted(1, mark)
        self._depth += 1
        if self._depth > DEPTH:
            raise _Fault(f"is nested more than {DEPTH} deep, the most that is read", mark)
        before = self._count - 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        if node is not None:
            self._sizes[id(node)] = self._count - before
            tag = node.tag.removeprefix("tag:yaml.org,2002:")
            if tag not in TAGS:
                raise _Fault(f"has the tag {node.tag}, which is not read: write plain numbers and words", mark)
        if isinstance(node, yaml.MappingNode):
            _refuse_twice(node)
        return node

    def _counted(self, more: int, mark: yaml.Mark) -> None:
        self._count += more
        if self._count > ENTRIES:
            raise _Fault(f"has more than {ENTRIES} entries, the most that are read, with all that aliases repeat", mark)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if isinstance(node, yaml.ScalarNode):
            kind = node.tag.rpartition(":")[2]
            if kind in ("int", "float") and len(node.value) > DIGITS:
                raise _Fault(f"has a number of {len(node.value)} digits", node.start_mark)
            if kind == "str" and SURROGATE.search(node.value):
                raise _Fault("has an escape that stands for no letter", node.start_mark)
        try:
            return super().construct_object(node, deep)
        except (ValueError, OverflowError, TypeError, LookupError, AttributeError):
            # such as the 31st of February, or a tag that says what the text is not
            shown = f"'{node.value[:40]}'" if isinstance(node, yaml.ScalarNode) else "an entry"
            raise _Fault(f"has {shown}, which is no {node.tag.rpartition(':')[2]}", node.start_mark) from None


def _refuse_twice(node: yaml.MappingNode) -> None:
    """Refuse the first key that stands twice in a mapping."""
    lines: dict[str, int] = {}
    for key, _ in node.value:
        line = key.start_mark.line + 1
        if not isinstance(key, yaml.ScalarNode) or key.value == "<<":  # several may be merged in
            continue
        if key.value in lines:
            where = f"in line {line}" if lines[key.value] == line else f"in lines {lines[key.value]} and {line}"
            said = f"'{key.value}' stands twice, {where}; keep one, or give the other another name"
            raise _Fault(said, key.start_mark, lines=True)
        lines[key.value] = line


# --- JSON ----------------------------------------------------------------------------------------------------------


def read_json(path: str | Path, most: int = JSON_SIZE, name: object = None) -> Any:
    """What a JSON file holds.

    Args:
        path: of the file.
        most: size up to which it is read [B].
        name: for the message; None: its path.

    Raises:
        DocumentError: it cannot be opened, is no JSON, or is beyond the bounds.
    """
    return parse_json(read_text(path, most, name), path if name is None else name)


def parse_json(text: str | bytes, name: object = "the text") -> Any:
    """What a JSON text, or a line of one, holds; see :func:`read_json`."""
    deep = DocumentError(name, f"is nested more than {DEPTH} deep, the most that is read")
    try:
        text = text if isinstance(text, str) else text.decode("utf-8")
        content = json.loads(text, parse_int=_whole)
    except UnicodeDecodeError:
        raise DocumentError(name, "is not UTF-8 text") from None
    except json.JSONDecodeError as error:
        raise DocumentError(name, f"is not valid JSON in line {error.lineno}: {error.msg}", error.lineno) from None
    except RecursionError:
        raise deep from None
    except ValueError as error:
        raise DocumentError(name, str(error)) from None
    escaped = ESCAPED.search(text) is not None
    level: list[Any] = [content]
    for _ in range(DEPTH + 2):
        if escaped and any(isinstance(item, str) and SURROGATE.search(item) for item in level):
            raise DocumentError(name, "has an escape that stands for no letter")
        level = [item for inner in level if isinstance(inner, dict | list) for item in _inside(inner, escaped)]
        if not level:
            return content
    raise deep


def _inside(content: dict[str, Any] | list[Any], words: bool) -> Iterator[Any]:
    """Containers in a container; with ``words``, its words and keys, too."""
    kinds = (dict, list, str) if words else (dict, list)
    values = content.values() if isinstance(content, dict) else content
    yield from (value for value in values if isinstance(value, kinds))
    if words and isinstance(content, dict):
        yield from content


def _whole(digits: str) -> int:
    if len(digits) > DIGITS:
        raise ValueError(f"has a number of {len(digits)} digits")
    return int(digits)


# --- XML -----------------------------------------------------------------------------------------------------------


def read_xml(path: str | Path) -> ElementTree.Element:
    """The root of an XML file.

    What MuJoCo passes over is passed over: bytes before the declaration, zero bytes at the end, prefixes that nothing
    declares, two dashes in a comment, a bare ampersand.

    Raises:
        DocumentError: it cannot be opened, is no XML, declares a document type, or is beyond the bounds.
    """
    return parse_xml(read_bytes(path, XML_SIZE), path)


def parse_xml(data: bytes, name: object = "the text") -> ElementTree.Element:
    """The root of an XML text; see :func:`read_xml`."""
    text = data
    if not data.startswith(UTF_16):  # whose letters hold zero bytes
        text = data.removeprefix(codecs.BOM_UTF8).strip(b"\0 \t\r\n")
    skipped = data.partition(text)[0].count(b"\n") if text else 0
    for read in (text, _mended):
        try:
            return _parsed(read if isinstance(read, bytes) else read(text), name)
        except ElementTree.ParseError as error:
            line = error.position[0] + skipped
            said = DocumentError(name, f"is not valid XML in line {line}: {ErrorString(error.code)}", line)
            if error.code == errors.codes[errors.XML_ERROR_NO_ELEMENTS]:
                break
        except (ValueError, LookupError) as error:  # an encoding that there is none of
            if isinstance(error, DocumentError):
                raise
            said = DocumentError(name, f"is not valid XML: {error}")
            break
    raise said


def _parsed(text: bytes, name: object) -> ElementTree.Element:
    parser = ElementTree.XMLParser(target=_Tree(name))
    parser.feed(text)
    return parser.close()


class _Tree:
    """Builds a tree whose elements are counted as they come."""

    def __init__(self, name: object) -> None:
        self._name, self._depth, self._count = name, 0, 0
        builder = ElementTree.TreeBuilder()
        self._start: Callable[..., Any] = builder.start
        self._end: Callable[..., Any] = builder.end
        self.data, self.close = builder.data, builder.close

    def start(self, tag: str, attributes: Mapping[str, str]) -> Any:
        self._depth += 1
        self._count += 1
        if self._depth > XML_DEPTH:
            raise DocumentError(self._name, f"is nested more than {XML_DEPTH} deep, the most that is read")
        if self._count > ELEMENTS:
            raise DocumentError(self._name, f"has more than {ELEMENTS} elements, the most that are read")
        return self._start(tag, attributes)

    def end(self, tag: str) -> Any:
        self._depth -= 1
        return self._end(tag)

    def doctype(self, *_: Any) -> None:
        raise DocumentError(self._name, "declares a document type (<!DOCTYPE), which is not read; remove it")


def _mended(text: bytes) -> bytes:
    """The same without comments, with every prefix declared and bare ampersands escaped; lines stay where they are."""
    text = AMPERSAND.sub(b"&amp;", without_comments(text))
    found = TAG.search(text)
    if found is None:
        return text
    names = dict.fromkeys(PREFIXED.findall(text))
    new = [name for name in names if name not in (b"xml", b"xmlns") and b"xmlns:" + name not in found.group(1)]
    more = b"".join(b' xmlns:%s="urn:%s"' % (name, name) for name in new)
    return text[: found.start(1)] + more + text[found.start(1) :]


def without_comments(text: bytes) -> bytes:
    """An XML text without its comments; lines stay where they are."""
    at, parts = 0, []
    while (start := text.find(b"<!--", at)) >= 0 and (end := text.find(b"-->", start + 4)) >= 0:
        parts += [text[at:start], b"\n" * text.count(b"\n", start, end)]
        at = end + 3
    return b"".join([*parts, text[at:]])


# --- arrays --------------------------------------------------------------------------------------------------------


def load_arrays(path: str | Path, most: int, name: object = None) -> dict[str, np.ndarray | None]:
    """The arrays of a file of named arrays (``.npz``); None for one of Python objects, which could run code.

    Args:
        path: of the file.
        most: size up to which all of them together are read, unpacked [B].
        name: for the message; None: its path.

    Raises:
        DocumentError: it cannot be opened, is no such file, or is larger.
    """
    name = path if name is None else name
    regular(path, most, name)
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > most:
                raise DocumentError(name, f"unpacks to more than {_size(most)}, the most that is read")
        with np.load(path, allow_pickle=False) as file:
            return {key: _array(file, key) for key in file.files}
    except DocumentError:
        raise
    except Exception as error:  # numpy has no class of its own for what is none of its files
        raise DocumentError(name, f"is no file of named arrays (np.savez), or a damaged one: {error}") from None


def _array(file: Mapping[str, np.ndarray], key: str) -> np.ndarray | None:
    try:
        found = file[key]
    except ValueError as error:
        if "pickle" not in str(error):
            raise
        return None
    return found if isinstance(found, np.ndarray) else None
