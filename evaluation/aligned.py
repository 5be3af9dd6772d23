"""What a model predicts from the measured state, over short windows: nothing adds up but what the model gets wrong.

A run of its own soon differs from the machine's, whatever the model: a hop more or less is enough. So the model is put
where the machine was at the start of each window, gets the goals that the machine got, when it got them, and is
compared over that window. How far it would be off if it were the machine is rehearsed in the same window, with the
model in the place of the machine: encoder steps, the time of a reading and of the goals, speeds taken from differences,
and how much a landing magnifies all that are then in both. The base of a robot that an IMU alone measures is placed
on its floor (:class:`FreeBase`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
from scipy.optimize import least_squares

from ..actuators.engine import install
from ..envs.engine import turns
from ..envs.engine.imu import Imu, Spread, Switches
from ..envs.engine.keyed import key_of
from ..envs.engine.model_poses import Pose, stand
from ..gap.ground.tree_model import PLANE, touching
from ..hw.machine.robot import ServoRobot
from ..hw.run.simulated import Recording, Turned, velocity_of
from ..hw.virtual.machine import Machine

WINDOW = 0.2  # [s]
DRAWS = 5000  # of exchanges
DEPARTS = 0.25  # of the spread of a signal on the machine: a model further off than this has departed
WHOLE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
MOST_BIASED = 3.0  # standard deviations of what an IMU is bought for, by which it may lean
LEVELLINGS = 5  # steps of the search for that
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
        self._switches = Switches(self._machine.model, () if robot.imu is None else robot.imu.switches)
        self._base = self._unmeasured_base()
        self._fixed = [self._machine.model.joint(name).id for name in self._driven_joints()]

    def levelled(self, run: Recording, window: float = WINDOW) -> tuple[Recording, np.ndarray]:
        """``run`` without the lean of its IMU's seat, where nothing but an IMU tells how the base turns.

        How it leans nobody knows. It is taken to lean, within what it is bought for, so that the base goes on from each
        window's start as it did: one that leans otherwise tips onto its feet.

        Returns:
            The run; and how far it may still lean, a standard deviation along the way that is known least (2,) [rad].
        """
        imu, turned, rows = self._robot.imu, run.turned, windows(run, window)
        if imu is None or turned is None or self._base is None or not rows or not imu.bias.orientation:
            return run, np.zeros(2)
        bias, seen = imu.bias.orientation, imu.noise.orientation + 1e-3

        @lru_cache
        def tips(*sizes: float) -> np.ndarray:
            supposed = leaning(run, bias * np.array(sizes))
            assert supposed.turned is not None
            turn = self._predicted(supposed, window)[1]
            off = turns.projected_gravity(turn) - turns.projected_gravity(supposed.turned.at(run.time)[0])
            return np.concatenate([off[first + 1 : last + 1].ravel() for first, last in rows])

        def slopes(sizes: np.ndarray) -> np.ndarray:
            return np.stack([tips(*(sizes + step)) - tips(*sizes) for step in np.eye(2)], axis=1)

        analytic: Any = slopes  # SciPy's stubs know words alone
        found: Any = least_squares(
            lambda sizes: tips(*sizes), (0.0, 0.0), analytic, (-MOST_BIASED, MOST_BIASED),
            loss="soft_l1", f_scale=seen, max_nfev=LEVELLINGS,
        )  # fmt: skip
        # windows differ in more than noise, so their spread tells how well the lean is known
        left, slope = tips(*found.x), slopes(found.x)
        weight = 1.0 / np.sqrt(1.0 + (left / seen) ** 2)
        pulls = np.array([part.sum(axis=0) for part in np.split((slope.T * weight * left).T, len(rows))])
        inverse = np.linalg.pinv((slope.T * weight) @ slope)
        size, axes = np.linalg.eigh(inverse @ (pulls.T @ pulls) @ inverse)
        unsure = axes[:, -1] * np.minimum(np.sqrt(max(size[-1], 0.0)), 1.0)
        return leaning(run, bias * found.x), bias * unsure

    def rehearsals(
        self, run: Recording, unsure: np.ndarray, window: float = WINDOW
    ) -> list[tuple[Recording, Recording]]:
        """:meth:`rehearse`, leaning to both sides by what :meth:`levelled` does not know."""
        leans = (unsure, -unsure) if unsure.any() else (None,)
        return [self.rehearse(run, window, lean) for lean in leans]

    def _unmeasured_base(self) -> FreeBase | None:
        """The free base, where no sensor says how high it is."""
        layout, model = self._machine.layout, self._machine.model
        place = layout.base_in(model)
        if place is None or f"{layout.base_name}.z" in self._robot.base_names:
            return None
        return FreeBase(model, place, self._robot.robot.pose)

    def _driven_joints(self) -> set[str]:
        model = self._machine.model
        names = {joint for item in self._machine.drivetrain.coordinates for joint, _ in item.terms}
        base = {name.partition(".")[0] for name in self._robot.base_names}
        return {model.joint(k).name for k in range(model.njnt)} & (names | base)

    def predict(self, run: Recording, window: float = WINDOW) -> Recording:
        """``run`` as the model predicts it from its state at the start of each window; NaN outside of windows.

        Its IMU has the samples within them, where contact switches are on its board.
        """
        samples = self._samples(run)
        predicted, _ = self._predicted(run, window, samples if samples.switched else None)
        return replace(predicted, turned=samples.taken())

    def _predicted(
        self, run: Recording, window: float, samples: _Samples | None = None
    ) -> tuple[Recording, np.ndarray]:
        """The prediction, and how a free base is turned in it (n, 4)."""
        columns, turn = blank(run), np.full((len(run.time), 4), np.nan)
        for first, last in windows(run, window):
            self._put(run, first)
            self._follow(run, first, last, run.time, columns, samples, turn)
        return _recording(run, columns), turn

    def _samples(self, run: Recording) -> _Samples:
        return _Samples(self._machine, self._switches, run.turned)

    def rehearse(
        self, run: Recording, window: float = WINDOW, lean: np.ndarray | None = None
    ) -> tuple[Recording, Recording]:
        """What :meth:`predict` would come to if the machine were the model: what was measured, and its prediction.

        The machine is simulated into and through each window of ``run``, with its goals as they went out. It is read as
        servos are: when they were asked, while the log dates the reading to the middle of the transaction, in the steps
        of their encoders. It goes on from window to window as a machine does, whose integrators fill and whose legs
        brace each other within a step of their encoders. Where it has strayed, as a hopper does after some hops, it is
        put where the machine was a window earlier. Its IMU leans by ``lean`` (2,) [rad]; None: it does not.
        """
        measured, predicted, stride = blank(run), blank(run), _lengths(run, window)[1]
        asked = run.asked if len(run.asked) else run.time
        model, data, turned, imu = self._machine.model, self._machine.data, run.turned, self._robot.imu
        leans = np.empty((len(run.time), 0)) if turned is None else turns.projected_gravity(turned.at(run.time)[0])
        told = 0.0 if imu is None else np.hypot(imu.noise.orientation, imu.bias.orientation)
        places = np.concatenate([run.position, run.base, leans], axis=1)
        steps = np.concatenate([self._steps["position"], self._steps["base"], np.full(leans.shape[1], told)])
        rounding = self._steps | (
            {"link": np.where(run.behind, self._steps["link"], self._steps["position"])} if run.link.size else {}
        )
        near = np.maximum(DEPARTS * places.std(axis=0), 2.0 * steps)
        state, there = np.zeros(mujoco.mj_stateSize(model, WHOLE)), np.full(len(steps), np.inf)
        taken, foretold = self._samples(run), self._samples(run)
        for first, last in windows(run, window):
            begin = first - stride
            if (np.abs(there - places[begin]) < near).all():
                mujoco.mj_setState(model, data, state, WHOLE)
                install()
                mujoco.mj_forward(model, data)
            else:
                self._put(run, begin)
            read = blank(run)
            samples = self._samples(run)
            self._follow(run, begin, first, asked, read, samples)
            before = len(samples)
            mujoco.mj_getState(model, data, state, WHOLE)
            there = np.concatenate([read["position"][first], read["base"][first], samples.lean])
            self._follow(run, first, last, asked, read, samples)
            for name, step in rounding.items():
                if read[name].size:
                    read[name][:] = step * np.round(read[name] / step)
            rows = np.arange(first - 1, last + 1)
            seen = replace(_recording(run, read), sent=run.sent, turned=samples.read(imu, last)).cut(rows)
            part = seen if lean is None else leaning(seen, lean)
            foreseen = blank(part)
            self._put(part, 1)
            self._follow(part, 1, len(rows) - 1, part.time, foreseen, foretold if foretold.switched else None)
            taken.add(samples, before)
            for name in measured:
                if measured[name].size:
                    measured[name][first + 1 : last + 1] = read[name][first + 1 : last + 1]
                    predicted[name][first + 1 : last + 1] = foreseen[name][2:]
        found, foreknown = _recording(run, measured), _recording(run, predicted)
        return replace(found, turned=taken.taken()), replace(foreknown, turned=foretold.taken())

    def _follow(
        self,
        run: Recording,
        first: int,
        last: int,
        times: np.ndarray,
        columns: Mapping[str, np.ndarray],
        samples: _Samples | None = None,
        turn: np.ndarray | None = None,
    ) -> None:
        """Simulate from the row ``first`` to ``last`` with the goals of ``run``, and note what is there at ``times``.

        Args:
            run: with n rows.
            first, last: of them.
            times: of the rows (n,) [s].
            columns: to fill.
            samples: of the IMU, to take on the way.
            turn: to fill with how a free base is turned (n, 4).
        """
        machine, joints = self._machine, range(len(self._machine.names))
        advance = machine.advance if samples is None else samples.advance
        sent = np.where(np.isfinite(run.sent), run.sent, run.time) if len(run.sent) else run.time
        machine.data.time = times[first]
        for row in range(first, last):
            advance(sent[row])
            for joint in joints:
                machine.set_goal(joint, float(run.goal[row, joint]))
            advance(times[row + 1])
            for name, value in (
                ("position", machine.reading), ("duty", machine.duty), ("current", machine.current),
                ("voltage", machine.voltage),
            ):  # fmt: skip
                columns[name][row + 1] = [value(joint) for joint in joints]
            columns["base"][row + 1] = [machine.position(k) for k in range(len(joints), len(machine.encoders))]
            if run.link.size:
                columns["link"][row + 1] = [(machine.link if run.behind[k] else machine.reading)(k) for k in joints]
            if turn is not None and self._base is not None:
                turn[row + 1] = machine.base_turn()[0]

    def _put(self, run: Recording, row: int) -> None:
        """The state of the machine at a row, its speeds from the rows beside it."""
        model, data = self._machine.model, self._machine.data
        before, here, after = (self._qpos(run, at) for at in (row - 1, row, row + 1))
        qvel = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, qvel, float(run.time[row + 1] - run.time[row - 1]), before, after)
        mujoco.mj_resetData(model, data)
        if self._base is not None:
            known = None if run.turned is None else run.turned.at(run.time[row : row + 1])
            turn, turn_rate = (None, None) if known is None else (known[0][0], known[1][0])
            self._base.put(here, turn)
            self._base.move(here, qvel, turn_rate)
        data.qpos[:], data.qvel[:] = here, qvel
        for joint, name in enumerate(self._machine.names):
            data.ctrl[self._machine.drivetrain.actuator_ids[name]] = run.goal[row - 1, joint]
        install()
        mujoco.mj_forward(model, data)

    def _qpos(self, run: Recording, row: int) -> np.ndarray:
        machine = self._machine
        qpos = np.array(machine.model.qpos0 if self._base is None else self._base.home)
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


class _Samples:
    """What the IMU of a simulated machine says at the times at which that of another one was read."""

    def __init__(self, machine: Machine, switches: Switches, other: Turned | None) -> None:
        self._machine, self._switches = machine, switches
        self.switched = other is not None and other.switches.shape[1] > 0
        self._due = np.empty(0) if other is None else other.time
        self._times: list[float] = []
        self._found: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def __len__(self) -> int:
        return len(self._times)

    @property
    def lean(self) -> np.ndarray:
        """Of the machine now, as the direction of gravity (3,); (0,) where no IMU is read."""
        return turns.projected_gravity(self._machine.base_turn()[0]) if len(self._due) else np.empty(0)

    def advance(self, time: float) -> None:
        """Simulate up to ``time`` [s]."""
        for due in self._due[(self._due > self._machine.time) & (self._due <= time)].tolist():
            self._machine.advance(due)
            self._times.append(due)
            self._found.append((*self._machine.base_turn(), self._switches.closed(self._machine.data.sensordata)))
        self._machine.advance(time)

    def add(self, other: _Samples, since: int) -> None:
        """Take those of another from a number on."""
        self._times += other._times[since:]
        self._found += other._found[since:]

    def taken(self) -> Turned | None:
        """All of them, true; None: there is none."""
        if not self._times:
            return None
        orientation, turn_rate, switches = (np.array(values) for values in zip(*self._found, strict=True))
        return Turned(np.array(self._times), orientation, turn_rate, switches)

    def read(self, imu: Imu | None, number: int) -> Turned | None:
        """The samples with the noise of an IMU, which ``number`` draws; how it leans is fitted, so it does not."""
        true = self.taken()
        if imu is None or true is None:
            return None
        plain = replace(imu, bias=Spread(0.0, imu.bias.turn_rate))
        key, count = key_of(np.full(len(self._times), 0.5)), len(self._times)
        orientation, turn_rate = plain.measured(
            true.orientation, true.turn_rate, key, number * count + np.arange(count)
        )
        return replace(true, orientation=orientation, turn_rate=turn_rate)


def leaning(run: Recording, lean: np.ndarray) -> Recording:
    """A run without a lean of its IMU about the level axes (2,) [rad]."""
    if (turned := run.turned) is None:
        return run
    back = turns.inverse(turns.of_vector(np.array([*lean, 0.0])))
    return replace(run, turned=replace(turned, orientation=turns.multiply(turned.orientation, back)))


def _lengths(run: Recording, window: float) -> tuple[int, int]:
    """Rows of a window, and from the start of one to that of the next: no gait has all of them at one moment of it."""
    rows = max(round(window / run.period), 2)
    return rows, rows + 1


def windows(run: Recording, window: float = WINDOW) -> list[tuple[int, int]]:
    """First row of each whole window but the first, from which the next is approached, and the row that ends it."""
    rows, stride = _lengths(run, window)
    return [(at, at + rows) for at in range(1 + stride, len(run.time) - rows, stride)]


def blank(run: Recording) -> dict[str, np.ndarray]:
    """Columns like those of ``run``, of NaN."""
    names = ("position", "duty", "current", "voltage", "base", "link")
    return {name: np.full(np.shape(getattr(run, name)), np.nan) for name in names}


def _recording(run: Recording, columns: Mapping[str, np.ndarray]) -> Recording:
    """With the times and goals of ``run``; speeds are from its positions where others are unknown."""
    known = np.isfinite(columns["position"])
    velocity = velocity_of(run.time, np.where(known, columns["position"], run.position))
    velocity = np.where(known, velocity, np.nan)
    return Recording(run.time, run.goal, velocity=velocity, **columns, rewards={}, behind=run.behind, turned=None)


def squares(run: Recording, predicted: Recording, window: float = WINDOW) -> np.ndarray:
    """Mean squares in each window of the position error of the joints, and behind them of the base (w, k + b)."""
    difference = np.concatenate([predicted.position - run.position, predicted.base - run.base], axis=1)
    rows = [np.nanmean(difference[first + 1 : last + 1] ** 2, axis=0) for first, last in windows(run, window)]
    return np.array(rows).reshape(len(rows), difference.shape[1])


def touches(run: Recording, predicted: Recording, window: float = WINDOW) -> tuple[np.ndarray, np.ndarray]:
    """How the contact switches of a model follow those of the machine, in the windows of :meth:`Aligned.predict`.

    Returns:
        Share of the samples in which both are closed, or both open (s,), NaN where the machine's said nothing; and by
        how much later the model's close, mean of the windows in which both do (s,) [s], NaN where none does.
    """
    ours, theirs = run.turned, predicted.turned
    if ours is None or theirs is None or not theirs.switches.size:
        return np.empty(0), np.empty(0)
    time, rows, columns = np.intersect1d(ours.time, theirs.time, return_indices=True)
    measured, modelled = ours.switches[rows], theirs.switches[columns]
    alike = np.where(np.isfinite(measured), measured == modelled, np.nan)
    agrees = np.array([np.nanmean(column) if np.isfinite(column).any() else np.nan for column in alike.T])
    later: list[list[float]] = [[] for _ in agrees]
    for first, last in windows(run, window):
        inside = (time > run.time[first]) & (time <= run.time[last])
        for k, found in enumerate(later):
            closings = [np.flatnonzero(np.diff(rows[inside, k]) > 0.0) for rows in (measured, modelled)]
            if all(map(len, closings)):
                here, there = (time[inside][1 + rows[0]] for rows in closings)
                found.append(float(there - here))
    return agrees, np.array([np.mean(found) if found else np.nan for found in later])


def ratios(found: np.ndarray, accounted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How many times what is accounted for an error is (s,), and by what chance it would be as many where they are one.

    Windows differ: in one of them a foot lands. Where machine and model are one, what was found and what is accounted
    for could change places in any window, so the ratio is compared with those after such exchanges. It is told without
    the window that adds most to it: a robot on two feet that tips to the other side once is no gap.

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
    kept = np.arange(len(found))[:, None] != np.argmax(found - accounted, axis=0)
    told = ratio((kept * found).mean(axis=0), (kept * accounted).mean(axis=0))
    return np.minimum(told, own), (1.0 + (drawn >= own * (1.0 - 1e-9)).sum(axis=0)) / (1.0 + DRAWS)


# --- where a free base is whose place nobody measured: turned as its IMU says, and on its floor with its nearest
# foot.
#
# Where it is on a level floor, and where it heads, changes nothing. That foot stands still, and the base moves over
# it.

FARTHEST = 10.0  # [m] that a floor is sought


class FreeBase:
    """The free base of a compiled robot.

    Attributes:
        home: positions where nothing is measured (nq,).
    """

    def __init__(self, model: mujoco.MjModel, place: tuple[int, int], pose: Pose) -> None:
        """Prepare.

        Args:
            model: robot and chains.
            place: where the joint begins in positions and in speeds.
            pose: where episodes start joints that nothing drives.
        """
        self._model, self._data = model, mujoco.MjData(model)
        self._qpos, self._dof = place
        self.home = np.array(model.qpos0)
        stand(model, pose, self.home)
        floors = [k for k in range(model.ngeom) if int(model.geom_type[k]) == PLANE]
        self._pairs = [(floor, geom) for floor in floors[:1] for geom in touching(model, floor)]

    def put(self, qpos: np.ndarray, turn: np.ndarray | None) -> None:
        """Put the base of ``qpos`` (nq,) onto its floor, turned by ``turn`` (4,); None: it stays turned as it is."""
        if turn is not None:
            qpos[self._qpos + 3 : self._qpos + 7] = turn
        if (nearest := self._nearest(qpos)) is not None:
            qpos[self._qpos + 2] -= nearest[0]

    def move(self, qpos: np.ndarray, qvel: np.ndarray, turn_rate: np.ndarray | None) -> None:
        """Write how the base moves into ``qvel`` (nv,), which holds the speeds of the joints.

        Args:
            qpos: from :meth:`put` (nq,).
            qvel: to complete.
            turn_rate: about its axes (3,) [rad/s]; None: it keeps that of ``qvel``.
        """
        dof = self._dof
        qvel[dof : dof + 3] = 0.0
        if turn_rate is not None:
            qvel[dof + 3 : dof + 6] = turn_rate
        if (nearest := self._nearest(qpos)) is None:
            return
        _, geom, point = nearest
        jacobian = np.zeros((3, self._model.nv))
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_jac(self._model, self._data, jacobian, None, point, int(self._model.geom_bodyid[geom]))
        qvel[dof : dof + 3] = -(jacobian @ qvel)

    def _nearest(self, qpos: np.ndarray) -> tuple[float, int, np.ndarray] | None:
        """What is nearest to the floor: how far [m], the geom, and its point (3,) [m]; None: nothing can touch it."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        ends, found = np.zeros(6), None
        for floor, geom in self._pairs:
            distance = mujoco.mj_geomDistance(self._model, self._data, floor, geom, FARTHEST, ends)
            if found is None or distance < found[0]:
                found = distance, geom, ends[3:].copy()
        return found if found is not None and found[0] < FARTHEST else None
