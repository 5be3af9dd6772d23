"""A hopper's log laid out for a search of its ground: stances, from the flight before each."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial

import mujoco
import numpy as np
from mujoco.batch import Batch

from ...actuators import Chain, load_chain
from ...actuators.gravity import GRAVITY
from ...common.errors import SealegsError
from ...envs.engine.scene import FLOOR
from ...envs.hopper.robot import HIP, KNEE
from ..causes.cause import Cause
from ..checks.signal import derivatives
from ..log.finding import Finding
from ..log.parts import SPEED_REACH, held_out
from ..log.progress import Progress
from ..log.types import LogError, MeasuredRun
from ..replay.parameters import Parameter, factor
from .leg_model import GROUND_BODY, GROUND_JOINT, LegModel
from .pieces import (
    ENGINE_STEP,
    PIECE_SECONDS,
    UNKNOWN_SPEED,
    WITHOUT_END,
    Piece,
    Replayer,
    polynomial,
    sample_error,
    thinned,
)
from .problem import (
    CONTACT_TIME_FACTOR,
    MIN_PIECES,
    GroundProblem,
    Judged,
    Laid,
    ground_causes,
    ground_problem,
    too_few,
)

COLUMNS = ("base.z", "base.x", "hip.link_position", "knee.link_position")
"""What is judged, the height of the hip first."""
UNITS = ("m", "m", "rad", "rad")
FLIGHT_SECONDS = 2.0 * SPEED_REACH  # [s] from the start of a piece to its touchdown: its state is read in flight
LINK_FIT = 0.013  # [s] to both sides of the start, from which the state of a joint is fitted: it moves fast
MIN_FLIGHT_SECONDS = 0.08  # [s] shortest flight after which a stance counts
FREE_FALL = 0.6  # of gravity: downward acceleration of the centre of mass from which the leg counts as flying
UNJUDGED_SECONDS = LINK_FIT  # [s] of a piece that is not judged: the start state was fitted to it
MODEL_ERRORS = (1.5e-4, 2e-4, 1e-3, 1e-3)
"""What two right models of hard contact differ by over a stance, in the judged columns [m, m, rad, rad]: assumed, from
replays of an independent leg on rigid ground. Errors this small say nothing about the ground."""
MAX_STANCES = 48  # stances of a data set; more cost time and teach little


def columns(run: MeasuredRun) -> np.ndarray:
    """The judged columns of a run (n, 4), NaN where one was not logged."""
    missing = np.full(len(run.time), np.nan)
    links = [run.joints[name].link_position for name in ("hip", "knee")]
    links = [
        run.joints[name].position if link is None else link for name, link in zip(("hip", "knee"), links, strict=True)
    ]
    return np.stack([run.base.get("z", missing), run.base.get("x", missing), *links], axis=1)


def column_noise(runs: Sequence[MeasuredRun]) -> np.ndarray:
    """Rms error of a sample of each judged column (4,), NaN where it was not logged."""
    rows = []
    for run in runs:
        values = columns(run)
        rows.append([sample_error(run.time, values[:, c]) for c in range(len(COLUMNS))])
    return np.median(np.array(rows), axis=0)


def touchdowns(run: MeasuredRun, leg: LegModel) -> np.ndarray:
    """Times at which a flight ends [s], from the acceleration of the centre of mass."""
    values = columns(run)
    height = values[:, 0] + leg.mass_centre(values[:, 2], values[:, 3])
    good = np.isfinite(height)
    _, _, acceleration = derivatives(run.time, np.interp(run.time, run.time[good], height[good]))
    flying = np.concatenate([[False], acceleration < -FREE_FALL * GRAVITY, [False]]).astype(int)
    edges = np.diff(flying)
    up, down = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    long = run.time[down] - run.time[up] > MIN_FLIGHT_SECONDS
    return run.time[down[long]]


def find_stances(runs: Sequence[MeasuredRun], leg: LegModel, noise: np.ndarray) -> list[Piece]:
    """The stances of all runs, thinned evenly to :data:`MAX_STANCES`."""
    found = []
    for k, run in enumerate(runs):
        values = columns(run)
        for touchdown in touchdowns(run, leg):
            start = int(np.searchsorted(run.time, touchdown - FLIGHT_SECONDS))
            stop = int(np.searchsorted(run.time, run.time[start] + PIECE_SECONDS))
            if start < 1 or stop >= len(run.time):
                continue
            if (stance := _stance(run, leg, values, k, start, stop, noise)) is not None:
                found.append(stance)
    return thinned(found, MAX_STANCES)


def _stance(
    run: MeasuredRun, leg: LegModel, values: np.ndarray, k: int, start: int, stop: int, noise: np.ndarray
) -> Piece | None:
    """A piece with its start state: links from parabolas, the base from a centre of mass that falls freely."""
    state, spread = np.zeros(8), np.zeros(8)
    time = run.time - run.time[start]
    for c in (2, 3):
        near = np.flatnonzero((np.abs(time) <= LINK_FIT) & np.isfinite(values[:, c]))
        if len(near) < 5:
            return None
        state[[c, c + 4]], spread[[c, c + 4]] = polynomial(time[near], values[near, c], 2, noise[c])
    over = np.stack([leg.mass_centre(values[:, 2], values[:, 3]), leg.mass_centre_ahead(values[:, 2], values[:, 3])])
    if not np.isfinite(over[:, start]).all():
        return None
    slope = np.stack([leg.mass_centre_ahead(*state[2:4], split=True), -leg.mass_centre(*state[2:4], split=True)])
    for c, fall in ((0, -0.5 * GRAVITY * time**2), (1, 0.0 * time)):
        near = np.flatnonzero((np.abs(time) <= SPEED_REACH) & np.isfinite(values[:, c] + over[c]))
        if len(near) < 5:
            if c == 0:
                return None
            spread[c + 4] = UNKNOWN_SPEED  # where x is does not matter on a ground that is alike everywhere
            continue
        centre = values[near, c] + over[c, near] - fall[near]
        (height, rise), (own, moving) = polynomial(time[near], centre, 1, noise[c])
        state[c], state[c + 4] = height - over[c, start], rise - float(slope[c] @ state[6:8])
        spread[c], spread[c + 4] = own, float(np.hypot(moving, np.linalg.norm(slope[c] * spread[6:8])))
    return Piece(k, start, stop, state, spread)


JOINTS = (HIP, KNEE)


class LegReplay(Replayer[LegModel]):
    """The engine with a leg in it; ``goal`` are those of its motors at every step (steps + 1, stances, 2) [rad].

    The motors follow their measured motion and push the leg through its springs, so what is judged is body and ground;
    a joint without a spring between motor and link is driven by its commands.
    """

    def __init__(self, leg: LegModel, runs: Sequence[MeasuredRun], stances: Sequence[Piece]) -> None:
        """Build the leg; ``leg`` gives body and chains, the ground may differ from replay to replay."""
        super().__init__(leg, runs, stances)
        model = self.model
        for name in JOINTS:  # a motor so heavy that only the force which makes it follow its path can move it
            if _has_motor(model, name):
                motor = int(model.joint(f"{name}_motor").dofadr[0])
                model.dof_armature[motor] = WITHOUT_END
                model.dof_frictionloss[motor] = model.dof_damping[motor] = 0.0
        mujoco.mj_setConst(model, mujoco.MjData(model))
        self.drivetrain.set_teeth()  # they are told per inertia
        self.follows = [model.joint(f"{name}_motor").id if _has_motor(model, name) else -1 for name in JOINTS]
        shape = (self.steps + 1, len(self.pieces), len(JOINTS))
        position, self.goal = np.empty(shape), np.empty(shape)
        ticks = np.arange(self.steps + 1) * ENGINE_STEP
        for k, stance in enumerate(self.pieces):
            run = runs[stance.run]
            at = run.time[stance.start] + ticks
            held = np.clip(np.searchsorted(run.time, at + 1e-9, side="right") - 1, 0, len(run.time) - 1)
            for j, name in enumerate(JOINTS):
                log = run.joints[name]
                position[:, k, j] = np.interp(at, run.time, log.position)
                self.goal[:, k, j] = position[:, k, j] if log.goal is None else log.goal[held]
        self._follow(position)

    def _run(self, models: Sequence[LegModel], ground: np.ndarray, piece: np.ndarray, states: np.ndarray) -> np.ndarray:
        n, model = len(ground), self.model
        batch = self._begun(n)
        self._lay_ground(batch, models, ground)
        batch.set_const(np.arange(n))  # inertias follow from the ground's mass
        # which is to make no contact softer
        batch.expand("body_invweight0")[:n, model.body(GROUND_BODY).id] = 0.0
        qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
        x, z, hip, knee = (int(model.joint(name).qposadr[0]) for name in ("base_x", "base_z", HIP, KNEE))
        order = [z, x, hip, knee]  # every joint has one degree of freedom: qpos and qvel agree in order
        leg = states.copy()
        leg[:, 3] -= leg[:, 2]  # the knee joint turns relative to the upper link
        leg[:, 7] -= leg[:, 6]
        # the engine moves with the speed at the end of a step: half a step makes free fall exact
        leg[:, 4] += 0.5 * GRAVITY * ENGINE_STEP
        qpos[:n, order], qvel[:n, order] = leg[:, :4], leg[:, 4:]
        control = np.zeros((n, self.steps, model.nu + model.nv))
        for j, name in enumerate(JOINTS):
            control[:, :, self.drivetrain.actuator_ids[name]] = self.goal[:-1, piece, j].T
            if (number := self.follows[j]) >= 0:
                motor = int(model.jnt_dofadr[number])
                qpos[:n, motor], qvel[:n, motor] = self.position[0, piece, j], self.speed[0, piece, j]
                control[:, :, model.nu + motor] = WITHOUT_END * self.acceleration[:, piece, j].T
        recorded = np.empty((self.steps + 1, n, 4))
        recorded[0] = leg[:, :4]
        spec = int(mujoco.mjtState.mjSTATE_CTRL) | int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
        path = batch.rollout(self.steps, control, spec, ("qpos",), np.arange(n))["qpos"]
        recorded[1:] = path[:, :, order].transpose(1, 0, 2)
        recorded[:, :, 3] += recorded[:, :, 2]
        return recorded

    def _lay_ground(self, batch: Batch, legs: Sequence[LegModel], ground: np.ndarray) -> None:
        n, floor, body = len(ground), self.model.geom(FLOOR).id, self.model.body(GROUND_BODY).id
        joint = self.model.joint(GROUND_JOINT)
        value = {path: np.array([leg.value(path) for leg in legs])[ground] for path in legs[0].ground}
        batch.expand("geom_friction")[:n, floor, 0] = value["contact.friction"]
        batch.expand("geom_solref")[:n, floor, 0] = value["contact.time"]
        half = -0.5 * value["contact.slope"]
        quaternion = batch.expand("body_quat")
        quaternion[:n, body, 0], quaternion[:n, body, 2] = np.cos(half), np.sin(half)
        batch.expand("body_pos")[:n, body, 2] = value["contact.height"]
        stiffness, damping, mass = np.array([leg.compliance() for leg in legs])[ground].T
        batch.expand("jnt_stiffness")[:n, joint.id] = stiffness
        batch.expand("dof_damping")[:n, joint.dofadr[0]] = damping
        batch.expand("body_mass")[:n, body] = mass


def _has_motor(model: mujoco.MjModel, name: str) -> bool:
    return any(model.joint(k).name == f"{name}_motor" for k in range(model.njnt))


def lay_leg(
    runs: Sequence[MeasuredRun], chains: Mapping[str, Chain], progress: Progress, test_group: str | None = None
) -> Laid | str:
    """The stances of a hopper; a sentence where the log has none to judge.

    Args:
        runs: of one machine.
        chains: of the joints that were diagnosed, as found.
        progress: is told what goes on.
        test_group: group of runs that no fit and no choice may see.

    Raises:
        SealegsError: the sidecar's numbers are none of the robot's, or the test group does not exist.
    """
    held = held_out(runs, test_group)
    absent = [name for name in JOINTS if any(name not in run.joints or name not in run.actuators for run in runs)]
    if absent:
        return f"{' and '.join(absent)} of the leg was not logged; record all of its joints."
    if not all(np.isfinite(run.base.get("z", np.nan)).any() for run in runs):
        return "the height of the base was not logged; record it as base.z (a boom encoder or a camera)."
    try:
        leg = LegModel.of(
            runs[0].robot_params, {name: chains.get(name) or load_chain(runs[0].actuators[name]) for name in JOINTS}
        )
    except SealegsError as error:
        raise LogError(f"{runs[0].name}: {error}") from None
    hidden = [
        name for name in JOINTS if leg.chains[name].gives() and any(r.joints[name].link_position is None for r in runs)
    ]
    if hidden:
        wanted = " and ".join(f"{name}.link_position" for name in hidden)
        return f"the links behind the springs were not logged; record {wanted}."
    progress("looking for stances")
    noise = column_noise(runs)
    stances = find_stances(runs, leg, noise)
    if len(stances) < MIN_PIECES:
        return (
            f"the leg left the ground {len(stances)} times for long enough, and {MIN_PIECES} stances are needed; "
            "let it hop for longer."
        )
    tested = sum(stance.run in held for stance in stances)
    if (why := too_few(len(stances), tested, bool(held), test_group, "stances")) is not None:
        return why
    return Laid(
        problem=leg_problem(runs, leg, stances, noise, test_group),
        causes=partial(contact_causes, leg),
        tuned=tuple(ground_numbers(leg)),
        pieces="stances",
        advice="the foot stays far from its limits. Hop higher, or push harder forward and back.",
        findings=() if np.isfinite(noise[1]) else (_unlogged(),),
        needs_joints=True,
    )


def leg_problem(
    runs: Sequence[MeasuredRun],
    leg: LegModel,
    stances: Sequence[Piece],
    noise: np.ndarray,
    test_group: str | None = None,
) -> GroundProblem:
    """Stances of a hopper as a problem, with the rms error of a sample of each judged column (4,)."""
    judged = Judged(COLUMNS, UNITS, np.array(MODEL_ERRORS), noise, UNJUDGED_SECONDS)
    replay = LegReplay(leg, runs, stances)
    return ground_problem(runs, leg, replay, judged, [columns(run) for run in runs], test_group)


def _unlogged() -> Finding:
    return Finding(
        "contact.columns", "note", "ground", "base.x",
        "base.x was not logged: friction and slope show through the links alone, and are less certain.",
    )  # fmt: skip


# --- contact causes, and numbers of the ground that nobody knows exactly ---------------------------------------------


HEIGHT_ZERO_TOLERANCE = 3e-3  # [m] how well the zero of the height is known
SHORTEST_TIME_CONSTANT = 2.0 * ENGINE_STEP  # [s] the engine takes no shorter time constant for a step
HARD_STIFFNESS = 2e4  # [N/m] below which that contact is not made by tuning: it would do a soft ground's work unnamed
SHOWN_IN = {"contact.friction": "base.x", "contact.stiffness": "base.z", "contact.slope": "base.x"}
STIFFNESS_STARTS, SOFT_STIFFNESS = (1500.0, 5000.0), 4000.0  # [N/m]


def contact_causes(nominal: LegModel, names: Sequence[str] | None = None) -> list[Cause]:
    """The catalogue of the ground under a leg.

    Args:
        nominal: the leg on the ground that is believed in.
        names: of the causes to consider; default: all of them.
    """
    return ground_causes(STIFFNESS_STARTS, nominal.softest_rigid(), SOFT_STIFFNESS, SHOWN_IN, names=names)


def ground_numbers(nominal: LegModel) -> list[Parameter]:
    """What every fit tunes: no finding, as long as it stays within these bounds."""
    shortest = SHORTEST_TIME_CONSTANT / nominal.value("contact.time")
    longest = min(max(math.sqrt(nominal.engine_stiffness() / HARD_STIFFNESS), 1.0), CONTACT_TIME_FACTOR)
    return [
        factor("contact.time", min(max(1.0 / CONTACT_TIME_FACTOR, shortest), 1.0), longest, 0.2),
        Parameter("contact.height", "m", -HEIGHT_ZERO_TOLERANCE, HEIGHT_ZERO_TOLERANCE, 0.0, 5e-4),
    ]
