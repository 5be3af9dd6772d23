"""An environment of its own in which only what pip installed is sealegs, and a folder of somebody else to work in."""

from __future__ import annotations

import os
import shutil
import site
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
PARTS = ("actuators", "agents", "commands", "common", "configs", "envs", "evaluation", "gap", "hw")
NAMES = (
    "envs",
    "agents",
    "configs",
    "gap",
    "hw",
    "actuators",
    "tests",
    "testbed",
    "benchmarks",
    "commands",
    "common",
    "docs",
)
"""Folders of the checkout, none of which may be a package of its own once installed."""


NO_CONFIG = "a stranger: [was read\n"


@dataclass(frozen=True)
class Stranger:
    """A virtual environment, and a folder whose own envs/, agents/ and configs/ must never be imported nor read.

    Attributes:
        root: of the environment.
        folder: to work in.
    """

    root: Path
    folder: Path

    @property
    def packages(self) -> Path:
        """Its site-packages."""
        return Path(sysconfig.get_path("purelib", vars={"base": str(self.root), "platbase": str(self.root)}))

    def run(self, *command: str, timeout: float = 120.0) -> subprocess.CompletedProcess[str]:
        """Run a program of the environment in the stranger's folder."""
        program = str(self.root / "bin" / command[0])
        kept = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")}
        return subprocess.run(
            [program, *command[1:]],
            cwd=self.folder,
            env={**kept, "PATH": f"{self.root / 'bin'}:{os.environ['PATH']}"},
            capture_output=True,
            text=True,
            timeout=timeout,
        )

    def done(self, *command: str, timeout: float = 120.0) -> str:
        """What a program that must succeed prints."""
        answer = self.run(*command, timeout=timeout)
        assert answer.returncode == 0, f"{' '.join(command)}\n{answer.stdout}\n{answer.stderr}"
        return answer.stdout

    def install(self, *arguments: str) -> None:
        """``pip install``, without looking for packages anywhere."""
        self.done("python", "-m", "pip", "install", "-q", "--no-index", "--no-build-isolation", *arguments, timeout=300)


def stranger(folder: Path) -> Stranger:
    """An environment with what sealegs depends on, but without sealegs.

    The packages are links to those that the tests run with, so nothing is downloaded.
    """
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder / "venv")], check=True, timeout=120)
    made = Stranger(folder / "venv", folder / "mine")
    borrowed = folder / "borrowed"
    borrowed.mkdir()
    for place in reversed(site.getsitepackages()):
        for item in Path(place).iterdir():
            if "sealegs" not in item.name and item.suffix != ".pth":
                (borrowed / item.name).unlink(missing_ok=True)
                (borrowed / item.name).symlink_to(item)
    (made.packages / "borrowed.pth").write_text(f"{borrowed}\n")
    for name in NAMES:
        (made.folder / name).mkdir(parents=True)
        (made.folder / name / "__init__.py").write_text("raise RuntimeError('a stranger was imported')\n")
    for script in (REPOSITORY / "configs").glob("*.yaml"):
        (made.folder / "configs" / script.name).write_text(NO_CONFIG)
    for group in ("actuator", "env", "robot"):
        (made.folder / "configs" / group).mkdir()
        for name in ("sts3215", "bench"):
            (made.folder / "configs" / group / f"{name}.yaml").write_text(NO_CONFIG)
    return made


def copied_checkout(folder: Path) -> Path:
    """The code of the checkout, its tests and benches included, so that a build leaves nothing behind in it."""
    for name in (*PARTS, "tests", "testbed", "benchmarks", "typings"):
        shutil.copytree(REPOSITORY / name, folder / name, ignore=shutil.ignore_patterns("__pycache__", "results"))
    for name in ("pyproject.toml", "README.md", "LICENSE", "py.typed"):
        shutil.copy(REPOSITORY / name, folder)
    for script in REPOSITORY.glob("*.py"):
        shutil.copy(script, folder)
    return folder


def built(source: Path, folder: Path, *arguments: str) -> Path:
    """The wheel of a folder or of a source distribution."""
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-index", "--no-build-isolation"]
    answer = subprocess.run(
        [*command, *arguments, "-w", str(folder), str(source)], capture_output=True, text=True, timeout=300
    )
    assert answer.returncode == 0, answer.stderr
    (wheel,) = folder.glob("*.whl")
    return wheel


def recorded(wheel_files: Sequence[str]) -> set[str]:
    """Top-level names in a wheel, metadata left out."""
    return {name.partition("/")[0] for name in wheel_files if ".dist-info/" not in name}
