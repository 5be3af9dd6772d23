"""Where the jobs of a fleet run: in local processes, or on a Ray cluster."""

from __future__ import annotations

import contextlib
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

from ...common.atomic import folder_written
from ...common.errors import SealegsError
from ...common.extras import needed_for
from ...common.plugins import environment
from ...common.processes import cores, exit_with_parent
from ..log.reader import files_named_by
from .jobs import Job, Outcome, Report, finished, fits_of_joint, joints_of, remove_unfinished, run_job

STOPPING_SECONDS = 5.0  # [s] a stopped worker has to end


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
        ray_module()  # says at once that it is missing
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
    count = workers or cores()
    yield from on_ray(todo, report) if cluster else in_processes(todo, max(min(count, len(todo)), 1), report)


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
    joints = max(cores() // workers, 1)
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
        end = time.monotonic() + STOPPING_SECONDS
        for process, job in running.values():
            process.join(max(end - time.monotonic(), 0.1))
            if process.is_alive():
                process.kill()
                process.join()
            remove_unfinished(job)


def _work(job: Job, connection: Connection, joints: int) -> None:
    """Body of a worker process, with so many joints at a time: tells progress as text, and at last the outcome."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    exit_with_parent()
    from numba import get_num_threads, set_num_threads

    set_num_threads(min(joints, get_num_threads()))
    connection.send(run_job(job, connection.send, joints))


def _died(job: Job, code: int | None) -> str:
    if code is not None and code < 0:
        name = signal.Signals(-code).name
        return f"{job.log}: its process was ended by {name}; if memory ran out, use fewer workers=<number>."
    return f"{job.log}: its process ended without a result (status {code})."


# --- A fleet on a Ray cluster: a task for each robot, which hands each of its joints to a task of its own ------------
#
# Logs travel to the workers and diagnoses back, so no shared file system is needed. The task of a joint brings back
# its fits. The robot's own task then finds them made, judges the joints and seeks what they share. A node that dies
# loses none: Ray begins its tasks once more, and a joint that still fails is fitted in the robot's task.

PACKAGE = __name__.partition(".")[0]
PARTS = ("actuators", "common", "configs", "envs", "gap")  # what a worker of a cluster needs of the package


def ray_module() -> Any:
    """The module ``ray``.

    Raises:
        SealegsError: it is not installed; the sentence names the extra.
    """
    with needed_for("fleet=ray", ", or give fleet=true to use processes of this machine"):
        import ray  # pyright: ignore[reportMissingImports]  (an extra of its own)
    return ray


def on_ray(jobs: Sequence[Job], report: Report) -> Iterator[Outcome]:
    """One task per job. Logs travel to the worker and the diagnosis back, so no shared file system is needed."""
    ray = ray_module()
    started = not ray.is_initialized()
    if started:
        with tempfile.TemporaryDirectory() as folder:  # Ray packs it at once
            modules = [str(copied_package(Path(folder)))]
            needed = {"py_modules": modules, "env_vars": environment()}
            ray.init(runtime_env=needed, logging_level="ERROR", log_to_driver=False, include_dashboard=False)
    task = ray.remote(num_cpus=1, max_retries=1)(diagnosed_elsewhere)
    pending: dict[Any, Job] = {}
    try:
        for job in jobs:
            pending[task.remote(job.name, shipped(job.log), dict(job.settings))] = job
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


def shipped(log: Path) -> dict[str, bytes]:
    """What a worker needs of a folder of logs, by the path from there: its files, and those of its robot elsewhere."""
    folder = log.resolve()
    files = [path for path in folder.iterdir() if path.is_file()]
    paths = {Path(os.path.relpath(path, folder)).as_posix(): path for path in (*files, *files_named_by(log))}
    return {name: path.read_bytes() for name, path in paths.items()}


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
        log, out = written_log(Path(folder), name, files), Path(folder) / "out"
        joints = settings.get("joints") or joints_of(log)
        fits = _fits_of_tasks(name, files, settings, joints) if len(joints) > 1 else b""
        outcome = run_job(Job(name, log, out, settings), fits=fits)
        if outcome.error:
            return outcome.error.replace(f"{log.parent}/", "").replace(f"{folder}/", ""), {}
        return "", {str(path.relative_to(out)): path.read_bytes() for path in out.rglob("*") if path.is_file()}


def fitted_elsewhere(name: str, files: dict[str, bytes], settings: dict[str, Any], joint: str) -> bytes:
    """The fits of one joint of a job on such a machine."""
    with tempfile.TemporaryDirectory() as folder:
        return fits_of_joint(written_log(Path(folder), name, files), joint, settings)


def _fits_of_tasks(name: str, files: dict[str, bytes], settings: dict[str, Any], joints: Sequence[str]) -> bytes:
    """The fits of all joints, each from a task of its own; this one's core is free for them meanwhile."""
    ray = ray_module()
    task, sent = ray.remote(num_cpus=1, max_retries=1)(fitted_elsewhere), ray.put(files)
    fits = b""
    for reference in [task.remote(name, sent, settings, joint) for joint in joints]:
        with contextlib.suppress(ray.exceptions.RayError):  # what is missing is fitted here
            fits += ray.get(reference)
    return fits


def written_log(folder: Path, name: str, files: dict[str, bytes]) -> Path:
    """A folder of logs that came as bytes, so deep that what lies above it has its place as well."""
    above = max((Path(file).parts.count("..") for file in files), default=0)
    log = folder.joinpath("logs", *["above"] * above, name).resolve()
    log.mkdir(parents=True)
    for file, content in files.items():
        path = Path(os.path.normpath(log / file))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return log


def received(job: Job, files: dict[str, bytes]) -> Outcome:
    """Write what a worker sent back."""
    try:
        with folder_written(job.out) as staged:
            for name, content in files.items():
                (staged / name).parent.mkdir(parents=True, exist_ok=True)
                (staged / name).write_bytes(content)
    except OSError as error:
        return Outcome(job.name, error=f"{job.out} cannot be written: {error.strerror or error}.")
    try:
        found = finished(job)
    except SealegsError as error:  # the logs or the robot were edited meanwhile
        return Outcome(job.name, error=str(error))
    assert found is not None
    return Outcome(job.name, found.document)
