"""Joints of a robot side by side: a process for each, which takes no other with it when it dies."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from ...actuators.processes import cores, end_with_parent
from ..log.finding import Finding
from ..log.progress import Milestone
from ..log.types import MeasuredRun
from ..search.journal import keeping, kept_at
from .request import Request
from .verdict import JointDiagnosis

WAITING = "OMP_WAIT_POLICY"
MANY = 3  # joints from which processes pay for what it costs to start them
Diagnose = Callable[[Sequence[MeasuredRun], str, Sequence[Finding], Request], JointDiagnosis]
"""Diagnoses one joint of runs; a function of a module, so that another process finds it."""


def side_by_side(
    diagnose: Diagnose,
    runs: Sequence[MeasuredRun],
    joints: Sequence[str],
    findings: Sequence[Finding],
    request: Request,
    workers: int | None,
    done: Callable[[JointDiagnosis], None],
) -> list[JointDiagnosis]:
    """Diagnose joints, so many at a time; one whose process dies is diagnosed in this one.

    Args:
        diagnose: of one joint.
        runs, findings, request: what it is called with.
        joints: their names.
        workers: processes; None: one per core where there are at least :data:`MANY` joints.
        done: is given each joint as soon as it is diagnosed.

    Returns:
        The diagnoses in the order of ``joints``.
    """
    workers = (cores() if len(joints) >= MANY else 1) if workers is None else workers
    if min(workers, len(joints)) < 2:
        return [_told(diagnose(runs, joint, findings, request), done) for joint in joints]
    fits, quiet = kept_at(), replace(request, progress=_quiet)
    threads = _threads()  # all for each: as joints are done, the others have the cores to themselves
    found: dict[str, JointDiagnosis] = {}
    request.progress(f"diagnosing {len(joints)} joints, {min(workers, len(joints))} at a time")
    context, before = multiprocessing.get_context("spawn"), set(multiprocessing.active_children())
    size = min(workers, len(joints))
    with _waiting_asleep(), ProcessPoolExecutor(size, context, _begin, (threads,)) as pool:
        asked: dict[str, Future[JointDiagnosis]] = {
            joint: pool.submit(_one, diagnose, runs, joint, findings, quiet, fits) for joint in joints
        }
        try:
            for joint, future in asked.items():
                found[joint] = _told(future.result(), done)
                request.progress(Milestone(f"{joint}: {found[joint].verdict}"))
        except BrokenProcessPool:
            request.progress("a process ended without a result; going on in this one")
        except BaseException:  # also when the person stops it
            pool.shutdown(wait=False, cancel_futures=True)
            for process in set(multiprocessing.active_children()) - before:
                process.terminate()
            raise
    for joint in joints:
        if joint not in found:
            with keeping(_beside(fits, joint)):
                found[joint] = _told(diagnose(runs, joint, findings, request), done)
    return [found[joint] for joint in joints]


def _threads() -> int:
    from numba import get_num_threads

    return get_num_threads()  # a worker of a fleet has a part of the cores


def _told(joint: JointDiagnosis, done: Callable[[JointDiagnosis], None]) -> JointDiagnosis:
    done(joint)
    return joint


def _quiet(text: str) -> None:
    del text


@contextmanager
def _waiting_asleep() -> Iterator[None]:
    """Processes begun here sleep where threads wait for each other, and keep no core that others need."""
    before = os.environ.get(WAITING)
    os.environ.setdefault(WAITING, "passive")
    try:
        yield
    finally:
        if before is None:
            del os.environ[WAITING]


def _begin(threads: int) -> None:
    end_with_parent(lambda: os._exit(1))
    from numba import get_num_threads, set_num_threads

    set_num_threads(min(threads, get_num_threads()))


def _one(
    diagnose: Diagnose,
    runs: Sequence[MeasuredRun],
    joint: str,
    findings: Sequence[Finding],
    request: Request,
    fits: Path | None,
) -> JointDiagnosis:
    """Body of a process: its fits are kept in a journal of their own, by which another one goes on."""
    with keeping(_beside(fits, joint)):
        return diagnose(runs, joint, findings, request)


def _beside(fits: Path | None, joint: str) -> Path | None:
    return None if fits is None else fits.with_name(f"{fits.stem}-{joint}{fits.suffix}")
