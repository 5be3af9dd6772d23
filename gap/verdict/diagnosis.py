"""The verdict: what a diagnosis says, and how it comes about from measured logs, one joint at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...actuators.chain import Chain, load_chain
from ...actuators.errors import SealegsError, nearest
from ...envs.hopper.robot import HOPPER
from ..causes.catalogue import catalogue, checked, retunable
from ..causes.visible import limits as limits_of_driven
from ..causes.visible import shown
from ..checks.data_set import check_set, corrected, merged, noise_floor, shows_little, unusable
from ..experiment import Experiment, Limits, blind_spots, experiment_for_still, propose
from ..load.unknown import unknown_parameters, with_believed_load
from ..log.finding import Finding
from ..log.parts import FIT_A, FIT_B, TEST, cut
from ..log.types import LogError, MeasuredRun, MeasuredSet
from ..replay.driven import driven_problem
from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter
from ..replay.problem import Problem, converged, lay_out
from ..replay.robust import robust_loss
from ..search.channels import weigh_channels
from ..search.fit import Fit, fit, middle
from ..search.forward import Searcher
from ..search.intervals import intervals
from ..search.result import Search
from ..search.settings import DEFAULT, SearchSettings
from ..search.structure import Structure, structure
from ..search.windows import in_windows
from .unseen_range import unseen_range
from .verdict import (
    EXPLAINED,
    NOT_IDENTIFIABLE,
    NOTHING,
    PARTLY,
    UNUSABLE,
    Error,
    JointDiagnosis,
    NamedCause,
    Value,
    data_causes,
    verdict_of,
    with_data_errors,
)

WIDE = 4.0  # how far re-tuning alone may turn each number the model has: up to five times, down to a fifth

ROBOTS = ("bench", "hopper")  # any other is taken for a machine whose load nobody knows


Progress = Callable[[str], None]


def diagnose(
    data: MeasuredSet,
    test_group: str | None = None,
    seed: int = 0,
    progress: Progress = lambda text: None,
    limits: Limits | None = None,
    causes: Sequence[str] | None = None,
    settings: SearchSettings = DEFAULT,
    look_on: bool = False,
    done: Callable[[JointDiagnosis], None] = lambda joint: None,
) -> list[JointDiagnosis]:
    """Diagnose every joint of a data set.

    Args:
        data: measured runs of one machine.
        test_group: group of runs that no fit and no choice may see.
        seed: of all resampling.
        progress: is told what goes on.
        limits: of the next experiment; default: :func:`sealegs.gap.experiment.excitations.default_limits`.
        causes: names of those of a joint to consider; default: all of the catalogue.
        settings: thresholds of the search.
        look_on: whether the search of a joint records rounds that it would skip (:mod:`sealegs.gap.search.record`).
        done: is given each joint as soon as it is diagnosed.

    Raises:
        SealegsError: the runs have no joint that can be diagnosed, or the catalogue has no such cause.
    """
    robot = data.runs[0].robot
    if robot not in ROBOTS and (hint := nearest(robot, ROBOTS)):
        raise LogError(f"{data.runs[0].name}: there is no robot '{robot}'{hint}; correct it in the sidecar.")
    checked(causes)
    progress("checking the log")
    data, every = corrected(data, [*data.findings, *check_set(data)])
    findings = merged(every)
    if (reason := unusable(every, data)) is not None:
        return [
            _unusable(
                joint, reason.sentence, findings, _first_experiment(data.runs, joint, reason, limits, seed, causes)
            )
            for joint in data.runs[0].joints
        ]
    found = []
    for joint in data.runs[0].joints:
        found.append(
            with_data_errors(
                _joint(data.runs, joint, findings, test_group, seed, progress, limits, causes, settings, look_on)
            )
        )
        done(found[-1])
    if all(run.robot == HOPPER.name for run in data.runs):
        from ..ground.ground import diagnose_ground  # here, since it concludes as joints do

        found.append(diagnose_ground(data.runs, found, seed, progress, test_group, causes))
    return found


def _joint(
    runs: Sequence[MeasuredRun],
    joint: str,
    findings: Sequence[Finding],
    test_group: str | None,
    seed: int,
    progress: Progress,
    limits: Limits | None,
    names: Sequence[str] | None,
    settings: SearchSettings,
    look_on: bool,
) -> JointDiagnosis:
    mine = tuple(f for f in findings if f.joint in (joint, None, ""))
    runs = [with_believed_load(run) for run in runs]
    if all(run.joints[joint].goal is None for run in runs):
        from .torque import diagnose_torque  # a log without commands: only its torque can be judged

        return diagnose_torque(runs, joint, mine, test_group)
    missing = [run.name for run in runs if joint not in run.actuators]
    if missing:
        raise LogError(f"{missing[0]}: the sidecar names no actuator for joint '{joint}'; add it under 'actuators'.")
    chains = [_chain(run, joint) for run in runs]
    models = [
        JointModel(chain, unknown=unknown_parameters(run, chain)) for run, chain in zip(runs, chains, strict=True)
    ]
    noise = float(np.median([noise_floor(run, joint) for run in runs]))
    units = cut(runs, joint, test_group)
    wide = retunable(models[0], WIDE)
    causes = catalogue(models[0], names)
    if all(run.robot == "bench" for run in runs):
        problem = weigh_channels(converged(lay_out(runs, joint, models, units, {"position": 1.0 / noise})))
        fitting = in_windows(problem, wide)
    else:  # what holds the link is not known: it moves as measured
        try:
            driven = driven_problem(runs, joint, models, units, noise)
        except LogError as error:
            return _unusable(joint, str(error), mine, verdict=NOT_IDENTIFIABLE)
        causes, hidden = shown(driven, models[0], causes)
        mine = (*mine, limits_of_driven(driven, joint, hidden))
        progress(f"judging the actuator of {joint} along its measured motion")
        problem = fitting = weigh_channels(converged(driven))
    search = Searcher(fitting, progress, seed, causes, settings=settings, look_on=look_on).run()
    progress("measuring the gain on runs that nothing has seen")
    still = shows_little(runs, joint)
    return conclude(problem, search, joint, mine, seed, wide, limits, fitting, still)


def _chain(run: MeasuredRun, joint: str) -> Chain:
    """The chain that a sidecar names.

    Raises:
        LogError: it cannot be had; the message names the run.
    """
    try:
        return load_chain(run.actuators[joint])
    except SealegsError as error:
        raise LogError(f"{run.name}: actuator of joint '{joint}': {error}") from None


def conclude(
    problem: Problem,
    search: Search,
    joint: str,
    findings: tuple[Finding, ...],
    seed: int,
    wide: Sequence[Parameter],
    limits: Limits | None = None,
    fitting: Problem | None = None,
    still: bool = False,
) -> JointDiagnosis:
    """What a search says: gain on the test part, causes with shares and intervals, verdict.

    Args:
        wide: what re-tuning alone may turn, and how far.
        fitting: the data as the search saw them, if not as ``problem`` has them.
        still: whether the joint hardly moves in any run: what fits that best may not be what it is.
    """
    fitting = fitting or problem
    fitted, test = fitting.part(FIT_A, FIT_B), problem.part(TEST)
    retuned = fit(fitted, wide, evaluations=25)
    last = search.accepted[-1].fits if search.accepted else search.base
    parameters = search.parameters()
    extended = fit(fitted, parameters, middle(*last), evaluations=25)
    tight = fit(fitted, search.tuned, middle(*search.base), evaluations=25) if search.accepted else extended
    models = {"nominal": {}, "retuned": retuned.values, "extended": extended.values}
    errors = {name: _error(test.position_error(test.simulate([values])[0])) for name, values in models.items()}
    noise = problem.noise
    errors["noise_floor"] = Error(noise, noise * float(np.sqrt(2.0 / np.pi)))

    simulated = {name: problem.simulate([values])[0] for name, values in models.items()}
    rest = structure(problem, simulated["extended"], seed)
    # the noise as it is, where the floor was estimated with a margin
    white = float(np.mean(problem.position_error(simulated["extended"]) ** 2)) - rest.rms**2
    white = min(white, noise**2)
    excess = max(errors["nominal"].rmse ** 2 - white, 1e-12)
    left = float(np.clip((errors["extended"].rmse ** 2 - white) / excess, 0.0, 1.0))
    # what numbers within their tolerance can do is no merit of the causes
    base = _error(test.position_error(test.simulate([tight.values])[0]))
    explained = float(np.clip((base.rmse**2 - errors["extended"].rmse ** 2) / excess, 0.0, 1.0 - left))
    causes = _name_causes(
        replace(fitting, coarse=search.settings.coarse_step), search, extended, fitted, joint, explained, rest, seed
    )
    rivals = tuple(
        {"of": named.name, "names": [named.name, *named.rivals], "confidence": named.confidence}
        for named in causes
        if named.rivals
    )
    signal, unit = problem.signal
    verdict, sentence = verdict_of(joint, causes, errors, base, left, rest, _whole_runs(problem))
    if (note := unseen_range(problem, simulated["extended"], joint)) is not None:
        findings = (*findings, note)
        sentence = f"{sentence} {note.sentence}" if verdict in (PARTLY, NOT_IDENTIFIABLE) else sentence
    poor = ""
    if still and verdict in (EXPLAINED, PARTLY):
        poor = "But the joint hardly moves, so other causes may do as well."
    elif verdict == NOTHING and all(problem.params) and (hidden := blind_spots(problem, search)):
        poor = f"But the motion is so poor that it would hardly show {', '.join(hidden)}."
    if poor:
        verdict, sentence = NOT_IDENTIFIABLE, f"{sentence} {poor}"
    undecided = verdict in (NOT_IDENTIFIABLE, PARTLY) or rivals
    experiment = propose(problem, search, limits, seed, blind=bool(poor)) if undecided else None
    tuned = {p.number: extended.values[p.path] for p in search.tuned if p.path in extended.values}
    return JointDiagnosis(
        joint=joint,
        verdict=verdict,
        sentence=sentence,
        signal=signal if "." in signal else f"{joint}.{signal}",
        unit=unit,
        gap=errors,
        causes=(*causes, *data_causes(findings, joint)),
        unexplained=left,
        rivals=rivals,
        experiment=experiment,
        findings=findings,
        values=extended.values,
        retuned=tuned,
        problem=problem,
        search=search,
        simulated=simulated,
        structure=rest,
    )


def _whole_runs(problem: Problem) -> bool:
    """Whether the runs of the test part are in no other part."""
    runs = [{unit.run for unit in problem.units if (unit.part == TEST) is test} for test in (True, False)]
    return not runs[0] & runs[1]


def _error(error: np.ndarray) -> Error:
    return Error(float(np.sqrt(np.mean(error**2))), float(np.mean(np.abs(error))))


def _name_causes(
    problem: Problem,
    search: Search,
    extended: Fit,
    fitted: Problem,
    joint: str,
    explained: float,
    rest: Structure,
    seed: int,
) -> list[NamedCause]:
    """Causes with shares by what the model loses without each, all others re-fitted."""
    if not search.accepted:
        return []
    final = search.accepted[-1]
    parts = (problem.part(FIT_A), problem.part(FIT_B))
    losses = []
    for candidate in search.accepted:
        others = search.parameters(without=candidate.cause.name)
        kept = [{p.path: f.values[p.path] for p in others if p.path in f.values} for f in final.fits]
        fits = [fit(part, others, start) for part, start in zip(parts, kept, strict=True)]
        blocks = np.concatenate(
            [p.block_errors(p.simulate([f.values])[0]) for p, f in zip(reversed(parts), fits, strict=True)]
        )
        losses.append((max(float(blocks.sum() - final.blocks.sum()), 0.0), float(blocks.sum())))
    total = sum(loss for loss, _ in losses) or 1.0
    parameters = search.parameters()
    bounds = intervals(fitted, parameters, extended, seed, final.fits)
    named = []
    rounds = [r for r in search.rounds if r.accepted]
    stays = float(robust_loss(np.sqrt(rest.level))) if rest.noticed else 0.0
    for candidate, (loss, without), chosen in zip(search.accepted, losses, rounds, strict=True):
        rivals = tuple(c.cause.name for c in chosen.candidates[1:] if c.best > search.settings.rival_win_rate)
        removed = float((chosen.before.sum() - candidate.blocks.sum()) / search.counts.sum())
        values = {
            p.number: _value(p, extended, bounds, problem.models[0])
            for p in candidate.variant
            if p.path in extended.values
        }
        named.append(
            NamedCause(
                name=candidate.cause.name,
                sentence=candidate.cause.sentence,
                joint=joint,
                share=explained * loss / total,
                confidence=candidate.best * removed / (removed + stays),
                parameters=values,
                gain=1.0 - float(np.sqrt(final.blocks.sum() / without)),
                kind="number" if candidate.cause.error else "effect",
                picture=candidate.cause.picture,
                rivals=rivals,
            )
        )
    return sorted(named, key=lambda cause: -cause.share)


def _value(
    parameter: Parameter, extended: Fit, bounds: Mapping[str, tuple[float, float]], nominal: JointModel
) -> Value:
    found = (extended.values[parameter.path], *bounds[parameter.path])
    value, low, high = (float(parameter.physical(number, nominal)) for number in found)
    unit = nominal.unit(parameter.number) if parameter.factor else parameter.unit
    return Value(value, low, high, unit, float(nominal.value(parameter.number)))


def _first_experiment(
    runs: Sequence[MeasuredRun],
    joint: str,
    reason: Finding,
    limits: Limits | None,
    seed: int,
    causes: Sequence[str] | None,
) -> Experiment | None:
    """What to run on a joint of a bench that nobody has moved yet."""
    asked = reason.code != "motion.none" or reason.data_error
    if asked or runs[0].robot != "bench" or joint not in runs[0].actuators or runs[0].joints[joint].goal is None:
        return None
    return experiment_for_still(runs, joint, [JointModel(_chain(runs[0], joint))], limits, seed, causes)


def _unusable(
    joint: str,
    reason: str,
    findings: Sequence[Finding],
    experiment: Experiment | None = None,
    verdict: str = UNUSABLE,
) -> JointDiagnosis:
    return JointDiagnosis(
        joint,
        verdict,
        f"The log cannot be used: {reason}" if verdict == UNUSABLE else f"Nothing can be said: {reason}",
        f"{joint}.position",
        "rad",
        {},
        (),
        1.0,
        (),
        experiment,
        tuple(findings),
    )
