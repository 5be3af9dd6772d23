"""One joint as the search sees it.

Its chain, what hangs on it, and how its host reads it. Everything that a cause may change.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...actuators.chain import Chain, with_stages
from ...actuators.layout import P_VISCOUS
from ...actuators.stages import Stage, stage_of
from ...actuators.stages.base import ChainError
from ..load.load import Load
from ..load.pendulum import PendulumLoad
from .axis import ROTATION, Axis
from .constants import Constants
from .integral import integral_constants
from .parameters import Parameter, Target, absolute, address

TOOTH_FREQUENCY = 400.0  # [rad/s] of the motor against stiff teeth: far above any motion, far below the step
TOOTH_DAMPING_RATIO = 0.2
IMMOVABLE = 1e12  # [kg.m2] of a link that moves as measured


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
    def by_torque(self) -> bool:
        """Whether it is commanded by a torque (or force), not by a position."""
        return self.chain.find("torque_command") is not None

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
            return self.load.value(at.key)
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
            stop_stiffness=self.axis.stop_stiffness,
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
