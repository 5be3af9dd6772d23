"""What pip installs is one package that works from any folder, beside anybody's own envs, agents and configs."""

from __future__ import annotations

import json
import os
import shutil
import site
import subprocess
import sys
import sysconfig
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml
from sealegs.agents.policy_files import load_policy
from sealegs.commands.cli import COMMANDS

from tests.made_once import folder_made_once, made_once

REPOSITORY = Path(__file__).resolve().parents[2]
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


FOUND = "import sealegs, pathlib; print(pathlib.Path(sealegs.__file__).resolve().parent)"
ENVIRONMENTS = """
import multiprocessing, pickle, sys, warnings
import gymnasium, numpy as np, sealegs
from gymnasium.utils.env_checker import check_env as check_gymnasium
from sealegs.envs.engine.sb3 import BatchVecEnv
from stable_baselines3.common.env_checker import check_env as check_sb3
from stable_baselines3.common.vec_env import SubprocVecEnv

def make():
    return gymnasium.make("SeaLegs/Bench-v0", actuator="ideal")

if __name__ == "__main__":
    warnings.filterwarnings("ignore")
    for name in ("SeaLegs/Hopper-v0", "sealegs:SeaLegs/Hopper-v0", "SeaLegs/Bench-v0"):
        env = gymnasium.make(name)
        first, _ = env.reset(seed=1)
        many = gymnasium.make_vec(name, num_envs=2)
        assert (many.reset(seed=1)[0][0] == first).all()
    check_gymnasium(env.unwrapped, skip_render_check=True)
    check_sb3(env.unwrapped, skip_render_check=True)
    assert (pickle.loads(pickle.dumps(env.unwrapped)).reset(seed=1)[0] == first).all()
    alone = make().reset(seed=3)[0]
    side_by_side = gymnasium.vector.AsyncVectorEnv([make, make], context="spawn")
    assert (side_by_side.reset(seed=3)[0][0] == alone).all()
    side_by_side.close()
    spawned = SubprocVecEnv([make, make], start_method="spawn")
    spawned.seed(3)
    assert (spawned.reset()[0] == alone).all()
    spawned.close()
    batch = BatchVecEnv("SeaLegs/Bench-v0", 2, seed=3, actuator="ideal")
    assert (batch.reset()[0] == alone).all()
    assert not {"envs", "agents", "configs", "gap", "hw", "actuators"} & set(sys.modules)
    print("all of it")
"""


@pytest.fixture(scope="session")
def wheel() -> Path:
    folder = folder_made_once("wheel", lambda folder: built(copied_checkout(folder / "source"), folder))
    (made,) = folder.glob("*.whl")
    return made


@pytest.fixture(scope="session")
def installed(wheel: Path) -> Stranger:
    @made_once
    def made() -> Stranger:
        one = stranger(folder_made_once("stranger", lambda folder: None))
        one.install(str(wheel))
        return one

    return made()


def shipped() -> set[str]:
    """Files of the checkout that belong into the package, as they are called there."""
    kinds = (".py", ".yaml", ".xml", ".npz", ".j2", ".css", ".typed")
    names = {f"sealegs/{name}" for name in ("__init__.py", "__main__.py", "py.typed")}
    for part in PARTS:
        for file in (REPOSITORY / part).rglob("*"):
            if file.suffix in kinds or file.name == "py.typed":
                names.add(f"sealegs/{file.relative_to(REPOSITORY)}")
    return names


def test_the_wheel_holds_one_package_with_all_that_it_reads(wheel: Path) -> None:
    files = zipfile.ZipFile(wheel).namelist()
    assert recorded(files) == {"sealegs"}
    assert {name for name in files if ".dist-info/" not in name} == shipped()
    assert {"sealegs/py.typed", "sealegs/configs/train.yaml", "sealegs/hw/bus/registers/sts3215.yaml"} <= set(files)


@pytest.mark.long
def test_a_source_distribution_builds_the_same_wheel(wheel: Path, tmp_path: Path) -> None:
    source = copied_checkout(tmp_path / "source")
    build = f"from setuptools import build_meta; print(build_meta.build_sdist({str(tmp_path)!r}))"
    subprocess.run([sys.executable, "-c", build], cwd=source, check=True, capture_output=True, timeout=300)
    (archive,) = tmp_path.glob("*.tar.gz")
    again = built(archive, tmp_path)
    assert sorted(zipfile.ZipFile(again).namelist()) == sorted(zipfile.ZipFile(wheel).namelist())


@pytest.mark.long
def test_nothing_but_sealegs_is_installed(installed: Stranger) -> None:
    here = {path.name.partition(".")[0] for path in installed.packages.iterdir()}
    assert here - {"borrowed"} == {"sealegs", "sealegs-0"}
    assert not here & set(NAMES)
    assert (installed.packages / "sealegs" / "py.typed").is_file()
    assert installed.done("python", "-c", FOUND).strip() == str(installed.packages / "sealegs")


def test_import_loads_nothing_heavy(installed: Stranger) -> None:
    heavy = {"torch", "stable_baselines3", "mujoco", "numba", "matplotlib", "pandas", "pyarrow", "pydantic"}
    loaded = installed.done("python", "-c", "import sealegs, sys; print(*sys.modules)").split()
    assert not heavy & set(loaded)


@pytest.mark.long
@pytest.mark.parametrize("word", COMMANDS)
def test_every_command_has_its_help_page_anywhere(word: str, installed: Stranger) -> None:
    page = installed.done("sealegs", word, "--help")
    assert f"sealegs {word}" in page and "RuntimeError" not in page
    assert ("Keys and their defaults" in page) == bool(COMMANDS[word][1])


@pytest.mark.long
def test_a_command_reads_the_configs_of_the_package_and_the_paths_of_its_caller(installed: Stranger) -> None:
    answer = installed.run("sealegs", "diagnose", "log=logs/none")
    assert answer.returncode == 2 and "logs/none" in answer.stderr and "Traceback" not in answer.stderr
    answer = installed.run("sealegs", "diagnos")
    assert answer.returncode == 2 and "did you mean 'diagnose'" in answer.stderr


@pytest.mark.long
def test_an_editable_installation_is_the_checkout(tmp_path: Path) -> None:
    source, made = copied_checkout(tmp_path / "checkout"), stranger(tmp_path)
    made.install("-e", str(source))
    assert not {path.name for path in made.packages.iterdir()} & {"sealegs", *NAMES}
    assert made.done("python", "-c", FOUND).strip() == str(source)
    (source / "envs" / "fresh.py").write_text("LIVE = True\n")
    assert made.done("python", "-c", "from sealegs.envs.fresh import LIVE; print(LIVE)").strip() == "True"
    assert "Keys and their defaults" in made.done("sealegs", "train", "--help")


@pytest.mark.long
def test_environments_work_from_a_strangers_folder(installed: Stranger) -> None:
    (installed.folder / "main.py").write_text(ENVIRONMENTS)
    assert "all of it" in installed.done("python", "main.py", timeout=900)


PATIENT = ["hw.timeout=5", "robot.safety.late=5", "silence=30", "live=false"]
"""A busy computer is no fault of the package."""
STEPPED = ["hw.virtual.time=stepped", *PATIENT]


@pytest.fixture(scope="session")
def worked(installed: Stranger) -> Stranger:
    """The stranger, who has trained a policy (runs/first), measured (logs/mine) and diagnosed (found)."""

    def work(_: Path) -> None:
        small = ["n_envs=2", "agent.n_steps=64", "total_timesteps=128", "evaluate.episodes=2", "video.seconds=0"]
        installed.done("sealegs", "train", "env=bench", "name=first", *small, timeout=900)
        for excitation in ("chirp", "steps", "slow_triangle"):
            what = [f"excitation={excitation}", "duration=8", "out=logs/mine"]
            installed.done("sealegs", "deploy", *what, *STEPPED, timeout=900)
        few = "causes=[friction.coulomb,drive.delay]"
        installed.done("sealegs", "diagnose", "log=logs/mine", "out=found", few, timeout=1800)

    folder_made_once("stranger-worked", work)
    return installed


@pytest.mark.long
def test_training_deploying_and_diagnosing_work_from_a_strangers_folder(worked: Stranger) -> None:
    run = worked.folder / "runs" / "first"
    assert (run / "final" / "policy.onnx").is_file()
    session = json.loads((run / "run.json").read_text())["sessions"][0]
    assert session["git"] == {"revision": None, "changed": None}
    shutil.copytree(run, run.with_name("more"))
    worked.done("sealegs", "train", "resume=runs/more", "total_timesteps=256", timeout=900)
    worked.done("sealegs", "deploy", "policy=runs/first/final", "duration=1", "out=logs/run", *STEPPED, timeout=900)
    assert len(list((worked.folder / "logs" / "mine").glob("*.csv"))) == 3
    found = worked.folder / "found"
    assert (found / "diagnosis.json").is_file() and (found / "report.html").is_file()


@pytest.mark.long
def test_comparing_filming_and_learning_a_net_work_from_a_strangers_folder(worked: Stranger) -> None:
    policy = "policy=runs/first/final"
    both = [policy, "extended=found"]
    worked.done("sealegs", "evaluate", *both, "robot=bench", "seconds=2", "out=compared", *STEPPED, timeout=900)
    figures = json.loads((worked.folder / "compared" / "comparison.json").read_text())["figures"]
    assert figures.keys() == {"nominal", "extended", "machine"}
    worked.done("sealegs", "evaluate", "relevant", "robot=bench", "seconds=1", "tempos=[1]", "out=relevant")
    assert (worked.folder / "relevant" / "relevant.json").is_file()
    worked.done("sealegs", "train-net", "log=logs/mine", "epochs=1", "out=net", timeout=900)
    size = ["seconds=0.1", "width=64", "height=48"]
    worked.done("sealegs", "watch", *both, "out=film.mp4", *size, timeout=900)
    (worked.folder / "configs" / "actuator" / "own.yaml").write_text("- ideal: {stiffness: 2.0}\n")
    worked.done("sealegs", "watch", policy, "actuator=configs/actuator/own.yaml", "out=own.mp4", *size, timeout=900)
    assert all((worked.folder / film).stat().st_size > 1000 for film in ("film.mp4", "own.mp4"))


@pytest.mark.long
def test_the_loop_works_from_a_strangers_folder(worked: Stranger) -> None:
    """It goes on with a diagnosis that is there: that of a log of its own takes minutes."""
    shutil.copytree(worked.folder / "found", worked.folder / "looped" / "diagnosis")
    short = ["excitations=[hold]", "loads=[{mass:0.25,length:0.1}]", "further=0", "total_timesteps=1", "seconds=2"]
    patient = [item for item in PATIENT if item != "live=false"]
    worked.done("sealegs", "loop", "out=looped", *short, *patient, timeout=1800)
    made = {path.name for path in (worked.folder / "looped").iterdir()}
    assert {"log", "policy-nominal", "policy-extended", "comparison-nominal", "comparison-extended", "gap.png"} <= made


SCANNED = """
import subprocess, sys
from sealegs.hw.virtual import VirtualBus

with VirtualBus(robot="bench") as virtual:
    command = [sys.argv[1], "scan", f"port={virtual.port}", "baudrate=1000000", "last=3"]
    sys.exit(subprocess.run(command).returncode)
"""
CALIBRATED = """
import builtins, sys
import sealegs.hw.bus.servo_bus
from sealegs.commands.cli import main
from sealegs.hw.virtual import VirtualBus

class Bus(sealegs.hw.bus.servo_bus.ServoBus):
    def __init__(self, *arguments):
        super().__init__(*arguments, timeout=1.0)  # a busy computer is no fault of the package
        opened.append(self)

    def scan(self, ids=range(3)):
        return super().scan(ids)

def pushed(*angles):
    for angle in angles:
        opened[-1].torque_on([1])
        opened[-1].write_goals([1], [angle])
        virtual.advance(1.0)

opened, moves = [], [(0.0,), (0.5,), (-0.8, 0.8)]
sealegs.hw.bus.servo_bus.ServoBus = Bus
builtins.input = lambda question: pushed(*moves.pop(0)) or ""
with VirtualBus(time="stepped", cycle=0.0) as virtual:
    sys.exit(main(["calibrate", f"port={virtual.port}", "out=calibrations/own.yaml"]))
"""
"""A hand on a virtual bench: its servo, switched on for as long as the hand moves it."""


@pytest.mark.long
def test_calibrating_works_from_a_strangers_folder(installed: Stranger) -> None:
    (installed.folder / "calibrated.py").write_text(CALIBRATED)
    said = installed.done("python", "calibrated.py", timeout=900)
    assert "Written: calibrations/own.yaml" in said
    assert "joint" in yaml.safe_load((installed.folder / "calibrations" / "own.yaml").read_text())["joints"]


@pytest.mark.long
def test_characterising_and_scanning_work_from_a_strangers_folder(installed: Stranger) -> None:
    installed.done("sealegs", "characterize", "repeats=1", "out=bench", timeout=900)
    written = {path.name for path in (installed.folder / "bench").iterdir()}
    assert written == {"chain.yaml", "table.csv", "fit.json", "fit.png"}
    (installed.folder / "scanned.py").write_text(SCANNED)
    said = installed.done("python", "scanned.py", str(installed.root / "bin" / "sealegs"), timeout=900)
    assert "sts3215" in said


def test_the_policies_that_come_along_load() -> None:
    folders = sorted((REPOSITORY / "policies").glob("*/seed*"))
    kinds = {"arm", "biped", "biped_hopping", "hexapod", "hopper", "leg"}
    assert {folder.parent.name for folder in folders} == kinds
    for folder in folders:
        act, description = load_policy(folder)
        actions = act(np.zeros((2, *description["observation"]["shape"]), np.float32))
        assert actions.shape == (2, *description["action"]["shape"]) and np.isfinite(actions).all()


SCRIPTS = sorted(
    path.name for path in REPOSITORY.glob("*.py") if path.name not in ("setup.py", "__init__.py", "__main__.py")
)


@pytest.mark.parametrize("command", [[name] for name in SCRIPTS] + [["-m", "benchmarks"], ["-m", "benchmarks.hidden"]])
def test_without_the_environment_a_script_ends_in_a_sentence(command: list[str]) -> None:
    answer = subprocess.run(
        [sys.executable, "-I", "-S", "-c", RUN_BARE, str(REPOSITORY), *command],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert answer.returncode == 1
    assert len(answer.stderr.splitlines()) == 1 and "make setup" in answer.stderr


RUN_BARE = """
import runpy, sys
sys.path.insert(0, sys.argv[1])
if sys.argv[2] == "-m":
    runpy.run_module(sys.argv[3], run_name="__main__", alter_sys=True)
else:
    runpy.run_path(sys.argv[1] + "/" + sys.argv[2], run_name="__main__")
"""
"""A Python without any installed package, which runs a script of the checkout."""
