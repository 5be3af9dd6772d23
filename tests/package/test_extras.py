"""Without the optional packages the core works, and each command says which extra it lacks."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from sealegs.common.extras import CORE as BROUGHT
from sealegs.common.extras import EXTRAS, MissingPackage, needed_for

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
