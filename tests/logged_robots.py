"""Logs of hidden arms, the robot that a log names, and a dog with contact switches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.interpolate import make_smoothing_spline
from sealegs.actuators.chain import load_chain
from sealegs.envs.engine.robot import Robot
from sealegs.envs.robots import get_robot
from sealegs.gap.load.robot import LoggedRobot, robot_of
from sealegs.gap.load.terms import T_OWN, T_SIZE
from sealegs.gap.log.parts import cut
from sealegs.gap.log.types import MeasuredRun, MeasuredSet
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.tree import joint_of_tree, terms_of

from testbed.bench import NOISE_FLOOR
from testbed.logs import hidden_arm

JOINTS = ("shoulder", "elbow")


def two_link_run(folder: Path, duration: float) -> MeasuredRun:
    """A run [s] of the two-link arm that is as believed."""
    data, _ = hidden_arm(folder, "two_link", {}, 5, runs=1, duration=duration, nominal_error=0.0)
    return data.runs[0]


def robot(run: MeasuredRun) -> LoggedRobot:
    """The robot of a run that names one."""
    found = robot_of(run)
    assert found is not None
    return found


def free_replay(run: MeasuredRun, joint: str) -> FreeProblem:
    """A joint of a run that is replayed alone, as its file and its chain believe it to be."""
    machine = robot(run)
    terms = terms_of(machine, joint, [run])
    model = joint_of_tree(machine, joint, load_chain(run.actuators[joint]), [run], terms)
    return free_problem([run], joint, [model], cut([run], joint), {"position": 1.0 / NOISE_FLOOR}, terms)


def block_of(terms: np.ndarray, number: int) -> np.ndarray:
    """One of the blocks of a joint's terms (samples, columns)."""
    return terms[:, T_OWN + number * T_SIZE :][:, :T_SIZE]


def nominal_error(problem: FreeProblem) -> float:
    """Root of the mean square of its position error [rad]."""
    return float(np.sqrt(np.mean(problem.position_error(problem.simulate([{}], 1e-3)[0]) ** 2)))


# --- logs of the hidden bench with other columns than were recorded --------------------------------------------------

JOINT = "servo"
"""Joint of the hidden bench."""


def with_log(run: MeasuredRun, **signals: np.ndarray | None) -> MeasuredRun:
    """The run with other columns of its joint, each (n,); None: without it."""
    return replace(run, joints={JOINT: replace(run.joints[JOINT], **signals)})


def signal(run: MeasuredRun, name: str) -> np.ndarray:
    """A column of the run's joint (n,)."""
    return run.joints[JOINT].signals()[name]


def with_torque(
    data: MeasuredSet, truth: Mapping[str, Any], delay: float = 0.0, factor: float = 1.0, armature: float = 0.0
) -> MeasuredSet:
    """Logs of a bench with the torque that its true motion, an armature [kg.m2] and some dry friction need, logged late
    by a delay [s] and with a factor.
    """
    rng, runs = np.random.default_rng(0), []
    for run, position in zip(data.runs, truth["clean_position"], strict=True):
        motion = make_smoothing_spline(run.time, position, lam=1e-9)
        velocity, acceleration = motion.derivative(1)(run.time), motion.derivative(2)(run.time)
        mass, length, arm = (run.robot_params[key] for key in ("mass", "length", "arm_mass"))
        torque = (mass * length**2 + arm * length**2 / 3 + armature) * acceleration + 0.05 * np.tanh(velocity / 0.1)
        torque += 9.81 * length * (mass + arm / 2) * np.sin(position) + rng.normal(0, 0.005, len(position))
        runs.append(with_log(run, torque=factor * np.interp(run.time - delay, run.time, torque)))
    return replace(data, runs=tuple(runs))


# --- the dog of ``tests/robots`` with contact switches under its feet ------------------------------------------------

ROBOTS = Path(__file__).resolve().parent / "robots"
FEET = ("fl", "fr", "hl", "hr")
SWITCHES = {f"{leg}_foot": {"body": f"{leg}2", "threshold": 0.5} for leg in FEET}
SHIN = '<geom name="fl_shin" class="knee"/><site name="fl_sole" pos="0 0 -0.08" size="0.02"/>'


def switched_file(folder: Path, switches: dict[str, Any] | None = None, **imu: Any) -> Path:
    """Its file; other keys of ``imu`` as given."""
    model = (ROBOTS / "dog.xml").read_text()
    front = '<joint name="fl_knee" class="knee"/>'
    (folder / "dog.xml").write_text(model.replace(front + '<geom class="knee"/>', front + SHIN))
    document = yaml.safe_load((ROBOTS / "dog.yaml").read_text())
    document["imu"] |= {"switches": SWITCHES if switches is None else switches, **imu}
    path = folder / "dog.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


def switched(folder: Path, switches: dict[str, Any] | None = None, **imu: Any) -> Robot:
    """The robot of :func:`switched_file`."""
    return get_robot(switched_file(folder, switches, **imu))
