"""Joint friction from motor currents alone, leg by leg and direction by direction: paper 001, 5.3 and 5.4.

A vertical joint on its own, with what its leg weighs and what its foot carries as forces at the joint. Steady-state
curves come from constant speeds, at which inertia vanishes; breakaway forces from a voltage that grows by 0.05 V/s
until the joint moves, by the balances (32) and (33). The paper's tables 4 to 9 did not reach us, so what is planted is
assumed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from ...actuators import Chain, Drivetrain, load_chain
from ...actuators.gravity import GRAVITY
from ...actuators.layout import S_CURRENT
from ...common.errors import SealegsError
from ...envs.hexapod.kinematics import foot_load
from ...envs.hexapod.parameters import LEGS, NUMBERS
from ...envs.hexapod.robot import KINDS, VERTICAL, chains_of, coordinate
from .leg_model import gravity

STEP = 0.001  # [s]
RAMP = 0.05  # [V/s], 5.4
SPEEDS = (0.002, 0.004, 0.006, 0.008)  # [m/s] of the screw, assumed
SETTLING, MEASURED = 0.5, 1.0  # [s] at each speed
MOVED = 2e-5  # [m] by which a joint has broken away: bristles give way by less than 1e-6
LONGEST = 60.0  # [s] of a ramp
SOFT = 1e-4  # duty per metre of a loop so weak that its goal is a voltage
SPREAD = 0.2  # of friction by leg and direction, relative, assumed


@dataclass(frozen=True)
class Steady:
    """Friction while a joint moves, by direction.

    Attributes:
        coulomb: Q_fd of the positive and the negative direction (2,) [N].
        viscous: f_v of both (2,) [N.s/m].
    """

    coulomb: tuple[float, float]
    viscous: tuple[float, float]


def external(load: float) -> float:
    """Force on a vertical joint beside motor and friction, Q_leg - Q_load [N], with a load on the foot [kg]."""
    force_per_load = 1.0 / foot_load({name: number.value for name, number in NUMBERS.items()})
    return leg_weight() + force_per_load * GRAVITY * load


def leg_weight() -> float:
    """Q_leg, by which the weight of the leg's own parts raises a vertical joint [N]."""
    return -gravity()[KINDS.index(VERTICAL)]


def planted(changes: Mapping[str, float], control: bool) -> Chain:
    """The chain of a vertical joint with LuGre bristles and other friction; without ``control`` under a voltage."""
    stages = chains_of("amru5_lugre")[coordinate(0, VERTICAL)].to_list()
    for stage in stages:
        if "friction" in stage:
            stage["friction"] |= dict(changes)
    if not control:
        stages[0] = {"position_p": {"gain": SOFT}}
    return load_chain(stages)


class JointBench:
    """One vertical joint under a constant force."""

    def __init__(self, chain: Chain, force: float) -> None:
        """Build it at rest.

        Args:
            chain: of the joint.
            force: beside motor and friction, positive as the joint rises [N].
        """
        spec = mujoco.MjSpec()
        spec.option.timestep, spec.option.gravity = STEP, (0.0, 0.0, 0.0)
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        gear, motor = chain.value("gear.ratio"), chain.value("dc_motor.motor_constant")
        rotor = NUMBERS["rotor_inertia"].value * gear**2  # [kg] at the screw
        nut = spec.worldbody.add_body(mass=rotor, ipos=(0, 0, 0), inertia=(1.0,) * 3, explicitinertial=True)
        nut.add_joint(name="screw", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0.0, 0.0, 1.0))
        drivetrain = Drivetrain(spec, {"screw": chain})
        self.model, self.force_per_ampere = drivetrain.model, gear * motor
        self.data = mujoco.MjData(self.model)
        self.data.qfrc_applied[0] = force
        self._current = drivetrain.state_addresses["screw"] + S_CURRENT
        self._volts = chain.value("supply.volts")

    @property
    def motor_force(self) -> float:
        """Q_a, by the motor's current [N]."""
        return float(self.data.userdata[self._current]) * self.force_per_ampere

    def volts(self, volts: float) -> None:
        """Set the voltage of a joint without a controller."""
        self.data.ctrl[0] = self.data.qpos[0] + volts / self._volts / SOFT

    def step(self) -> None:
        """A millisecond."""
        mujoco.mj_step(self.model, self.data)


def breakaway(changes: Mapping[str, float], load: float) -> tuple[float, float]:
    """Q_fs of the positive and the negative direction, by (32) and (33) [N].

    Args:
        changes: of the friction's numbers.
        load: on the foot [kg].

    Raises:
        SealegsError: the load overcomes the joint, which then moves without a voltage.
    """
    beside = external(load)
    found = []
    for sign in (1.0, -1.0):
        bench = JointBench(planted(changes, control=False), beside)
        for k in range(round(SETTLING / STEP)):  # laid on slowly: a load that drops onto bristles pulls twice as hard
            bench.data.qfrc_applied[0] = beside * min(2.0 * k * STEP / SETTLING, 1.0)
            bench.step()
        start, before = float(bench.data.qpos[0]), bench.motor_force
        if abs(start) > MOVED:
            raise SealegsError(f"a load of {load:g} kg overcomes the joint, whose breakaway force cannot be found.")
        for k in range(round(LONGEST / STEP)):
            bench.volts(sign * RAMP * STEP * k)
            bench.step()
            if abs(float(bench.data.qpos[0]) - start) > MOVED:
                break
            before = max(before, sign * bench.motor_force)
        found.append(before + sign * beside)
    return found[0], found[1]


def steady(changes: Mapping[str, float], speeds: Sequence[float] = SPEEDS) -> Steady:
    """Coulomb and viscous friction of both directions from constant speeds, gravity taken away (5.3).

    Args:
        changes: of the friction's numbers.
        speeds: of the screw [m/s].
    """
    beside = external(0.0)
    coulomb, viscous = [], []
    for sign in (1.0, -1.0):
        forces = []
        for speed in speeds:
            bench = JointBench(planted(changes, control=True), beside)
            total, count = 0.0, round((SETTLING + MEASURED) / STEP)
            for k in range(count):
                bench.data.ctrl[0] = sign * speed * STEP * k
                bench.step()
                total += bench.motor_force if k * STEP >= SETTLING else 0.0
            forces.append(sign * (total / round(MEASURED / STEP) + beside))
        slope, level = np.polyfit(speeds, forces, 1)
        coulomb.append(float(level))
        viscous.append(float(slope))
    return Steady((coulomb[0], coulomb[1]), (viscous[0], viscous[1]))


def of_leg(leg: int, kind: str = VERTICAL, seed: int = 1) -> dict[str, float]:
    """Friction of a leg's joint: that of the chain, spread by leg and direction; assumed.

    Returns:
        Numbers of the friction; ``asymmetry`` is half of what the positive direction has more.
    """
    own = chains_of("amru5_lugre")[coordinate(0, kind)]
    draw = np.random.default_rng([seed, leg, KINDS.index(kind)]).uniform(-1.0, 1.0, 3)
    dry = own.value("friction.coulomb") * (1.0 + SPREAD * draw[0])
    return {
        "coulomb": dry,
        "stribeck": own.value("friction.stribeck") * (1.0 + SPREAD * draw[1]),
        "asymmetry": SPREAD * dry * draw[2],
    }


@dataclass(frozen=True)
class Identified:
    """Friction of the six vertical joints, found beside planted, by leg and direction (6, 2).

    Attributes:
        coulomb, viscous, breakaway: found [N, N.s/m, N].
        planted_coulomb, planted_viscous, planted_breakaway: likewise.
    """

    coulomb: np.ndarray
    viscous: np.ndarray
    breakaway: np.ndarray
    planted_coulomb: np.ndarray
    planted_viscous: np.ndarray
    planted_breakaway: np.ndarray

    def worst(self, quantity: str) -> float:
        """Largest relative error of ``coulomb``, ``viscous`` or ``breakaway``."""
        found, planted = getattr(self, quantity), getattr(self, f"planted_{quantity}")
        return float(np.abs(found / planted - 1.0).max())


def identify(load: float = 5.0) -> Identified:
    """Both experiments on all legs, with a load on the foot for the breakaway force [kg]."""
    own = chains_of("amru5_lugre")[coordinate(0, VERTICAL)]
    both = np.array([1.0, -1.0])
    rows = []
    for leg in range(LEGS):
        friction = of_leg(leg)
        moving = steady(friction)
        dry = friction["coulomb"] + both * friction["asymmetry"]
        planted_viscous = np.full(2, own.value("friction.viscous"))
        rest = dry + friction["stribeck"]
        rows.append((moving.coulomb, moving.viscous, breakaway(friction, load), dry, planted_viscous, rest))
    return Identified(*(np.array(column, float) for column in zip(*rows, strict=True)))


def largest_bristle_damping(coulomb: float, stribeck: float, viscous: float) -> float:
    """Bristle damping sigma_1 up to which LuGre friction gives no power back that it did not store [N.s/m].

    F = x + sigma_1 z' + f_v v, with x = sigma_0 z the force of the bristles and z' = v - |v| x / g(v). Power in, less
    what the bristles' energy sigma_0 z^2 / 2 gains in that time, is

        F v - x z' = |v| x^2 / g + v^2 (f_v + sigma_1 (1 - sign(v) x / g)).

    Bristles never hold more than F_s, and g is no less than F_c: the bracket is at least
    f_v - sigma_1 (F_s - F_c) / F_c.

    Args:
        coulomb: F_c [N].
        stribeck: F_s - F_c [N].
        viscous: f_v [N.s/m].
    """
    return viscous * coulomb / stribeck
