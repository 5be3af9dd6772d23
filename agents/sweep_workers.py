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
import platform
import shutil
import signal
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol

from ..common.bugs import told
from ..common.documents import read_json
from ..common.errors import SealegsError
from ..common.extras import needed_for
from ..common.plugins import environment
from ..common.processes import cores, exit_with_parent
from ..configs.script import Interrupted
from .run_folder import Busy
from .seeds import is_study

MARK = "sweep.yaml"
"""By which a machine sees that it has the sweep's folder."""
STOPPING_SECONDS = 60.0  # [s] a trial has to write its checkpoint
LOCKED_SECONDS = 60.0  # [s] until the process of a machine that is gone lets its trial go
ATTEMPTS = 3
"""Times that a trial is begun whose process or machine dies."""


@dataclass(frozen=True)
class Trial:
    """One training: its number, the arguments of ``sealegs train``, the sweep's folder, and the code that may run.

    ``task`` is its own task where that is a file's; ``trust`` is that of :class:`~.sweep_plan.Code`.
    """

    number: int
    arguments: tuple[str, ...]
    sweep: Path
    task: str | None = None
    trust: bool = False

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
    """How a trial ended: the mean reward of its final policy, a sentence why there is none, or what stopped it that is
    not the trial's own: then it is to be begun again."""

    reward: float | None = None
    error: str = ""
    lost: str = ""
    busy: bool = False
    """Whether the error is that another process still trains the trial."""


def attempt(trial: Trial) -> Result:
    """:func:`learn`, where this machine has the sweep's folder; what it prints goes to the trial's file."""
    if not (trial.sweep / MARK).is_file():
        where = platform.node()
        return Result(
            lost=f"{trial.sweep} is not on {where}: share it, or give out=<a folder that all machines share>."
        )
    try:
        with written_to(trial):
            return learn(trial)
    except Exception as error:  # this is the outermost place of a trial
        return Result(error=f"A bug of sealegs ended {trial.folder}: {told(error)}; {trial.log} has the details.")


def learn(trial: Trial) -> Result:
    """Train, or go on with, a trial in this process."""
    from .config import read_config
    from .training import train

    folder = trial.folder
    try:
        if (found := reward_of(folder)) is None:
            if begun(folder):
                task = [] if trial.task is None else [f"env={trial.task}"]
                arguments = [f"resume={folder}", *task, *(["trust=true"] if trial.trust else [])]
            else:
                shutil.rmtree(folder, ignore_errors=True)  # of a start that was killed before its config was written
                arguments = [*trial.arguments, f"out={trial.sweep}", f"name={folder.name}"]
            train(read_config(arguments, trial.trust))
            found = reward_of(folder)
        if found is None or not math.isfinite(found):
            raise SealegsError(f"{folder} ended without a reward.")
        return Result(found)
    except Interrupted:
        return Result(lost=f"{folder} was told to stop.")
    except SealegsError as error:
        return Result(error=str(error), busy=isinstance(error, Busy))


def begun(folder: Path) -> bool:
    """Whether a trial can go on."""
    return (folder / "config.yaml").is_file() or is_study(folder)


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
        self._stopping = False
        self._lock = threading.Lock()
        """Held while a process is begun: one begins before a stop, and is stopped, or never."""

    def submit(self, trial: Trial) -> Future[Result]:
        """See :class:`Workers`."""
        return self._threads.submit(self._train, trial)

    def _train(self, trial: Trial) -> Result:
        context = multiprocessing.get_context("spawn")
        code: int | None = None
        for _ in range(ATTEMPTS):
            ours, theirs = context.Pipe(duplex=False)
            process = context.Process(target=_work, args=(trial, theirs))
            with self._lock:
                if self._stopping:
                    break
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
        if self._stopping:
            return Result(lost="The sweep was stopped.")
        why = f"by {signal.Signals(-code).name}" if code is not None and code < 0 else f"with status {code}"
        return Result(error=f"{trial.folder}: its process ended {why}; see {trial.log}.")

    def stop(self) -> None:
        """Have running trials write a checkpoint and end."""
        with self._lock:
            self._stopping = True
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
    connection.send(attempt(trial))


@contextlib.contextmanager
def written_to(trial: Trial) -> Iterator[None]:
    """What a trial prints goes to its file."""
    with trial.log.open("a", encoding="utf-8") as log:
        kept = os.dup(1), os.dup(2)
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        try:
            yield
        except Exception:
            traceback.print_exc()
            raise
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
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
        result = attempt(trial)
        if not result.busy or time.monotonic() > end:
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
        said = str(error).strip().splitlines() or [type(error).__name__]  # after the traceback of the machine
        return Result(error=f"{trial.folder}: Ray could not run it: {said[-1]}")
