"""The encoder, and the host that logs what it reads; and the torque column of a log that is judged by it."""

from __future__ import annotations

from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter
from .cause import Cause, Limit, alone, entry


@entry("sensor.offset")
def offset(nominal: JointModel) -> Cause:
    del nominal
    in_loop = Parameter("encoder.offset", "rad", -0.8, 0.8, 0.0, 0.02)
    in_log = Parameter("host.offset", "rad", -0.8, 0.8, 0.0, 0.005)
    return Cause(
        sentence="The encoder's zero is not where the model has it.",
        picture="residual_against_position",
        variants=((in_loop,), (in_log,)),
        error=True,
        degenerates_to=Limit("drive.offset", "gravity does not act on the joint"),
    )


@entry("sensor.scale")
def scale(nominal: JointModel) -> Cause:
    del nominal
    in_loop = Parameter("encoder.scale", "1", 0.4, 2.5, 1.0, 0.05, logarithmic=True)
    in_log = Parameter("host.scale", "1", 0.01, 100.0, 1.0, 0.02, logarithmic=True)
    return Cause(
        sentence="The encoder reads more or less than the angle.",
        picture="residual_against_position",
        variants=((in_loop,), (in_log,)),
        error=True,
    )


@entry("sensor.delay")
def delay(nominal: JointModel) -> Cause:
    del nominal
    late = Parameter("encoder.latency", "s", 0.0, 0.2, 0.006, 0.003)
    return Cause(
        sentence="Readings reach the host late.",
        signature="lag",
        picture="response",
        variants=((late,),),
        degenerates_to=Limit("drive.delay", "neither duty nor current was logged"),
    )


def of_torque_column(start: float, reach: float, size: float) -> list[Cause]:
    """What may be wrong with a torque column, under the names of the same faults of an encoder.

    Args:
        start: delay at which a shift against the motion is seen [s].
        reach: largest delay that is tried [s].
        size: of the torque (rms) [N.m].
    """
    delays = [min(max(at, -reach), reach) for at in dict.fromkeys((start, 0.005, -0.005))]
    shift = Parameter("torque.offset", "N.m", -5.0 * size, 5.0 * size, 0.05 * size, 0.02 * size)
    return [
        Cause(
            name="sensor.offset",
            sentence="The torque column is shifted by a constant.",
            picture="residual_against_position",
            variants=((shift,),),
            error=True,
            of_column=True,
        ),
        Cause(
            name="sensor.scale",
            sentence="The torque column reads more or less than the torque.",
            picture="residual_against_position",
            variants=alone(Parameter("torque.scale", "1", -10.0, 10.0, 1.0, 0.05), 1.0, -1.0),
            error=True,
            of_column=True,
        ),
        Cause(
            name="sensor.delay",
            sentence="Torque and motion were not read at the same time: the torque column is late, or early where the "
            "delay is below zero.",
            picture="response",
            variants=alone(Parameter("torque.delay", "s", -reach, reach, 0.0, 0.003), *delays),
            error=True,
            of_column=True,
        ),
    ]
