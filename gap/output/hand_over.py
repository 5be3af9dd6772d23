"""What of a diagnosis a robot takes: all of it, unless it then misses its own log by more than as it was believed.

Each joint is judged alone, with its neighbours moving as measured, and what was tuned beside a cause is its own best
guess. Of bodies that other joints carry as well, such guesses may contradict each other; only the whole robot tells.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...actuators import Chain, load_chain
from ...actuators.layout import P_STATE_SIZE
from ...common.errors import SealegsError
from ...envs.described.as_robot import as_robot
from ...envs.extended import Draws, Extended
from ...envs.robots import get_robot
from ..checks.signal import Z95
from ..load.robot import LoggedRobot, Machine
from ..log.parts import FIT_A, FIT_B
from ..log.progress import Progress
from ..log.types import MeasuredRun, MeasuredSet
from ..measure.case import ROBOT
from ..measure.named import CERTAIN, LIKELY, NamedCause
from ..prepare.checking import check_log
from ..prepare.resting import without_rests
from ..replay.engine import Whole, replay_whole, whole, why_not_whole
from ..replay.parameters import Parameter, Target, address, numbers
from ..robot.encoders import ENCODERS
from ..search.fit import Fit, merge
from ..search.intervals import intervals, linearised
from ..search.structure import told_in
from ..verdict.verdict import JointDiagnosis
from .extension import Taken, as_taken, believed_still, extended_of

NARROWER: tuple[Taken, ...] = ("own", "named")
KEPT = "Encoders whose error is doubted stay as believed in the model that is handed over"
HARM_RATIO = 1.1  # times its error as believed, beyond its noise, from which a joint counts as harmed
LEFT = {
    "own": "Numbers of bodies that were only tuned stay as the robot's file has them",
    "named": "Joints without a named cause, and numbers of bodies that were only tuned, stay as they were believed",
}
TOLD_MASS_CHANGE = 0.02  # relative change of a mass, or one in its unit, from which it is told
UNITS = {"payload": "kg"}
UNSEEN = f"{LEFT['own']}: no simulation of the whole robot could show that they do no harm."
"""Said where a robot cannot be simulated along its log."""


def hand_over(
    diagnoses: Sequence[JointDiagnosis], recorded: MeasuredSet, progress: Progress = lambda text: None
) -> tuple[Extended | None, dict[str, Any] | None]:
    """The machine as diagnosed, and how the whole robot follows its log with it.

    Args:
        diagnoses: of the machine.
        recorded: the data as they were logged.
        progress: is told what goes on.

    Returns:
        The model, with machines as it may be (:func:`with_draws`); of a robot with a file also what
        :func:`confirm_whole` found of it, with ``taken``, the sentence ``left`` where not all is taken, ``harm`` where
        it still misses its log by more, and ``bodies`` where it changes any.
    """
    diagnoses, kept = [without_doubted_encoders(one) for one in diagnoses], kept_of(diagnoses)
    extended, confirmed = _taken(diagnoses, recorded, progress)
    if kept:
        confirmed = dict(confirmed or {})
        confirmed["left"] = " ".join(filter(None, (kept, confirmed.get("left"))))
    if extended is None:
        return None, confirmed
    progress("drawing machines as it may be")
    taken = "all" if confirmed is None else confirmed.get("taken", "all")
    extended = with_draws(extended, diagnoses, as_taken(recorded, diagnoses), taken)
    if confirmed is None or not (said := bodies_of(extended)):
        return extended, confirmed
    return extended, confirmed | {"bodies": said}


def doubted_encoders(diagnosis: JointDiagnosis) -> dict[str, NamedCause]:
    """Numbers of the encoder, by path, whose cause is no more likely than not.

    A log tells an encoder that reads too little from a joint that moves too little by their traces alone. Where it can
    not, a policy that believes the encoder's error would bring the link elsewhere; one that does not loses nothing that
    it has today.
    """
    if diagnosis.search is None:
        return {}
    doubted = {cause.name: cause for cause in diagnosis.causes if cause.standing not in (CERTAIN, LIKELY)}
    return {
        p.path: doubted[found.cause.name]
        for found in diagnosis.search.accepted
        if found.cause.name in ENCODERS and found.cause.name in doubted
        for p in found.variant
        if address(p.path).target is Target.STAGE and p.path in diagnosis.values
    }


def without_doubted_encoders(diagnosis: JointDiagnosis) -> JointDiagnosis:
    """The diagnosis as its model is handed over: with encoders as believed where their error is doubted."""
    doubted = doubted_encoders(diagnosis)
    if not doubted:
        return diagnosis
    return diagnosis.changed(values={path: value for path, value in diagnosis.values.items() if path not in doubted})


def kept_of(diagnoses: Sequence[JointDiagnosis]) -> str:
    """What is not handed over of encoders, in a sentence; empty for nothing."""
    rows = [
        f"{cause.name} of '{one.joint}' (confidence {cause.confidence:.0%})"
        for one in diagnoses
        for cause in one.causes
        if cause in doubted_encoders(one).values()
    ]
    return f"{KEPT}: {', '.join(rows)}." if rows else ""


def bodies_of(extended: Extended) -> str:
    """What a model changes of bodies, in a sentence; empty for nothing."""
    rows = []
    for change in extended.changes:
        _, _, key = change.path.partition("body.")
        if not key or abs(change.after - change.before) <= TOLD_MASS_CHANGE * max(abs(change.before), TOLD_MASS_CHANGE):
            continue
        value = f"x {change.after:.3g}" if key.endswith("factor") else f"{change.after:+.3g} {UNITS.get(key, 'm')}"
        rows.append(
            f"{change.joint} {key.replace('_factor', '').replace('_', ' ')} {value} ({change.cause or 'tuned'})"
        )
    return f"Bodies as handed over: {', '.join(dict.fromkeys(rows))}." if rows else ""


def _taken(
    diagnoses: Sequence[JointDiagnosis], recorded: MeasuredSet, progress: Progress
) -> tuple[Extended | None, dict[str, Any] | None]:
    data = as_taken(recorded, diagnoses)
    extended = extended_of(diagnoses, data)
    confirmed = None if extended is None else confirm_whole(diagnoses, recorded, extended, progress)
    if extended is None or confirmed is None:
        return extended, confirmed
    floors = {item.joint: item.gap["noise_floor"].rmse for item in diagnoses if "noise_floor" in item.gap}
    if "joints" not in confirmed:
        narrower = extended_of(diagnoses, data, "own")
        if narrower is None or narrower.changes == extended.changes:
            return extended, confirmed
        return narrower, confirmed | {"taken": "own", "left": UNSEEN}
    nominal = {name: {"nominal": item["nominal"]} for name, item in confirmed["joints"].items()}
    tried: dict[Taken, tuple[Extended, dict[str, Any]]] = {"all": (extended, confirmed)}
    for taken in NARROWER:
        last, of_last = next(reversed(tried.values()))
        if not harmed(of_last["joints"], floors):
            break
        narrower = extended_of(diagnoses, data, taken)
        if narrower is None or narrower.to_dict() == last.to_dict():
            continue
        found = confirm_whole(diagnoses, recorded, narrower, progress, taken, ("extended",))
        if found is None or "joints" not in found:
            break
        joints = {name: nominal[name] | item for name, item in found["joints"].items()}
        tried[taken] = narrower, found | {"joints": joints}
    best = min(
        tried, key=lambda taken: (bool(harmed(tried[taken][1]["joints"], floors)), _missed(tried[taken], floors))
    )
    extended, found = tried[best]
    said = found | {"taken": best}
    if best != "all":
        rows = _worse(confirmed["joints"], floors)
        said["left"] = f"{LEFT[best]}. As tuned, the whole robot misses its log by more: {rows}."
    if harmed(found["joints"], floors):
        rows = _worse(found["joints"], floors)
        said["harm"] = f"With what was found, the whole robot misses its log by more than as believed: {rows}."
    return extended, said


def harmed(joints: Mapping[str, Mapping[str, Any]], floors: Mapping[str, float]) -> list[str]:
    """Joints that the extended robot misses by more than the nominal one.

    Args:
        joints: errors of both by joint.
        floors: noise of joints, where it is known.
    """
    return [
        name
        for name, item in joints.items()
        if item["extended"] > HARM_RATIO * item["nominal"]
        and item["extended"] - item["nominal"] > floors.get(name, 0.0)
    ]


def _missed(tried: tuple[Extended, dict[str, Any]], floors: Mapping[str, float]) -> float:
    """How much more a robot misses its log by than as believed, over all joints, in logarithms."""
    joints = tried[1]["joints"]
    least = {name: max(floors.get(name, 0.0), 1e-12) for name in joints}
    return sum(
        math.log(max(item["extended"], least[name]) / max(item["nominal"], least[name]))
        for name, item in joints.items()
    )


def _worse(joints: Mapping[str, Mapping[str, Any]], floors: Mapping[str, float]) -> str:
    """Which joints the whole robot misses by more, in words."""
    rows = []
    for name in harmed(joints, floors):
        factor, unit = told_in(joints[name]["unit"])
        before, after = (f"{factor * joints[name][model]:.3g}" for model in ("nominal", "extended"))
        rows.append(f"'{name}' by {after} {unit} ({before} as believed)")
    return ", ".join(rows)


# --- machines as they may be, for training on all of them ------------------------------------------------------------

DRAWN_MACHINES = 32
BUILD_TRIES = 8  # of a machine that cannot be built, or whose chain has another law


@dataclass(frozen=True, eq=False)
class Spread:
    """How well the numbers of a joint are known, in the coordinates of its fit.

    Attributes:
        parameters: that were fitted.
        centre: where they are (p,).
        sizes: standard deviations (p,).
        root: of their correlation: root times its transpose (p, p).
    """

    parameters: tuple[Parameter, ...]
    centre: np.ndarray
    sizes: np.ndarray
    root: np.ndarray

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Values by path, within the bounds of each."""
        u = self.centre + self.sizes * (self.root @ rng.standard_normal(len(self.centre)))
        return {p.path: p.from_fit(x) for p, x in zip(self.parameters, u, strict=True)}


def spread_of(diagnosis: JointDiagnosis, seed: int = 0) -> Spread | None:
    """How well the numbers of a joint's model are known; None where it is as believed."""
    replay, search = diagnosis.case.replay, diagnosis.search
    if replay is None or search is None:
        return None
    wide = replay.wide if diagnosis.model == "refitted" else ()
    known = {p.path: p for p in merge(search.parameters(), wide)}
    parameters = [known[path] for path in diagnosis.values if path in known]
    if not parameters:
        return None
    fitted = replay.fitting.part(FIT_A, FIT_B)
    values = {p.path: min(max(diagnosis.values[p.path], p.low), p.high) for p in parameters}
    found = Fit(values, fitted.simulate([values])[0], 0.0)
    halves = search.fits if diagnosis.model == "extended" else ()
    ends = intervals(fitted, parameters, found, seed, halves)
    centre = np.array([p.to_fit(values[p.path]) for p in parameters])
    half = [0.5 * (p.to_fit(ends[p.path][1]) - p.to_fit(ends[p.path][0])) for p in parameters]
    correlation = linearised(fitted, parameters, found).correlation()
    sizes, vectors = np.linalg.eigh(correlation)
    root = vectors * np.sqrt(np.maximum(sizes, 0.0))
    return Spread(tuple(parameters), centre, np.array(half) / Z95, root)


def with_draws(
    extended: Extended, diagnoses: Sequence[JointDiagnosis], data: MeasuredSet, taken: Taken, seed: int = 0
) -> Extended:
    """The model that is handed over, with machines as it may be.

    Each draw is one machine. Numbers of a joint are drawn together, with the correlation of its fit, as wide as their
    95 % intervals. What joints share (bodies, a payload, the latency of the bus) is drawn once for all of them.

    Args:
        extended: the model.
        diagnoses, data, taken: what it is of, as of :func:`.extension.extended_of`.
        seed: of the draws.
    """
    spreads = {one.joint: spread_of(one, seed) for one in diagnoses}
    rng = np.random.default_rng(seed)
    machines: list[dict[tuple[str, ...], float]] = []
    for _ in range(DRAWN_MACHINES):
        for _ in range(BUILD_TRIES):
            drawn = extended_of(_drawn(diagnoses, spreads, rng), data, taken)
            if drawn is not None and _like(drawn, extended):
                machines.append(drawn.numbers())
                break
    return dataclasses.replace(extended, draws=_varying(extended.numbers(), machines))


def _drawn(
    diagnoses: Sequence[JointDiagnosis], spreads: Mapping[str, Spread | None], rng: np.random.Generator
) -> list[JointDiagnosis]:
    """The diagnoses of a machine that may be the one that was measured."""
    shared = {  # of all chains, such as the latency
        number: rng.normal() * 0.5 * (value.high - value.low) / Z95
        for one in diagnoses
        if one.joint == ROBOT
        for cause in one.causes
        for number, value in cause.parameters.items()
    }
    found = []
    for one in diagnoses:
        spread = spreads[one.joint]
        if spread is None:
            found.append(one)
            continue
        values = dict(one.values) | spread.draw(rng)
        path_of, nominal = numbers(values), None if one.problem is None else one.problem.models[0]
        for number in one.shared:
            path = path_of.get(number)
            if path is None or nominal is None or number not in shared:
                continue
            unit = nominal.value(number) if path != number else 1.0
            low = min(1e-9, one.values[path])
            values[path] = max(one.values[path] + shared[number] / unit, low)
        found.append(one.changed(values=values))
    return found


def _like(drawn: Extended, extended: Extended) -> bool:
    """Whether a drawn machine has the laws of the model, and can be: a body with a negative inertia is none."""
    if drawn.numbers().keys() != extended.numbers().keys():
        return False
    for joint, variants in extended.chains.items():
        for one, other in zip(variants, drawn.chains[joint], strict=True):
            if _law(one.chain) != _law(other.chain):
                return False
    if not any(change.owner == "robot" for change in extended.changes):
        return True
    try:
        robot = get_robot(drawn.robot)
        drawn_on = drawn.chains_on(robot), drawn.params_on(robot, told=False)
    except SealegsError:
        return True  # the model itself is refused there, with a sentence
    try:
        robot.drivetrain(*drawn_on)
    except (SealegsError, ValueError):
        return False
    return True


def _law(chain: Chain) -> tuple[bool, int, int]:
    program = chain.program()
    return chain.friction_needs_law(), len(program), int(program[P_STATE_SIZE])


def _varying(model: Mapping[tuple[str, ...], float], machines: Sequence[Mapping[tuple[str, ...], float]]) -> Draws:
    varying = [key for key, value in model.items() if any(one[key] != value for one in machines)]
    return Draws(tuple(varying), tuple(tuple(one[key] for key in varying) for one in machines))


# --- the extended model as a whole robot: all joints together in the engine along the log, beside the nominal one ----

MODELS = ("nominal", "extended")


def confirm_whole(
    diagnoses: Sequence[JointDiagnosis],
    data: MeasuredSet,
    extended: Extended,
    progress: Progress = lambda text: None,
    taken: Taken = "all",
    models: Sequence[str] = MODELS,
) -> dict[str, Any] | None:
    """Error of each joint when the whole robot is simulated along the log.

    Args:
        diagnoses, data: of the robot.
        extended: its model.
        progress: is told what goes on.
        taken: what ``extended`` takes of the diagnoses.
        models: that are simulated.

    Returns:
        By joint the root mean square of the error of each model, in the unit of the joint; a ``reason`` where the robot
        cannot be simulated so; None where the log is of no robot with a file.
    """
    if Machine.of(data.runs).robot is None:
        return None
    data, *_ = check_log(data, lambda text: None)  # in the model's units, and mended as where it was judged
    machine, _ = without_rests(Machine.of(as_taken(data, diagnoses).runs))
    data, robot = replace(data, runs=machine.runs), machine.robot
    if robot is None:
        return None
    if (why := why_not_whole(robot, data.runs)) is not None:
        return {"reason": f"The robot was not simulated as a whole: {why}."}
    progress("simulating the whole robot along the log")
    found = {diagnosis.joint: diagnosis for diagnosis in diagnoses if diagnosis.joint != ROBOT}
    still = [name for name, diagnosis in found.items() if believed_still(diagnosis, taken)]
    squares: dict[str, dict[str, list[np.ndarray]]] = {name: {model: [] for model in models} for name in found}
    machines: dict[str, Whole] = {}
    try:
        numbers = {"nominal": dict(extended.params or {}), "extended": extended.params_on(as_robot(robot.file))}
        for index, run in enumerate(data.runs):
            for model in models:
                as_found = {name: d for name, d in found.items() if model == "extended" and name not in still}
                chains = {name: _chain(robot, run, name, found.get(name), index, name in as_found) for name in found}
                key = model + "".join(chain.to_yaml() for chain in chains.values())
                if key not in machines:
                    machines[key] = whole(robot, chains, numbers[model])
                for name, error in _errors(machines[key], run, index, list(found), as_found).items():
                    squares[name][model].append(error**2)
    except SealegsError as error:
        return {"reason": f"The robot was not simulated as a whole: {error}"}
    joints = {
        name: {model: float(np.sqrt(np.mean(np.concatenate(parts)))) for model, parts in of.items()}
        | {"unit": robot.joint(name).unit}
        for name, of in squares.items()
    }
    return {"runs": [run.name for run in data.runs], "joints": joints}


def _chain(
    robot: LoggedRobot, run: MeasuredRun, name: str, found: JointDiagnosis | None, index: int, as_found: bool
) -> Chain:
    """The chain of a joint in a run, in the frame of the robot's model."""
    if found is not None and found.problem is not None and found.problem.joint is not None:
        joint = found.problem.joint.models[index]
        chain = joint.with_fitted(found.values).chain if as_found else joint.chain
    elif name in run.actuators:
        chain = robot.joint(name).carried(load_chain(run.actuators[name]))
    else:
        return robot.joint(name).chain  # in that frame already
    return robot.frame(name).chain_to_model(chain)


def _errors(
    machine: Whole, run: MeasuredRun, index: int, names: Sequence[str], as_found: Mapping[str, JointDiagnosis]
) -> dict[str, np.ndarray]:
    """Errors of joints (n,), each reading as the host's log has it."""
    hosts = dict.fromkeys(names, (1.0, 0.0))
    for name, diagnosis in as_found.items():
        if diagnosis.problem is not None and diagnosis.problem.joint is not None:
            joint = diagnosis.problem.joint.models[index].with_fitted(diagnosis.values)
            hosts[name] = joint.host_scale, joint.host_offset
    joints = dict(run.joints)
    for name, (scale, offset) in hosts.items():
        joints[name] = replace(joints[name], position=(joints[name].position - offset) / scale)
    readings = replay_whole(machine, replace(run, joints=joints))
    errors = {}
    for name, (scale, offset) in hosts.items():
        error = scale * readings[name] + offset - run.joints[name].position
        log = run.joints[name]
        free = True if log.touched is None or log.always_touched else log.touched < 0.5
        errors[name] = error[np.isfinite(error) & free]
    return errors
