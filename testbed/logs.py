"""The recordings as measured logs: the one place where the testbed knows a type of sealegs, that of the log."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ParamSpec

import numpy as np
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet

from .arm import record_arm
from .bench import JOINT, nominal_chain, record_again, record_bench
from .everyday.recorded import record_drawn
from .hopper import record_hopper
from .quadruped import record_walker
from .recording import Recording
from .wide import record_wide

Given = ParamSpec("Given")


def measured_run(recording: Recording) -> MeasuredRun:
    """The same run as the finder reads it; each run is a group of its own."""
    return MeasuredRun(
        name=recording.name,
        time=recording.time,
        joints={joint: JointLog(**{"goal": None, **signals}) for joint, signals in recording.joints.items()},
        base=recording.base,
        robot=recording.robot,
        robot_params=recording.robot_params,
        actuators=dict(recording.actuators),
        meta={"group": recording.name},
    )


def as_logs(
    record: Callable[Given, tuple[list[Recording], dict[str, Any]]],
) -> Callable[Given, tuple[MeasuredSet, dict[str, Any]]]:
    """The same machine, with its recordings as a measured set."""

    def hidden(*given: Given.args, **named: Given.kwargs) -> tuple[MeasuredSet, dict[str, Any]]:
        recordings, truth = record(*given, **named)
        return MeasuredSet(tuple(map(measured_run, recordings)), f"hidden-{truth['seed']}"), truth

    hidden.__doc__ = record.__doc__
    return hidden


hidden_bench = as_logs(record_bench)
hidden_hopper = as_logs(record_hopper)
hidden_arm = as_logs(record_arm)
hidden_walker = as_logs(record_walker)
hidden_wide = as_logs(record_wide)
hidden_everyday = as_logs(record_drawn)


def run_again(
    data: MeasuredSet,
    truth: Mapping[str, Any],
    goals: Callable[[np.ndarray], np.ndarray],
    load: Mapping[str, float],
    *,
    duration: float,
    runs: int = 3,
    seed: int = 0,
) -> list[MeasuredRun]:
    """Record further runs of the machine behind ``data``: see :func:`testbed.bench.record_again`."""
    first = data.runs[0]
    again = record_again(
        truth, first.robot_params, nominal_chain(truth["machines"][0]), goals, load,
        duration=duration, runs=runs, seed=seed, link_encoder=first.joints[JOINT].link_position is not None,
    )  # fmt: skip
    return [measured_run(recording) for recording in again]
