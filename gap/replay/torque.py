"""A joint judged by its torque: where no command was logged, the torque that its measured motion needs is compared.

The motion is given, so that nothing but load and friction is judged, and the torque column itself. Both sides are
averaged by the window of the weak form (:mod:`sealegs.gap.checks.torque_balance`): nothing measured is differentiated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from ...actuators import Chain
from ...actuators.chain import load_chain
from ...actuators.stages.base import ChainError
from ...actuators.stages.controller import TorqueCommand
from ...actuators.stages.friction import Friction
from ..checks.signal import sample_noise
from ..checks.torque_balance import (
    GRID_STEP,
    SHIFT_BIAS,
    SHIFT_REACHES,
    WEAK_FORM_BLOCK,
    WEAK_FORM_WINDOW,
    Shift,
    TorqueBalance,
    WeakForm,
    acceleration_noise,
    averaged,
    shifted_balance,
)
from ..load.load import PendulumLoad, bench_parameters, hung
from ..load.resting import REVERSAL_SPEED
from ..log.parts import FIT_A, FIT_B, TEST, Unit
from ..log.torque_side import Reason, TorqueSide, said_side, side_by_load
from ..log.types import Array, LogError, MeasuredRun
from .comparison import Comparison, Groups, robust_loss
from .driven_simulator import law_along
from .joint_model import Axis, JointModel
from .parameters import Target, absolute, address
from .problem import FAR, Problem

STOPS = ("stop_angle", "lower_stop")  # numbers of a load that no motion beside them shows
MOST_KEPT = 2**26  # bytes of torques of friction
BY_LOAD = (
    *("load", "load_quadratic", "load_stribeck", "load_external", "load_stribeck_external"),
    *("quadratic_motor", "quadratic_external"),
)
"""Numbers of a friction that hangs on the torque that passes."""
SHAFT = Chain((TorqueCommand(),))
"""Chain of a torque that was taken behind the gear: nothing of the drive is in it."""


@dataclass(frozen=True)
class TorqueColumn:
    """What a log makes of a torque: ``scale`` times the torque of ``delay`` [s] ago, and ``offset`` [N.m]."""

    scale: float = 1.0
    offset: float = 0.0
    delay: float = 0.0


COLUMN_UNITS = {"scale": "1", "offset": "N.m", "delay": "s"}


@dataclass(frozen=True)
class TorqueModel:
    """A joint, and the torque column of its log: numbers of the column are ``torque.scale`` and so on."""

    joint: JointModel
    column: TorqueColumn = TorqueColumn()

    def value(self, path: str) -> float:
        """A number by path."""
        at = address(path)
        return getattr(self.column, at.key) if at.target is Target.TORQUE else self.joint.value(path)

    def unit(self, path: str) -> str:
        """Its unit."""
        at = address(path)
        return COLUMN_UNITS[at.key] if at.target is Target.TORQUE else self.joint.unit(path)

    def with_fitted(self, values: Mapping[str, float]) -> TorqueModel:
        """The joint and its column with values of a fit: factors are on their own values.

        Raises:
            ChainError: the values do not make a chain.
        """
        numbers = absolute(values, self)
        own = {address(path).key: x for path, x in numbers.items() if address(path).target is Target.TORQUE}
        rest = {path: x for path, x in numbers.items() if address(path).target is not Target.TORQUE}
        return TorqueModel(self.joint.with_values(rest), replace(self.column, **own))


@dataclass(frozen=True, eq=False, kw_only=True)
class TorqueProblem(Problem):
    """Units of a joint on a bench whose torque was logged and no command: averages of the weak form as samples.

    Attributes:
        models: the joint of each run, with the torque column.
        params: bench parameters of each run.
        forms: of each run, by its number.
        at: grid point of each sample in its run (n,).
        block: number of the block of each sample (n,).
        side: what the torque column is of, and ``side_reason``: why it is taken as that.
        sides_differ: whether anything of the drive would be in it.
        shift: between torque and motion, where no number hides it.
        reach: largest delay of the column that these samples can be asked for [s].
        kept: torques of frictions that were asked for, which all parts of the data share.
    """

    models: tuple[TorqueModel, ...]
    params: tuple[dict[str, float], ...]
    forms: Mapping[int, WeakForm]
    at: np.ndarray
    block: np.ndarray
    side: TorqueSide
    side_reason: Reason
    sides_differ: bool
    shift: Shift
    reach: float
    kept: dict[tuple[object, ...], Array] = field(default_factory=dict)

    per_sample: ClassVar[tuple[str, ...]] = (*Problem.per_sample, "at", "block")

    @property
    def channels(self) -> tuple[str, ...]:
        """The torque, which is judged, and the position, which is given."""
        return ("torque", "position")

    @property
    def sampled(self) -> tuple[int, ...]:
        """The torque."""
        return (0,)

    @property
    def signal(self) -> tuple[str, str]:
        """The torque and its unit."""
        return "torque", "N.m"

    @property
    def machines(self) -> tuple[tuple[JointModel, Mapping[str, float]], ...]:
        """The joint of each run where the column is of the drive; behind the gear nothing tells of its chain."""
        joints = (model.joint for model in self.models)
        return tuple(zip(joints, self.params, strict=True)) if self.side == "drive" else ()

    @property
    def clock(self) -> float:
        """What a shift between torque and motion is off by on perfect data [s]."""
        return SHIFT_BIAS

    @cached_property
    def _compared(self) -> Comparison:
        none = np.full(len(self.time), -1)
        return Comparison(
            sampled=(0,),
            averaged=(),
            measured=self.measured,
            weight=self.weight,
            reliability=np.ones(self.measured.shape),
            judged=self.judged,
            block=self.block,
            groups=Groups.of(none),
        )

    def residual(self, simulated: np.ndarray, every: int = 1) -> np.ndarray:
        """Weighted errors (v, m) of simulated channels (v, n, 2)."""
        return self._compared.residual(simulated, every)

    def blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Block number of each entry of :meth:`residual` (m,), and entries per block (b,)."""
        return self._compared.blocks

    def left_over(self, simulated: np.ndarray) -> float:
        """Mean squared error beyond the noise, in parts of it: averages that overlap share their noise."""
        return max(float(np.mean(self.residual(simulated[None])[0] ** 2)) - 1.0, 0.0)

    def excess_loss(self, simulated: np.ndarray) -> float:
        """Loss per judged value beyond that of noise."""
        return float(robust_loss(self.residual(simulated[None])[0]).mean()) - 1.0

    def chain(self, values: Mapping[str, float]) -> Chain | None:
        """The chain of the first run with fitted values, where the column is of the drive that it describes."""
        return self.machines[0][0].with_fitted(values).chain if self.machines else None

    def simulate(self, variants: Sequence[Mapping[str, float]], step: float | None = None) -> np.ndarray:
        """Channels (v, n, 2) of every variant: the torque that the motion needs, as the column reads it."""
        del step
        out = np.empty((len(variants), len(self.time), 2))
        out[..., 1] = self.measured[:, 1]
        run_of = np.repeat([unit.run for unit in self.units], np.diff(self.starts))
        for v, values in enumerate(variants):
            needed: dict[tuple[JointModel, int], Array] = {}
            for run in np.unique(run_of):
                rows, form = run_of == run, self.forms[run]
                try:
                    model = self.models[run].with_fitted(values)
                    key = (model.joint, int(run))
                    if key not in needed:
                        needed[key] = self._needed(*key)
                except ChainError:
                    out[v, rows, 0] = FAR
                    continue
                column, then = model.column, form.time[self.at[rows]] - model.column.delay
                out[v, rows, 0] = column.scale * np.interp(then, form.time, needed[key]) + column.offset
        return out

    def _needed(self, joint: JointModel, run: int) -> Array:
        """Torque (g,) [N.m] that the motion of a run needs, averaged: of load, armature and friction."""
        form, params, chain, load = self.forms[run], self.params[run], joint.chain, joint.load
        encoder, friction = chain.find("encoder"), chain.find("friction")
        zero = joint.host_offset + (0.0 if encoder is None else encoder.offset)
        inertia, gravity = load.inertia(params) + chain.armature(), load.gravity_torque(params)
        pull = gravity * (form.sine * math.cos(zero) - form.cosine * math.sin(zero))
        free = inertia * form.acceleration + pull
        if friction is None:
            return free
        key = (run, replace(friction, viscous=0.0), (inertia, gravity, zero) if by_load(friction) else ())
        if key not in self.kept:  # most variants turn no number of friction
            if sum(values.nbytes for values in self.kept.values()) > MOST_KEPT:
                self.kept.clear()
            self.kept[key] = _friction(form, friction, free, -pull)
        return free + self.kept[key] + friction.viscous * form.speed


def _friction(form: WeakForm, friction: Friction, free: Array, external: Array) -> Array:
    """Torque (g,) [N.m] that dry friction takes, averaged, by the law of the chain.

    Args:
        form: the motion.
        friction: stage of the chain.
        free: torque that load and armature need (g,) [N.m].
        external: torque of the load alone (g,) [N.m].
    """
    model = JointModel(Chain((TorqueCommand(), friction)))
    program, out = model.chain.program(), np.empty((len(form.time), 5))
    constants, on = model.constants({}, program), np.ones(len(form.time), bool)
    way, given = np.tanh(form.speed / REVERSAL_SPEED), free
    for _ in range(1 + by_load(friction)):  # friction by load grows by what it takes itself
        law_along(
            program.copy(), constants, on.astype(float), form.time, given, on,
            form.angle, w=form.speed, external=external, out=out,
        )  # fmt: skip
        given = free + given - out[:, 0] + out[:, 1] * way
    return averaged(given - free)


def by_load(friction: Friction) -> bool:
    """Whether a friction hangs on the torque that passes."""
    return any(getattr(friction, key) != 0.0 for key in BY_LOAD)


def acts(path: str) -> bool:
    """Whether a number changes the torque that a motion needs, or what the column makes of it."""
    at = address(path)
    if at.target is Target.LOAD:
        return at.key not in STOPS
    return at.target is Target.TORQUE or at.owner == "friction" or at.key == "armature" or path == "encoder.offset"


def torque_problem(
    runs: Sequence[MeasuredRun],
    joint: str,
    units: Sequence[Unit],
    model_of: Callable[[MeasuredRun, Chain], JointModel],
    calibrated: float,
    test_group: str | None = None,
) -> TorqueProblem:
    """Lay the torque of one joint out; runs without torque are left out.

    Args:
        runs: of one bench.
        joint: its name.
        units: of :func:`sealegs.gap.log.parts.cut`.
        model_of: the joint of a run with a chain.
        calibrated: error of a torque column in parts of its rms, of calibration and of the drive's own ripple.
        test_group: that is kept for the test, for the message.

    Raises:
        LogError: no run has a torque, they are too short, or a part of the data has none of it.
    """
    params = [_bench(run, joint) for run in runs]
    logs = {k: (run.time, run.joints[joint].position, torque) for k, run in enumerate(runs)
            if (torque := run.joints[joint].torque) is not None}  # fmt: skip
    if not logs:
        raise LogError(f"joint '{joint}': no run has a goal or a torque that can be used; record one of them.")
    chains = [_chain(run, joint) for run in runs]
    load = hung(params)
    believed = [(load.inertia(p) + (c.armature() if c else 0.0), load.gravity_torque(p))
                for p, c in zip(params, chains, strict=True)]  # fmt: skip
    numbers = list(logs)

    def seen(balance: TorqueBalance) -> np.ndarray:
        rows = np.zeros(len(balance.run), bool)
        for unit in units:
            if unit.part != TEST and unit.run in logs:
                begin, end = _span(runs[unit.run], unit)
                mine = np.array(numbers)[balance.run] == unit.run
                rows |= mine & (balance.time >= begin) & (balance.time < end)
        if rows.all() or not rows.any():
            raise LogError(_missing(joint, "fit" if not rows.any() else "test", test_group))
        return rows

    # judged with all numbers refitted, so that no wrong one hides a shift
    found = shifted_balance(list(logs.values()), [believed[k] for k in logs], seen)
    if found is None:
        raise LogError(f"joint '{joint}': a torque log of a second or more is needed; these are shorter.")
    balance, shift = found
    side, reason = _side(runs, joint, chains, params, balance.only(seen(balance)), numbers, shift)
    mine = [unit for unit in units if unit.part != TEST and unit.run in logs]
    fitted = [(runs[unit.run], slice(unit.start + unit.judged, unit.stop)) for unit in mine]
    efforts = np.concatenate([logs[unit.run][2][part] for unit, (_, part) in zip(mine, fitted, strict=True)])
    axis = Axis(effort=float(np.nanquantile(np.abs(efforts), 0.999)) or None)
    models = tuple(
        TorqueModel(replace(
            model_of(run, chain if side == "drive" and chain else SHAFT), load=load, axis=axis
        ))
        for run, chain in zip(runs, chains, strict=True)
    )  # fmt: skip
    forms = {k: WeakForm.of(*log) for k, log in logs.items()}
    reach = float(balance.shifts[-1])
    kept, at, starts = [], [], [0]
    for unit in sorted(units, key=lambda unit: (unit.run, unit.start)):
        if unit.run not in forms:
            continue
        form, (begin, end) = forms[unit.run], _span(runs[unit.run], unit)
        inside = form.inside(reach)  # as far as the column may be late or early
        within = (form.time[inside] >= begin + 0.5 * WEAK_FORM_WINDOW) & (
            form.time[inside] < end - 0.5 * WEAK_FORM_WINDOW
        )
        rows = inside[within & np.isfinite(form.torque[inside])]
        if len(rows):
            kept.append(unit)
            at.append(rows)
            starts.append(starts[-1] + len(rows))
    for part in (FIT_A, FIT_B, TEST):
        if all(unit.part != part for unit in kept):
            raise LogError(_missing(joint, "test" if part == TEST else "fit", test_group))
    of = [forms[unit.run] for unit in kept]
    measured = [np.stack([form.torque[rows], form.angle[rows]], axis=1) for form, rows in zip(of, at, strict=True)]
    table = np.concatenate(measured)
    seen_rows = np.repeat([unit.part != TEST for unit in kept], np.diff(starts))
    noise = math.hypot(
        _noise(fitted, joint),
        max(one[0] for one in believed) * max(_noise_of_motion(*piece, joint) for piece in fitted),
        calibrated * float(np.sqrt(np.mean(table[seen_rows, 0] ** 2))),
    )
    blocks, count = [], 0
    for form, rows in zip(of, at, strict=True):
        number = ((form.time[rows] - form.time[rows[0]]) / WEAK_FORM_BLOCK).astype(int)
        blocks.append(number + count)
        count += int(number[-1]) + 1
    return TorqueProblem(
        units=tuple(kept),
        time=np.concatenate([form.time[rows] for form, rows in zip(of, at, strict=True)]),
        starts=np.array(starts),
        measured=table,
        weight=np.array([1.0 / max(noise, 1e-9), 0.0]),
        judged=np.ones(len(table), bool),
        models=models,
        step=GRID_STEP,
        params=tuple(params),
        forms=forms,
        at=np.concatenate(at),
        block=np.concatenate(blocks),
        side=side,
        side_reason=reason,
        sides_differ=reason == "said" or any(_inside(chain) for chain in chains),
        shift=shift,
        reach=min(reach, SHIFT_REACHES[-1]),
    )


def _bench(run: MeasuredRun, joint: str) -> dict[str, float]:
    if run.robot != "bench":
        raise LogError(
            f"{run.name}: joint '{joint}' of {run.robot} was driven by torque; what it works against is known for a "
            "bench only."
        )
    return bench_parameters(run.robot_params, run.name)


def _chain(run: MeasuredRun, joint: str) -> Chain | None:
    """The chain that a sidecar names; without one, nothing is believed of friction and armature."""
    return load_chain(run.actuators[joint]) if joint in run.actuators else None


def _inside(chain: Chain | None) -> bool:
    """Whether a chain has anything that a torque behind it lacks."""
    friction = chain.find("friction") if chain else None
    return chain is not None and (chain.armature() > 0.0 or (friction is not None and friction != friction.neutral()))


def _span(run: MeasuredRun, unit: Unit) -> tuple[float, float]:
    """Times since the start of the run between which a unit is judged [s]."""
    time = run.time - run.time[0]
    return float(time[unit.start + unit.judged]), float(time[unit.stop - 1]) + GRID_STEP


def _missing(joint: str, use: str, group: str | None) -> str:
    held = f" with the group '{group}' held out" if group else ""
    return f"joint '{joint}': no torque is left to {use} on{held}; record more runs or longer ones."


def _side(
    runs: Sequence[MeasuredRun],
    joint: str,
    chains: Sequence[Chain | None],
    params: Sequence[Mapping[str, float]],
    balance: TorqueBalance,
    numbers: Sequence[int],
    shift: Shift,
) -> tuple[TorqueSide, Reason]:
    """What the torque column is of, by what was said of it or by its own shape, and why."""
    said = said_side([runs[k] for k in numbers], joint)
    believed = np.zeros((len(numbers), 4))  # inertia of the load, armature, coulomb, viscous
    for row, k in zip(believed, numbers, strict=True):
        row[0], chain = PendulumLoad().inertia(params[k]), chains[k]
        if chain is not None:
            friction = chain.find("friction")
            row[1], row[2:] = chain.armature(), (friction.coulomb, friction.viscous) if friction else 0.0
    load, armature, coulomb, viscous = believed[balance.run].T
    turning = balance.terms[:, 0] / np.maximum(load + armature, 1e-12)
    inside = (turning * armature, balance.terms[:, 2] * coulomb + balance.terms[:, 3] * viscous)
    if said:
        return said, "said"
    table = np.column_stack([turning * load, balance.terms[:, 1]])
    shown = side_by_load(balance.torques[:, shift.index], table, *inside, balance.block)
    return (shown, "shown") if shown else ("shaft", "assumed")


def _noise(pieces: Sequence[tuple[MeasuredRun, slice]], joint: str) -> float:
    """Noise of the torque column after averaging [N.m]: that of its samples over the root of how many are averaged.

    Dry friction makes the torque jump wherever the joint turns around.
    """
    values = []
    for run, part in pieces:
        time, torque = run.time[part], run.joints[joint].torque
        if torque is not None and (good := np.isfinite(torque[part])).any():
            noise = sample_noise(time[good], torque[part][good], jumps=True)
            values.append(noise / np.sqrt(max(WEAK_FORM_WINDOW / run.period / 2.0, 1.0)))
    return float(np.median(values)) if values else 0.0


def _noise_of_motion(run: MeasuredRun, part: slice, joint: str) -> float:
    """Noise of the averaged acceleration [rad/s2]."""
    return acceleration_noise(sample_noise(run.time[part], run.joints[joint].position[part]), run.period)
