"""Set-up: the commands, the pins, extras, help pages, and the structure of the package."""

from __future__ import annotations

import ast
import importlib.metadata
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
import sealegs
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from sealegs.common.extras import CORE as BROUGHT
from sealegs.common.extras import EXTRAS, MissingPackage, needed_for
from sealegs.envs.robots import NAMES

from tests.conftest import in_share

REPOSITORY = Path(__file__).resolve().parents[2]
NO_SCRIPTS = ("setup.py", "__init__.py", "__main__.py")
SCRIPTS = sorted(path.name for path in REPOSITORY.glob("*.py") if path.name not in NO_SCRIPTS)


def constraints() -> dict[str, str]:
    """Version of each pinned package."""
    lines = (REPOSITORY / "constraints.txt").read_text().splitlines()
    pins = (line.split("==") for line in lines if line and not line.startswith("#"))
    return {canonicalize_name(name): version for name, version in pins}


def needed() -> set[str]:
    """Packages that pyproject.toml asks for, and all that those which `make` installs bring along on this machine."""
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    extras = re.search(r"^EXTRAS := (.*)$", (REPOSITORY / "Makefile").read_text(), re.MULTILINE)
    assert extras
    found: set[str] = set()
    open_ends = [Requirement(line) for line in project["dependencies"]]
    for extra, lines in project["optional-dependencies"].items():
        if extra in extras[1].split():
            open_ends += [Requirement(line) for line in lines]
        else:
            found |= {canonicalize_name(Requirement(line).name) for line in lines}
    while open_ends:
        requirement = open_ends.pop()
        name = canonicalize_name(requirement.name)
        if name in found and not requirement.extras:
            continue
        found.add(name)
        for line in importlib.metadata.requires(name) or ():
            further = Requirement(line)
            wanted = [{"extra": extra} for extra in requirement.extras] or [{"extra": ""}]
            if further.marker is None or any(further.marker.evaluate(extra) for extra in wanted):
                open_ends.append(further)
    return found


def test_every_package_is_pinned() -> None:
    assert needed() <= set(constraints())


@pytest.mark.parametrize("name", ["mujoco", "numba", "gymnasium", "pydantic", "stable-baselines3"])
def test_what_an_older_release_lacks_has_a_floor_that_the_pin_is_above(name: str) -> None:
    """``pip install .`` was content with a MuJoCo that has no batches, and failed at the first environment."""
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    lines = [*project["dependencies"], *project["optional-dependencies"]["train"]]
    (asked,) = (r for r in map(Requirement, lines) if r.name == name)
    assert any(bound.operator == ">=" for bound in asked.specifier)
    assert asked.specifier.contains(constraints()[canonicalize_name(name)])


def test_the_pins_are_what_the_tests_run_with() -> None:
    here: dict[str, str] = {canonicalize_name(item.name): item.version for item in importlib.metadata.distributions()}
    wrong = {
        name: (version, here[name])
        for name, version in constraints().items()
        if name in here and here[name].partition("+")[0] != version
    }
    assert not wrong, "constraints.txt and .venv differ: run make setup"


@pytest.mark.parametrize("script", SCRIPTS)
def test_every_script_has_a_help_page(
    script: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [script, "--help"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(REPOSITORY / script), run_name="__main__")
    page = capsys.readouterr()
    assert not ended.value.code and not page.err
    assert f"sealegs {script.removesuffix('.py').replace('_', '-')}" in page.out
    assert "\n  robot=" not in page.out or all(name in page.out for name in NAMES)


def test_make_help_lists_every_command() -> None:
    makefile = (REPOSITORY / "Makefile").read_text()
    phony = re.search(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)
    assert phony
    page = subprocess.run(
        ["make", "--no-print-directory", "help"], cwd=REPOSITORY, capture_output=True, text=True, check=True
    ).stdout
    assert [line.split()[1] for line in page.splitlines()] == phony.group(1).split()


def test_make_clean_keeps_what_was_recorded(tmp_path: Path) -> None:
    shutil.copy(REPOSITORY / "Makefile", tmp_path)
    kept = [tmp_path / "runs" / "first" / "config.yaml", tmp_path / "logs" / "bench.csv"]
    removed = [tmp_path / ".venv" / "pyvenv.cfg", tmp_path / "gap" / "__pycache__" / "log.pyc"]
    for file in [*kept, *removed]:
        file.parent.mkdir(parents=True)
        file.touch()
    subprocess.run(["make", "clean"], cwd=tmp_path, capture_output=True, check=True)
    assert all(file.exists() for file in kept) and not any(file.exists() for file in removed)


def test_continuous_integration_runs_quick_tests_a_third_of_the_long_ones_and_on_sundays_an_eighth_of_the_longest() -> (
    None
):
    script = REPOSITORY / ".ci" / "run"
    assert script.stat().st_mode & 0o111
    lines = [line.strip() for line in script.read_text().splitlines()]
    weekly = 'make test-weekly SHARE="$((10#$(date +%V) % 8))/8"'
    daily = 'make test-all SHARE="$(($(date +%s) / 86400 % 3))/3"'
    assert lines[-5:] == ["make test", daily, 'if [ "$(date +%u)" = 7 ]; then', weekly, "fi"]
    makefile = (REPOSITORY / "Makefile").read_text()
    assert all(f'-m "{chosen}"' in makefile for chosen in ("not long", "long and not weekly"))
    assert "-m weekly $(if $(SHARE),--share $(SHARE))" in makefile
    assert '-m "long and not weekly" $(if $(SHARE),--share $(SHARE))' in makefile


def test_each_test_is_of_one_share(request: pytest.FixtureRequest) -> None:
    names = [item.nodeid for item in request.session.items]
    shares = [[name for name in names if in_share(name, f"{k}/4")] for k in range(4)]
    assert sorted(name for share in shares for name in share) == sorted(names)


@pytest.mark.long
def test_the_demo_never_writes_into_an_existing_folder(tmp_path: Path) -> None:
    (tmp_path / "kept").touch()
    command = [sys.executable, "demo.py", f"out={tmp_path}"]
    answer = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, timeout=60)
    assert answer.returncode == 2 and "nothing is overwritten" in answer.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


# --- how the package is built: no circles among its modules, and calls whose arguments a reader can tell apart -------

ROOT = Path(sealegs.__file__).parent
PARTS = (
    "actuators", "agents", "commands", "common", "configs", "envs", "evaluation", "gap", "hw", "papers",
)  # fmt: skip
MOST_POSITIONAL = 7


@cache
def sources() -> dict[str, tuple[Path, ast.Module]]:
    """File and tree of each module of the package, by its name."""
    found = {}
    for path in sorted(path for part in PARTS for path in (ROOT / part).rglob("*.py")):
        name = ".".join(("sealegs", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__")
        found[name] = (path, ast.parse(path.read_text()))
    return found


def imported(name: str) -> Iterator[str]:
    """Modules that a module names in an import, wherever in it and for whatever, types alone included."""
    path, tree = sources()[name]
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            start = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join((*start, *([node.module] if node.module else [])))
            for item in node.names:
                inside = f"{module}.{item.name}"
                yield inside if inside in sources() else module


def test_no_module_imports_itself_over_others_for_types_neither() -> None:
    graph = {name: [other for other in imported(name) if other in sources() and other != name] for name in sources()}
    assert sum(map(len, graph.values())) > 2000
    TopologicalSorter(graph).prepare()  # a circle raises CycleError, which names it


@pytest.mark.parametrize("part", PARTS)
def test_no_call_tells_more_than_seven_arguments_apart_by_their_order(part: str) -> None:
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno} {ast.unparse(node.func)}"
        for path, tree in sources().values()
        if path.is_relative_to(ROOT / part)
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and len(node.args) > MOST_POSITIONAL
    ]
    assert not found


# --- without the optional packages ------------------------------------------------------------------------------------


REPOSITORY = Path(__file__).resolve().parents[2]
DISTRIBUTIONS = {"sbx": "sbx-rl", "scservo_sdk": "feetech-servo-sdk", "serial": "pyserial"}
"""Where the name in ``import`` is another than that in ``pip install``."""
FAMILY = {"adafruit_extended_bus": "adafruit-extended-bus", "adafruit_": "adafruit-circuitpython-"}
"""The same by the beginning of the name, the first that fits."""


def distribution(package: str) -> str:
    """What ``pip install`` calls a package."""
    began = next((begin for begin in FAMILY if package.startswith(begin)), "")
    named = DISTRIBUTIONS.get(package, package.replace(began, FAMILY.get(began, "")) if began else package)
    return named.replace("_", "-")


CORE = f"""
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {[package for packages in EXTRAS.values() for package in packages]}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Missing())
"""


def without_extras(program: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run Python with the core dependencies only."""
    return subprocess.run(
        [sys.executable, "-c", CORE + program], cwd=folder, capture_output=True, text=True, timeout=600
    )


def test_the_table_of_extras_is_that_of_the_project() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    for extra, packages in EXTRAS.items():
        asked = {Requirement(line).name for line in project["optional-dependencies"][extra]}
        named = {distribution(package) for package in packages}
        assert named <= asked
    assert not {Requirement(line).name for line in project["dependencies"]} & {
        distribution(package) for packages in EXTRAS.values() for package in packages
    }


def test_a_command_in_an_installation_that_misses_a_package_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    imported = {"hydra-core": "hydra", "pyyaml": "yaml", "scikit-learn": "sklearn"}
    names = {Requirement(line).name for line in project["dependencies"]}
    assert {imported.get(name, name.replace("-", "_")) for name in names} == set(BROUGHT)
    monkeypatch.setitem(sys.modules, "pydantic", None)
    with pytest.raises(MissingPackage, match=r"the package pydantic.*install sealegs again"), needed_for("Flying"):
        import pydantic  # noqa: F401


@pytest.mark.long
def test_environments_need_the_core_only(tmp_path: Path) -> None:
    program = """
import gymnasium, sealegs
env = gymnasium.make("SeaLegs/Bench-v0", actuator="ideal")
env.reset(seed=0)
env.step(env.action_space.sample())
print(gymnasium.make_vec("SeaLegs/Bench-v0", num_envs=2, actuator="ideal").reset(seed=0)[0].shape)
"""
    answer = without_extras(program, tmp_path)
    assert answer.stdout.strip() == "(2, 6)", answer.stderr


@pytest.mark.parametrize(
    ("words", "extra"),
    [
        (["train", "env=bench"], "train"),
        (["deploy", "excitation=chirp"], "hw"),
        *(
            pytest.param(words, extra, marks=pytest.mark.long)
            for words, extra in (
                (["watch", f"policy={REPOSITORY / 'policies' / 'biped' / 'seed0'}"], "train"),
                (["demo"], "train"),
                (["train-net", "log=logs/none"], "train"),
                (["scan", "port=/dev/none"], "hw"),
                (["calibrate", "robot=bench", "port=/dev/none"], "hw"),
            )
        ),
    ],
)
def test_a_command_names_the_extra_that_it_lacks(words: list[str], extra: str, tmp_path: Path) -> None:
    answer = without_extras(f"from sealegs.commands.cli import main; sys.exit(main({words!r}))", tmp_path)
    assert answer.returncode == 2, answer.stderr
    assert f"pip install 'sealegs[{extra}]'" in answer.stderr and len(answer.stderr.splitlines()) == 1


@pytest.mark.long
def test_the_environment_for_stable_baselines3_names_its_extra(tmp_path: Path) -> None:
    answer = without_extras("import sealegs.envs.engine.sb3", tmp_path)
    assert "MissingPackage" in answer.stderr and "pip install 'sealegs[train]'" in answer.stderr


@pytest.mark.long
def test_a_diagnosis_needs_the_core_only_and_says_what_a_report_needs(tmp_path: Path) -> None:
    program = """
from pathlib import Path
from sealegs.commands.cli import main
from sealegs.gap.virtual.bench import record
record(Path("logs"), "sts3215", {}, excitations=("chirp", "steps", "slow triangle"))
sys.exit(main(["diagnose", "log=logs", "out=found"]))
"""
    answer = without_extras(program, tmp_path)
    assert answer.returncode == 0, answer.stderr
    assert (tmp_path / "found" / "diagnosis.json").is_file()
    assert "pip install 'sealegs[report]'" in " ".join(answer.stdout.split())
    assert not (tmp_path / "found" / "report.html").exists() and not (tmp_path / "found" / "pictures").exists()


def test_a_package_that_no_extra_brings_is_missing_as_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingPackage, match="Flying needs the package torch"), needed_for("Flying"):
        import torch  # noqa: F401
    with pytest.raises(ModuleNotFoundError, match="no_such_package"), needed_for("Flying"):
        import no_such_package  # pyright: ignore[reportMissingImports]  # noqa: F401
