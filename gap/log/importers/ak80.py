"""T-Motor AK80-6 on a 0.5 m pendulum, torque-driven swing-ups (dfki-ric-underactuated-lab, BSD-3-Clause)."""

from __future__ import annotations

from pathlib import Path

from ..types import JointLog, MeasuredRun
from ..writer import write_run
from .source import BENCH_JOINT, column, read_table, source_files

CHAIN = "ak80_6"


def convert_ak80(source: Path, target: Path) -> list[Path]:
    """Write one measured run per recording of ``source`` into ``target`` and return their paths.

    Raises:
        LogError: a recording is missing, damaged or incomplete, or a target exists.
    """
    return [write_run(read_ak80(path), target) for path in source_files(source, "*.csv")]


def read_ak80(path: Path) -> MeasuredRun:
    """Read one recording; its torque column is the driver's estimate."""
    table = read_table(path, ("time", "position", "velocity", "torque"))
    log = JointLog(
        goal=None,
        position=column(table, "position"),
        velocity=column(table, "velocity"),
        torque=column(table, "torque"),
    )
    return MeasuredRun(
        name=path.stem,
        time=column(table, "time"),
        joints={BENCH_JOINT: log},
        robot="bench",
        robot_params={"mass": 0.546, "arm_mass": 0.13, "length": 0.5},
        actuators={BENCH_JOINT: CHAIN},
        source=path,
        meta={
            "group": path.stem,
            "machine": "T-Motor AK80-6, pendulum 0.5 m",
            "source": "dfki-ric-underactuated-lab/torque_limited_simple_pendulum at ed17ea2d32a3",
            "licence": "BSD-3-Clause",
        },
    )
