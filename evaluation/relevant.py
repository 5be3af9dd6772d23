"""Which dynamics of a robot are relevant: what its motors' torque goes into, over workspace and speed (paper 000).

The robot moves in simulation, with its drives and on its ground: goals go from point to point of the workspace,
bang-bang in acceleration, at several tempos. At each sample the equations of motion are split, and each part is carried
to the driven coordinates by the virtual work of turning one motor alone, with its link, while the base and the other
motors rest: forces of springs between motor and link and of closed loops do no work then, and drop out.

The four steps of paper 000, section 3: compute each term, compare, leave out what is under 5 % of the motor's torque
on every run, and tell what that costs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from ..common.errors import SealegsError
from ..envs.contract import task_of
from ..envs.engine.batch import BatchEngine
from ..envs.engine.robot import ChainSource

PARTS = ("constant inertia", "varying inertia", "Coriolis", "gravity", "springs and stops", "friction", "contact")
RULE = 0.05
RATE = 100.0  # [Hz] samples
SETTLING = 0.3  # [s] of the start that no figure looks at
CONTACTS = tuple(
    int(getattr(mujoco.mjtConstraint, f"mjCNSTR_CONTACT_{kind}")) for kind in ("FRICTIONLESS", "PYRAMIDAL", "ELLIPTIC")
)
FRICTIONS = (int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF), int(mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON))
LIMITS = (int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT), int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON))
EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)


@dataclass(frozen=True)
class Run:
    """One motion. Torques are at the driven coordinates, and the parts add up to the motor's.

    Attributes:
        tempo: seconds for the whole range of a coordinate [s].
        time: (n,) [s].
        motor: torque of the motors (n, k) [N.m].
        parts: of it, by name (n, k) each [N.m].
        speed: of the coordinates (n, k) [rad/s].
    """

    tempo: float
    time: np.ndarray
    motor: np.ndarray
    parts: Mapping[str, np.ndarray]
    speed: np.ndarray

    def shares(self) -> dict[str, np.ndarray]:
        """Largest size of each part over that of the motor's torque (k,)."""
        most = np.maximum(np.abs(self.motor).max(axis=0), 1e-12)
        return {name: np.abs(values).max(axis=0) / most for name, values in self.parts.items()}

    def balance(self) -> float:
        """What the parts leave over, over the largest motor torque: 0 but for rounding."""
        total = sum(self.parts.values())
        return float(np.abs(total - self.motor).max() / max(np.abs(self.motor).max(), 1e-12))


class Mover:
    """A robot whose goals go from point to point.

    Attributes:
        names: of the driven coordinates.
        floating: whether part of the robot is not driven, such as a base that stands on feet.
    """

    def __init__(
        self,
        env: str,
        actuator: ChainSource | Mapping[str, ChainSource] | None = None,
        params: Mapping[str, float] | None = None,
        robot: str | None = None,
    ) -> None:
        """Build the robot of an environment's id, or another one in an environment that takes any.

        Raises:
            SealegsError: there is none, or a chain or number does not fit.
        """
        self._task, _ = task_of({"id": env} if robot is None else {"id": env, "robot": robot})
        self._engine = BatchEngine(
            self._task, 1, actuator=actuator, params=params, control_rate=self._task.control_rate
        )
        drivetrain = self._engine.drivetrain
        self.model, self.names = drivetrain.model, list(self._engine.names)
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # one evaluation a step, which is split
        eye = np.eye(self.model.nv)
        self._motor = np.stack([drivetrain.speed(name, eye, "motor") for name in self.names])
        self._link = np.stack([drivetrain.speed(name, eye, "link") for name in self.names])
        self._limits = np.array([self._task.robot.goal_limits(self._engine.numbers)[name] for name in self.names])
        self._loops = self.model.neq > 0
        self._rotors = np.array([drivetrain.chains[name].armature() for name in self.names])
        self._at_rest = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self._at_rest)
        moved = np.abs(self._turning(self._at_rest, np.asarray(self._at_rest.efc_type))).max(axis=1)
        self.floating = bool((moved < 1e-6).any())

    def run(self, tempo: float, seconds: float, amplitude: float, seed: int = 0) -> Run:
        """Move for ``seconds``, with goals up to ``amplitude`` of the range from where the robot starts.

        Raises:
            SealegsError: the simulation became unstable.
        """
        self._engine.seed(seed)
        self._engine.reset()
        model, data = self.model, mujoco.MjData(self.model)
        mujoco.mj_setState(model, data, self._engine.batch.state[0], mujoco.mjtState.mjSTATE_INTEGRATION)
        start, random = data.ctrl.copy(), np.random.default_rng(seed)
        every = max(round(1.0 / (RATE * model.opt.timestep)), 1)
        begin, target, began, lasts = start, start, 0.0, 0.0
        rows: list[tuple[float, np.ndarray, np.ndarray, dict[str, np.ndarray]]] = []
        for step in range(round(seconds / model.opt.timestep)):
            now = step * model.opt.timestep
            if now >= began + lasts:
                begin, began = target, now
                target = self._point(start, amplitude, random)
                span = self._limits[:, 1] - self._limits[:, 0]
                lasts = max(float((np.abs(target - begin) / span).max()) * tempo, 10.0 * model.opt.timestep)
            phase = (now - began) / lasts
            data.ctrl[:] = begin + (target - begin) * (
                2.0 * phase**2 if phase < 0.5 else 1.0 - 2.0 * (1.0 - phase) ** 2
            )
            sample = step % every == 0 and now >= SETTLING
            qpos, qvel = data.qpos.copy(), data.qvel.copy()
            mujoco.mj_step(model, data)
            if sample:
                rows.append((now, *self._split(data, qpos, qvel)))
        if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number or not rows:
            raise SealegsError("the simulation became unstable; make the tempo longer or the amplitude smaller.")
        time, speed = np.array([row[0] for row in rows]), np.array([row[2] for row in rows])
        motor = np.array([row[1] for row in rows])
        parts = {name: np.array([row[3][name] for row in rows]) for name in (*PARTS[2:], "inertia")}
        factor, link, rotor = (np.array([row[3][name] for row in rows]) for name in ("factor", "link", "rotor"))
        constant = (factor.mean(axis=0) - self._rotors) * link + self._rotors * rotor
        parts = {"constant inertia": constant, "varying inertia": parts.pop("inertia") - constant, **parts}
        return Run(tempo, time, motor, {name: parts[name] for name in PARTS}, speed)

    def _point(self, start: np.ndarray, amplitude: float, random: np.random.Generator) -> np.ndarray:
        anywhere = random.uniform(self._limits[:, 0], self._limits[:, 1])
        return start + amplitude * (anywhere - start)

    def _turning(self, data: mujoco.MjData, types: np.ndarray) -> np.ndarray:
        """Virtual displacements (nv, k): each turns one motor and its link by one radian, closed loops kept."""
        rows, wanted = [self._motor, self._link], [np.eye(len(self.names))] * 2
        if self._loops:
            closed = data.efc_J.reshape(-1, self.model.nv)[types == EQUALITY]
            rows.append(closed)
            wanted.append(np.zeros((len(closed), len(self.names))))
        return np.linalg.lstsq(np.vstack(rows), np.vstack(wanted), rcond=1e-9)[0]

    def _split(
        self, data: mujoco.MjData, qpos: np.ndarray, qvel: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Motor torque, speed and parts (k,) of the step that ``data`` has just done, from ``qpos`` and ``qvel``."""
        model, rest = self.model, self._at_rest
        rest.qpos[:], rest.qvel[:] = qpos, 0.0
        mujoco.mj_fwdPosition(model, rest)
        mujoco.mj_rne(model, rest, 0, weight := np.empty(model.nv))
        types = np.asarray(data.efc_type)
        turning = self._turning(data, types)

        def force(kinds: Sequence[int]) -> np.ndarray:
            chosen = np.isin(types, kinds)
            return data.efc_J.reshape(-1, model.nv)[chosen].T @ data.efc_force[chosen]

        mujoco.mj_mulM(model, data, inertial := np.empty(model.nv), data.qacc)
        moved = np.empty_like(turning)
        for k in range(len(self.names)):
            mujoco.mj_mulM(model, data, column := np.empty(model.nv), np.ascontiguousarray(turning[:, k]))
            moved[:, k] = column
        forces = {
            "inertia": inertial,
            "Coriolis": data.qfrc_bias - weight,
            "gravity": weight,
            "springs and stops": -data.qfrc_spring - force(LIMITS),
            "friction": -data.qfrc_damper - force(FRICTIONS),
            "contact": -force(CONTACTS),
        }
        parts = {name: turning.T @ value for name, value in forces.items()}
        parts["factor"] = np.einsum("ik,ik->k", turning, moved)
        parts["link"], parts["rotor"] = self._link @ data.qacc, self._motor @ data.qacc
        return turning.T @ data.qfrc_actuator, self._link @ qvel, parts


@dataclass(frozen=True)
class Verdict:
    """What is relevant, by coordinate.

    Attributes:
        shares: most of each part over all runs, by coordinate and part.
        left_out: parts under 5 % on every run.
        error: largest of the simplified model over the largest motor torque, by coordinate.
    """

    shares: Mapping[str, Mapping[str, float]]
    left_out: Mapping[str, Sequence[str]]
    error: Mapping[str, float]


def judge(names: Sequence[str], runs: Sequence[Run]) -> Verdict:
    """Steps 2 and 3 of the method."""
    most = {part: np.max([run.shares()[part] for run in runs], axis=0) for part in PARTS}
    shares = {name: {part: float(most[part][k]) for part in PARTS} for k, name in enumerate(names)}
    left_out = {name: tuple(part for part in PARTS if row[part] < RULE) for name, row in shares.items()}
    error = {}
    for k, name in enumerate(names):
        dropped = [sum((run.parts[part][:, k] for part in left_out[name]), np.zeros(len(run.time))) for run in runs]
        error[name] = max(
            float(np.abs(off).max() / max(np.abs(run.motor[:, k]).max(), 1e-12))
            for off, run in zip(dropped, runs, strict=True)
        )
    return Verdict(shares, left_out, error)
