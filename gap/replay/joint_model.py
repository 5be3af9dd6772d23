"""One joint as the search sees it.

Its kind, its chain, what hangs on it, and how its host reads it. Everything that a cause may change.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...actuators.chain import Chain, with_stages
from ...actuators.layout import P_VISCOUS
from ...actuators.stages import Stage, stage_of
from ...actuators.stages.base import ChainError
from ...envs.bench.stops import STOP_DAMPING, STOP_STIFFNESS
from ..load.load import Load, PendulumLoad
from .constants import Constants
from .parameters import Parameter, Target, absolute, address

LINEAR = (
    ("kg.m2", "kg"),
    ("N.m.s2/rad2", "N.s2/m2"),
    ("N.m.s/rad", "N.s/m"),
    ("N.m/rad", "N/m"),
    ("1/(N.m)", "1/N"),
    ("1/(rad.s)", "1/(m.s)"),
    ("N.m/A = V.s/rad", "N/A = V.s/m"),
    ("s/rad", "s/m"),
    ("1/rad", "1/m"),
    ("1/turn", "rad/m"),
    ("rad/s2", "m/s2"),
    ("rad/s", "m/s"),
    ("N.m", "N"),
    ("rad", "m"),
)
"""Units of a hinge, and what they are of a slide."""
USUAL_REACH = 2.0  # [rad] that the bounds of causes were set for: what a servo turns through
USUAL_EFFORT = 1.5  # [N.m] and what it drives with
TOOTH_FREQUENCY = 400.0  # [rad/s] of the motor against stiff teeth: far above any motion, far below the step
TOOTH_DAMPING_RATIO = 0.2
IMMOVABLE = 1e12  # [kg.m2] of a link that moves as measured


@dataclass(frozen=True)
class Axis:
    """A hinge or a slide.

    Attributes:
        slide: whether it moves along a line: lengths in m and forces in N, where a hinge has rad and N.m.
        low, high: where it went in the log [rad] or [m].
        effort: largest torque that was commanded [N.m] or [N]; None where the chain's motor says it.
    """

    slide: bool = False
    low: float = -math.inf
    high: float = math.inf
    effort: float | None = None

    def unit(self, unit: str) -> str:
        """A unit as it is of this axis."""
        if not self.slide:
            return unit
        return next((linear for angular, linear in LINEAR if unit == angular), unit)

    @property
    def reach(self) -> float:
        """Length that a slide goes where a servo turns by a radian; 1 of a hinge."""
        span = self.high - self.low
        return span / USUAL_REACH if self.slide and math.isfinite(span) and span > 0.0 else 1.0

    @property
    def span(self) -> float:
        """How far it goes in the log [rad] or [m]; 0 where that is not known."""
        return self.high - self.low if math.isfinite(self.high - self.low) else 0.0

    @property
    def stop_stiffness(self) -> float:
        """Of what stops it [N.m/rad]: as of the bench, by this axis' effort and reach; assumed."""
        return STOP_STIFFNESS * max((self.effort or USUAL_EFFORT) / USUAL_EFFORT, 1.0) / self.reach

    @property
    def stop_damping(self) -> float:
        """Of what stops it [N.m.s/rad]."""
        return STOP_DAMPING * max((self.effort or USUAL_EFFORT) / USUAL_EFFORT, 1.0) / self.reach

    def scaled(self, parameter: Parameter) -> Parameter:
        """A parameter of a hinge as it is of this axis: unit, and bounds by how far the axis goes."""
        if not self.slide or parameter.phase:
            return parameter
        unit = self.unit(parameter.unit)
        size = 1.0 if parameter.factor else self.reach ** POWER.get(parameter.unit, 0)
        scale = parameter.scale if parameter.logarithmic else parameter.scale * size
        return dataclasses.replace(
            parameter,
            unit=unit,
            low=parameter.low * size,
            high=parameter.high * size,
            start=parameter.start * size,
            scale=scale,
        )


POWER = {"1/turn": -1, "rad": 1, "rad/s": 1, "rad/s2": 1, "N.m.s/rad": -1, "N.m/rad": -1, "N.m.s2/rad2": -2}
"""With which power of the reach numbers in these units grow, torques being given by the effort already."""
ROTATION = Axis()


@dataclass(frozen=True)
class JointModel:
    """A joint: chain, load, and what the host's log does to the reading.

    ``unknown`` are numbers that nobody measured (:mod:`sealegs.gap.causes.unknown`): every fit turns them, and none is
    a finding. ``axis`` is what kind of joint it is, and how much it moves and is driven. ``of_robot`` says whether it
    is one of a robot, not of a bench.
    """

    chain: Chain
    load: Load = field(default_factory=PendulumLoad)
    host_offset: float = 0.0
    host_scale: float = 1.0
    unknown: tuple[Parameter, ...] = ()
    axis: Axis = ROTATION
    of_robot: bool = False

    @property
    def command(self) -> str:
        """Column of its log that it is told: ``goal``, ``goal_velocity`` or ``torque_command``."""
        return self.chain.command

    @property
    def by_torque(self) -> bool:
        """Whether it is commanded by a torque (or force), not by a position or a speed."""
        return self.command == "torque_command"

    @property
    def elastic(self) -> bool:
        """Whether something of a known stiffness gives between motor and link."""
        play = self.chain.find("backlash")  # whose teeth are as stiff as the inertia asks for, unless somebody says
        springs = any(self.chain.find(stage) is not None for stage in ("spring", "compliance"))
        return springs or (play is not None and play.tooth_stiffness > 0.0)

    def value(self, path: str) -> float:
        """A parameter by path: ``stage.parameter``, ``load.*``, ``host.*`` or ``gear_ratio.factor`` (1 by
        definition).
        """
        at = address(path)
        if at.target is Target.LOAD:
            value = self.load.value(at.key)
            return value or self.axis.stop_stiffness if at.key == "stop_stiffness" else value
        if at.target is Target.HOST:
            return getattr(self, f"host_{at.key}")
        if at.target is Target.GEAR:
            return 1.0
        stage = self.chain.find(at.owner)
        if stage is None:
            return float(getattr(_neutral(at.owner), at.key))
        return getattr(stage, at.key)

    def unit(self, path: str) -> str:
        """Unit of a parameter of a stage by path; 1 where it has none."""
        at = address(path)
        stage = self.chain.find(at.owner)
        fields = dataclasses.fields(stage) if stage is not None else ()
        return self.axis.unit(next((item.metadata.get("unit", "1") for item in fields if item.name == at.key), "1"))

    def with_values(self, values: Mapping[str, float]) -> JointModel:
        """The joint with parameters set by path; stages that are missing are added where they belong.

        Raises:
            ChainError: the values do not make a chain.
        """
        chain, load, host = self.chain, {}, {}
        by_stage: dict[str, dict[str, float]] = {}
        for path, value in values.items():
            at = address(path)
            if at.target is Target.LOAD:
                load[at.key] = value
            elif at.target is Target.HOST:
                host[f"host_{at.key}"] = value
            elif at.target is Target.STAGE:
                by_stage.setdefault(at.owner, {})[at.key] = value
        stages = list(chain.stages)
        added: list[Stage] = []
        for name, change in by_stage.items():
            at = next((k for k, stage in enumerate(stages) if stage.name == name), None)
            if at is None:
                added.append(dataclasses.replace(_neutral(name), **change))
            else:
                stages[at] = dataclasses.replace(stages[at], **change)
        if (factor := values.get("gear_ratio.factor")) is not None:
            at = next(k for k, stage in enumerate(stages) if stage.name == "dc_motor")
            motor: Any = stages[at]
            stages[at] = dataclasses.replace(
                motor,
                motor_constant=motor.motor_constant * factor,
                armature=motor.armature * factor**2,
            )
        if by_stage or "gear_ratio.factor" in values:
            chain = Chain(with_stages(stages, added), chain.label)
        return JointModel(
            chain,
            self.load.with_values(load) if load else self.load,
            host.get("host_offset", self.host_offset),
            host.get("host_scale", self.host_scale),
            self.unknown,
            self.axis,
            self.of_robot,
        )

    def with_fitted(self, values: Mapping[str, float]) -> JointModel:
        """The joint with values of a fit: factors are on this joint's own values.

        Raises:
            ChainError: as :meth:`with_values`.
        """
        return self.with_values(absolute(values, self))

    def constants(self, params: Mapping[str, float], program: np.ndarray) -> np.ndarray:
        """What the simulator needs beside the program, for a run with these bench parameters; without any, for a link
        that moves as it was measured, whatever torque acts on it.

        Raises:
            ChainError: the chain's spring has an inertia of its own.
        """
        chain = self.chain
        if (spring := chain.find("spring")) is not None and spring.has_coordinate:
            raise ChainError(
                f"{chain.label}: its 'spring' has an inertia of its own, a third body that the replay of a joint does "
                "not simulate; give the chain a spring without inertia."
            )
        load = self.load
        lower_stop, upper_stop = load.stops(params)
        known = load.known(params)
        inertia = load.inertia(params) if known else IMMOVABLE
        numbers = Constants(
            inertia=inertia,
            gravity=load.gravity_torque(params) if known else 0.0,
            motor_inertia=max(chain.armature(), 1e-7),
            viscous=float(program[P_VISCOUS]),
            host_offset=self.host_offset,
            host_scale=self.host_scale,
            stop=upper_stop,
            lower_stop=lower_stop,
            stop_stiffness=self.value("load.stop_stiffness"),
            stop_damping=self.axis.stop_damping,
            delay=delay.seconds if (delay := chain.find("delay")) is not None else 0.0,
        )
        if (thermal := chain.find("thermal")) is not None:
            motor = chain.address("dc_motor.motor_constant")
            numbers = numbers._replace(
                loss=thermal.loss,
                reference=thermal.reference,
                motor=motor,
                constant=program[motor] / chain.magnetisation(),
            )
        if (supply := chain.find("supply")) is not None and supply.resistance > 0.0:
            at, of = (chain.address(f"supply.{key}") for key in ("volts", "resistance"))
            numbers = numbers._replace(supply=at, resistance=of, volts=supply.volts, sag=supply.resistance)
        numbers = numbers._replace(**self._coupling(numbers), **integral_constants(chain, program))
        return np.array(numbers._replace(**load.along_log(self.axis.slide)), float)

    def _coupling(self, numbers: Constants) -> dict[str, float]:
        """Of :class:`Constants`, what lies between motor and link."""
        chain = self.chain
        element, play = chain.find("spring") or chain.find("compliance"), chain.find("backlash")
        if element is None and (play is None or play.width <= 0.0):
            return {}
        if element is not None:
            stiffness, damping = element.stiffness, element.damping
        elif play.tooth_stiffness > 0.0:
            stiffness, damping = play.tooth_stiffness, play.tooth_damping
        else:
            inertia = 1.0 / (1.0 / numbers.motor_inertia + 1.0 / numbers.inertia)
            stiffness = inertia * TOOTH_FREQUENCY**2
            damping = 2.0 * TOOTH_DAMPING_RATIO * inertia * TOOTH_FREQUENCY
        half_play = play.width / 2.0 if play is not None else 0.0
        return {"coupled": 1.0, "stiffness": stiffness, "damping": damping, "half_play": half_play}


def _neutral(name: str) -> Stage:
    if (stage := stage_of(name)) is None:
        raise ChainError(f"the chain has no stage '{name}', and there is no such stage to add.")
    return stage.neutral()


def integral_constants(chain: Chain, program: np.ndarray) -> dict[str, float]:
    """Of :class:`sealegs.gap.replay.constants.Constants`, where a chain keeps its integral and what it does."""
    loop = chain.find("position_pi")
    if loop is None or loop.integral == 0.0:
        return {}
    record = chain.address("position_pi.gain")  # the first number of its record, behind where its memory starts
    found = {"integral": float(program[record - 1]), "sampled": float(loop.period > 0.0)}
    motor, supply = chain.find("dc_motor"), chain.find("supply")
    if motor is None or supply is None:
        return found
    stall = supply.volts / motor.resistance
    constant = motor.motor_constant * chain.gear_ratio() * chain.magnetisation()
    return {**found, "duty_current": stall, "duty_torque": constant * stall}
