"""The engine of every environment: many simulations of one robot, each control step a few NumPy calls over all of them.

A single environment, a Gymnasium vector environment and an SB3 one are shells around it. Simulation i of a batch with
seed s draws from the generator of seed s + i. So it is bit-equal to a batch of one with seed s + i.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch

from ...actuators import load_chain
from ...actuators.engine import install
from ...actuators.layout import S_DUTY, S_OUT_OF_RANGE, S_TORQUE
from ...common.errors import SealegsError
from .arguments import check_values, steps_of_delay, steps_of_rate
from .at_once import BreaksAtOnce
from .base import BaseLayout, Sides
from .disturbances import Disturbances, stand_on_slope, tilt_floor
from .imu import ImuHistory
from .model_poses import Loops, in_turn, place_followers
from .randomization import Randomization, Source
from .robot import ChainSource, check_position_goals
from .servo_use import ServoUse
from .task import ModulatedTask, Motion, Step, Task, check_observation, check_step
from .terrain import Terrain
from .world import World, with_contacts

ON_TIME = 1e-6  # of an interval, that times are rounded by


class BatchEngine:
    """n simulations of one task.

    Attributes:
        task: what is asked of the robot, :meth:`~sealegs.envs.engine.task.Task.fitted` to it.
        fitted: numbers of the task that were left open, by name.
        drivetrain: the robot with its actuators.
        chains: those of the robot that were asked for, by coordinate; the drivetrain's may have room for more.
        batch: the simulations.
        numbers: of the robot, by name.
        names: of the driven coordinates, in the order of goals.
        action_names: what the elements of an action mean.
        dt: control step [s].
        steps: control steps since reset, (n,).
        world: contacts, bodies, sites and sensors that the task sees.
        drawn: values of the running episodes' randomisation by name, (n,) each.
    """

    def __init__(
        self,
        task: Task,
        num_envs: int,
        *,
        actuator: ChainSource | Mapping[str, ChainSource] | None = None,
        randomization: Source = None,
        params: Mapping[str, float] | None = None,
        control_rate: float = 50.0,
        action_delay: float = 0.0,
        servo: Mapping[str, float] | None = None,
        max_episode_steps: int | None = None,
        autoreset: bool = True,
        threads: int = 0,
    ) -> None:
        """Build the robot and its simulations; :meth:`reset` starts them.

        Args:
            task: what is asked of the robot.
            num_envs: simulations side by side.
            actuator: chain of all coordinates, or chains by coordinate; None: the robot's own.
            randomization: see :mod:`sealegs.envs.engine.randomization`.
            params: numbers of the robot other than its own.
            control_rate: actions per second [Hz]; the physics step must fit into their distance a whole number of
                times.
            action_delay: from an observation to the goal that follows from it [s], a whole number of physics steps
                and less than the distance of two goals; the goal before holds meanwhile.
            servo: weights of terms of the reward that spare the servos, see :mod:`sealegs.envs.engine.servo_use`.
            max_episode_steps: control steps until truncation; None: never.
            autoreset: start a new episode in the step that ends one.
            threads: of the engine; 0: one per core.

        Raises:
            SealegsError: one of the arguments does not fit the robot, or a chain takes no position goals.
        """
        if isinstance(num_envs, bool) or not isinstance(num_envs, int | np.integer) or num_envs < 1:
            raise SealegsError(f"num_envs is {num_envs!r}; it must be a whole number of at least 1.")
        self._sound = False  # what the task gives, which the first step looks at
        same: Any = {"actuator": actuator, "params": params, "control_rate": control_rate, "action_delay": action_delay}
        given, task = task, task.fitted(lambda trial, count: BatchEngine(trial, count, autoreset=False, **same))
        names = [item.name for item in dataclasses.fields(task)]
        self.fitted = {name: getattr(task, name) for name in names if getattr(task, name) != getattr(given, name)}
        self.task, self.num_envs = task, num_envs
        self.numbers = task.robot.parameters(params)
        chains = {name: load_chain(source) for name, source in task.robot.chains_for(actuator).items()}
        check_position_goals(task.robot, chains, "a task gives", task.takes_speeds)
        robot = with_contacts(task.robot, task.sees)
        self.drivetrain = robot.drivetrain(chains, params)
        self.chains = self.drivetrain.chains
        self.randomization = Randomization(
            self.drivetrain,
            randomization,
            lambda chains, numbers: robot.drivetrain(dict(chains), {**(params or {}), **numbers}),
        )
        spans = self.randomization.uneven
        self._terrain = Terrain.under(self.drivetrain.model, spans) if spans else None
        if self._terrain is not None:
            robot = self._terrain.on(robot)
        if self._terrain is not None or self.randomization.chains != self.chains:
            self.drivetrain = robot.drivetrain(self.randomization.chains, params)
        model = self.drivetrain.model
        self.substeps = steps_of_rate(control_rate, model.opt.timestep)
        self._late = steps_of_delay(action_delay, model.opt.timestep)
        self.dt = self.substeps * model.opt.timestep
        self.max_episode_steps, self.autoreset = max_episode_steps, autoreset
        self.batch = Batch(model, num_envs, 1 if num_envs == 1 else threads)
        self._qpos, self._qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self._ctrl, self._time = self.batch.bind("ctrl"), self.batch.bind("time")
        self._userdata = self.batch.bind("userdata")
        # position, speed, acceleration or control went bad, and the engine reset the simulation
        self._warnings = self.batch.warning[:, int(mujoco.mjtWarning.mjWARN_BADQPOS) :, 1]
        self._programs: np.ndarray | None = None
        self._followers, self._loops = in_turn(model), Loops.of(self.drivetrain)
        self._base = BaseLayout.of_model(model, range(model.njnt)).base
        imu, base = task.robot.imu, self._base
        self._imu = None if imu is None or base is None else ImuHistory(imu, self.batch, base, self.substeps)
        names = [item.name for item in self.drivetrain.coordinates]
        addresses = np.array([self.drivetrain.state_addresses[name] for name in names])
        self._torques, self._out_of_range = addresses + S_TORQUE, addresses + S_OUT_OF_RANGE
        self._duties = addresses + S_DUTY
        self.world = World(self.batch, task.sees, max(round(task.averaged() / self.dt), 1))
        self._motor, self._link = (Sides(self.drivetrain, names, side) for side in ("motor", "link"))
        limits = np.array([task.robot.goal_limits(self.numbers)[name] for name in names])
        self.goal_centre, self.goal_half = limits.mean(axis=1), 0.5 * (limits[:, 1] - limits[:, 0])
        self._limits = limits.T
        self._middle = np.broadcast_to(self.goal_centre, (num_envs, len(names)))
        self.names, self.action_names = names, task.action_names()
        self.observation_size = len(task.observation_names())
        shape = (num_envs, len(names))
        self._action = np.zeros((num_envs, len(self.action_names)))
        self._link_before, self._reading_before = np.zeros(shape), np.zeros(shape)
        self._generated = _Generated(task, self) if isinstance(task, ModulatedTask) else None
        self.goals_per_step = self._generated.goals_per_step if self._generated is not None else 1
        longest = self.substeps if self._generated is None else self._generated.substeps
        if self._late >= longest:
            most = longest * model.opt.timestep
            raise SealegsError(f"action_delay is {action_delay:g} s; here it must be less than {most:g} s.")
        self.watch: Callable[[], None] = lambda: None  # called at each new goal, for films
        self._command = np.zeros((num_envs, task.commands(np.zeros((1, task.draws))).shape[1]))
        self.steps = np.zeros(num_envs, dtype=np.int64)
        self._use = ServoUse({name: self.chains[name] for name in names}, num_envs, self.dt, servo)
        self._breaks = BreaksAtOnce(task.robot.name, num_envs)
        self.drawn = {f"{draw.group}.{draw.name}": np.zeros(num_envs) for draw in self.randomization.draws}
        self.disturbances = Disturbances(num_envs, self._base, self.drawn)
        self._asked = np.zeros(shape)
        self._queue = _Queue(self) if "delay.goals" in self.drawn else None
        if self._generated is not None and {"delay.goals", "lost.goals"} & self.drawn.keys():
            raise SealegsError(
                f"{type(task).__name__} gives goals more often than actions, and randomization can neither lose "
                "nor delay them: leave delay and lost.goals out, or give action_delay."
            )
        self.generators = [np.random.Generator(np.random.PCG64())] * num_envs
        self.seed(None)

    # --- looking -----------------------------------------------------------------------------------------------

    @cached_property
    def seen(self) -> mujoco.MjModel:
        """Model of the simulation that was looked at last, with what its episode drew; made when one is."""
        return copy(self.drivetrain.model)

    def look(self, simulation: int, data: mujoco.MjData) -> mujoco.MjData:
        """Copy the state of one simulation into ``data``, with all that follows from it: poses, speeds, contacts,
        forces, sensors; the simulation is not touched. :attr:`seen` is its model until the next look."""
        model = self.batch.get_model(simulation, self.seen)
        mujoco.mj_setState(model, data, self.batch.state[simulation], mujoco.mjtState.mjSTATE_INTEGRATION)
        install()
        mujoco.mj_forward(model, data)
        mujoco.mj_setState(model, data, self.batch.state[simulation], mujoco.mjtState.mjSTATE_INTEGRATION)
        return data

    def set_number(self, name: str, value: Any) -> None:
        """Give a number of the task, such as a weight of its reward, another value from the next step on.

        What the present episodes were drawn with stays; a range is for those that start from now on.

        Raises:
            SealegsError: the value is none for it.
        """
        check_values(type(self.task), {name: value})
        self.task = replace(self.task, **{name: value})

    # --- starting ----------------------------------------------------------------------------------------------

    def seed(self, seed: int | Sequence[int | None] | None) -> None:
        """Seed the generators: one number s makes s, s + 1, ...; None takes new entropy; a list holds one for each."""
        if seed is None or isinstance(seed, int | np.integer):
            seeds: Sequence[int | None] = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise SealegsError(f"there are {len(seeds)} seeds for {self.num_envs} simulations.")
        self.generators = [np.random.Generator(np.random.PCG64(np.random.SeedSequence(value))) for value in seeds]

    def reset(self, simulations: np.ndarray | None = None) -> np.ndarray:
        """Start new episodes in all or some simulations; their observations, (m, size), float32."""
        chosen = np.arange(self.num_envs) if simulations is None else simulations
        self._start(chosen)
        return self._observation(self.motion(self._action))[chosen]

    def _start(self, chosen: np.ndarray) -> None:
        task_draws = self.task.draws
        draws = task_draws + len(self.randomization.draws)
        random = np.empty((len(chosen), draws + (self._imu is not None) + self.randomization.disturbs))
        for row, number in enumerate(chosen):
            random[row] = self.generators[number].random(random.shape[1])
        install()  # a library may have taken the callback's place since
        self.batch.reset(chosen, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        for name, values in self.randomization.apply(
            self.drivetrain, self.batch, chosen, random[:, task_draws:draws]
        ).items():
            self.drawn[name][chosen] = values
        if self.randomization.disturbs:
            self.disturbances.start(chosen, random[:, -1])
        self._programs = self.batch.expanded("actuator_user")
        qpos, qvel = self._qpos[chosen], self._qvel[chosen]
        goals = self.task.place(self.drivetrain, self.numbers, random[:, :task_draws], qpos, qvel)
        place_followers(self.drivetrain.model, self._followers, qpos)
        if self._loops is not None:
            before = self._motor(qpos)
            self._loops.close_each(qpos)
            goals = goals + self._motor(qpos) - before
        if self._terrain is not None and self._base is not None:
            qpos[:, self._base[0] : self._base[0] + 3] += self.disturbances.place(chosen, self._terrain)
        if (turn := self.disturbances.slope(chosen)) is not None and self._base is not None:
            tilt_floor(self.batch, chosen, turn)
            stand_on_slope(turn, qpos[:, self._base[0] : self._base[0] + 7])
        self._command[chosen] = self.task.commands(random[:, :task_draws])
        self._qpos[chosen], self._qvel[chosen], self._ctrl[chosen] = qpos, qvel, goals
        self.batch.forward(chosen)  # the chains' memories start at these goals
        if self._imu is not None:
            self._imu.begin(chosen, random[:, draws])
        self.steps[chosen] = 0
        self.world.start(chosen)
        if self._generated is not None:
            self._action[chosen] = 0.0
            self._generated.begin(chosen, random[:, :task_draws], goals)
        else:
            zero, per_action = self._scale()
            self._action[chosen] = np.clip((goals - zero[chosen]) / per_action, -1.0, 1.0)
        self._asked[chosen] = goals
        self._use.start(chosen, goals)
        if self._queue is not None:
            self._queue.start(chosen, goals)
        self._link_before[chosen] = self._link(self._qpos[chosen])
        self._reading_before[chosen] = self._readings()[chosen]

    # --- stepping ----------------------------------------------------------------------------------------------

    def step(self, action: np.ndarray) -> Step:
        """Advance every simulation by one control step.

        Args:
            action: (n, k), finite; -1 and 1 are the limits of the robot's goals, or how far the task lets actions
                correct its reference or modulate its generator.

        Raises:
            SealegsError: the action has another shape, or is not finite.
        """
        action = np.asarray(action, np.float64)
        if action.shape != self._action.shape or not np.isfinite(action).all():
            raise SealegsError(self._refusal(action))
        previous, action = self._action, np.clip(action, -1.0, 1.0)
        self.disturbances.push(self.steps, self.dt, self._qvel)
        if self._generated is not None:
            self._generated.step(action)
        else:
            self._send(self._goals(action))
        self._action = action
        self.steps += 1
        self.world.advance(self.dt)
        motion = self.motion(previous)
        terms, failed = self.task.rewards(motion), self.task.failed(motion)
        if not self._sound:
            check_step(self.task, terms, failed, self.num_envs)
            self._sound = True
        use = self._use.step(self._ctrl, motion.torque, motion.duty)
        terms |= self._use.terms(use)
        reward = np.zeros(self.num_envs)
        for term in terms.values():
            reward += term
        unstable = self._warnings.any(axis=1)
        self._breaks.see(unstable, self.steps, self.drivetrain.model.opt.timestep)
        terminated = failed | unstable
        truncated = np.zeros(self.num_envs, dtype=bool)
        if self.max_episode_steps is not None:
            np.greater_equal(self.steps, self.max_episode_steps, out=truncated)
        self._renew_commands()
        observation = self._observation(motion)
        flags = {"net_out_of_range": self._userdata[:, self._out_of_range].sum(axis=1), "unstable": unstable}
        self._link_before, self._reading_before = motion.link, motion.reading
        done = np.flatnonzero(terminated | truncated)
        final = observation[done]
        if self.autoreset and len(done):
            self._start(done)
            observation[done] = self._observation(self.motion(self._action))[done]
        return Step(
            observation,
            reward=reward,
            terminated=terminated,
            truncated=truncated,
            terms=terms,
            flags=flags,
            servo=use,
            errors=self.task.errors(motion),
            done=done,
            final_observation=final,
        )

    def _renew_commands(self) -> None:
        """Draw new commands where the task wants others by now."""
        if self.task.command_interval <= 0.0:
            return
        number = np.floor(self.steps * self.dt / self.task.command_interval + ON_TIME)
        before = np.floor((self.steps - 1) * self.dt / self.task.command_interval + ON_TIME)
        for simulation in np.flatnonzero(number > before):
            random = self.generators[simulation].random((1, self.task.draws))
            self._command[simulation] = self.task.commands(random)[0]

    def simulate(self, steps: int) -> None:
        """Let so many steps of the simulation pass, with the goals as they are."""
        if self._imu is None:
            self.batch.step(nstep=steps)
        else:
            self._imu.carry(steps)

    def _send(self, goals: np.ndarray) -> None:
        """Simulate a control step in which the servos get goals (n, k), in time and all of them or not."""
        lost = self.disturbances.lost_goals(self.steps)
        self._asked = goals if lost is None else np.where(lost[:, None], self._asked, goals)
        if self._queue is not None:
            self._queue.step(self._asked)
            return
        if self._late:
            self.simulate(self._late)
        self._ctrl[:] = self._asked
        self.watch()
        self.simulate(self.substeps - self._late)

    def _goals(self, action: np.ndarray) -> np.ndarray:
        zero, per_action = self._scale()
        goals = zero + per_action * self.task.on_joints(self.steps * self.dt, action)
        return np.clip(goals, *self._limits)  # a correction may lead beyond

    def _scale(self) -> tuple[np.ndarray, np.ndarray]:
        """Goals at action 0 (n, k) and their change per unit of action (k,) [rad], at this moment."""
        corrected = self.task.reference(self.steps * self.dt, self._command, self.numbers)
        return (self._middle, self.goal_half) if corrected is None else corrected

    def _refusal(self, action: np.ndarray) -> str:
        if action.shape != self._action.shape:
            return (
                f"actions have the shape {action.shape}; {self.num_envs} simulations of {', '.join(self.action_names)} "
                f"need {self._action.shape}."
            )
        number, column = np.argwhere(~np.isfinite(action))[0]
        return (
            f"the action of '{self.action_names[column]}' in simulation {number} is {action[number, column]:g}; "
            "give finite numbers (a learner that diverged gives none: lower its learning rate)."
        )

    def motion(self, previous_action: np.ndarray) -> Motion:
        """What rewards and observations are computed from, as the robots stand now."""
        qpos, qvel = self._qpos, self._qvel
        link, reading = self._link(qpos), self._readings()
        return Motion(
            qpos=qpos,
            qvel=qvel,
            link=link,
            link_speed=(link - self._link_before) / self.dt,
            reading=reading,
            reading_speed=(reading - self._reading_before) / self.dt,
            torque=np.ascontiguousarray(self._userdata[:, self._torques]),  # sums of rows round alike in any batch
            motor_speed=self._motor.speed(qvel),
            action=self._action,
            previous_action=previous_action,
            command=self._command,
            time=self.steps * self.dt,
            numbers=self.numbers,
            duty=np.ascontiguousarray(self._userdata[:, self._duties]),
            world=self.world,
            base=self._base,
            switches=np.empty((self.num_envs, 0)) if self._imu is None else self._imu.closed(),
            **(self._generated.motion() if self._generated is not None else {}),
        )

    def _readings(self) -> np.ndarray:
        columns = [
            self.drivetrain.reading(name, self._qpos, self._userdata, self._time, self._programs) for name in self.names
        ]
        return self.disturbances.readings(self.steps, np.stack(columns, axis=1), self._reading_before)

    def _observation(self, motion: Motion) -> np.ndarray:
        seen = motion if self._imu is None else replace(motion, **self._imu.seen(motion.time))
        qpos, qvel = self.disturbances.base(self.steps, seen.qpos, seen.qvel)
        parts = self.task.observe(replace(seen, qpos=qpos, qvel=qvel))
        if not self._sound:
            check_observation(self.task, parts, self.num_envs, self.observation_size)
        observation = np.empty((self.num_envs, self.observation_size), np.float32)
        at = 0
        for part in parts:
            width = 1 if part.ndim == 1 else part.shape[1]
            observation[:, at : at + width] = part[:, None] if part.ndim == 1 else part
            at += width
        return observation


class _Generated:
    """The generator that actions modulate: its memory, and the power drawn in the latest control step."""

    def __init__(self, task: ModulatedTask, engine: BatchEngine) -> None:
        self._engine = engine
        timestep = engine.drivetrain.model.opt.timestep
        periods = [engine.dt / task.goal_period, task.goal_period / task.sample_period, task.sample_period / timestep]
        if any(round(count) < 1 or abs(count - round(count)) > 1e-6 * count for count in periods):
            raise SealegsError(
                f"a control step of {engine.dt:g} s, goals every {task.goal_period:g} s, samples every "
                f"{task.sample_period:g} s and steps of {timestep:g} s do not fit into one another a whole number of "
                "times; change control_rate."
            )
        self.goals_per_step, self._samples, self.substeps = (round(count) for count in periods)
        self._memory = np.zeros((engine.num_envs, task.memory))
        self._power = np.zeros(engine.num_envs)
        self._qpos_rate = np.zeros_like(engine._qpos)

    @property
    def _task(self) -> ModulatedTask:
        task = self._engine.task
        assert isinstance(task, ModulatedTask)
        return task

    def begin(self, chosen: np.ndarray, random: np.ndarray, goals: np.ndarray) -> None:
        engine = self._engine
        self._memory[chosen] = self._task.begin(engine.numbers, random, goals, engine._command[chosen])
        self._power[chosen], self._qpos_rate[chosen] = 0.0, 0.0

    def step(self, action: np.ndarray) -> None:
        engine, task = self._engine, self._task
        before, total = engine._qpos.copy(), np.zeros(engine.num_envs)
        for _ in range(self.goals_per_step):
            goals = task.generate(engine.numbers, action, engine._command, self._memory)
            if engine._late:  # goals before it hold; power is sampled where it was
                engine.simulate(engine._late)
            engine._ctrl[:] = np.clip(goals, *engine._limits)
            engine.watch()
            for sample in range(self._samples):
                engine.simulate(self.substeps - (engine._late if sample == 0 else 0))
                torque, speed = engine._userdata[:, engine._torques], engine._motor.speed(engine._qvel)
                total += task.power(engine.numbers, torque, speed)
        self._power = total / (self.goals_per_step * self._samples)
        self._qpos_rate = (engine._qpos - before) / engine.dt

    def motion(self) -> dict[str, np.ndarray]:
        return {"memory": self._memory, "power": self._power, "qpos_rate": self._qpos_rate}


class _Queue:
    """Goals on their way to the servos, each simulation's as late as its episode drew."""

    def __init__(self, engine: BatchEngine) -> None:
        self._engine, self._timestep = engine, engine.drivetrain.model.opt.timestep
        longest = max(draw.high for draw in engine.randomization.draws if draw.group == "delay")
        steps = round(longest / self._timestep) // engine.substeps + 2
        self._sent = np.zeros((steps, *engine._asked.shape))  # the newest first

    def start(self, chosen: np.ndarray, goals: np.ndarray) -> None:
        self._sent[:, chosen] = goals

    def step(self, goals: np.ndarray) -> None:
        """A control step in which the policy gives ``goals``."""
        engine = self._engine
        self._sent = np.concatenate([goals[None], self._sent[:-1]])
        late = engine.disturbances.late(self._timestep)
        assert late is not None
        whole, part = np.divmod(late, engine.substeps)
        new, now = self._sent[whole, np.arange(len(goals))], 0
        for at in np.unique(part):
            if at > now:
                engine.simulate(int(at - now))
            engine._ctrl[part == at] = new[part == at]
            now = at
        engine.watch()
        engine.simulate(int(engine.substeps - now))
