"""What the joints of a robot do to each other: how each moves, and what its drive draws from the supply of all.

Both follow from a replay of each joint. A first look at all of them knows their numbers better than what is believed:
a joint whose rotor is heavier than believed moves less sharply, and shakes its neighbours less.

Few logs have currents. A drive's duty follows from its goals and its measured motion, and duty and speed give the
current: a bridge draws its duty times the motor's current, and returns nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from ...actuators.stages.power import motor_behind
from ..checks.signal import derivatives
from ..load.robot import LoggedRobot, Machine
from ..log.types import Array, MeasuredRun
from ..replay.driven_simulator import law_along
from ..replay.joint_model import JointModel
from ..replay.parameters import Target, address
from .pieces import chain_of

MOMENTS = 8
"""Of a row, at which a duty is worked out: goals take effect between two rows."""
NOTHING_FOUND: Mapping[str, Mapping[str, float]] = MappingProxyType({})


def with_neighbours(machine: Machine, found: Mapping[str, Mapping[str, float]] = NOTHING_FOUND) -> Machine:
    """The machine with what is known of the neighbours of each joint; as it is where there is no robot's file.

    Args:
        machine: that was logged.
        found: numbers of joints that are better known than what is believed, by joint and path.
    """
    robot = machine.robot
    if robot is None:
        return machine
    runs, driven = [], {item.name for item in robot.file.joints if robot.number(item.name) >= 0}
    for run in machine:
        names = [name for name in run.joints if name in driven]
        draws = {name: drawn_by(run, name, robot, found.get(name, {})) for name in names} if len(names) > 1 else {}
        runs.append(
            replace(run, draws={name: rows for name, rows in draws.items() if rows is not None}, seen=dict(found))
        )
    return Machine.of(runs)


def drawn_by(run: MeasuredRun, joint: str, robot: LoggedRobot, found: Mapping[str, float]) -> Array | None:
    """What one drive draws at full voltage, and less of it per volt of sag (n, 2); None where nothing tells.

    Args:
        run, joint: that were logged.
        robot: of the run.
        found: numbers of the drive by path, beside what is believed.
    """
    log = run.joints[joint]
    own = {path: value for path, value in found.items() if address(path).target is Target.STAGE}
    model = JointModel(chain_of(run, joint, robot)).with_fitted(own)
    supply, command = model.chain.find("supply"), getattr(log, model.command)
    if supply is None or not model.chain.shares_supply():
        return None
    on = np.ones(len(run.time)) if log.enabled is None else log.enabled
    if log.duty is not None and log.current is not None:
        drawn = np.maximum(np.nan_to_num(log.duty * log.current), 0.0)
        return on[:, None] * np.stack([drawn, np.zeros(len(drawn))], axis=1)
    good = np.isfinite(log.position)
    if not good.any():
        return None
    smooth, rate, _ = derivatives(run.time, np.interp(run.time, run.time[good], log.position[good]))
    every, duty, speed = 1, log.duty, rate
    if duty is None:
        if command is None or not np.isfinite(command).any():
            return None
        every, count = MOMENTS, len(run.time)
        at = np.interp(np.arange(every * count) / every, np.arange(count), run.time)
        speed = np.interp(at, run.time, rate)
        duty = _duty(model, at - at[0], _held(run.time, command, at), np.interp(at, run.time, smooth), speed)
    duty = np.nan_to_num(duty)
    motor = motor_behind(model.chain, supply)
    drawn = duty * (duty * supply.volts - motor["back_emf"] * speed) / motor["motor_resistance"]
    less = np.where(drawn > 0.0, duty**2 / motor["motor_resistance"], 0.0)
    return on[:, None] * np.stack([np.maximum(drawn, 0.0), less], axis=1).reshape(-1, every, 2).mean(axis=1)


def _held(time: Array, command: Array, at: Array) -> Array:
    """The command in force (m,) at other times ``at`` (m,), from rows (n,) of which some may be empty."""
    known = np.isfinite(command)
    return command[known][np.maximum(np.searchsorted(time[known], at, "right") - 1, 0)]


def _duty(model: JointModel, time: Array, goal: Array, position: Array, speed: Array) -> Array:
    """Duty of a drive along a motion of its joint (n,)."""
    zeros, out = np.zeros(len(time)), np.empty((len(time), 5))
    program = model.chain.program()
    constants = model.constants({}, program)
    law_along(program, constants, zeros + 1.0, time, goal, zeros == 0.0, position, w=speed, external=zeros, out=out)
    return out[:, 2]
