"""Joints of a robot side by side: a process for each, which takes no other with it when it dies."""

from __future__ import annotations

import multiprocessing
import os
import queue
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from multiprocessing.managers import SyncManager
from pathlib import Path
from typing import Any

from ...common import plugins
from ...common.bugs import apart
from ...common.processes import cores, exit_with_parent, worker_pool
from ..load.robot import Machine
from ..log.finding import Finding
from ..log.progress import Milestone, Progress
from ..prepare.request import Request
from ..search.journal import keeping, kept_at
from ..verdict.verdict import JointDiagnosis

WAIT_POLICY = "OMP_WAIT_POLICY"
QUEUE_LOST = (EOFError, OSError)
"""What a queue raises whose own process is gone."""
PROGRESS_PERIOD = 0.2  # [s] a person sees what joints are at
MIN_PARALLEL_JOINTS = 3  # joints from which processes pay for what it costs to start them
Diagnose = Callable[[Machine, str, Sequence[Finding], Request], JointDiagnosis]
"""Diagnoses one joint of a machine; a function of a module, so that another process finds it."""


def side_by_side(
    tasks: Mapping[str, Diagnose],
    machine: Machine,
    findings: Sequence[Finding],
    request: Request,
    workers: int | None,
    done: Callable[[JointDiagnosis], None],
    errors: dict[str, Exception] | None = None,
) -> list[JointDiagnosis]:
    """Diagnose joints, so many at a time; one whose process dies is diagnosed in this one.

    Args:
        tasks: what diagnoses each joint, by its name.
        machine, findings, request: what they are called with.
        workers: processes; None: one per core where there are at least :data:`MIN_PARALLEL_JOINTS` joints.
        done: is given each joint as soon as it is diagnosed.
        errors: is given what nobody foresaw, by joint, and the other joints go on; None: the first one is raised.

    Returns:
        The diagnoses in the order of ``tasks``, without joints in ``errors``.
    """
    failed: dict[str, Exception] = {} if errors is None else errors

    def kept(joint: str) -> AbstractContextManager[None]:
        return nullcontext() if errors is None else apart(joint, errors)

    joints = list(tasks)
    workers = (cores() if len(joints) >= MIN_PARALLEL_JOINTS else 1) if workers is None else workers
    if min(workers, len(joints)) < 2:
        in_turn = []
        for number, (joint, diagnose) in enumerate(tasks.items(), 1):
            own = request if len(joints) < 2 else replace(request, progress=_named(joint, request.progress))
            with kept(joint), nullcontext() if kept_at() else keeping(None):
                in_turn.append(_told(diagnose(machine, joint, findings, own), done))
                if len(joints) > 1:
                    request.progress(_ended(in_turn[-1], len(joints) - number))
        return in_turn
    fits, size = kept_at(), min(workers, len(joints))
    threads = _threads()  # all for each: as joints are done, the others have the cores to themselves
    found: dict[str, JointDiagnosis] = {}
    request.progress(f"diagnosing {len(joints)} joints, {size} at a time")
    with _waiting_asleep(), _lines() as said, worker_pool(size, _begin, (threads,)) as pool:
        asked: dict[Future[JointDiagnosis], str] = {}
        for joint, diagnose in tasks.items():
            own = replace(request, progress=Said(joint, said))
            asked[pool.submit(_one, diagnose, machine, joint, findings, own, fits)] = joint
        try:
            left = set(asked)
            while left:
                ended, left = wait(left, PROGRESS_PERIOD, FIRST_COMPLETED)
                _tell(said, request.progress)
                for future in ended:
                    joint = asked[future]
                    if isinstance(future.exception(), BrokenProcessPool):
                        future.result()
                    with kept(joint):
                        found[joint] = _told(future.result(), done)
                        request.progress(_ended(found[joint], len(joints) - len(found) - len(failed)))
        except BrokenProcessPool:
            request.progress("a process ended without a result; going on in this one")
    for joint in joints:
        if joint not in found and joint not in failed:
            with keeping(_beside(fits, joint)), kept(joint):
                found[joint] = _told(tasks[joint](machine, joint, findings, request), done)
    return [found[joint] for joint in joints if joint in found]


def _threads() -> int:
    from numba import get_num_threads

    return get_num_threads()  # a worker of a fleet has a part of the cores


def _told(joint: JointDiagnosis, done: Callable[[JointDiagnosis], None]) -> JointDiagnosis:
    done(joint)
    return joint


def _ended(joint: JointDiagnosis, left: int) -> Milestone:
    """That a joint is done, and how many are left."""
    return Milestone(f"{joint.joint}: {joint.verdict}; {left} joint{'s' * (left != 1)} left")


def _named(joint: str, progress: Progress) -> Progress:
    """A progress that says which joint it is at."""

    def say(text: str) -> None:
        line = f"{joint}: {text}"
        progress(Milestone(line) if isinstance(text, Milestone) else line)

    return say


@dataclass(frozen=True)
class Said:
    """What a joint is at, on its way to the process that asked for it.

    Attributes:
        joint: its name.
        queue: on which it goes; None where there is none. What is lost on it is no loss to the diagnosis.
    """

    joint: str
    queue: Any

    def __call__(self, text: str) -> None:
        if self.queue is not None:
            with suppress(*QUEUE_LOST):
                _named(self.joint, self.queue.put)(text)


@contextmanager
def _lines() -> Iterator[Any]:
    """A queue between processes, whose own ends with this one; None where it cannot be had."""
    manager = SyncManager(ctx=multiprocessing.get_context("spawn"))
    try:
        manager.start(exit_with_parent)
        lines = manager.Queue()
    except QUEUE_LOST:
        yield None
        return
    try:
        yield lines
    finally:
        manager.shutdown()


def _tell(said: Any, progress: Progress) -> None:
    """Hand on what joints said since the last time."""
    while said is not None:
        try:
            line = said.get_nowait()
        except (queue.Empty, *QUEUE_LOST):
            return
        progress(line)


@contextmanager
def _waiting_asleep() -> Iterator[None]:
    """Processes begun here sleep where threads wait for each other, and keep no core that others need."""
    before = os.environ.get(WAIT_POLICY)
    os.environ.setdefault(WAIT_POLICY, "passive")
    try:
        yield
    finally:
        if before is None:
            del os.environ[WAIT_POLICY]


def _begin(threads: int) -> None:
    exit_with_parent()
    from numba import get_num_threads, set_num_threads

    set_num_threads(min(threads, get_num_threads()))
    plugins.load("causes")  # before a joint comes whose chain has a stage of a file that was named


def _one(
    diagnose: Diagnose,
    machine: Machine,
    joint: str,
    findings: Sequence[Finding],
    request: Request,
    fits: Path | None,
) -> JointDiagnosis:
    """Body of a process: its fits are kept in a journal of their own, by which another one goes on."""
    with keeping(_beside(fits, joint)):
        return diagnose(machine, joint, findings, request)


def _beside(fits: Path | None, joint: str) -> Path | None:
    return None if fits is None else fits.with_name(f"{fits.stem}-{joint}{fits.suffix}")
