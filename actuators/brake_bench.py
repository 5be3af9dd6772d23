"""A virtual brake bench: the measurement of paper 004, section III-B, on any chain that works with a duty.

The servo runs at a set duty (PWM) against a hysteresis brake, which can only oppose its motion. Torque and speed are
recorded once they are steady, so the bench solves for the speed at which chain, friction and brake balance.
"""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.errors import SealegsError
from .chain import GIVING, Chain
from .compiled import compiled
from .law import begin, torque
from .layout import P_STATE_SIZE, P_VISCOUS, S_LIMIT
from .stages import Quantity
from .stages.controller import PositionP

COPPER = 0.00393  # [1/K] growth of a copper winding's resistance, from its data sheet value at:
REFERENCE_TEMPERATURE = 25.0  # [degC]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Protocol:
    """What the bench is told to measure; the defaults are the printed ones.

    Attributes:
        duties: PWM as a share of full [-].
        loads: brake torque [N.m].
        temperatures: of the motor [degC].
        repeats: measurements of each point.
    """

    duties: tuple[float, ...] = tuple(round(-0.9 + 0.05 * k, 2) for k in range(37))
    loads: tuple[float, ...] = tuple(round(0.05 * k, 2) for k in range(25))
    temperatures: tuple[float, ...] = (40.0, 55.0, 70.0)
    repeats: int = 3

    def points(self, rng: np.random.Generator) -> Array:
        """All points in random order, (n, 3): duty, load [N.m], temperature [degC]."""
        grid = list(itertools.product(self.duties, self.loads, self.temperatures))
        points = np.array(grid * self.repeats)
        return points[rng.permutation(len(points))]


@dataclass(frozen=True)
class Noise:
    """What the instruments add.

    Attributes:
        torque: standard deviation of the transducer [N.m] (0.1 % of the Magtrol TMHS 306's 5 N.m).
        speed: standard deviation of the speed over the recorded second [rad/s] (assumed).
        spurious: share of measurements that are wrong altogether (assumed).
        spurious_torque: standard deviation of those [N.m] (assumed).
    """

    torque: float = 0.005
    speed: float = 0.02
    spurious: float = 0.01
    spurious_torque: float = 0.3


@dataclass(frozen=True, eq=False)
class BenchTable:
    """Measurements of a brake bench, one row each, in the order they were taken; arrays of shape (n,).

    Attributes:
        duty: PWM as a share of full, signed [-].
        speed: of the output shaft, signed [rad/s].
        torque: of the servo on the brake, signed as the speed [N.m].
        temperature: of the motor [degC]; NaN where not measured.
        valid: False where the servo stalled or the measurement failed.
    """

    duty: Array
    speed: Array
    torque: Array
    temperature: Array
    valid: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.duty)

    def where(self, kept: NDArray[np.bool_]) -> BenchTable:
        """The rows that are kept."""
        return BenchTable(*(getattr(self, item.name)[kept] for item in dataclasses.fields(self)))


def measure(chain: Chain, protocol: Protocol, noise: Noise, seed: int) -> BenchTable:
    """Run a protocol on a chain.

    Args:
        chain: any chain with a duty in it; what stands before the duty (delay, controller) and behind the gearbox
            (spring, play, encoder) is not on the bench.
        protocol: points to measure.
        noise: of the instruments.
        seed: of order and noise.

    Raises:
        SealegsError: the chain has no duty.
    """
    rng = np.random.default_rng(seed)
    points = protocol.points(rng)
    speed = np.full(len(points), np.nan)
    for temperature in protocol.temperatures:
        rows = points[:, 2] == temperature
        program = _on_the_bench(chain, temperature).program()
        speed[rows] = _steady_speeds(program, points[rows, 0], points[rows, 1])
    valid = np.isfinite(speed)
    way = np.sign(points[:, 0])
    seen_speed = speed + noise.speed * rng.standard_normal(len(points))
    seen_torque = way * points[:, 1] + noise.torque * rng.standard_normal(len(points))
    wrong = rng.random(len(points)) < noise.spurious
    seen_torque[wrong] += noise.spurious_torque * rng.standard_normal(int(wrong.sum()))
    seen_torque[~valid] = np.nan
    return BenchTable(points[:, 0].copy(), seen_speed, seen_torque, points[:, 2].copy(), valid)


def _on_the_bench(chain: Chain, temperature: float) -> Chain:
    """The part of a chain from the duty to the output shaft, as a chain whose goal is the duty."""
    stages = [
        stage
        for stage in chain.stages
        if stage.name not in (*GIVING, "encoder") and chain.quantity_before(stage) != Quantity.POSITION_GOAL
    ]
    if not any(Quantity.DUTY in stage.takes for stage in stages):
        raise SealegsError(
            f"the chain '{chain.label}' has no duty to set on a brake bench; "
            "it needs a 'supply' with a 'dc_motor', or a 'regression'."
        )
    bench = Chain((PositionP(gain=1.0), *stages), chain.label)
    if bench.find("friction") is not None:
        bench = bench.with_value("friction.bristle_stiffness", 0.0)  # a steady shaft has slipped: its limit is dry
    if bench.find("thermal") is not None:
        bench = bench.with_value("thermal.temperature", temperature)
    if bench.find("dc_motor") is not None:
        warm = 1.0 + COPPER * (temperature - REFERENCE_TEMPERATURE)
        bench = bench.with_value("dc_motor.inductance", 0.0)
        bench = bench.with_value("dc_motor.resistance", bench.value("dc_motor.resistance") * warm)
    return bench


@compiled()
def _surplus(p, s, duty, load, speed):
    """Torque that is left to accelerate the shaft in the direction of the duty [N.m]."""
    way = 1.0 if duty > 0.0 else -1.0
    value = torque(p, s, 0.0, duty, 0.0, way * speed, -way * load, first=True)
    return way * value - s[S_LIMIT] - p[P_VISCOUS] * speed - load


@compiled(allocates=True)
def _steady_speeds(p, duties, loads):
    """Signed speed at each duty and brake torque [rad/s], NaN where the servo stalls."""
    out = np.full(len(duties), np.nan)
    s = np.zeros(int(p[P_STATE_SIZE]))
    for k in range(len(duties)):
        duty, load = duties[k], loads[k]
        if duty == 0.0:
            continue
        begin(p, s, 0.0, duty, 0.0, 0.0)
        if _surplus(p, s, duty, load, 0.0) <= 0.0:
            continue
        slow, fast = 0.0, 1.0
        while _surplus(p, s, duty, load, fast) > 0.0 and fast < 1e6:
            slow, fast = fast, 2.0 * fast
        for _ in range(60):
            middle = 0.5 * (slow + fast)
            if _surplus(p, s, duty, load, middle) > 0.0:
                slow = middle
            else:
                fast = middle
        out[k] = slow if duty > 0.0 else -slow
    return out
