"""A log before anything is fitted: what its sidecar says, units, faults that are mended, and what makes it unusable."""

from __future__ import annotations

from ...actuators.errors import nearest
from ...envs.robot_file import is_robot_file
from ...envs.robots import ROBOTS
from ..checks.data_set import check_set, corrected, merged, unusable
from ..checks.off import released
from ..load.robot import robot_of
from ..load.units import in_model_units
from ..log.finding import Finding
from ..log.progress import Progress
from ..log.types import LogError, MeasuredSet
from .columns import check_robot

MISTYPED = 0.7  # likeness to a robot's name from which a log means it: any other is a machine whose load nobody knows


def check_log(data: MeasuredSet, progress: Progress) -> tuple[MeasuredSet, list[Finding], Finding | None]:
    """The data with their faults mended, what was found about them, and the finding that makes them unusable."""
    robot = data.runs[0].robot
    if robot not in ROBOTS and not is_robot_file(robot) and (hint := nearest(robot, ROBOTS, MISTYPED)):
        raise LogError(f"{data.runs[0].name}: there is no robot '{robot}'{hint}; correct it in the sidecar.")
    machine = robot_of(data.runs[0])
    said = []
    if machine is not None:
        _alike(data)
        data, said = in_model_units(data, machine)
        said += check_robot(data.runs, machine)
    progress("checking the log")
    data, off = released(data)
    data, every = corrected(data, [*data.findings, *said, *off, *check_set(data)])
    return data, merged(every), unusable(every, data)


def _alike(data: MeasuredSet) -> None:
    """Refuse runs of a robot's file whose sidecars differ in what the robot is: one model is made of it."""
    first = data.runs[0]
    for run in data.runs[1:]:
        for key, mine, its in (
            ("robot_params", dict(run.robot_params), dict(first.robot_params)),
            ("meta.frames", run.meta.get("frames"), first.meta.get("frames")),
        ):
            if mine != its:
                raise LogError(f"{run.name}: its sidecar has other {key} than {first.name}; diagnose such runs apart.")
