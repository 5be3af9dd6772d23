"""Documents that people give are read within bounds, by one reader: none hangs, none ends in a traceback."""

from __future__ import annotations

import ast
import io
import os
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.common.documents import (
    DEPTH,
    XML_DEPTH,
    DocumentError,
    load_arrays,
    parse_json,
    parse_xml,
    parse_yaml,
    read_json,
    read_xml,
    read_yaml,
)
from sealegs.envs.described.model_file import read_model
from sealegs.envs.engine.numbers import RobotError
from sealegs.gap.log.importers.readers import read_recordings
from sealegs.gap.log.types import LogError

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ("actuators", "agents", "commands", "common", "configs", "envs", "evaluation", "gap", "hw")
ALLOWED = {
    "common/documents.py": "the reader itself",
    "gap/output/mjcf.py": "what MuJoCo wrote",
    "gap/output/robot_mjcf.py": "what MuJoCo wrote",
    "hw/guard/supervision.py": "what the loop says through its own pipe",
}
"""Files that may call a parser, and of what."""
PARSERS = {
    "yaml": ("load", "safe_load", "load_all", "safe_load_all", "full_load", "unsafe_load"),
    "json": ("load", "loads"),
    "ElementTree": ("parse", "fromstring", "XML", "iterparse"),
    "np": ("load",),
}
CALL = re.compile(r"\.(\w*load\w*|parse|fromstring|XML|iterparse)\(")
ALIASES = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{b}: &{b} [{','.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
LAUGHS = b'<!DOCTYPE a [<!ENTITY a "ha"><!ENTITY b "' + b"&a;" * 1000 + b'">]><a>&b;</a>'


@pytest.mark.parametrize(
    ("parse", "text", "said"),
    [
        (parse_yaml, ALIASES, "in line 5 has more than 50000 entries"),
        (parse_yaml, "[" * 20_000, f"is nested more than {DEPTH} deep"),
        (parse_yaml, "&a [*a]", "within what it names"),
        (parse_yaml, "- a\n" * 100_000, "more than 50000 entries"),
        (parse_yaml, "a: 1\nb: 2\na: 3", "'a' stands twice, in lines 1 and 3"),
        (parse_yaml, "a: 2001-02-31", "in line 1 has '2001-02-31', which is no timestamp"),
        (parse_yaml, "a: " + "9" * 5000, "has a number of 5000 digits"),
        (parse_yaml, "a: !!python/object/apply:os.system [true]", "has the tag"),
        (parse_yaml, "a: !!binary aGk=", "has the tag"),
        (parse_yaml, '\na: "\\ud800"', "in line 2 has an escape that stands for no letter"),
        (parse_yaml, "a: b\n\0", "is not valid YAML in line 2"),
        (parse_yaml, "a: [1\nb: 2", "is not valid YAML in line 2"),
        (parse_yaml, "#" * (2**20 + 1), "larger than 1 MiB"),
        (parse_json, "[" * 20_000, "is nested more than"),
        (parse_json, "[" * 900 + "]" * 900, "is nested more than"),
        (parse_json, '[{"a\\u0000": 1}]', "has an escape that stands for no letter"),
        (parse_json, "9" * 5000, "has a number of 5000 digits"),
        (parse_json, "[1,\n2", "is not valid JSON in line 2"),
        (parse_json, b"\xff", "is not UTF-8 text"),
        (parse_xml, LAUGHS, "declares a document type"),
        (parse_xml, b"<a>" * 20_000, f"is nested more than {XML_DEPTH} deep"),
        (parse_xml, b"<a>" + b"<b/>" * 300_000 + b"</a>", "has more than 200000 elements"),
        (parse_xml, b"<a>\n<b></a>", "is not valid XML in line 2: mismatched tag"),
        (parse_xml, b"<!--" * 1_000_000, "is not valid XML"),
        (parse_xml, b"", "is not valid XML"),
    ],
    ids=lambda value: value.__name__ if callable(value) else str(value)[:20],
)
def test_what_is_beyond_the_bounds_is_refused_in_a_sentence(parse: Callable[..., Any], text: Any, said: str) -> None:
    with pytest.raises(DocumentError, match=said) as refusal:
        parse(text)
    assert "\n" not in str(refusal.value)


def test_plain_documents_are_read_as_ever() -> None:
    said = parse_yaml("\ufeffa: &a {x: 1.5, y: .inf}\nb: {<<: *a, y: null}\nc: [on, 'on', 2024-02-29, 1e5]\n")
    assert said["a"] == {"x": 1.5, "y": float("inf")} and said["b"] == {"x": 1.5, "y": None}
    assert said["c"][:2] == [True, "on"] and said["c"][2].year == 2024 and said["c"][3] == "1e5"
    assert parse_json('{"a": [1, 1e999, "\\ud83d\\ude00"]}') == {"a": [1, float("inf"), "\U0001f600"]}


def test_xml_that_mujoco_reads_is_read() -> None:
    text = b"\n<?xml version='1.0'?><!-- legs -- and arms --><a x='1 & 2' q:y='3'><q:b/><c/></a>\0\0"
    root = parse_xml(text)
    assert root.get("x") == "1 & 2" and root.find("c") is not None


@pytest.mark.parametrize("read", [read_yaml, read_json, read_xml])
def test_a_device_a_pipe_and_a_folder_are_refused_at_once(read: Callable[[Path], Any], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (Path("/dev/zero"), tmp_path / "pipe", tmp_path, tmp_path / "none"):
        with pytest.raises(DocumentError, match=rf"{path} (is a device or a pipe|cannot be read)"):
            read(path)


def test_arrays_that_unpack_to_more_than_is_read_are_refused(tmp_path: Path) -> None:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**6,)})
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("weights.npy", header.getvalue() + b"\0" * 8 * 10**6)
    with pytest.raises(DocumentError, match="unpacks to more than 1 MiB"):
        load_arrays(tmp_path / "bomb.npz", 2**20)
    assert len(load_arrays(tmp_path / "bomb.npz", 2**24)["weights"]) == 10**6  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("model", "said"),
    [
        ('<mujoco><include file="part.xml"/></mujoco>', "part.xml includes itself"),
        ('<mujoco><asset><mesh name="a" file="/dev/zero"/></asset></mujoco>', "/dev/zero is a device"),
        ('<mujoco><asset><texture type="2d" name="a" file="pipe"/></asset></mujoco>', "pipe is a device or a pipe"),
        ('<mujoco><include file="secret"/></mujoco>', "secret is no part of a model; its name must end in .xml"),
        ("<mujoco>" * 300, "nested more than"),
        (
            '<mujoco><worldbody><replicate count="1000000"><geom/></replicate></worldbody></mujoco>',
            "more than 50000 el",
        ),
        ('<mujoco><worldbody><flexcomp count="900 900 900"/></worldbody></mujoco>', "more than 50000 elements"),
        ('<mujoco><asset><hfield nrow="90000" ncol="90000"/></asset></mujoco>', "a <hfield> of more than"),
        ('<mujoco><size nkey="2000000000"/></mujoco>', "a <size> of more than 10000"),
    ],
)
def test_mujoco_opens_no_file_that_was_not_looked_at(model: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(model)
    (tmp_path / "part.xml").write_text('<mujocoinclude><include file="part.xml"/></mujocoinclude>')
    (tmp_path / "secret").write_text("password: 1234")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(RobotError, match=said) as refusal:
        read_model(tmp_path / "arm.xml")
    assert "password" not in str(refusal.value)


def test_models_that_attach_models_many_times_are_counted_as_written_out(tmp_path: Path) -> None:
    """A few short files, each of which attaches the next ten times, would stand for a hundred million bodies."""
    attach = "".join(f'<attach model="m" body="b" prefix="{k}"/>' for k in range(10))
    for k in range(8):
        inner = (
            f'<asset><model name="m" file="{k + 1}.xml"/></asset><worldbody><body name="b">{attach}</body></worldbody>'
        )
        (tmp_path / f"{k}.xml").write_text(f"<mujoco>{inner}</mujoco>")
    (tmp_path / "8.xml").write_text('<mujoco><worldbody><body name="b"><geom size="1"/></body></worldbody></mujoco>')
    with pytest.raises(RobotError, match="stands for more than 50000 elements"):
        read_model(tmp_path / "0.xml")


@pytest.mark.parametrize("word", ["1" * 50_000 + "x", "a" * 50_000 + "!"], ids=["digits", "letters"])
def test_a_long_word_of_a_table_takes_no_time(word: str, tmp_path: Path) -> None:
    """The time of a pattern grew with the square of a word: 50,000 digits took two minutes."""
    (tmp_path / "log.csv").write_text(f"time,{word}\n" + f"1,{word}\n2,{word}\n" * 10)
    with pytest.raises(LogError):
        read_recordings(tmp_path / "log.csv")


def test_no_other_file_of_the_package_calls_a_parser() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{call.lineno}"
        for part in PACKAGE
        for path in sorted((ROOT / part).rglob("*.py"))
        if str(path.relative_to(ROOT)) not in ALLOWED and CALL.search(text := path.read_text(encoding="utf-8"))
        for call in ast.walk(ast.parse(text))
        if isinstance(call, ast.Call) and _parses(call)
    ]
    assert not found, f"read documents by sealegs.common.documents instead: {', '.join(found)}"


def _parses(call: ast.Call) -> bool:
    """Whether a call is one of a parser; what the program itself just wrote is no document."""
    match call:
        case ast.Call(func=ast.Attribute(attr="loads"), args=[ast.Call(func=ast.Attribute(attr="dumps"))]):
            return False
        case ast.Call(func=ast.Attribute(value=ast.Name(id=module), attr=name)):
            return name in PARSERS.get(module, ())
    return False
