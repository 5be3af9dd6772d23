"""Servos that are set up otherwise than the factory or a robot's file says, in sentences."""

from __future__ import annotations

from collections.abc import Mapping

from ..bus.registers import ServoModel
from .robot import ServoRobot


def unlike_the_factory(registers: Mapping[str, Mapping[str, int]], servo: ServoModel) -> list[str]:
    """A sentence for each joint whose servo has been set up to move otherwise than it left the factory.

    Args:
        registers: counts by joint and name; a scan, which knows no joints, names the servo.
        servo: model of the servos.
    """
    found = []
    for joint, row in registers.items():
        changed = [
            f"{name} {row[name]} ({servo[name].default})"
            for name in servo.moves
            if row[name] != servo[name].default
            and not (name == servo.role("mark") and row[name] == servo[name].default - 1)  # the mark of an earlier run
        ]
        if changed:
            found.append(
                f"Joint {joint} moves otherwise than from the factory, which the chains of configs/actuator describe: "
                f"{', '.join(changed)}."
            )
    return found


def unlike_the_file(
    registers: Mapping[str, Mapping[str, int]], robot: ServoRobot, ports: Mapping[str, str]
) -> list[str]:
    """A sentence for each joint whose servo is not set up as the robot's file says, and what to type.

    Args:
        registers: counts by joint and name.
        robot: with what its file says.
        ports: paths by name of the bus.
    """
    found = []
    for joint in robot.joints:
        row = registers[joint.name]
        if other := [name for name, count in robot.registers.items() if row.get(name, count) != count]:
            counts = ", ".join(f"{name} {row[name]} ({robot.registers[name]})" for name in other)
            model, wanted = joint.line.model(robot.servo), {name: robot.registers[name] for name in other}
            mend = model.setting(joint.id, wanted, ports[joint.line.name])
            found.append(
                f"Joint {joint.name} is set up otherwise than the robot's file says: {counts}; {mend} mends it."
            )
    return found
