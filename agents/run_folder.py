"""One folder per training run: never overwritten, and usable after a kill at any moment.

config.yaml      resolved config; what a resumed run reads
actuators.yaml   copies of the chains, so that later changes of their files do not reach the run
sources.json     digests of the files of robot and task, which a resumed run compares
run.json         git revision, versions, and each session with its command line
tensorboard/     event files
servo.md         how hard the final policy drives the servos
evaluations.npz  as EvalCallback writes them
checkpoints/     <steps>/: policy, learner with normaliser, replay buffer (safetensors), state
best/, final/    policy.safetensors, policy.json, policy.onnx; model.zip, vecnormalize.pkl for users of SB3 alone
video.mp4
"""

from __future__ import annotations

import contextlib
import datetime
import hashlib
import importlib.metadata
import json
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from ..common.atomic import finish_replacements, folder_written, fresh, write_text
from ..common.documents import DocumentError, read_json, read_mapping, read_yaml
from ..common.errors import SealegsError
from ..envs.any_robot.user import file_of, is_user_task
from ..envs.described.model_sources import files_read
from ..envs.described.robot_described import RobotFile
from ..envs.engine.batch import BatchEngine
from ..envs.engine.sb3 import BatchVecEnv

try:
    import fcntl
except ImportError:  # Windows has no such lock
    fcntl = None

REPOSITORY = Path(__file__).resolve().parents[1]


class Busy(SealegsError):
    """Another process trains in the folder."""


class RunFolder:
    """Folder of a run, locked while a process trains in it.

    Attributes:
        path: the folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = open(path / ".lock", "w")  # noqa: SIM115 held until the process ends
        if fcntl:
            try:
                fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise Busy(f"Another process is training in {path}: wait for it, or stop it.") from error
        for folder in (path, path / "checkpoints"):
            finish_replacements(folder)

    def close(self) -> None:
        """Let other processes train in the folder."""
        self._lock.close()

    @classmethod
    def create(cls, out: Path, label: str, name: str | None) -> RunFolder:
        """New folder ``out/<name>``, or ``out/<label>-<time>`` without a name.

        Raises:
            SealegsError: the name is taken, or is a path.
        """
        if name is not None and (name in ("", ".", "..") or Path(name).name != name):
            raise SealegsError(
                f"name={name} must be one word without '/'; the folder it is made in is given as out=<folder>."
            )
        for _ in range(100):  # another process may take a name that was free
            path = fresh(out, label) if name is None else out / name
            try:
                path.mkdir(parents=True)
                return cls(path)
            except FileExistsError as error:
                if name is not None:
                    raise SealegsError(
                        f"{path} exists, and a run is never overwritten: "
                        f"give another name, or go on with it by resume={path}."
                    ) from error
            except OSError as error:
                raise SealegsError(
                    f"{path} cannot be made ({error.strerror}): give another folder, out=<folder>."
                ) from error
        raise SealegsError(f"{out} has too many runs that start with {label}: give the run a name, name=<word>.")

    @classmethod
    def open(cls, path: Path) -> RunFolder:
        """Folder of an earlier run.

        Raises:
            SealegsError: there is no run, or another process trains in it.
        """
        if not (path / "config.yaml").is_file():
            beside = (
                sorted(run.parent.name for run in path.parent.glob("*/config.yaml")) if path.parent.is_dir() else []
            )
            there = f"; {path.parent} has {', '.join(beside[-5:])}" if beside else ""
            raise SealegsError(f"resume={path} is not a run folder (it has no config.yaml){there}.")
        return cls(path)

    def read_config(self) -> dict[str, Any]:
        """Resolved config that the run was started with."""
        return self.read_yaml("config.yaml")

    def read_yaml(self, name: str) -> dict[str, Any]:
        """Mapping that one of the run's YAML files holds.

        Raises:
            SealegsError: the file is gone, or was damaged.
        """
        file = self.path / name
        try:
            return read_mapping(file)
        except DocumentError as error:
            raise SealegsError(f"{file}, which the run needs to go on, {error.problem}.") from error

    def write_text(self, name: str, text: str) -> None:
        """Write a file as a whole or not at all."""
        write_text(self.path / name, text, replace=True)

    @contextlib.contextmanager
    def writing(self, name: str) -> Iterator[Path]:
        """Folder to write into, which becomes ``<run>/<name>`` when the block ends, as a whole or not at all.

        An older folder of that name stays until the new one is complete.
        """
        with folder_written(self.path / name, replace=True) as folder:
            yield folder

    def record_session(self, from_step: int) -> None:
        """Append this session to ``run.json``: command line, time, git revision, versions."""
        record = self._sessions()
        record["sessions"].append(
            {
                "command": shlex.join([Path(sys.executable).name, *sys.argv]),
                "started": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
                "from_step": from_step,
                "git": git_revision(),
                "python": platform.python_version(),
                "platform": platform.platform(),
                "packages": {
                    d.name: d.version for d in sorted(importlib.metadata.distributions(), key=lambda d: d.name)
                },
            }
        )
        self.write_text("run.json", json.dumps(record, indent=2))

    def _sessions(self) -> dict[str, Any]:
        """Content of ``run.json``. A damaged file is set aside: a run can go on without its history."""
        file = self.path / "run.json"
        if not file.is_file():
            return {"sessions": []}
        try:
            record = read_json(file)
            if isinstance(record["sessions"], list):
                return record
        except (ValueError, LookupError, TypeError):
            pass
        aside = next(path for k in range(1, 1000) if not (path := self.path / f"run.damaged-{k}.json").exists())
        file.rename(aside)
        print(f"{file} is damaged: it is kept as {aside.name}, and a new one begins.", file=sys.stderr)
        return {"sessions": []}


def git_revision(*paths: str) -> dict[str, Any]:
    """Commit of the code (of these paths), and whether it has changes since; both None outside a git checkout.

    A repository that contains the environment in which sealegs is installed does not count as its checkout.
    """

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(REPOSITORY), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=20).stdout.strip()

    try:
        if Path(git("rev-parse", "--show-toplevel")).resolve() != REPOSITORY:
            return {"revision": None, "changed": None}
        commit, changed = git("log", "-1", "--format=%H", "--", *paths), git("status", "--porcelain", "--", *paths)
        return {"revision": commit, "changed": bool(changed)}
    except (OSError, subprocess.SubprocessError):
        return {"revision": None, "changed": None}


# --- what a run learns from: digests of the files of its robot and its own task, and copies of its actuation chains --
#
# With other files it would be another run; later changes of the file of a chain or net do not reach it.

SOURCES_FILE, CHAINS_FILE = "sources.json", "actuators.yaml"


def write_sources(run: RunFolder, env_id: str, env: BatchVecEnv) -> None:
    """Write ``sources.json``."""
    run.write_text(SOURCES_FILE, json.dumps(_digests(env_id, env), indent=2))


def check_sources(run: RunFolder, env_id: str, env: BatchVecEnv) -> None:
    """Refuse to go on with files that have changed; a run of an earlier version has no digests, and goes on.

    Raises:
        SealegsError: a file is another than the run began with; the message names it.
    """
    if not (run.path / SOURCES_FILE).is_file():
        return
    before, now = run.read_yaml(SOURCES_FILE), _digests(env_id, env)
    if sorted(map(str, before.values())) == sorted(now.values()):  # the same files, perhaps in another place
        return
    changed = sorted(path for path in {**before, **now} if before.get(path) != now.get(path))
    if changed:
        verb = "have" if len(changed) > 1 else "has"
        raise SealegsError(
            f"{', '.join(changed)} {verb} changed since {run.path} began, and a run keeps its robot and task: start a "
            "new run, or put back what was there."
        )


def _digests(env_id: str, env: BatchVecEnv) -> dict[str, str]:
    """By path, of the files of a task and of its robot; what is part of the package has none."""
    files = [file_of(env_id)] if is_user_task(env_id) else []
    robot = env.engine.task.robot.file
    said = {}
    if robot is not None:
        files += files_read([str(robot.model.path)])
        said = {} if robot.path == robot.model.path else {str(robot.path.resolve()): _said(robot)}
    return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files} | said


def _said(robot: RobotFile) -> str:
    """Digest of what a robot's YAML says to a training: not of servos, nor of chains, which a run has copies of."""
    document = dict(read_yaml(robot.path))
    document.pop("deploy", None)
    joints = document.get("joints") or {}
    document["joints"] = {name: _of_joint(row or {}) for name, row in joints.items()}
    return hashlib.sha256(json.dumps(document, sort_keys=True, default=str).encode()).hexdigest()


def _of_joint(row: Mapping[str, Any]) -> dict[str, Any]:
    # whether there is a chain decides whose numbers count
    kept = {key: value for key, value in row.items() if key not in ("chain", "servo", "unknown")}
    return {**kept, "chain": row.get("chain") is not None}


# --- chains ----------------------------------------------------------------------------------------------------------


def chains(engine: BatchEngine) -> dict[str, list[dict[str, Any]]]:
    """Stages of the chain on each joint, whatever name or path was given."""
    return {name: chain.to_list() for name, chain in engine.chains.items()}


def write_chains(run: RunFolder, env: BatchVecEnv) -> None:
    """Write ``actuators.yaml``, and copies of the nets that the chains name."""
    kept = chains(env.engine)
    for joint, net in _nets(kept):
        original = Path(net["file"])
        net["file"] = f"{joint}-{original.name}"
        shutil.copyfile(original, run.path / net["file"])
    run.write_text(CHAINS_FILE, yaml.safe_dump(kept, sort_keys=False))


def read_chains(run: RunFolder) -> dict[str, Any]:
    """Chains by joint, as an environment takes them.

    Raises:
        SealegsError: the file is gone, or was damaged.
    """
    kept = run.read_yaml(CHAINS_FILE)
    for _, net in _nets(kept):
        if Path(str(net["file"])).name != net["file"]:
            raise SealegsError(f"{run.path / CHAINS_FILE} names the net {net['file']}; a run's nets lie in its folder.")
        net["file"] = str((run.path / net["file"]).resolve())
    return kept


def _nets(kept: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    return [
        (joint, stage["net"])
        for joint, stages in kept.items()
        for stage in (stages if isinstance(stages, list) else [])
        if isinstance(stage, dict) and isinstance(stage.get("net"), dict) and "file" in stage["net"]
    ]
