"""Dynamixel XL330-M288-T on a pendulum, position control with three P gains (Rhoban/bam, Apache-2.0)."""

from __future__ import annotations

import json
import math
from pathlib import Path

from ..types import JointLog, LogError, MeasuredRun
from ..writer import write_run
from .source import BENCH_JOINT, column, read_table, source_files

COUNTS_PER_TURN = 4096
PWM_FULL = 885
"""PWM register value that means duty 1 (control table, PWM Limit)."""
GAIN_DIVISOR = 256
"""The firmware divides the P gain register by 256; duty = kp * error_counts / 256 / 885 holds to a count at kp 100."""

COLUMNS = ("timestamp", "goal_position", "position", "speed", "duty", "input_volts", "temp", "torque_enable")


def firmware_gain(kp: float) -> float:
    """Return the gain of the P register value ``kp`` in duty per position error [1/rad]."""
    return kp * COUNTS_PER_TURN / (2 * math.pi) / GAIN_DIVISOR / PWM_FULL


def chain(kp: float, volts: float) -> list[dict[str, dict[str, float]]]:
    """Return the actuation chain believed to be right before anything was fitted.

    Motor values are read off the data sheet at 5 V and hold at the output shaft: the stall current of 1.47 A gives
    3.4 Ohm, and the no-load speed of 103 rpm, at which the motor turns the assumed friction, a motor constant of
    0.41 N.m/A. The stall torque of 0.52 N.m is what the gears let through of 0.60 N.m, so it gives no motor constant.
    Armature and friction are assumed, and the sidecar says so.
    """
    return [
        {"position_p": {"gain": firmware_gain(kp)}},
        {"duty_limit": {"limit": 1.0}},
        {"supply": {"volts": volts, "resistance": 0.0}},
        {"dc_motor": {"motor_constant": 0.41, "resistance": 3.4, "armature": 0.002}},
        {"friction": {"coulomb": 0.02, "viscous": 0.005}},
        {"encoder": {"ticks": COUNTS_PER_TURN}},
    ]


def convert_xl330(source: Path, target: Path) -> list[Path]:
    """Write one measured run per recording of ``source`` into ``target`` and return their paths.

    The supply reading is kept as it was logged, although it aliases the PWM ripple.

    Raises:
        LogError: a recording or its ``.meta.json`` is missing, damaged or incomplete, or a target exists.
    """
    return [write_run(read_xl330(path), target) for path in source_files(source, "*.csv")]


def read_xl330(path: Path) -> MeasuredRun:
    """Read one recording and its ``.meta.json``."""
    facts = _facts(path.with_suffix(".meta.json"))
    table = read_table(path, COLUMNS)
    enabled = column(table, "torque_enable")
    log = JointLog(
        goal=column(table, "goal_position"),
        position=column(table, "position"),
        velocity=column(table, "speed"),
        duty=column(table, "duty"),
        voltage=column(table, "input_volts"),
        temperature=column(table, "temp"),
        enabled=None if enabled.all() else enabled,
    )
    return MeasuredRun(
        name=path.stem,
        time=column(table, "timestamp"),
        joints={BENCH_JOINT: log},
        robot="bench",
        robot_params={"mass": facts["mass"], "length": facts["length"], "arm_mass": 0.0},
        actuators={BENCH_JOINT: chain(facts["kp"], facts["vin"])},
        source=path,
        meta={
            "group": f"kp{facts['kp']:g}",
            "machine": "Dynamixel XL330-M288-T, pendulum",
            "source": "Rhoban/bam at af2260462471",
            "licence": "Apache-2.0",
            "notes": "Neither the mass of the pendulum's rod was recorded (arm_mass 0 is a placeholder) nor where the "
            "encoder's zero is: the pendulum hangs anywhere within friction of 0.02 rad after a drop.",
            "unknown": ["zero", "friction", "armature"],
        },
    )


def _facts(path: Path) -> dict[str, float]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return {key: float(content[key]) for key in ("mass", "length", "kp", "vin")}
    except FileNotFoundError:
        raise LogError(f"{path}: is missing; it holds mass, length, kp and vin of the recording") from None
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise LogError(f"{path}: must hold mass, length, kp and vin as numbers ({error})") from None
