"""One policy in the nominal model, in the extended model and on the machine: what it earns, and what departs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..common.errors import SealegsError
from ..envs.contract import ContractError
from ..envs.extended import FILE as EXTENDED
from ..hw.machine.robot import ServoRobot, build_robot, extended_robot
from ..hw.run import deployment
from ..hw.run.asked import GAMEPAD, KEYS
from ..hw.run.commands import PolicyCommands
from ..hw.run.policy import Policy
from ..hw.run.simulated import Recording, recorded, simulate
from .aligned import DEPARTS, WINDOW, Aligned, ratios, squares, touches
from .figures import Contact, Figures, measure, rms_by_unit, told

MACHINE = "machine"
LASTS = 3  # cycles in a row that it takes
GAP = 1.5  # times what is accounted for: from here on it is a gap, where that is no chance
CHANCE = 0.05  # that a gap is named where there is none, over all joints and the base
MOST_TOLD = 100.0  # times: a larger ratio says that next to nothing was accounted for, as of a joint that stands still
NOTHING_ELSE: dict[str, Any] = {
    "excitation": None, "replay": None, "reference": False, "reach": None, "dry_run": False,
    "overruns": "log", "realtime": None,
}  # fmt: skip
"""Keys of ``configs/deploy.yaml`` that ``configs/evaluate.yaml`` has not."""


NOMINAL_MACHINE = (
    "This virtual machine hides nothing: it is the nominal one, from which an extended model should differ. "
    "hw.virtual.hidden=<file> names another, such as the extended.yaml of the diagnosis."
)


@dataclass(frozen=True)
class Comparison:
    """Runs of one policy.

    Attributes:
        policy: its file.
        robot: name.
        joints, base: names of the recordings' columns.
        units: of the joints, rad or m.
        runs: by ``nominal``, ``extended`` (where there is one) and ``machine``.
        figures: by the same names.
        ending: of the machine's run.
        log: of the machine's run.
        note: what else a person should know of the machine; "": nothing.
    """

    policy: str
    robot: str
    joints: list[str]
    units: list[str]
    base: list[str]
    runs: Mapping[str, Recording]
    figures: Mapping[str, Figures]
    ending: str
    log: Path
    note: str = ""


def compare(config: Mapping[str, Any], folder: Path, say: Callable[[str], None] = print) -> Comparison:
    """Run the policy on the machine and in the models, from the same start, asked for the same.

    Args:
        config: of ``configs/evaluate.yaml``: ``policy``, ``nominal``, ``extended``, ``hw``, ``port``, ``robot``, ...
        folder: for the machine's log.
        say: prints a line.

    Raises:
        SealegsError: policy, robot or chains do not fit, or the machine ended before anything could be compared.
    """
    policy = Policy(str(config["policy"]), config["task"])
    robot = build_robot(config["robot"], config["nominal"], None)
    models = {"nominal": robot}
    if config["extended"] is not None:
        models["extended"] = extended_model(config)
    check_policy(policy, config["robot"], list(models.values()), deployment.calibration_of(config))
    rate, seconds = policy.contract.goal_rate, float(config["seconds"])
    schedule, segment = command_schedule(policy, robot, seconds, int(config["seed"]))

    if config["command"] in (KEYS, GAMEPAD):
        raise SealegsError(f"command={config['command']} is for deploy: model and machine are asked for the same here.")

    def commands(robot: ServoRobot = robot) -> PolicyCommands:
        if config["command"] is not None:
            return deployment.policy_commands(policy, robot, config["command"])
        return PolicyCommands(policy, robot, schedule, segment)

    deploy = {
        **config, "actuator": config["nominal"], "extended": None, "rate": rate, "duration": seconds,
        "out": str(folder), "name": MACHINE, **NOTHING_ELSE,
    }  # fmt: skip
    prepared = deployment.prepare(deploy, commands)  # the policy was checked: its chains are what is compared
    own = prepared.commands
    assert isinstance(own, PolicyCommands)
    say(f"On the machine ({'servos' if config['hw']['virtual'] is None else 'virtual bus'}), {seconds:g} s")
    outcome, log = on_machine(prepared, say)
    machine = recorded(log, own, robot)
    if len(machine.time) < rate:
        raise SealegsError(f"the machine's run ended after {len(machine.time)} cycles: {outcome}; the log is {log}.")
    limits = prepared.limits
    runs: dict[str, Recording] = {}
    figures: dict[str, Figures] = {}
    spent = len(machine.time) / rate
    for name, model in models.items():
        say(f"In the {name} model")
        run = simulate(model, commands(), limits, rate, spent)
        runs[name] = run.cut(min(len(run.time), len(machine.time)))
        aligned = Aligned(model)
        level, unsure = aligned.levelled(machine)
        predicted, rehearsals = aligned.predict(level), aligned.rehearsals(level, unsure)
        rehearsed, foreseen = rehearsals[0]
        unpredictable = find_departures(rehearsed, foreseen, robot)  # not even where nothing differs
        departures = {
            signal: at
            for signal, at in find_departures(machine, predicted, robot).items()
            if signal not in unpredictable
        }
        accounted = np.maximum(accounted_for(rehearsals), aligned.rounding)
        gap = gap_of(squares(machine, predicted), accounted, robot)
        departures = departures if gap["gap"] is not None else {}
        first = min(departures, key=lambda signal: departures[signal], default=None)
        figures[name] = measure(
            run,
            robot,
            **gap,
            departs=first,
            departs_at=departures[first] if first else None,
            departures=departures,
            contacts=contacts_of(robot, touches(level, predicted), touches(rehearsed, foreseen)[0]),
        )
    runs[MACHINE], figures[MACHINE] = machine, measure(machine, robot)
    note = NOMINAL_MACHINE if config["extended"] is not None and hides_nothing(config["hw"]["virtual"]) else ""
    return Comparison(
        str(policy.path), robot.robot.name, joints=robot.names, units=robot.units, base=robot.base_names, runs=runs,
        figures=figures, ending=outcome, log=log, note=note,
    )  # fmt: skip


def hides_nothing(virtual: Mapping[str, Any] | None) -> bool:
    """Whether a machine is a virtual one, and as everybody believes."""
    return virtual is not None and not any(virtual.get(key) for key in ("hidden", "actuator", "params"))


def accounted_for(rehearsals: Sequence[tuple[Recording, Recording]]) -> np.ndarray:
    """Mean squares of the windows (w, k + b) of the rehearsal in which each signal is off the furthest."""
    found = np.stack([squares(*each) for each in rehearsals])
    most = found.mean(axis=1).argmax(axis=0)
    return np.take_along_axis(found, most[None, None, :], axis=0)[0]


def gap_of(found: np.ndarray, accounted: np.ndarray, robot: ServoRobot) -> dict[str, Any]:
    """The gap as :class:`Figures` has it, from mean squares of joints and base (w, k + b), found and accounted for."""
    names = [*robot.names, *(f"base {name}" for name in robot.base_names)]
    ratio, chance = ratios(found, accounted)
    ratio = np.where(chance < CHANCE / len(names), ratio, 0.0)
    worst, joints = int(np.argmax(ratio)), len(robot.names)
    total, expected = (rms_by_unit(rows[:, :joints], robot) for rows in (found, accounted))
    there = bool(ratio[worst] > GAP)
    return {
        "same_goals": total[0],
        "same_goals_of_slides": total[1],
        "accounted": expected[0],
        "accounted_of_slides": expected[1],
        "gap": float(ratio[worst]) if there else None,
        "gap_at": names[worst] if there else None,
    }


def contacts_of(robot: ServoRobot, found: tuple[np.ndarray, np.ndarray], accounted: np.ndarray) -> dict[str, Contact]:
    """Of each contact switch of a robot that said something, from what :func:`touches` gives of model and machine.

    Args:
        robot: with the switches.
        found: of model and machine.
        accounted: share of the samples that are alike in the rehearsal (s,).
    """
    if robot.imu is None or not len(found[0]):
        return {}
    rows = zip(robot.imu.switches, found[0].tolist(), accounted.tolist(), found[1].tolist(), strict=True)
    return {switch.name: Contact(*figures) for switch, *figures in rows if math.isfinite(figures[0])}


def verdict(figures: Figures) -> str:
    """Whether the model and the machine differ, in a sentence."""
    size = f"{told(figures.same_goals, figures.same_goals_of_slides)} over windows of {WINDOW:g} s"
    known = f"{told(figures.accounted, figures.accounted_of_slides)} are accounted for by encoders, bus and start"
    if figures.gap is None:
        return f"no gap: the model's position error is {size}, and {known}."
    times = f"{figures.gap:.1f}" if figures.gap < MOST_TOLD else f"over {MOST_TOLD:g}"
    where = f"{figures.gap_at} is off {times} times as far"
    return f"a gap: the model's position error is {size}, and {known}; {where}."


def extended_model(config: Mapping[str, Any]) -> ServoRobot:
    """The robot as a diagnosis found it; a chain of another origin is taken for all of it.

    Raises:
        SealegsError: it cannot be read, or does not fit the robot.
    """
    path = Path(str(config["extended"]))
    if path.is_file() and not (path.parent / EXTENDED).is_file():
        return build_robot(config["robot"], str(path), None)
    return extended_robot(config["robot"], path)


def check_policy(
    policy: Policy, config: Mapping[str, Any], models: Sequence[ServoRobot], calibration: Path | None = None
) -> None:
    """Make sure that a policy is for one of the models but for the chains it was trained with, which are compared.

    Args:
        policy: to check.
        config: of ``configs/robot``.
        models: that it may be for.
        calibration: file with the ranges of the joints; None: as drawn.

    Raises:
        ContractError: it is not; the message is that of the first model.
    """
    refused: list[ContractError] = []
    for model in models:
        try:
            build_robot({**config, "params": model.params}, model.belief, calibration).check_contract(
                policy.contract, chains=False
            )
            return
        except ContractError as error:
            refused.append(error)
    raise refused[0]


def on_machine(prepared: deployment.Deployment, say: Callable[[str], None]) -> tuple[str, Path]:
    """Run on servos; how the run ended, in words, and its log. A fault is told, and what was run is compared.

    Raises:
        NotAtRestError: torque may be on; that is then the last that is said.
    """
    done = deployment.run(prepared, say)
    assert done is not None
    outcome = done.outcome
    try:
        deployment.report(prepared, done, say)
    except deployment.NotAtRestError:
        raise
    except SealegsError as error:
        say(str(error))
        return (f"{outcome.fault.name}: {outcome.fault.sentence}" if outcome.fault else outcome.ending), done.log
    say(f"{outcome.ending.capitalize()}; {deployment.at_rest_sentence(done, prepared.config['rest'])}")
    return outcome.ending, done.log


def command_schedule(
    policy: Policy, robot: ServoRobot, seconds: float, seed: int, segment: float = 2.5
) -> tuple[np.ndarray, float]:
    """What the policy is asked for, one command after the other (m, c), as its task draws them; time of each [s]."""
    task = policy.contract.task_on(robot.robot)[0]
    count = max(math.ceil(seconds / segment), 1)
    return task.commands(np.random.default_rng(seed).random((count, task.draws))), segment


def find_departures(machine: Recording, model: Recording, robot: ServoRobot) -> dict[str, float]:
    """When each signal of a model leaves that of the machine for good, or for :data:`LASTS` cycles [s].

    A signal departs where it is off by more than :data:`DEPARTS` of its spread on the machine.
    """
    signals: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for k, joint in enumerate(robot.names):
        for name in ("goal", "position", "velocity", "duty", "current"):
            signals[f"{joint}.{name}"] = getattr(machine, name)[:, k], getattr(model, name)[:, k]
    for k, name in enumerate(robot.base_names):
        signals[f"base.{name}"] = machine.base[:, k], model.base[:, k]
    found = {}
    for name, (ours, theirs) in signals.items():
        known = np.isfinite(ours)
        spread = float(ours[known].std()) if known.any() else 0.0
        if spread < 1e-9 or not np.isfinite(theirs).any() or not np.nan_to_num(theirs).any():
            continue  # not measured, or not in the model
        off = np.abs(ours - theirs) > DEPARTS * spread
        lasting = np.convolve(off, np.ones(LASTS), "valid") >= LASTS
        if lasting.any():
            found[name] = float(machine.time[int(np.argmax(lasting))])
    return dict(sorted(found.items(), key=lambda item: item[1]))


# --- telling -------------------------------------------------------------------------------------------------------

ROWS: tuple[tuple[str, str, float], ...] = (
    ("reward per second", "reward", 1.0),
    ("tracking error, goal to position [mrad]", "tracking", 1e3),
    ("tracking error, goal to position [mm]", "tracking_of_slides", 1e3),
    ("frequency [Hz]", "frequency", 1.0),
    ("height of a hop [mm]", "height", 1e3),
    ("electrical energy [J]", "energy", 1.0),
    ("position error, same start and goals [mrad]", "same_goals", 1e3),
    ("  of it accounted for [mrad]", "accounted", 1e3),
    ("position error, same start and goals [mm]", "same_goals_of_slides", 1e3),
    ("  of it accounted for [mm]", "accounted_of_slides", 1e3),
)


CONTACT_ROWS: tuple[tuple[str, str, float], ...] = (
    ("contact as on the machine [% of time]", "agrees", 100.0),
    ("the same of a model that is the machine", "accounted", 100.0),
    ("closes later than the machine's [ms]", "later", 1e3),
)


def table(comparison: Comparison) -> tuple[list[str], list[list[str]]]:
    """Header and rows of the comparison, as text."""
    names = [*[name for name in comparison.figures if name != MACHINE], MACHINE]
    rows = []
    for label, field, factor in ROWS:
        if field == "tracking":
            for term in comparison.figures[MACHINE].terms:
                rows.append(
                    [f"  {term} per second", *(f"{comparison.figures[name].terms[term]:.4g}" for name in names)]
                )
        values = [getattr(comparison.figures[name], field) * factor for name in names]
        if all(math.isnan(value) for value in values):
            continue
        rows.append([label, *("-" if math.isnan(value) else f"{value:.4g}" for value in values)])
    for label, field, factor in CONTACT_ROWS:
        for switch in comparison.figures["nominal"].contacts:
            found = [comparison.figures[name].contacts.get(switch) for name in names]
            values = [math.nan if contact is None else getattr(contact, field) * factor for contact in found]
            rows.append([f"{switch}: {label}", *("-" if math.isnan(value) else f"{value:.3g}" for value in values)])
    rows.append(["first to depart", *(comparison.figures[name].departs or "-" for name in names)])
    times = [comparison.figures[name].departs_at for name in names]
    rows.append(["  after [s]", *("-" if at is None else f"{at:.2f}" for at in times)])
    return ["", *names], rows
