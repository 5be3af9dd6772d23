"""From a measured log to a diagnosis: the entry point for scripts, fleets and notebooks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..common.bugs import Unforeseen
from ..common.errors import SealegsError
from .diagnosis import Diagnosis
from .log.progress import Progress
from .log.reader import InMemory, measured_set
from .log.types import MeasuredSet


def diagnose(
    log: str | Path | InMemory,
    *,
    sidecar: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None,
    test: str | None = None,
    seed: int = 0,
    limits: Sequence[float] | None = None,
    speed_limit: float | None = None,
    causes: Sequence[str] | None = None,
    progress: Progress = lambda text: None,
    keep: str | Path | None = None,
    joints: Sequence[str] | None = None,
    workers: int | None = 1,
) -> Diagnosis:
    """Find what the simulation of a machine gets wrong, from measured runs of it.

    Args:
        log: a file or a folder of them (docs/log-format.md), measured runs, or columns in memory: a data frame or a
            dict of arrays such as ``{"time": t, "servo.goal": g, "servo.position": q}``, for one run or a list of runs.
        sidecar: for columns in memory, the content of the YAML beside a log: ``{"robot": "bench", "robot_params":
            {...}, "actuators": {"servo": "sts3215"}}``; one for all runs, or one for each.
        test: group of runs that serves for the final errors alone; None: chosen from the runs.
        seed: of all resampling.
        limits: lowest and highest goal of the next experiment [rad]; None: from the log.
        speed_limit: largest speed of its goals [rad/s].
        causes: names of the causes to consider; None: all of the catalogue.
        joints: names of those to diagnose, each for itself; None: all, and what the joints of a robot share.
        progress: called with each step as a sentence.
        workers: joints diagnosed at a time, each in a process of its own. Then call this under
            ``if __name__ == "__main__"``. None: one per core where a machine has several joints.
        keep: folder in which intermediate results are kept; after a stop, the same call resumes from it.

    Raises:
        SealegsError: the log cannot be read or diagnosed, or an argument is wrong.
        Unforeseen: a bug of sealegs; its ``found`` is the diagnosis of the joints that it left alone, or None.
    """
    settings = checked_settings(test, seed, limits, speed_limit, causes, joints)
    from .experiment import Limits, default_limits
    from .finder import diagnosis as search
    from .finder.imu import beside
    from .output.partial import going_on, source_in_memory, source_of
    from .prepare.columns import chosen, commanded

    out = None if keep is None else Path(keep)
    data: MeasuredSet | None = None
    if not isinstance(log, str | Path):
        data = measured_set(log, sidecar)
    elif sidecar is not None:
        raise SealegsError(f"{log} has its sidecar beside it; sidecar= is for columns in memory.")
    else:
        from .log.reader import log_files

        log_files(Path(log))  # raises at once if there is none

    def source() -> dict[str, Any]:
        return (
            source_of(Path(log), settings) if isinstance(log, str | Path) else source_in_memory(_given(data), settings)
        )

    with going_on(out, source, progress) as (say, done):
        if isinstance(log, str | Path):
            from .checks.long import read_bounded

            data = read_bounded(Path(log), progress=say)
        data = _given(data)
        if joints is not None:
            chosen(
                commanded(data.runs), joints, beside(data.runs, joints)
            )  # says what there is not before the log is checked
        speed = math.inf if speed_limit is None else float(speed_limit)
        kept = None
        if limits is not None:
            kept = Limits(float(limits[0]), float(limits[1]), speed)
        elif speed_limit is not None:
            moved = np.concatenate([run.joints[j].position for run in data.runs for j in run.joints])
            kept = default_limits(moved, speed)
        try:
            found = search.diagnose(data, test, seed, say, kept, causes, done=done, workers=workers, only=joints)
        except Unforeseen as error:
            error.found = _of(data, error.found) if error.found else None
            raise
    return _of(data, found)


def _of(data: MeasuredSet, found: Any) -> Diagnosis:
    return Diagnosis(data.name, tuple(run.name for run in data.runs), tuple(found), data)


def _given(data: MeasuredSet | None) -> MeasuredSet:
    assert data is not None
    return data


def checked_settings(
    test: str | None,
    seed: int,
    limits: Sequence[float] | None,
    speed_limit: float | None,
    causes: Sequence[str] | None = None,
    joints: Sequence[str] | None = None,
) -> dict[str, Any]:
    """The settings of a diagnosis as plain data.

    Raises:
        SealegsError: one of them is wrong.
    """
    if test is not None and not isinstance(test, str):
        raise SealegsError(f"test={test!r} must be the name of a group of runs, as the sidecars give it.")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise SealegsError(f"seed={seed} must be a whole number from 0.")
    if limits is not None and not _two_angles(limits):
        raise SealegsError(f"limits={limits} must be two angles [rad], the lower one first, such as [-1.2, 1.2].")
    if speed_limit is not None and not (_number(speed_limit) and speed_limit > 0.0):
        raise SealegsError(f"speed_limit={speed_limit} must be a speed above zero [rad/s].")
    if causes is not None:
        if not (_names(causes) and causes):
            raise SealegsError(f"causes={causes} must be a list of names, such as [friction.coulomb,drive.delay].")
        from .causes.catalogue import checked

        checked(causes)
    if joints is not None and not (_names(joints) and joints):
        raise SealegsError(f"joints={joints} must be a list of names, such as [shoulder,elbow].")
    return {
        "test": test,
        "seed": int(seed),
        "limits": None if limits is None else [float(end) for end in limits],
        "speed_limit": None if speed_limit is None else float(speed_limit),
        "causes": None if causes is None else list(causes),
        "joints": None if joints is None else list(joints),
    }


def _two_angles(limits: Any) -> bool:
    sound = isinstance(limits, Sequence | np.ndarray) and len(limits) == 2 and all(map(_number, limits))
    return bool(sound and limits[0] < limits[1])


def _names(causes: object) -> bool:
    return isinstance(causes, Sequence) and not isinstance(causes, str) and all(isinstance(c, str) for c in causes)


def _number(value: object) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(float(value))
