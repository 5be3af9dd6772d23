"""Where the jobs of a fleet run: in local processes, or on a Ray cluster (:mod:`sealegs.gap.fleet.cluster`)."""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any

from ...common.errors import SealegsError
from ...common.processes import cores, exit_with_parent
from .cluster import on_ray, ray_module
from .jobs import Job, Outcome, Report, finished, remove_unfinished, run_job

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
