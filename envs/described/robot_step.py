"""Step, integrator and assumed servos at which a robot can be simulated, by all its degrees of freedom.

A file may damp a light joint that nothing drives so much that a step of the engine overshoots, or hang a stiff servo on
it. At the file's pose the robot is ``M a = -C v - K q`` with servos that add to both. The bounds are those of
:mod:`sealegs.actuators.stability`, with the largest ratio of damping and of stiffness to inertia over all motions in
place of those of one joint: a chain that keeps these keeps the engine's own check as well.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np
from scipy.linalg import eigh

from ...actuators import Chain, Drivetrain
from ...actuators.stability import ONE_STAGE, RUNGE_KUTTA, position_slope, unstable_beyond, velocity_slope
from .as_robot import as_robot
from .model_file import UNITS
from .robot_described import SAME, FileJoint, RobotFile

Integrator = Literal["RK4", "Euler", "implicit", "implicitfast"]
SHORTEST = 1e-5  # [s] that a YAML may ask for
SENSIBLE = 2.5e-4  # [s] rather than a shorter step, an assumed servo becomes weaker: 80 steps in an action
SOFT = 5e-4  # [s] from here on the other integrator is tried, as RK4 at four times the step costs as much; assumed
WEAKER = 0.5  # of its stiffness an assumed servo keeps each time, and the root of it of its damping
SLUGGISH = 0.5  # [s] time constant of a servo against the damping of its joint from which it is named; assumed
ALIKE = 0.5  # of the largest share in an unstable motion from which a servo becomes weaker too, as on the other side
TINY = 1e-9  # of the largest share: below it a servo has none
NUDGE = 1e-6  # [rad or m] of a position, for the slope of springs


@dataclass(frozen=True)
class Cause:
    """What makes a step too long.

    Attributes:
        words: for people.
        shares: of each driven coordinate in that motion, by its servo; 0: none.
    """

    words: str
    shares: dict[str, float]


def engine_number(integrator: str) -> int:
    """Of an integrator that a YAML names: a ``mujoco.mjtIntegrator``."""
    return int(getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}"))


def settled(robot: RobotFile, integrator: Integrator | None) -> tuple[RobotFile, str]:
    """The robot with a step, an integrator and assumed servos that are stable together, and why in a phrase.

    Args:
        robot: with the step that it has where nothing forces another.
        integrator: that its YAML asks for; None: any.
    """
    system = _System(robot)
    tried = list(_candidates(robot.timestep, integrator))
    stated = {joint.name: joint.chain for joint in robot.joints if joint.least is None}
    causes: dict[str, str] = {}  # of the latest step that was too long, by integrator
    for k, (step, kind) in enumerate(tried):
        last = k + 1 == len(tried)
        if not last and (cause := system.cause(stated, step, kind)) is not None:
            causes[kind] = cause.words
            continue
        # no shorter step is tried for the sake of an assumed servo
        final = last or tried[k + 1][0] < SENSIBLE
        joints, cause = system.weakened(robot.joints, step, kind, keep=not final)
        if cause is None or final:
            words = causes.get(kind) or next(iter(causes.values()), "")
            why = f", since {words}" if words else ""
            return dataclasses.replace(robot, joints=joints, timestep=step, integrator=kind), why
        causes[kind] = cause.words
    raise AssertionError  # the last one returns


def _candidates(step: float, integrator: Integrator | None) -> list[tuple[float, Integrator]]:
    """Steps [s] and integrators in the order in which they are tried."""
    steps = [step]
    while steps[-1] / 2.0 >= SHORTEST:
        steps.append(steps[-1] / 2.0)
    if integrator is not None:
        return [(item, integrator) for item in steps]
    found: list[tuple[float, Integrator]] = []
    for item in steps:
        both: list[tuple[float, Integrator]] = [(item, "RK4"), (item, "implicitfast")]
        found += both if item <= SOFT * (1.0 + SAME) else both[:1]
    return found


class _System:
    """A robot at its file's pose, as matrices."""

    def __init__(self, robot: RobotFile) -> None:
        machine = as_robot(robot)
        drivetrain = Drivetrain(
            machine.build_spec(),
            {joint.name: joint.chain for joint in robot.joints},
            machine.coordinates,
            checked=False,
        )
        self._model = model = drivetrain.model
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        self._mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, self._mass)
        self._damping, self._stiffness = self._slopes(data)
        self._along: dict[str, np.ndarray] = {}
        for name in drivetrain.chains:
            self._along[name] = np.zeros(model.nv)
            for joint, coefficient in drivetrain.terms(name):
                self._along[name][model.jnt_dofadr[model.joint(joint).id]] += coefficient
        self._felt = drivetrain.inertias()
        self._units = {joint.name: UNITS[joint.kind] for joint in robot.joints}

    def _slopes(self, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
        """Fall of the passive forces over speeds and over positions, both (nv, nv)."""
        model, size = self._model, self._model.nv
        damping, stiffness = np.zeros((size, size)), np.zeros((size, size))
        rest, held = data.qpos.copy(), data.qfrc_spring.copy()
        for dof in range(size):
            for matrix, speed, nudge in ((damping, 1.0, 0.0), (stiffness, 0.0, NUDGE)):
                data.qpos[:], data.qvel[:] = rest, 0.0
                data.qvel[dof] = 1.0
                if nudge:
                    mujoco.mj_integratePos(model, data.qpos, data.qvel, nudge)
                data.qvel[dof] = speed
                mujoco.mj_fwdPosition(model, data)
                mujoco.mj_fwdVelocity(model, data)
                matrix[:, dof] = (held - data.qfrc_spring) / nudge if nudge else -data.qfrc_damper
        return 0.5 * (damping + damping.T), 0.5 * (stiffness + stiffness.T)

    def cause(self, chains: dict[str, Chain], step: float, integrator: str) -> Cause | None:
        """What is unstable at a step [s] with these chains on their coordinates; None: nothing."""
        falls = {name: (velocity_slope(c, step), max(position_slope(c, step), 0.0)) for name, c in chains.items()}
        number = engine_number(integrator)
        for name, chain in chains.items():
            inertia, coupled = self._felt[name]
            if (found := unstable_beyond(chain, inertia, coupled, step, number)) is not None:
                position, force = self._units[name]
                words = found[1].replace("its ", "the servo's ").replace("N.m", force).replace("rad", position)
                return Cause(f"at joint {name} {words} on an inertia of {inertia:.3g}", {name: 1.0})
        damping, stiffness = np.zeros_like(self._mass), np.zeros_like(self._mass)
        for name, (slope, held) in falls.items():
            outer = np.outer(self._along[name], self._along[name])
            damping, stiffness = damping + slope * outer, stiffness + held * outer
        stiffness = step**2 * (stiffness + self._stiffness)
        if integrator == "RK4":
            damping = step * (damping + self._damping)
            most = RUNGE_KUTTA[0]
            if self._largest(damping / most)[0] <= 1.0 and self._largest(stiffness / most**2)[0] <= 1.0:
                return None
            largest, motion = self._fastest(damping, stiffness)
            return self._named(motion, falls, step, integrator) if largest > most else None
        most, frequency = ONE_STAGE
        # the native damping is implicit
        for bound in (damping / most, damping / most - self._damping / 2.0 + stiffness / step / frequency**2):
            largest, motion = self._largest(step * bound)
            if largest > 1.0:
                return self._named(motion, falls, step, integrator)
        return None

    def _largest(self, matrix: np.ndarray) -> tuple[float, np.ndarray]:
        """Largest ratio of a symmetric matrix (nv, nv) to inertia, and the motion (nv,) that has it."""
        last = len(matrix) - 1
        ratio, motions = eigh(matrix, self._mass, subset_by_index=[last, last])
        return float(ratio[0]), motions[:, 0]

    def _fastest(self, damping: np.ndarray, stiffness: np.ndarray) -> tuple[float, np.ndarray]:
        """Distance from 0 of the farthest root, of damping and stiffness (nv, nv) per step, and its motion (nv,)."""
        size = len(damping)
        blocks = np.linalg.solve(self._mass, np.hstack([-stiffness, -damping]))
        roots, motions = np.linalg.eig(np.vstack([np.hstack([np.zeros((size, size)), np.eye(size)]), blocks]))
        farthest = int(np.abs(roots).argmax())
        return float(np.abs(roots[farthest])), np.abs(motions[:size, farthest]) * np.sign(
            np.real(motions[:size, farthest])
        )

    def _named(self, motion: np.ndarray, falls: dict[str, tuple[float, float]], step: float, kind: str) -> Cause:
        """The cause by the motion that is unstable."""
        moved = {name: float(self._along[name] @ motion) ** 2 for name in falls}
        shares = {name: moved[name] * (step * slope + step**2 * held) for name, (slope, held) in falls.items()}
        native = step**2 * motion * (self._stiffness @ motion)
        if kind == "RK4":
            native = native + step * motion * (self._damping @ motion)
        worst = int(np.argmax(native))
        if shares and (most := max(shares, key=lambda name: shares[name])) and shares[most] >= native[worst]:
            return Cause(f"the servo of joint {most} would be unstable at a longer step", shares)
        joint = self._model.joint(int(self._model.dof_jntid[worst])).name or "without a name"
        what = "damping" if self._damping[worst, worst] * step > self._stiffness[worst, worst] * step**2 else "springs"
        of = "the file" if joint not in falls else "file or chain"
        return Cause(f"the {what} that {of} gives the joint {joint} would be unstable at a longer step", shares)

    def weakened(
        self, joints: Sequence[FileJoint], step: float, integrator: str, *, keep: bool
    ) -> tuple[tuple[FileJoint, ...], Cause | None]:
        """The joints with assumed servos so weak that a step is stable, and what still is not.

        Args:
            joints: of the robot.
            step: of the simulation [s].
            integrator: of the engine.
            keep: whether servos keep the stiffness that their joints need.
        """
        chains = {joint.name: joint.chain for joint in joints}
        least = {joint.name: joint.least if keep else 0.0 for joint in joints if joint.least is not None}
        while (cause := self.cause(chains, step, integrator)) is not None:
            open_to = {
                name: share
                for name, share in cause.shares.items()
                if share > 0.0
                and name in least
                and WEAKER * chains[name].value("ideal.stiffness") >= (least[name] or 0.0)
            }
            if not open_to or max(open_to.values()) < TINY * max(cause.shares.values()):
                break
            most = max(open_to.values())
            for name in [name for name, share in open_to.items() if share >= ALIKE * most]:
                chains[name] = scaled(chains[name], WEAKER)
        return tuple(_with(joint, chains[joint.name], step, integrator) for joint in joints), cause


def weak(joint: FileJoint, share: float, step: float, integrator: str) -> FileJoint:
    """A joint with an assumed servo of a share of its stiffness, and the root of it of its damping."""
    if joint.least is None:
        return joint
    return _with(joint, scaled(joint.chain, share), step, integrator)


def scaled(chain: Chain, times: float) -> Chain:
    """An ideal servo of so many times the stiffness, and the root of that of its damping; below 1, a weaker one."""
    for key, factor in (("stiffness", times), ("damping", times**0.5)):
        chain = chain.with_value(f"ideal.{key}", float(f"{factor * chain.value(f'ideal.{key}'):.4g}"))
    return chain


def _with(joint: FileJoint, chain: Chain, step: float, integrator: str) -> FileJoint:
    """A joint with a weaker servo, and a note of it in place of the one on its stiffness."""
    if chain == joint.chain:
        return joint
    before, now = (item.value("ideal.stiffness") for item in (joint.chain, chain))
    position, force = UNITS[joint.kind]
    note = (
        f"an ideal servo of {now:g} {force}/{position} drives it (assumed: {before:g} would be unstable at "
        f"{1e3 * step:g} ms with {integrator})"
    )
    kept = [item for item in joint.notes if not item.startswith("an ideal servo of ")]
    return dataclasses.replace(joint, chain=chain, notes=(*kept, note))


def said_again(said: Sequence[str], before: Sequence[FileJoint], now: Sequence[FileJoint]) -> list[str]:
    """Sentences with the notes that joints have now in place of those that they had before."""
    found = list(said)
    for old, new in zip(before, now, strict=True):
        if old.notes != new.notes:
            gone = [f"joint {old.name}: {note}." for note in old.notes if note not in new.notes]
            found = [f"joint {new.name}: {new.notes[-1]}." if sentence in gone else sentence for sentence in found]
    return found


def feeble(joint: FileJoint, most: float) -> str:
    """Why an assumed servo hardly moves its joint, as a phrase; empty where it does.

    Args:
        joint: with its servo.
        most: error that dry friction may hold it at [rad or m].
    """
    if joint.least is None:
        return ""
    values: dict[str, Any] = {key: joint.chain.value(f"ideal.{key}") for key in ("stiffness", "torque_limit")}
    friction = joint.chain.find("friction")
    dry, viscous = (friction.coulomb, friction.viscous) if friction is not None else (0.0, 0.0)
    position, force = UNITS[joint.kind]
    ends = "; give it an armature or less friction in the model file, or a chain"
    if dry >= values["torque_limit"]:
        return (
            f"its largest force, {values['torque_limit']:g} {force}, is not above the dry friction of {dry:g} {force}"
        )
    if (error := dry / values["stiffness"]) > most:
        return (
            f"its servo of {values['stiffness']:g} {force}/{position} is weak: it moves {dry:g} {force} of dry "
            f"friction only from an error of {error:.3g} {position} on{ends}"
        )
    if (lag := viscous / values["stiffness"]) > SLUGGISH:
        return (
            f"its servo of {values['stiffness']:g} {force}/{position} is weak: against a damping of {viscous:g} "
            f"{force}.s/{position} it takes {lag:.3g} s to come near a goal{ends}"
        )
    return ""
