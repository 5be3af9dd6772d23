"""The paper's analysis of the leg's dynamics (paper 000, sections 3 and 4.3), over lines of the foot at many speeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from ...envs.leg import path
from ...envs.leg.inertia import rotors
from ...envs.leg.kinematics import angles, foot, lengthening
from ...envs.leg.parameters import LIMITS
from ...envs.leg.robot import FOOT, JOINTS, LEG, chains_of
from .control import friction_torque
from .dynamics import Constants, constants, coriolis, gravity, mass_matrix

SPEEDS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)  # [m/s] highest of the foot: twice the mean of a bang-bang line
FIGURE_7 = 0.3  # [m/s] highest of the foot in figure 7, assumed
OWN_SPEED = 0.4  # [m/s] highest of a straight line with the printed mean of 0.2 m/s
REACH_LOW, REACH_HIGH = np.array([0.10, -0.35, -0.42]), np.array([0.50, 0.35, 0.10])  # [m] ends of lines, assumed
SHORTEST = 0.10  # [m] of a line
LINES, SEEDS = 150, 20  # lines at a speed, and draws of them
SAMPLES = 400
EFFICIENCY = (0.60, 0.80 * 0.70, 0.80 * 0.70)  # of the gears, table V
RULE = 0.05  # step 3: a term is significant from here on


@dataclass(frozen=True)
class Contributions:
    """Torques along one line, at the joints, (n, 3) each [N.m].

    Attributes:
        time: (n,) [s].
        q: angles [rad].
        lengthening: R_h (n,) [m].
        constant: of the constant inertia of the links, ``D_1``.
        varying: of the rest of the mass matrix, ``D_2``.
        coriolis: ``H``.
        gravity: ``C``.
        rotor: of what turns in motors and gears.
        friction: (16) with the viscous part.
        sliding: Coulomb and viscous friction of it.
        coupled: of ``varying`` and ``coriolis``, what the other joints' accelerations and speeds make.
        by_others: what the links' torque has because the other joints do not rest where they start.
    """

    time: np.ndarray
    q: np.ndarray
    lengthening: np.ndarray
    constant: np.ndarray
    varying: np.ndarray
    coriolis: np.ndarray
    gravity: np.ndarray
    rotor: np.ndarray
    friction: np.ndarray
    sliding: np.ndarray
    coupled: np.ndarray
    by_others: np.ndarray

    @property
    def perturbation(self) -> np.ndarray:
        """Equation (25)."""
        return self.varying + self.coriolis + self.gravity

    @property
    def inertia(self) -> np.ndarray:
        """Of the actuator's equivalent inertia: what (17) to (19) multiply by the acceleration."""
        return self.constant + self.rotor

    @property
    def total(self) -> np.ndarray:
        """What the motor gives, at the joint."""
        return self.slick + self.friction

    @property
    def slick(self) -> np.ndarray:
        """The same without friction."""
        return self.inertia + self.perturbation


class Analysis:
    """Contributions along lines of the foot.

    Attributes:
        values: numbers of the leg.
        constants: of its equations, without what the paper omits.
    """

    def __init__(self, params: Mapping[str, float] | None = None) -> None:
        self.values = LEG.parameters(params)
        self.constants: Constants = constants(self.values).as_printed()
        self._chains = chains_of("silo4")

    def lines(self, count: int, horizontal: bool, seed: int = 0) -> np.ndarray:
        """Begin and end (count, 2, 3) [m] of lines within reach, drawn over the whole workspace."""
        random, found = np.random.default_rng(seed), list[np.ndarray]()
        low, high = np.array(list(LIMITS.values())).T
        along = np.linspace(0.0, 1.0, 60)[:, None]
        while len(found) < count:
            ends = random.uniform(REACH_LOW, REACH_HIGH, (2, 3))
            if horizontal:
                ends[1, 2] = ends[0, 2]
            q = angles(self.values, ends[0] + (ends[1] - ends[0]) * along)
            inside = np.isfinite(q).all() and (q >= low).all() and (q <= high).all()
            if inside and np.linalg.norm(ends[1] - ends[0]) >= SHORTEST:
                found.append(ends)
        return np.array(found)

    def along(self, line: np.ndarray, speed: float) -> Contributions:
        """Contributions along a line whose highest speed is ``speed`` [m/s]."""
        return self.in_time(line, 2.0 * float(np.linalg.norm(line[1] - line[0])) / speed)

    def in_time(self, line: np.ndarray, seconds: float, joints_straight: bool = False) -> Contributions:
        """Contributions between the ends of a line in a time [s], bang-bang in acceleration.

        Args:
            line: begin and end of the foot (2, 3) [m].
            seconds: that it takes.
            joints_straight: each joint goes straight from its first to its last angle, and the foot does not.
        """
        time, step = np.linspace(0.0, seconds, SAMPLES + 2)[1:-1], 1e-4 * seconds
        ends = angles(self.values, line) if joints_straight else line
        command = np.concatenate([ends[0], ends[1], [seconds]])

        def reference(at: np.ndarray) -> np.ndarray:
            place = path.position(np.tile(command, (len(at), 1)), at)
            return place if joints_straight else angles(self.values, place)

        q, ahead, behind = reference(time), reference(time + step), reference(time - step)
        rate, acceleration = (ahead - behind) / (2.0 * step), (ahead - 2.0 * q + behind) / step**2
        k = self.constants
        constant = np.array([k.h, k.l, k.m]) * acceleration
        mass, turning, weight = mass_matrix(k, q), coriolis(k, q, rate), gravity(k, q)
        whole = np.einsum("nij,nj->ni", mass, acceleration)
        own = np.einsum("nii,ni->ni", mass, acceleration)
        alone = np.empty_like(q)
        for j in range(3):
            rest = np.tile(q[0], (len(q), 1))
            rest[:, j] = q[:, j]
            alone[:, j] = mass_matrix(k, rest)[:, j, j] * acceleration[:, j] + gravity(k, rest)[:, j]

        def friction(sliding: bool) -> np.ndarray:
            chains = [self._chains[name] for name in JOINTS]
            columns = [friction_torque(chain, q[:, j], rate[:, j], sliding) for j, chain in enumerate(chains)]
            return np.stack(columns, axis=1)

        return Contributions(
            time,
            q=q,
            lengthening=lengthening(self.values, q),
            constant=constant,
            varying=whole - constant,
            coriolis=turning,
            gravity=weight,
            rotor=rotors(self.values) * acceleration,
            friction=friction(sliding=False),
            sliding=friction(sliding=True),
            coupled=whole - own + turning,
            by_others=whole + turning + weight - alone,
        )

    def workspace(self, count: int, seed: int = 0) -> np.ndarray:
        """Joint angles over the whole workspace (count, 3) [rad]."""
        low, high = np.array(list(LIMITS.values())).T
        return np.random.default_rng(seed).uniform(low, high, (count, 3))


def peak(values: np.ndarray) -> np.ndarray:
    """Largest size of each column."""
    return np.abs(values).max(axis=0)


def coriolis_error(found: Contributions) -> float:
    """Largest Coriolis and centrifugal torque of any joint over the largest perturbation of any.

    A guess at the measure of Figure 7, which is not at hand: each joint's own perturbation cannot give its 4.2 %.
    """
    return float(peak(found.coriolis).max() / peak(found.perturbation).max())


def straightness(reach: np.ndarray, torque: np.ndarray) -> float:
    """How well a torque is linear in the lengthening: R2."""
    return float(np.corrcoef(reach, torque)[0, 1] ** 2)


def linear(reach: np.ndarray, torque: np.ndarray) -> tuple[float, float]:
    """``m`` and ``b`` of (29) and (30) by least squares [N.m/m], [N.m]."""
    slope, offset = np.polyfit(reach, torque, 1)
    return float(slope), float(offset)


def against_engine(count: int = 200, seed: int = 0) -> dict[str, float]:
    """Largest difference between symbols and MuJoCo of each element, over the element's largest size."""
    drivetrain, values = LEG.drivetrain("ideal"), LEG.parameters()
    model, data, k = drivetrain.model, mujoco.MjData(drivetrain.model), constants(values)
    random = np.random.default_rng(seed)
    q, rate = random.uniform(-np.pi, np.pi, (count, 3)), random.uniform(-3.0, 3.0, (count, 3))
    mass, turning, weight, place = (np.zeros((count, 3, 3)), *(np.zeros((count, 3)) for _ in range(3)))
    base = np.array([0.0, 0.0, values["base_height"]])
    for n in range(count):
        data.qpos[:], data.qvel[:] = q[n], 0.0
        mujoco.mj_forward(model, data)
        weight[n], place[n] = data.qfrc_bias, data.geom(FOOT).xpos - base
        mujoco.mj_fullM(model, data, mass[n])
        data.qvel[:] = rate[n]
        mujoco.mj_forward(model, data)
        turning[n] = data.qfrc_bias - weight[n]
    mass -= np.diag(rotors(values))
    ours = mass_matrix(k, q), coriolis(k, q, rate), gravity(k, q), foot(values, q)
    found = {}
    for row, column in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        gap = np.abs(ours[0] - mass)[:, row, column].max()
        found[f"D{row + 1}{column + 1}"] = float(gap / np.abs(mass[:, row, column]).max())
    for name, mine, engine in (("H", ours[1], turning), ("C", ours[2], weight), ("foot", ours[3], place)):
        for j in range(3):
            if (most := np.abs(engine[:, j]).max()) > 1e-9:
                found[f"{name}{j + 1}"] = float(np.abs(mine - engine)[:, j].max() / most)
    return found


def own_shares(rows: Sequence[Contributions]) -> np.ndarray:
    """Largest Coriolis torque over the largest perturbation of the same joint, by line and joint (n, 3)."""
    return np.array([peak(row.coriolis) / peak(row.perturbation) for row in rows])


@dataclass(frozen=True)
class Draw:
    """Figures of the worst of some lines, which hang on how the lines are drawn.

    Attributes:
        error: of leaving out Coriolis.
        of_motor: Coriolis torque over the motor's, by joint (3,).
        coupled: torque of other joints' motion over the motor's, by joint (3,).
    """

    error: float
    of_motor: np.ndarray
    coupled: np.ndarray


def draws(analysis: Analysis, speed: float, count: int, seeds: int, horizontal: bool = True) -> list[Draw]:
    """The worst of ``count`` lines, by the seed that they are drawn with."""
    found = []
    for seed in range(seeds):
        rows = [analysis.along(line, speed) for line in analysis.lines(count, horizontal, seed)]
        of_motor, coupled = (
            np.max([peak(torque) / peak(row.total) for torque, row in pairs], axis=0)
            for pairs in ([(row.coriolis, row) for row in rows], [(row.coupled, row) for row in rows])
        )
        found.append(Draw(max(map(coriolis_error, rows)), of_motor, coupled))
    return found


def by_efficiency(row: Contributions) -> np.ndarray:
    """What friction is by the gears' efficiencies (6) in place of (16), at the joints (n, 3) [N.m]."""
    return (1.0 / np.array(EFFICIENCY) - 1.0) * row.constant


def supply_volts() -> float:
    """Voltage of the assumed supply [V]."""
    return float(chains_of("silo4")[JOINTS[0]].value("supply.volts"))


def needed_volts(found: Contributions) -> float:
    """Largest voltage that a motor needs for a motion [V]."""
    chains, rate = chains_of("silo4"), np.gradient(found.q, found.time, axis=0)
    needed = 0.0
    for j, name in enumerate(JOINTS):
        motor, ratio = chains[name].find("dc_motor"), chains[name].gear_ratio()
        voltage = motor.resistance * found.total[:, j] / (motor.motor_constant * ratio)
        needed = max(needed, float(np.abs(voltage + motor.back_emf * ratio * rate[:, j]).max()))
    return needed


def fastest(analysis: Analysis, line: np.ndarray, volts: float, joints_straight: bool = False) -> float:
    """Highest mean speed of the foot between the ends of a line at which no motor needs more than ``volts`` [m/s]."""
    short, long = 0.01, 60.0
    for _ in range(14):
        middle = float(np.sqrt(short * long))
        enough = needed_volts(analysis.in_time(line, middle, joints_straight)) <= volts
        short, long = (short, middle) if enough else (middle, long)
    way = foot(analysis.values, analysis.in_time(line, long, joints_straight).q)
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum() / long)
