"""The encoder, and the host that logs what it reads."""

from __future__ import annotations

from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter
from .cause import Cause, Limit
from .registry import entry


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
