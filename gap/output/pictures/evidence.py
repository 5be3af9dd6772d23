"""What the measured motion says about torques, and what each model says along that same motion.

The measured joint is followed, not simulated: speed and acceleration come from its positions, gravity and inertia from
the load, the motor torque from the logged current or duty. What is left over is friction, read off the machine. Each
model is asked for its own torques at the very same samples, so that nothing but the law differs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...causes.friction import BRISTLE
from ...checks.signal import DERIVATIVE_WINDOW, derivatives
from ...load.resting import REVERSAL_SPEED
from ...load.terms import E_BIAS, E_COUPLING, E_INERTIA, E_SIZE
from ...replay.constants import K
from ...replay.driven_simulator import law_along
from ...replay.joint_model import JointModel
from ...replay.parameters import address
from ...replay.problem import JointProblem
from ...replay.simulator import CHANNELS, combine
from ...search.settings import DEFAULT
from ...verdict.verdict import JointDiagnosis

SMOOTHING_WINDOW = 2.0 * DERIVATIVE_WINDOW  # [s] over which accelerations are read: a picture shows single samples
DUTY, CURRENT = CHANNELS.index("duty"), CHANNELS.index("current")


@dataclass(frozen=True, eq=False)
class Motion:
    """Smoothed log of one joint, per sample of the problem (n,).

    Attributes:
        position, speed, acceleration: from cubics over :data:`SMOOTHING_WINDOW` [rad, rad/s, rad/s2].
        duty, current: logged ones, smoothed alike; None where they were not logged throughout.
        judged: samples that count.
        moving: of these, where the joint moves one way over the whole window.
    """

    position: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    duty: np.ndarray | None
    current: np.ndarray | None
    judged: np.ndarray
    moving: np.ndarray


@dataclass(frozen=True, eq=False)
class Balance:
    """Torques [N.m] of one model along the measured motion (n,).

    Attributes:
        angle, speed: of the joint, as this model reads the log [rad, rad/s].
        inertial, gravity: what the load takes: inertia times acceleration, and weight; of a joint of a robot also what
            the motion of the other joints takes.
        coupling: part of ``gravity`` that accelerations of the others take, which is no load to friction.
        motor: by the logged current or duty, by the model's own law where neither was logged.
        source: which of them: ``current``, ``duty`` or ``law``.
        law: motor torque of the model's own law.
        limit, viscous: friction of the model: dry limit, and what grows with speed.
        duty, current, voltage: of the law [1, A, V].
    """

    angle: np.ndarray
    speed: np.ndarray
    inertial: np.ndarray
    gravity: np.ndarray
    coupling: np.ndarray
    motor: np.ndarray
    source: str
    law: np.ndarray
    limit: np.ndarray
    viscous: np.ndarray
    duty: np.ndarray
    current: np.ndarray
    voltage: np.ndarray

    @property
    def observed_friction(self) -> np.ndarray:
        """Torque that the motor gives and the load does not get, positive against positive motion (n,)."""
        return self.motor - self.inertial - self.gravity

    @property
    def modelled_friction(self) -> np.ndarray:
        """Friction torque of the model while moving (n,)."""
        return np.sign(self.speed) * self.limit + self.viscous

    @property
    def load(self) -> np.ndarray:
        """Torque through the gearbox: motor torque less what pulls on the joint from outside (n,)."""
        return np.abs(self.motor + self.gravity - self.coupling)


class Evidence:
    """Motion and balances of one diagnosed joint, each computed once and only when a picture asks for it."""

    def __init__(self, diagnosis: JointDiagnosis) -> None:
        self.diagnosis = diagnosis

    @cached_property
    def problem(self) -> JointProblem:
        """The replay of the joint."""
        joint = None if self.diagnosis.problem is None else self.diagnosis.problem.joint
        if joint is None:
            raise ValueError("a diagnosis without a replayed joint has no motion to draw")
        return joint

    def unit(self, angular: str) -> str:
        """A unit as it is of this joint: that of a slide for that of a hinge."""
        return self.problem.models[0].axis.unit(angular)

    @property
    def effort(self) -> str:
        """What the motor gives: a torque, or the force of a slide, with its unit."""
        unit = self.unit("N.m")
        return f"{'torque' if unit == 'N.m' else 'force'} [{unit}]"

    @cached_property
    def motion(self) -> Motion:
        """The smoothed log."""
        return smooth(self.problem)

    @cached_property
    def quarter_turn_torque(self) -> np.ndarray:
        """Nominal gravity torque of each sample's load at a quarter turn (n,) [N.m]."""
        problem = self.problem
        torques = [problem.models[u.run].load.gravity_torque(problem.params[u.run]) for u in problem.units]
        return np.repeat(torques, np.diff(problem.starts))

    @cached_property
    def nominal(self) -> Balance:
        """Torques of the nominal model."""
        return balance(self.problem, self.motion, {})

    @cached_property
    def extended(self) -> Balance:
        """Torques of the extended model."""
        return balance(self.problem, self.motion, self.diagnosis.values)


def smooth(problem: JointProblem) -> Motion:
    """Local cubics through the positions of each unit, and through duty and current over the same windows."""
    n = len(problem.time)
    out = np.zeros((3, n))
    extra = {c: np.full(n, np.nan) for c in (DUTY, CURRENT) if np.isfinite(problem.measured[:, c]).mean() > 0.95}
    moving = np.zeros(n, bool)
    for a, b in zip(problem.starts[:-1], problem.starts[1:], strict=True):
        time = problem.time[a:b]
        width = max(round(SMOOTHING_WINDOW / float(np.median(np.diff(time)))), 1) if b - a > 1 else 1
        if b - a <= width:
            continue
        out[:, a:b] = derivatives(time, problem.measured[a:b, 0], SMOOTHING_WINDOW)
        for c, values in extra.items():
            known = np.isfinite(problem.measured[a:b, c])
            if known.any():
                logged = np.interp(time, time[known], problem.measured[a:b, c][known])
                values[a:b] = derivatives(time, logged, SMOOTHING_WINDOW)[0]
        fast = np.sign(out[1, a:b]) * (np.abs(out[1, a:b]) > REVERSAL_SPEED)
        moving[a:b] = np.abs(np.convolve(fast, np.ones(width), "same")) == width
    judged = problem.judged & np.isfinite(problem.measured[:, 0])
    return Motion(out[0], out[1], out[2], extra.get(DUTY), extra.get(CURRENT), judged, judged & moving)


def balance(problem: JointProblem, motion: Motion, values: Mapping[str, float]) -> Balance:
    """Torques of the nominal joints with ``values`` along the measured motion.

    Sticking counts as rigid: the bristles of presliding pass the same torque once a joint slides.
    """
    n = len(problem.time)
    values = {path: value for path, value in values.items() if address(path).number != BRISTLE}
    angle, speed, inertial, gravity, coupling, motor, viscous = np.zeros((7, n))
    law = np.zeros((n, 5))
    sources = []
    for k, unit in enumerate(problem.units):
        at = slice(problem.starts[k], problem.starts[k + 1])
        joint = problem.models[unit.run].with_fitted(values)
        program = joint.chain.program()
        constants = joint.constants(problem.params[unit.run], program)
        encoder = joint.chain.find("encoder")
        scale = joint.host_scale * (encoder.scale if encoder else 1.0)
        zero = joint.host_offset + joint.host_scale * (encoder.offset if encoder else 0.0)
        angle[at], speed[at] = (motion.position[at] - zero) / scale, motion.speed[at] / scale
        gravity[at] = constants[K.gravity] * np.sin(angle[at])
        inertia = constants[K.inertia] + constants[K.motor_inertia]
        if problem.terms is not None:  # of a joint of a robot: what it carries, and how the other joints move
            felt = np.empty((len(speed[at]), E_SIZE))
            for row, terms in zip(felt, problem.terms[at], strict=True):
                combine(constants, terms, row)
            inertia, gravity[at] = inertia + felt[:, E_INERTIA], gravity[at] + felt[:, E_BIAS]
            coupling[at] = felt[:, E_COUPLING]
        inertial[at] = inertia * motion.acceleration[at] / scale
        viscous[at] = constants[K.viscous] * speed[at]
        warm = np.maximum(1.0 - constants[K.loss] * (problem.temperature[at] - constants[K.reference]), 0.05)
        moved = (problem.on[at], angle[at], speed[at], coupling[at] - gravity[at])
        law_along(program, constants, warm, problem.time[at], problem.goal[at], *moved, law[at])
        motor[at], source = _motor_torque(joint, motion, at, speed[at], warm, law[at], problem.on[at])
        if source == "law":  # motion is smoothed about a row, before which the goal of the last row was held
            law_along(program, constants, warm, problem.time[at], _about_rows(problem.goal[at]), *moved, law[at])
            motor[at] = law[at][:, 0]
        sources.append(source)
    source = max(set(sources), key=sources.count)
    torques, limit, duty, current, voltage = law.T
    return Balance(
        angle, speed, inertial=inertial, gravity=gravity, coupling=coupling, motor=motor, source=source, law=torques,
        limit=limit, viscous=viscous, duty=duty, current=current, voltage=voltage,
    )  # fmt: skip


def _about_rows(held: np.ndarray) -> np.ndarray:
    """Means about each row of what is held from there to the next (n,)."""
    return np.concatenate([held[:1], 0.5 * (held[1:] + held[:-1])])


def _motor_torque(
    joint: JointModel,
    motion: Motion,
    at: slice,
    speed: np.ndarray,
    warm: np.ndarray,
    law: np.ndarray,
    on: np.ndarray,
) -> tuple[np.ndarray, str]:
    """Motor torque [N.m] by the best of what was logged, and what that was."""
    chain = joint.chain
    dc_motor, supply, regression = chain.find("dc_motor"), chain.find("supply"), chain.find("regression")
    ratio = chain.gear_ratio()
    if dc_motor is not None and _agrees(motion.current, at, law[:, 3]):
        assert motion.current is not None
        return dc_motor.motor_constant * ratio * warm * motion.current[at] * on, "current"
    if not _agrees(motion.duty, at, law[:, 2]):
        return law[:, 0], "law"
    assert motion.duty is not None
    duty = motion.duty[at]
    if dc_motor is not None and supply is not None:
        constant = dc_motor.motor_constant * ratio * warm
        sag, back_emf = duty**2 * supply.resistance, dc_motor.emf_ratio * constant * speed
        return on * constant * (duty * supply.volts - back_emf) / (dc_motor.resistance + sag), "duty"
    if regression is not None:
        torques = (
            ratio * (regression.duty_torque * duty + regression.constant) + ratio**2 * regression.speed_torque * speed
        )
        return on * torques, "duty"
    return law[:, 0], "law"


def _agrees(logged: np.ndarray | None, at: slice, law: np.ndarray) -> bool:
    """Whether a logged column means what the model means: signed, in its unit."""
    if logged is None or not np.all(np.isfinite(logged[at])) or np.std(logged[at]) == 0.0 or np.std(law) == 0.0:
        return False
    same = float(np.corrcoef(logged[at], law)[0, 1])
    slope = same * float(np.std(logged[at]) / np.std(law))
    return same > DEFAULT.column_agreement and DEFAULT.column_least_slope < slope < DEFAULT.column_most_slope
