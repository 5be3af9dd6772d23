"""Compiled laws: kept once per version of what they say, wherever there is a place to keep them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from sealegs.actuators import compiled as compiling
from sealegs.actuators import law
from sealegs.gap.replay import simulator

MODULE = '''"""A law."""

from .numbers import FACTOR
from sealegs.actuators.compiled import Compiler

compiled = Compiler("a small law", "a moment")


@compiled()
def law(x):
    """Twice as much."""
    return FACTOR * x  # or thrice
'''
RUN = "import small.law, sys; print(small.law.law(float(sys.argv[1])), len(small.law.law.stats.cache_misses))"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package with a small law and a number in a file of its own."""
    folder = tmp_path / "small"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "numbers.py").write_text("FACTOR = 2.0\n")
    (folder / "law.py").write_text(MODULE)
    return folder


def start(package: Path, value: float = 3.0) -> subprocess.Popen[str]:
    """A process that calls the law and prints its value and how often nothing was found on disk."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(package.parent / "cache"), "PYTHONPATH": str(package.parent)}
    return subprocess.Popen(
        [sys.executable, "-c", RUN, str(value)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process: subprocess.Popen[str]) -> tuple[float, int, str]:
    """Value of the law, how often it was compiled, and what a person was told."""
    out, error = process.communicate()
    assert process.returncode == 0, error
    value, misses = out.split()
    return float(value), int(misses), error


@pytest.mark.long
def test_the_first_compilation_says_what_it_does_and_the_next_process_finds_it_done(package):
    value, misses, told = finish(start(package))
    assert (value, misses) == (6.0, 1)
    assert told == "Compiling a small law once (a moment) ...\n"
    assert finish(start(package)) == (6.0, 0, "")


@pytest.mark.long
def test_processes_that_compile_at_once_all_get_their_own_result(package):
    values = (1.0, 2.0, 3.0)
    running = [start(package, value) for value in values]
    assert [finish(process)[0] for process in running] == [2.0 * value for value in values]
    assert finish(start(package)) == (6.0, 0, "")


@pytest.mark.long
def test_a_comment_a_docstring_and_a_line_further_down_compile_nothing_anew(package):
    assert finish(start(package))[1] == 1
    text = MODULE.replace("# or thrice", "# or not").replace("Twice as much.", "Double.").replace("@", "\n\n\n@")
    (package / "law.py").write_text(text)
    assert finish(start(package)) == (6.0, 0, "")


@pytest.mark.long
def test_a_changed_number_in_a_file_that_the_law_imports_compiles_it_anew(package):
    assert finish(start(package))[0] == 6.0
    (package / "numbers.py").write_text("FACTOR = 5.0\n")
    assert finish(start(package))[:2] == (15.0, 1)


@pytest.mark.long
def test_without_a_writable_package_folder_the_laws_are_kept_in_the_cache_of_the_user(tmp_path):
    run = (
        "import tempfile\n"
        "def refuse(**where): raise PermissionError\n"
        "tempfile.TemporaryFile = refuse\n"
        "from sealegs.actuators import compiled\n"
        "assert compiled.folder() == compiled.user_folder()\n"
        "print(compiled.folder())"
    )
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    environment["XDG_CACHE_HOME"] = str(tmp_path)
    done = subprocess.run([sys.executable, "-c", run], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    if sys.platform.startswith("linux"):
        assert Path(done.stdout.strip()) == tmp_path / "sealegs"


def test_the_laws_depend_on_their_stages_and_on_nothing_that_they_are_used_by():
    files = {path.name for path in compiling.imported(Path(law.__file__))}
    assert {"law.py", "layout.py", "friction.py", "motor.py"} <= files
    assert not files & {"simulator.py", "engine.py", "chain.py", "joint_model.py"}
    assert {"law.py", "friction.py", "constants.py"} <= {
        path.name for path in compiling.imported(Path(simulator.__file__))
    }
