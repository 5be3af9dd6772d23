"""What the YAML of a robot says, as it stands there: of the robot, of a driven joint, and of its servo."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from ...configs.check import NotNegative, Positive

YAML_SUFFIXES = (".yaml", ".yml")
Owner = Literal["chain", "file"]
"""Whose number counts: the chain's, or the model file's."""

UNKNOWN = ("zero", "direction", "friction", "armature", "motor", "load")
"""Words for what nobody measured at a joint; fits may turn it."""


@dataclass(frozen=True)
class ServoEntry:
    """Which servo drives a joint, for deployment.

    Attributes:
        id: on the bus.
        zero: step of its encoder at which the joint is at 0; None: the centre.
        direction: 1 where growing steps are the joint's positive direction, else -1.
    """

    id: int
    zero: int | None = None
    direction: Literal[1, -1] = 1


@dataclass(frozen=True)
class JointEntry:
    """What the YAML says of a driven coordinate.

    Attributes:
        chain: word, path (relative to the YAML) or stages; None: an ideal servo as the model file has it.
        joint: of the model; None: the one of the same name.
        belt: joints of the model and coefficients whose sum is driven, in place of one joint.
        range: of its goals [rad or m; of a chain that is told speeds rad/s]; None: that of the model's joint.
        damping, armature, frictionloss, actuatorfrcrange: their owner; None: the chain where it states the number, else
            the file.
        start: where episodes start [rad or m]; None: the model's keyframe, else 0.
        unknown: words of :data:`UNKNOWN`.
        servo: that drives it; None: ids from 1 in order, zero at the encoder's centre.
    """

    chain: str | list[Any] | None = None
    joint: str | None = None
    belt: dict[str, Any] | None = None
    range: tuple[float, float] | None = None
    damping: Owner | None = None
    armature: Owner | None = None
    frictionloss: Owner | None = None
    actuatorfrcrange: Owner | None = None
    start: float | None = None
    unknown: list[str] = field(default_factory=list)
    servo: dict[str, Any] | None = None


@dataclass(frozen=True)
class FloorEntry:
    """A level floor at height 0, under a robot whose model file has none.

    Attributes:
        friction: coefficient of sliding [-]; assumed: rubber on wood.
    """

    friction: float = 1.0


@dataclass(frozen=True)
class ImuEntry:
    """An IMU on the robot's free base; numbers that are left out are assumed.

    Attributes:
        site: of the model where it sits, whose axes are its own; None: on ``body``.
        body: of the model that it sits on, which no joint moves against the base; None: the base itself.
        rotation: of its axes against those of site or body: roll, pitch, yaw [rad].
        rate: samples per second [Hz].
        delay: from the motion to the sample at the computer [s].
        noise: of each sample, standard deviation about each axis: ``orientation`` [rad], ``turn_rate`` [rad/s].
        bias: of each IMU, likewise.
        fallen: tilt from where the robot starts, at which a run ends [rad]; None: none.
        silent: time without a sample at which a run ends [s], and two cycles at least.
        part: how a computer reads it: ``name`` and what that needs, such as ``port``.
        switches: contact switches that its samples hold, by name; see :class:`SwitchEntry`.
    """

    site: str | None = None
    body: str | None = None
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rate: Positive = 100.0
    delay: NotNegative = 0.01
    noise: dict[str, Any] = field(default_factory=dict)
    bias: dict[str, Any] = field(default_factory=dict)
    fallen: Positive | None = 1.0
    silent: Positive = 0.1
    part: dict[str, Any] = field(default_factory=dict)
    switches: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class SwitchEntry:
    """A contact switch on the IMU's board.

    Attributes:
        body, geom, site: of the model, one of them: what is pressed; a site counts contacts within its own shape.
        threshold: force above which it is closed [N]; assumed.
    """

    body: str | None = None
    geom: str | None = None
    site: str | None = None
    threshold: Positive = 1.0


@dataclass(frozen=True)
class FileEntry:
    """What the YAML says of the robot.

    Attributes:
        model: MJCF or URDF, relative to the YAML.
        joints: by driven coordinate; None: those that the model's actuators drive, else all.
        name: of the robot; None: that of the YAML.
        base: fixed to the ground, or free; None: as in the model.
        floor: under it; None: that of the model, or none.
        height: of a free base at the start of an episode [m]; None: the keyframe's, or the model's.
        exclude: pairs of bodies that never touch, such as shapes of a file that lie within each other.
        feet: bodies without a shape that touches, which get one: the box of their mass and inertia.
        timestep: of the simulation [s]; None: 2 ms, the model's where it is shorter, or what is stable.
        integrator: of the engine; None: RK4, or what is stable.
        imu: on its free base; see :class:`ImuEntry`.
        deploy: what ``configs/robot`` holds of built-in robots: servo, sensors, rest, park, safety.
    """

    model: str
    joints: dict[str, Any] | None = None
    name: str | None = None
    base: Literal["fixed", "free"] | None = None
    floor: dict[str, Any] | None = None
    height: float | None = None
    exclude: list[list[str]] = field(default_factory=list)
    feet: list[str] = field(default_factory=list)
    timestep: float | None = None
    integrator: Literal["RK4", "Euler", "implicit", "implicitfast"] | None = None
    imu: dict[str, Any] | None = None
    deploy: dict[str, Any] = field(default_factory=dict)
