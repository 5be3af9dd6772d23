"""Where the jobs of a fleet run: in local processes, or on a Ray cluster."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from ...actuators.atomic import folder_written
from ...actuators.errors import SealegsError
from ...actuators.extras import needed_for
from ...actuators.processes import end_with_parent
from .jobs import Job, Outcome, finished, remove_unfinished, run_job

PACKAGE = __name__.partition(".")[0]
PARTS = ("actuators", "configs", "envs", "gap")  # what a worker of a cluster needs of the package
FORGIVE = 5.0  # [s] a stopped worker has to end

Report = Callable[[str, str], None]
"""Is told the name of a servo and what goes on with it."""


def diagnose_fleet(
    jobs: Sequence[Job],
    workers: int | None = None,
    cluster: bool = False,
    report: Report = lambda name, text: None,
) -> Iterator[Outcome]:
    """Diagnose every job that is not finished yet, several at a time; yield outcomes as they come.

    Args:
        jobs: servos of the fleet.
        workers: jobs at a time; default: one per core.
        cluster: on Ray (environment variable RAY_ADDRESS, else one is started on this machine).
        report: for progress.

    Raises:
        SealegsError: Ray is asked for and not installed.
    """
    if cluster:
        _ray()  # says at once that it is missing
    todo = []
    for job in jobs:
        try:
            kept = finished(job)
        except SealegsError as error:
            yield Outcome(job.name, error=str(error))
            continue
        if kept is None:
            todo.append(job)
        else:
            yield kept
    if not todo:
        return
    count = workers or (len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
    yield from _on_ray(todo, report) if cluster else in_processes(todo, max(min(count, len(todo)), 1), report)


# --- processes of this machine -------------------------------------------------------------------------------------


def in_processes(
    jobs: Sequence[Job], workers: int, report: Report, work: Callable[[Job, Connection, int], None] | None = None
) -> Iterator[Outcome]:
    """A process per job: one that dies takes no other with it, and its job is begun once more.

    Cores that are left over take the joints of a robot side by side.

    Args:
        jobs: to do.
        workers: jobs at a time.
        report: for progress.
        work: body of a process, a function of a module: sends progress and at last the outcome of a job, so many
            joints at a time; None: the diagnosis.
    """
    context = multiprocessing.get_context("spawn")
    joints = max((os.cpu_count() or 1) // workers, 1)
    waiting, died = list(jobs), set[str]()
    running: dict[Connection, tuple[Any, Job]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                job = waiting.pop(0)
                ours, theirs = context.Pipe(duplex=False)
                process = context.Process(target=work or _work, args=(job, theirs, joints))
                process.start()
                theirs.close()
                running[ours] = (process, job)
                report(job.name, "starting")
            for connection in wait(list(running)):
                assert isinstance(connection, Connection)
                process, job = running[connection]
                try:
                    message = connection.recv()
                except (EOFError, OSError):  # OSError: killed while it sent something
                    process.join()
                    message = Outcome(job.name, error=_died(job, process.exitcode))
                    if job.name not in died:
                        died.add(job.name)
                        waiting.append(job)
                if isinstance(message, str):
                    report(job.name, message)
                    continue
                process.join()
                connection.close()
                remove_unfinished(job)  # of one that died
                del running[connection]
                if job in waiting:
                    report(job.name, f"{message.error} Once more")
                else:
                    yield message
    finally:  # also when the person stops it
        for process, _ in running.values():
            process.terminate()
        end = time.monotonic() + FORGIVE
        for process, job in running.values():
            process.join(max(end - time.monotonic(), 0.1))
            if process.is_alive():
                process.kill()
                process.join()
            remove_unfinished(job)


def _work(job: Job, connection: Connection, joints: int) -> None:
    """Body of a worker process, with so many joints at a time: tells progress as text, and at last the outcome."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    end_with_parent(lambda: os._exit(1))
    from numba import get_num_threads, set_num_threads

    set_num_threads(min(joints, get_num_threads()))
    connection.send(run_job(job, connection.send, joints))


def _died(job: Job, code: int | None) -> str:
    if code is not None and code < 0:
        name = signal.Signals(-code).name
        return f"{job.log}: its process was ended by {name}; if memory ran out, use fewer workers=<number>."
    return f"{job.log}: its process ended without a result (status {code})."


# --- Ray -----------------------------------------------------------------------------------------------------------


def _ray() -> Any:
    with needed_for("fleet=ray", ", or give fleet=true to use processes of this machine"):
        import ray  # pyright: ignore[reportMissingImports]  (an extra of its own)
    return ray


def _on_ray(jobs: Sequence[Job], report: Report) -> Iterator[Outcome]:
    """One task per job. Logs travel to the worker and the diagnosis back, so no shared file system is needed."""
    ray = _ray()
    started = not ray.is_initialized()
    if started:
        with tempfile.TemporaryDirectory() as folder:  # Ray packs it at once
            modules = [str(copied_package(Path(folder)))]
            ray.init(
                runtime_env={"py_modules": modules}, logging_level="ERROR", log_to_driver=False, include_dashboard=False
            )
    task = ray.remote(num_cpus=1, max_retries=1)(diagnosed_elsewhere)
    pending: dict[Any, Job] = {}
    try:
        for job in jobs:
            files = {path.name: path.read_bytes() for path in job.log.iterdir() if path.is_file()}
            pending[task.remote(job.name, files, dict(job.settings))] = job
            report(job.name, "handed to Ray")
        while pending:
            (done,), _ = ray.wait(list(pending), num_returns=1)
            job = pending.pop(done)
            try:
                error, files = ray.get(done)
            except ray.exceptions.RayError as problem:
                error, files = f"{job.log}: Ray could not run it: {str(problem).splitlines()[0]}", {}
            yield Outcome(job.name, error=error) if error else received(job, files)
    finally:
        for reference in pending:
            ray.cancel(reference, force=True)
        if started:
            ray.shutdown()


def copied_package(folder: Path) -> Path:
    """The package as one folder of its own name in ``folder``, from a checkout or from where pip installed it."""
    target = folder / PACKAGE
    beside = shutil.ignore_patterns("__pycache__", *(PARTS if _home(PACKAGE) == _home(f"{PACKAGE}.gap").parent else ()))
    shutil.copytree(_home(PACKAGE), target, ignore=beside)
    for part in PARTS:
        shutil.copytree(_home(f"{PACKAGE}.{part}"), target / part, ignore=shutil.ignore_patterns("__pycache__"))
    return target


def _home(module: str) -> Path:
    file = importlib.import_module(module).__file__
    assert file is not None
    return Path(file).resolve().parent


def diagnosed_elsewhere(name: str, files: dict[str, bytes], settings: dict[str, Any]) -> tuple[str, dict[str, bytes]]:
    """A job on a machine that has neither the logs nor the folder for the diagnosis."""
    with tempfile.TemporaryDirectory() as folder:
        log, out = Path(folder) / name, Path(folder) / "out"
        log.mkdir()
        for file, content in files.items():
            (log / file).write_bytes(content)
        outcome = run_job(Job(name, log, out, settings))
        if outcome.error:
            return outcome.error.replace(f"{folder}/", ""), {}
        return "", {str(path.relative_to(out)): path.read_bytes() for path in out.rglob("*") if path.is_file()}


def received(job: Job, files: dict[str, bytes]) -> Outcome:
    """Write what a worker sent back."""
    try:
        with folder_written(job.out) as staged:
            for name, content in files.items():
                (staged / name).parent.mkdir(parents=True, exist_ok=True)
                (staged / name).write_bytes(content)
    except OSError as error:
        return Outcome(job.name, error=f"{job.out} cannot be written: {error.strerror or error}.")
    found = finished(job)
    assert found is not None
    return Outcome(job.name, found.document)
