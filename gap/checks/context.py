"""What every check of a run needs once: the motion of each joint, smoothed, and its noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...actuators.chain import Chain, load_chain
from ...common.errors import SealegsError
from ..load.robot import LoggedRobot, robot_of
from ..load.units import run_in_model_units
from ..log.finding import Finding, Severity
from ..log.types import Array, JointLog, MeasuredRun
from .signal import DERIVATIVE_WINDOW, derivatives, quantisation_step, sample_noise

MAX_EXCERPT_SAMPLES = 200_000
"""Samples that the checks of motion look at; of a longer log they take its middle."""
MIN_MOTION_SPAN = 30.0
"""Range of motion, in rms errors of a sample, below which causes look alike."""
MIN_MOVING_SHARE = 0.01
"""Share of the samples with motion below which causes look alike."""


@dataclass(frozen=True, eq=False)
class JointContext:
    """One joint of one run with what the checks share; arrays are (n,)."""

    run: MeasuredRun
    name: str
    log: JointLog
    time: Array

    def column(self, signal: str) -> str:
        """Return a column's name in the file."""
        return f"{self.name}.{signal}"

    def remark(
        self, code: str, severity: Severity, signal: str, value: float | None, sentence: str, **more: Any
    ) -> Finding:
        """Return a finding about a column; ``more`` are other attributes of it."""
        return Finding(code, severity, self.name, self.column(signal), sentence, value, **more)

    def fault(self, code: str, severity: Severity, signal: str, value: float | None, what: str, **more: Any) -> Finding:
        """Return what is wrong with the data of a column; ``what`` goes on after its name."""
        return self.remark(code, severity, signal, value, f"{self.column(signal)} {what}", data_error=True, **more)

    @cached_property
    def chain(self) -> Chain | None:
        """Nominal chain of its actuator; None where the log names none that can be read, which is told elsewhere."""
        try:
            return load_chain(self.run.actuators[self.name])
        except (KeyError, SealegsError):
            return None

    @cached_property
    def period(self) -> float:
        """Median sample period [s]."""
        return float(np.median(np.diff(self.time)))

    @cached_property
    def step(self) -> float:
        """Quantisation step of the position [rad], 0 where none shows."""
        return quantisation_step(self.log.position)

    @cached_property
    def noise(self) -> float:
        """Rms error of a position sample [rad]."""
        return sample_noise(self.time, self.log.position)

    @cached_property
    def span(self) -> float:
        """Range of the position [rad]."""
        return float(np.ptp(self.log.position))

    @cached_property
    def still(self) -> bool:
        """Whether the joint shows no motion beyond noise and a few encoder steps."""
        return self.span <= max(6.0 * self.noise, 5.0 * self.step, 1e-9)

    @cached_property
    def radians(self) -> bool:
        """Whether position and goal are in radians."""
        return self.unit == "rad"

    @cached_property
    def natural(self) -> bool:
        """Whether the position is in the unit of a hinge, rad, or of a slide, m."""
        return self.unit in ("rad", "m")

    @cached_property
    def unit(self) -> str:
        """Unit of position and goal: of the robot's joint, or rad; or a share of a range that nobody says."""
        units = self.run.meta.get("units") or {}
        own = "m" if self.slides else "rad"
        return str(units.get(self.column("position"), units.get("position", own)))

    @cached_property
    def robot(self) -> LoggedRobot | None:
        """The robot of a file that the log names; None: there is none."""
        return robot_of(self.run)

    @cached_property
    def slides(self) -> bool:
        """Whether the model of the robot, where the log names one, has the joint as a slide."""
        return self.robot is not None and self.robot.slides(self.name)

    @cached_property
    def reach(self) -> float | None:
        """Furthest end of the joint's range in that model [rad or m]; None where nothing says it."""
        return None if self.robot is None else self.robot.reach(self.name)

    @cached_property
    def motion(self) -> tuple[Array, Array, Array]:
        """Smoothed position [rad], velocity [rad/s] and acceleration [rad/s2]."""
        return derivatives(self.time, self.log.position, DERIVATIVE_WINDOW)

    @property
    def velocity(self) -> Array:
        """Smoothed derivative of the position [rad/s]."""
        return self.motion[1]

    @cached_property
    def moving_speed(self) -> float:
        """Speed above which the joint certainly moves [rad/s]."""
        return max(5.0 * self.noise / DERIVATIVE_WINDOW, 0.05 * float(np.quantile(np.abs(self.velocity), 0.99)))

    @cached_property
    def moving(self) -> np.ndarray:
        """Samples where the joint certainly moves, (n,) bool."""
        return np.abs(self.velocity) > self.moving_speed

    @cached_property
    def on(self) -> np.ndarray:
        """Samples at which the drive is on, (n,) bool; all of them where nothing says that it is not."""
        return np.ones(len(self.time), bool) if self.log.enabled is None else self.log.enabled >= 0.5

    @cached_property
    def short(self) -> bool:
        """Whether the joint moves over so little that causes look alike."""
        return self.span < MIN_MOTION_SPAN * max(self.noise, self.step / 4)

    @cached_property
    def seldom(self) -> bool:
        """Whether the joint moves so seldom that causes look alike."""
        return float(self.moving.mean()) < MIN_MOVING_SHARE


def joint_contexts(run: MeasuredRun) -> list[JointContext]:
    """Return the context of every joint, in the model's units; of a very long run, of its middle.

    Raises:
        SealegsError: the sidecar names a unit that is not known.
    """
    if run.meta.get("units"):  # the pieces of a long log are checked before anything else looks at them
        run = run_in_model_units(run, robot_of(run))
    excess = max(len(run.time) - MAX_EXCERPT_SAMPLES, 0)
    part = slice(excess // 2, len(run.time) - (excess - excess // 2))
    contexts = []
    for name, log in run.joints.items():
        cut = log.each(lambda values: values[part]) if excess else log
        contexts.append(JointContext(run, name, cut, run.time[part]))
    return contexts
