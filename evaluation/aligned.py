"""What a model predicts from the measured state, over short windows: nothing adds up but what the model gets wrong.

A run of its own soon differs from the machine's, whatever the model: a hop more or less is enough. So the model is put
where the machine was at the start of each window, gets the goals that the machine got, when it got them, and is
compared over that window. How far it would be off if it were the machine is rehearsed in the same window, with the
model in the place of the machine: encoder steps, the time of a reading and of the goals, speeds taken from differences,
and how much a landing magnifies all that are then in both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import mujoco
import numpy as np

from ..actuators.engine import install
from ..hw.machine.robot import ServoRobot
from ..hw.run.simulated import Recording, velocity_of
from ..hw.virtual.machine import Machine

WINDOW = 0.2  # [s]
DRAWS = 5000  # of exchanges
DEPARTS = 0.25  # of the spread of a signal on the machine: a model further off than this has departed
WHOLE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
LOOPS = 5  # Newton steps that close a mechanism's loops


class Aligned:
    """A model that is put into measured states.

    Attributes:
        rounding: mean square of the error that the encoders' steps alone make (k + b,): a joint at rest within a step
            may show none of it for long, and then all.
    """

    def __init__(self, robot: ServoRobot) -> None:
        """Build the machine that ``robot`` is believed to be."""
        sizes = dict(zip((s.name for s in robot.sensors), robot.resolution[len(robot.joints) :], strict=True))
        own = robot.resolution[: len(robot.joints)]
        links = [sizes.get(f"{name}.link", size) for name, size in zip(robot.names, own, strict=True)]
        self._steps = {"position": own, "link": np.array(links), "base": np.array([sizes[n] for n in robot.base_names])}
        steps = np.concatenate([self._steps["position"], self._steps["base"]])
        self.rounding = steps**2 / 6.0  # a twelfth each for the start and for what is compared
        sensors = {sensor.name: 1.0 for sensor in robot.sensors if not sensor.name.endswith(".link")}
        self._robot = robot
        self._machine = Machine(robot.robot, dict(robot.chains), None, robot.params, sensors)
        self._fixed = [self._machine.model.joint(name).id for name in self._driven_joints()]

    def _driven_joints(self) -> set[str]:
        model = self._machine.model
        names = {joint for item in self._machine.drivetrain.coordinates for joint, _ in item.terms}
        base = {name.partition(".")[0] for name in self._robot.base_names}
        return {model.joint(k).name for k in range(model.njnt)} & (names | base)

    def predict(self, run: Recording, window: float = WINDOW) -> Recording:
        """``run`` as the model predicts it from its state at the start of each window; NaN outside of windows."""
        columns = blank(run)
        for first, last in windows(run, window):
            self._put(run, first)
            self._follow(run, first, last, run.time, columns)
        return _recording(run, columns)

    def rehearse(self, run: Recording, window: float = WINDOW) -> tuple[Recording, Recording]:
        """What :meth:`predict` would come to if the machine were the model: what was measured, and its prediction.

        The machine is simulated into and through each window of ``run``, with its goals as they went out. It is read as
        servos are: when they were asked, while the log dates the reading to the middle of the transaction, in the steps
        of their encoders. It goes on from window to window as a machine does, whose integrators fill and whose legs
        brace each other within a step of their encoders. Where it has strayed, as a hopper does after some hops, it is
        put where the machine was a window earlier.
        """
        measured, predicted, per_window = blank(run), blank(run), _per_window(run, window)
        asked = run.asked if len(run.asked) else run.time
        model, data = self._machine.model, self._machine.data
        places = np.concatenate([run.position, run.base], axis=1)
        steps = np.concatenate([self._steps["position"], self._steps["base"]])
        near = np.maximum(DEPARTS * places.std(axis=0), 2.0 * steps)
        state, there = np.zeros(mujoco.mj_stateSize(model, WHOLE)), np.full(len(steps), np.inf)
        for first, last in windows(run, window):
            begin = first - per_window
            if (np.abs(there - places[begin]) < near).all():
                mujoco.mj_setState(model, data, state, WHOLE)
                install()
                mujoco.mj_forward(model, data)
            else:
                self._put(run, begin)
            read = blank(run)
            self._follow(run, begin, first, asked, read)
            mujoco.mj_getState(model, data, state, WHOLE)
            there = np.concatenate([read["position"][first], read["base"][first]])
            self._follow(run, first, last, asked, read)
            for name, step in self._steps.items():
                if read[name].size:
                    read[name][:] = step * np.round(read[name] / step)
            rows = np.arange(first - 1, last + 1)
            part = replace(_recording(run, read), sent=run.sent).cut(rows)
            foreseen = blank(part)
            self._put(part, 1)
            self._follow(part, 1, len(rows) - 1, part.time, foreseen)
            for name in measured:
                if measured[name].size:
                    measured[name][first + 1 : last + 1] = read[name][first + 1 : last + 1]
                    predicted[name][first + 1 : last + 1] = foreseen[name][2:]
        return _recording(run, measured), _recording(run, predicted)

    def _follow(
        self,
        run: Recording,
        first: int,
        last: int,
        times: np.ndarray,
        columns: Mapping[str, np.ndarray],
    ) -> None:
        """Simulate from the row ``first`` to ``last`` with the goals of ``run``, and note what is there at ``times``.

        Args:
            run: with n rows.
            first, last: of them.
            times: of the rows (n,) [s].
            columns: to fill.
        """
        machine, joints = self._machine, range(len(self._machine.names))
        sent = np.where(np.isfinite(run.sent), run.sent, run.time) if len(run.sent) else run.time
        machine.data.time = times[first]
        for row in range(first, last):
            machine.advance(sent[row])
            for joint in joints:
                machine.set_goal(joint, float(run.goal[row, joint]))
            machine.advance(times[row + 1])
            for name, value in (
                ("position", machine.reading), ("duty", machine.duty), ("current", machine.current),
                ("voltage", machine.voltage),
            ):  # fmt: skip
                columns[name][row + 1] = [value(joint) for joint in joints]
            columns["base"][row + 1] = [machine.position(k) for k in range(len(joints), len(machine.encoders))]
            if run.link.size:
                columns["link"][row + 1] = [machine.link(joint) for joint in joints]

    def _put(self, run: Recording, row: int) -> None:
        """The state of the machine at a row, its speeds from the rows beside it."""
        model, data = self._machine.model, self._machine.data
        before, here, after = (self._qpos(run, at) for at in (row - 1, row, row + 1))
        qvel = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, qvel, float(run.time[row + 1] - run.time[row - 1]), before, after)
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = here, qvel
        for joint, name in enumerate(self._machine.names):
            data.ctrl[self._machine.drivetrain.actuator_ids[name]] = run.goal[row - 1, joint]
        install()
        mujoco.mj_forward(model, data)

    def _qpos(self, run: Recording, row: int) -> np.ndarray:
        machine = self._machine
        qpos = np.array(machine.model.qpos0)
        names = self._robot.base_names
        values: Mapping[str, float] = dict(zip(names, run.base[row].tolist(), strict=True))
        machine.layout.place(machine.model, qpos, values)
        link = run.link[row] if run.link.size else run.position[row]
        for _ in range(2):  # a coordinate of two joints needs the other's place
            for k, name in enumerate(machine.names):
                machine.drivetrain.set_position(name, qpos, run.position[row, k], link[k])
        return self._closed(qpos) if machine.model.neq else qpos

    def _closed(self, qpos: np.ndarray) -> np.ndarray:
        """The mechanism's loops closed by the joints that are neither driven nor measured."""
        model = self._machine.model
        data = mujoco.MjData(model)
        data.qpos[:] = qpos
        fixed = np.isin(model.dof_jntid, self._fixed)
        for _ in range(LOOPS):
            mujoco.mj_fwdPosition(model, data)
            rows = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
            jacobian = np.zeros((data.nefc, model.nv))
            if mujoco.mj_isSparse(model):
                mujoco.mju_sparse2dense(jacobian, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
            else:
                jacobian[:] = data.efc_J.reshape(data.nefc, model.nv)
            step = np.zeros(model.nv)
            step[~fixed] = np.linalg.lstsq(jacobian[rows][:, ~fixed], -data.efc_pos[: data.nefc][rows], rcond=None)[0]
            mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        return np.array(data.qpos)


def _per_window(run: Recording, window: float) -> int:
    return max(round(window / run.period), 2)


def windows(run: Recording, window: float = WINDOW) -> list[tuple[int, int]]:
    """First row of each whole window but the first, from which the next is approached, and the row that ends it."""
    per_window = _per_window(run, window)
    return [(at, at + per_window) for at in range(1 + per_window, len(run.time) - per_window, per_window)]


def blank(run: Recording) -> dict[str, np.ndarray]:
    """Columns like those of ``run``, of NaN."""
    names = ("position", "duty", "current", "voltage", "base", "link")
    return {name: np.full(np.shape(getattr(run, name)), np.nan) for name in names}


def _recording(run: Recording, columns: Mapping[str, np.ndarray]) -> Recording:
    """With the times and goals of ``run``; speeds are from its positions where others are unknown."""
    known = np.isfinite(columns["position"])
    velocity = velocity_of(run.time, np.where(known, columns["position"], run.position))
    return Recording(run.time, run.goal, velocity=np.where(known, velocity, np.nan), rewards={}, **columns)


def squares(run: Recording, predicted: Recording, window: float = WINDOW) -> np.ndarray:
    """Mean squares in each window of the position error of the joints, and behind them of the base (w, k + b)."""
    difference = np.concatenate([predicted.position - run.position, predicted.base - run.base], axis=1)
    rows = [np.nanmean(difference[first + 1 : last + 1] ** 2, axis=0) for first, last in windows(run, window)]
    return np.array(rows).reshape(len(rows), difference.shape[1])


def ratios(found: np.ndarray, accounted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How many times what is accounted for an error is (s,), and by what chance it would be as many where they are one.

    Windows differ: in one of them a foot lands. Where machine and model are one, what was found and what is accounted
    for could change places in any window, so the ratio is compared with those after such exchanges.

    Args:
        found, accounted: mean squares in the same windows (w, s).
    """
    least = 1e-9  # [rad or m]
    swapped = np.random.default_rng(0).integers(0, 2, (DRAWS, len(found)), dtype=np.int8).astype(float)

    def ratio(above: np.ndarray, below: np.ndarray) -> np.ndarray:
        return np.sqrt(np.maximum(above, 0.0)) / np.maximum(np.sqrt(np.maximum(below, 0.0)), least)

    difference = swapped @ (accounted - found) / len(found)
    drawn = ratio(found.mean(axis=0) + difference, accounted.mean(axis=0) - difference)
    own = ratio(found.mean(axis=0), accounted.mean(axis=0))
    return own, (1.0 + (drawn >= own * (1.0 - 1e-9)).sum(axis=0)) / (1.0 + DRAWS)
