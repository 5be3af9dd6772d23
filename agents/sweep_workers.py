"""Where the trials of a sweep are trained: in processes of this machine, or on a Ray cluster.

A trial is a run of ``sealegs train``. One whose process or machine dies is begun once more and goes on from its newest
checkpoint. On a cluster all machines share the sweep's folder, and sealegs is installed on each.
"""

from __future__ import annotations

import contextlib
import importlib
import math
import multiprocessing
import os
import shutil
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol

from ..common.documents import read_json
from ..common.errors import SealegsError
from ..common.extras import needed_for
from ..common.plugins import environment
from ..common.processes import cores, exit_with_parent
from ..configs.script import Interrupted

MARK = "sweep.yaml"
"""By which a machine sees that it has the sweep's folder."""
STOPPING_SECONDS = 60.0  # [s] a trial has to write its checkpoint
LOCKED_SECONDS = 60.0  # [s] until the process of a machine that is gone lets its trial go
ATTEMPTS = 3
"""Times that a trial is begun whose process or machine dies."""


@dataclass(frozen=True)
class Trial:
    """One training: its number, the arguments of ``sealegs train``, and the sweep's folder."""

    number: int
    arguments: tuple[str, ...]
    sweep: Path

    @property
    def folder(self) -> Path:
        """Of its run, or of its seeds' runs."""
        return self.sweep / f"trial{self.number}"

    @property
    def log(self) -> Path:
        """What it prints."""
        return self.sweep / f"trial{self.number}.log"


@dataclass(frozen=True)
class Result:
    """How a trial ended: the mean reward of its final policy, or a sentence why there is none; neither where it was
    stopped."""

    reward: float | None = None
    error: str = ""


def learn(trial: Trial) -> Result:
    """Train, or go on with, a trial in this process."""
    from .config import read_config
    from .training import train

    folder = trial.folder
    try:
        if not (trial.sweep / MARK).is_file():
            raise SealegsError(
                f"{trial.sweep} is not on {os.uname().nodename}: give out=<a folder that all machines share>."
            )
        if (found := reward_of(folder)) is None:
            if begun(folder):
                arguments = [f"resume={folder}"]
            else:
                shutil.rmtree(folder, ignore_errors=True)  # of a start that was killed before its config was written
                arguments = [*trial.arguments, f"out={trial.sweep}", f"name={folder.name}"]
            train(read_config(arguments))
            found = reward_of(folder)
        if found is None or not math.isfinite(found):
            raise SealegsError(f"{folder} ended without a reward.")
        return Result(found)
    except Interrupted:
        return Result()
    except SealegsError as error:
        return Result(error=str(error))


def begun(folder: Path) -> bool:
    """Whether a trial can go on."""
    return (folder / "config.yaml").is_file() or (folder / "seeds.yaml").is_file()


def reward_of(folder: Path) -> float | None:
    """Mean reward of the final policy of a finished trial, over its seeds where it has several; None: not finished."""
    with contextlib.suppress(OSError, ValueError, LookupError, TypeError):
        if (folder / "seeds.json").is_file():
            return float(read_json(folder / "seeds.json")["interquartile_mean"]["final policy"]["mean"])
        return float(read_json(folder / "final" / "policy.json")["mean_reward"])
    return None


class Workers(Protocol):
    """What trains trials, several at a time."""

    size: int

    def submit(self, trial: Trial) -> Future[Result]:
        """Begin, or queue, a trial."""
        ...

    def stop(self) -> None:
        """Have running trials write a checkpoint and end."""
        ...


# --- processes of this machine ----------------------------------------------------------------------------------------


class Local:
    """A process for each trial: one that dies takes no other with it."""

    def __init__(self, size: int) -> None:
        self.size = size
        self._threads = ThreadPoolExecutor(size)
        self._running: set[Any] = set()
        self._stopping = threading.Event()

    def submit(self, trial: Trial) -> Future[Result]:
        """See :class:`Workers`."""
        return self._threads.submit(self._train, trial)

    def _train(self, trial: Trial) -> Result:
        context = multiprocessing.get_context("spawn")
        code: int | None = None
        for _ in range(ATTEMPTS):
            if self._stopping.is_set():
                return Result()
            ours, theirs = context.Pipe(duplex=False)
            process = context.Process(target=_work, args=(trial, theirs))
            process.start()
            self._running.add(process)
            theirs.close()
            try:
                return ours.recv()
            except (EOFError, OSError):
                process.join()
                code = process.exitcode
                if code is None or code >= 0:  # a bug, which comes again
                    break
            finally:
                process.join()
                self._running.discard(process)
                ours.close()
        if self._stopping.is_set():
            return Result()
        why = f"by {signal.Signals(-code).name}" if code is not None and code < 0 else f"with status {code}"
        return Result(error=f"{trial.folder}: its process ended {why}; see {trial.log}.")

    def stop(self) -> None:
        """Have running trials write a checkpoint and end."""
        self._stopping.set()
        for process in list(self._running):
            process.terminate()
        end = time.monotonic() + STOPPING_SECONDS
        for process in list(self._running):
            process.join(max(end - time.monotonic(), 0.1))
            if process.is_alive():
                process.kill()
        self._threads.shutdown(cancel_futures=True)


def _work(trial: Trial, connection: Connection) -> None:
    """Body of a trial's process."""
    if hasattr(os, "setsid"):
        os.setsid()  # Ctrl-C is the parent's to handle
    exit_with_parent()
    with written_to(trial):
        connection.send(learn(trial))


@contextlib.contextmanager
def written_to(trial: Trial) -> Iterator[None]:
    """What a trial prints goes to its file."""
    with trial.log.open("a", encoding="utf-8") as log:
        kept = os.dup(1), os.dup(2)
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        try:
            yield
        finally:
            for number, copy in enumerate(kept, 1):
                os.dup2(copy, number)
                os.close(copy)


# --- a Ray cluster ----------------------------------------------------------------------------------------------------


class OnRay:
    """A task of one core for each trial. A task whose machine dies is begun on another one."""

    def __init__(self, size: int | None) -> None:
        with needed_for("cluster=ray", ", or leave it out to use processes of this machine"):
            ray: Any = importlib.import_module("ray")
        self._ray = ray
        self._started = not ray.is_initialized()
        if self._started:
            ray.init(
                runtime_env={"env_vars": environment()}, logging_level="ERROR", log_to_driver=False,
                include_dashboard=None if os.environ.get("RAY_ADDRESS") else False,
            )  # fmt: skip
        self.size = size or max(int(ray.cluster_resources().get("CPU", 1)), 1)
        self._task = ray.remote(num_cpus=1, max_retries=ATTEMPTS - 1)(learn_elsewhere)
        self._pending: list[Any] = []

    def submit(self, trial: Trial) -> Future[Result]:
        """See :class:`Workers`."""
        reference = self._task.remote(trial)
        self._pending.append(reference)
        return reference.future()

    def stop(self) -> None:
        """Have running trials write a checkpoint and end."""
        for reference in self._pending:
            with contextlib.suppress(self._ray.exceptions.RayError):
                self._ray.cancel(reference)
        self._ray.wait(self._pending, num_returns=len(self._pending), timeout=STOPPING_SECONDS)
        if self._started:
            self._ray.shutdown()


def learn_elsewhere(trial: Trial) -> Result:
    """A trial in a task of Ray; the process of a machine that was lost may hold its folder for a moment."""
    end = time.monotonic() + LOCKED_SECONDS
    while True:
        with written_to(trial):
            result = learn(trial)
        if "Another process is training" not in result.error or time.monotonic() > end:
            return result
        time.sleep(1.0)


@contextlib.contextmanager
def workers_for(cluster: str | None, size: int | None) -> Iterator[Workers]:
    """Workers of this machine, or of a Ray cluster.

    Raises:
        SealegsError: Ray is asked for and not installed.
    """
    workers = Local(size or cores()) if cluster is None else OnRay(size)
    try:
        yield workers
    finally:
        workers.stop()


def outcome(future: Future[Result], trial: Trial) -> Result:
    """The result of a trial that is done; what Ray could not run is an error."""
    try:
        return future.result()
    except Exception as error:
        if type(error).__module__.partition(".")[0] != "ray":
            raise
        return Result(error=f"{trial.folder}: Ray could not run it: {str(error).strip().splitlines()[0]}")
