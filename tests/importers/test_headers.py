"""What the import makes of headers, one a row of ``headers.yaml``, and of names, one a line of ``names.yaml``."""

from __future__ import annotations

import re
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import pytest
import yaml
from sealegs.gap.log.importers import propose_for
from sealegs.gap.log.importers.names import said

from benchmarks import import_headers
from benchmarks.import_headers import columns_of, motions, written

HERE = Path(__file__).parent
RAD = "time_s: t; goal_rad: g; pos_rad: p"
VALUES = motions()


def cases() -> list[Any]:
    """Each header as a case, of several forms each of them."""
    found = []
    for case in yaml.safe_load((HERE / "headers.yaml").read_text(encoding="utf-8")):
        for form in case.get("forms", [""]):
            name = f"{case['test']} [{form}]" if form else case["test"]
            found.append(pytest.param(case, form, id=name.replace(" ", "-")))
    return found


def in_form(text: str, form: str) -> str:
    """A text whose ``<word>`` is the form with that word in it; of a form with ``{{}}`` ``<1>`` is its second joint."""
    own = form.replace("{{}}", "{}")

    def filled(match: re.Match[str]) -> str:
        return own.format(match[1]) if match[1] and "{}" in own else own

    return re.sub(r"<(\w*)>", filled, text) if form else text


@pytest.mark.parametrize(("case", "form"), cases())
def test_a_header_is_claimed_and_asked_about_as_its_row_says(case: dict[str, Any], form: str, tmp_path: Path) -> None:
    source = written(tmp_path, "run.csv", columns_of(in_form(case["header"].replace("RAD", RAD), form), VALUES))
    found = propose_for(source, tmp_path / "out", case.get("unit"))
    lines, text = found.mapping.columns, " ".join(found.text.replace("#", "").replace("''", "'").split())
    for column, line in case.get("lines", {}).items():
        assert fnmatchcase(lines.get(column) or "-", pattern(in_form(line or "-", form))), text
    asked = {name for question in found.mapping.questions for name in question.about}
    if (wanted := case.get("asked", [])) != "any":
        assert len(asked) == len(wanted) or wanted == ["joint.*"], text
        assert all(any(fnmatchcase(name, one) for name in asked) for one in wanted), text
    assert {name.rpartition(".")[2] for name in lines} >= set(case.get("has", []))
    for words in listed(case.get("says", [])):
        assert in_form(words, form) in text, text
    for words in listed(case.get("silent", [])):
        assert words not in text


def pattern(line: str) -> str:
    """A line as a pattern: ``...`` stands for anything, and brackets for themselves."""
    return line.replace("[", "[[]").replace("*", "[*]").replace("...", "*")


def listed(words: Any) -> list[str]:
    return [words] if isinstance(words, str) else [str(one) for one in words]


def names() -> list[tuple[str, str, str, str]]:
    """Name of a column, and signal, joint and unit that it says."""
    content = yaml.safe_load((HERE / "names.yaml").read_text(encoding="utf-8"))
    return [(name, *map(str, meant)) for name, meant in content.items()]  # type: ignore[misc]


@pytest.mark.parametrize(("name", "signal", "joint", "unit"), names())
def test_a_name_says_its_signal_its_joint_and_its_unit(name: str, signal: str, joint: str, unit: str) -> None:
    found = said(name)
    assert (found.signal or found.aside, found.joint, found.unit) == (signal, joint, unit)


@pytest.mark.long
def test_no_column_of_the_collected_headers_is_read_otherwise_than_before(capsys: pytest.CaptureFixture[str]) -> None:
    """Four in five that were understood still are; ``python -m benchmarks.import_headers`` tells which."""
    assert import_headers.main([]) == 0
    counted = re.search(r"(\d+) of (\d+) columns understood as before", capsys.readouterr().out)
    assert counted and int(counted[1]) >= 0.8 * int(counted[2])
