"""A diagnosis in a terminal: one screen a joint, and no value apart from its unit however narrow the window."""

from __future__ import annotations

import math
import shlex
import textwrap
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from ...common import plugins
from ...common.errors import SealegsError
from ...envs.described.robot_file import is_robot_file
from ...envs.extended import read_extended
from ...envs.robots import ROBOTS, get_robot
from ..checks.drive import EFFORTS
from ..experiment import DetectionLimit
from ..experiment.proposal import COLUMNS, EXPERIMENT_REPEATS, VISIBLE_DIFFERENCE, lacking
from ..log.finding import MAX_TOLD
from ..log.sidecar import read_sidecar
from ..measure.case import ROBOT
from ..measure.named import ONE_OF_SEVERAL, NamedCause, Value
from ..prepare.frames import DOUBTED
from ..replay.tree import HELD
from ..robot.together import FirstLook
from ..robot.together import told as told_latency
from ..search.look import Look
from ..search.structure import fine, listed
from ..verdict.verdict import BESIDE, NOT_IDENTIFIABLE, JointDiagnosis, Reason, size
from .document import overall, sentences_of, to_document
from .numbers import GLUE, LAYOUT, glued, number, percent, sureness, told_value

MUCH_LEFT = 0.1  # of the gap: what stays unexplained beside causes is a line of its own from there

LEFT_OPEN = 3.0  # noise floors: an error beyond this is not explained by the numbers of a first look

LIMITS = "limits"  # code of the reason that lists them all
LEAD = "Nothing was found. That much could be there unseen, hidden by numbers within their tolerance:"
PROVISIONAL = (
    "A first look, provisional: all usual numbers turned together, and no data held back to judge them. "
    "The diagnosis without look=true does that."
)


def screen(
    diagnoses: Sequence[JointDiagnosis], written: Mapping[str, Path], width: int = 80, logs: Path | None = None
) -> list[str]:
    """Lines to print: per joint the sentence, errors of the log, causes and what to do next; then the files.

    Args:
        diagnoses: one per joint.
        written: files by what they hold.
        width: of the terminal, in characters.
        logs: folder of the logs, where those of the next experiment belong.
    """
    width = min(max(width, LAYOUT.narrowest), LAYOUT.widest)
    lines: list[str] = []
    told: set[str] = set()
    for diagnosis in diagnoses:
        lines += ["", *_joint(diagnosis, width, told)]
        told.update(doubts(diagnosis))
    if said := sentences_of(written):
        lines += ["", "The whole robot", *(line for sentence in said for line in _wrapped(sentence, width, 2))]
    words, commands = ("", ()) if any(map(doubts, diagnoses)) else next_step(diagnoses, written, logs)
    if words:
        lines += ["", "Next", *_wrapped(words, width, 2)]
        lines += [f"  {command}" for command in commands]  # to be copied, so never broken
    lines.append("")
    longest = max((len(name) for name in written), default=0)
    lines += [f"  {name:{longest}s}  {path}" for name, path in written.items()]  # a path is one word, whatever it takes
    return lines


DOUBTFUL = (DOUBTED,)
"""Findings that put all that is said below in doubt."""
DRAWS = "(Draws: blocks of the data that no fit saw, resampled at random.)"


def _joint(diagnosis: JointDiagnosis, width: int, told: Collection[str] = ()) -> Iterable[str]:
    verdict, (sentence, reasons) = diagnosis.verdict, told_once(diagnosis)
    said = sentence.lower().startswith(f"{verdict}: ")  # a verdict that its sentence begins with is told once
    yield from _wrapped(f"{verdict.upper()}: {sentence[len(verdict) + 2 :] if said else sentence}", width)
    if errors := [error for error in diagnosis.data_errors if error.sentence not in sentence]:
        yield from ("", "Errors of the log")
        for error in errors:
            yield from _wrapped(f"{error.name}: {error.sentence}", width, 2)
    doubted = [sentence for sentence in doubts(diagnosis) if sentence not in told]
    if doubted:
        yield from ("", "Check first")
        for doubt in doubted:
            yield from _wrapped(doubt, width, 2)
    if diagnosis.causes:
        yield from ("", "Causes")
        longest = max(len(cause.name) for cause in diagnosis.causes)
        for cause in diagnosis.causes:
            yield from _cause(cause, longest, width)
        if diagnosis.shared:
            yield from _wrapped(f"{'all joints':{longest}s}  {_share(diagnosis.shared_share)}", width, 2)
        if diagnosis.tuned_share >= 5e-4:
            name = rest_of(diagnosis)
            yield from _wrapped(f"{name:{longest}s}  {_share(diagnosis.tuned_share)}", width, 2)
        if diagnosis.unexplained >= MUCH_LEFT:
            left = f"{_share(diagnosis.unexplained)}{_left(diagnosis)}"
            yield from _wrapped(f"{'unexplained':{longest}s}  {left}", width, 2)
        for reason in reasons:
            if reason.code == BESIDE:
                yield ""
                yield from _wrapped(reason.sentence, width, 2)
    elif reasons and not diagnosis.data_errors:
        yield ""
        for reason in reasons:
            if reason.code == LIMITS:
                yield from _wrapped(LEAD, width, 2)
                for family, told in by_family(limits_told(diagnosis)):
                    yield from _wrapped(f"{family}: {told}", width, 4)
            else:
                yield from _wrapped(reason.sentence, width, 2)
    if diagnosis.causes and diagnosis.open_causes:
        yield from ("", "Not named")
        for cause in diagnosis.open_causes:
            yield from _wrapped(f"{cause.name} ({cause.standing}): {cause.sentence}", width, 2)
        if any("draws" in cause.sentence for cause in diagnosis.open_causes):
            yield from _wrapped(DRAWS, width, 2)
    if diagnosis.experiment is not None:
        yield from ("", "Next experiment")
        yield from _wrapped(diagnosis.experiment.sentence, width, 2)


def _left(diagnosis: JointDiagnosis) -> str:
    """How large what stays unexplained is, where that is known."""
    structure, noise = diagnosis.structure, diagnosis.gap.get("noise_floor")
    if structure is None or not structure.noticed or noise is None:
        return ""
    return f": {size(structure.rms, structure.unit)}, noise {fine(noise.rmse, structure.unit, 2)}"


def told_once(diagnosis: JointDiagnosis) -> tuple[str, Sequence[Reason]]:
    """Sentence and reasons of a joint; a refusal whose sentence begins with its reason is the whole reason."""
    whole = next((reason.sentence for reason in diagnosis.reasons if reason.code == "refused"), None)
    if whole is None:
        return diagnosis.sentence, diagnosis.reasons
    start = diagnosis.sentence.partition(":")[0].partition(";")[0]
    return f"{start}: {whole}", [reason for reason in diagnosis.reasons if reason.code != "refused"]


def doubts(diagnosis: JointDiagnosis) -> list[str]:
    """What is to be checked before anything of a joint is believed."""
    return [finding.sentence for finding in diagnosis.findings if finding.code in DOUBTFUL]


def _cause(cause: NamedCause, longest: int, width: int) -> Iterable[str]:
    sure = f"  {cause.standing}, confidence {sureness(cause.confidence)}"
    head = f"{cause.name:{longest}s}  {_share(cause.share)}{sure}"
    if len(head) + 2 > width:  # the name on a line of its own
        yield f"  {cause.name}"
        head = f"  {_share(cause.share)}{sure}"
    yield f"  {head}".replace(GLUE, " ")
    for path, value in cause.parameters.items():
        yield from _parameter(path, value, width)
    if cause.rivals:
        yield from _wrapped(f"{'rival' if len(cause.rivals) == 1 else 'rivals'}: {', '.join(cause.rivals)}", width, 4)


def _share(share: float) -> str:
    return f"{percent(share):>5s} of the gap"


def _parameter(path: str, value: Value, width: int) -> Iterable[str]:
    """``delay.seconds = 0.0225 s (0.0224 to 0.0226, model 0)``; broken between the value and its interval only."""
    told = told_value(value)
    interval = f"{told.interval}, " if told.interval else ""
    parts = [part.replace(" ", GLUE) for part in (f"{path} = {told.size}", f"({interval}model {told.nominal})")]
    yield from _wrapped(" ".join(parts), width, 4)


def _wrapped(text: str, width: int, indent: int = 0) -> list[str]:
    """Lines of at most ``width`` characters, which never end between a value and its unit."""
    space = " " * indent
    lines = textwrap.wrap(
        glued(text), width, initial_indent=space, subsequent_indent=space, break_long_words=False,
        break_on_hyphens=False,
    )  # fmt: skip
    return [line.replace(GLUE, " ") for line in lines]


# --- up to where each cause would not show, by family: thirty of them in a row are a wall ----------------------------


def limits_told(diagnosis: JointDiagnosis) -> Sequence[DetectionLimit]:
    """The limits of a joint whose verdict lists them; else none."""
    return diagnosis.limits if any(reason.code == LIMITS for reason in diagnosis.reasons) else ()


def by_family(limits: Sequence[DetectionLimit]) -> list[tuple[str, str]]:
    """Families of causes and their limits as text, in the order in which they come."""
    families: dict[str, list[str]] = {}
    for limit in limits:
        family, _, name = limit.name.partition(".")
        families.setdefault(family, []).append(f"{name}{limit.sentence.removeprefix(limit.name)}")
    return [(family, "; ".join(told)) for family, told in families.items()]


def limit_rows(limits: Sequence[DetectionLimit]) -> list[dict[str, str]]:
    """The same as a table: cause, number, what the model has, and below and above which values it would show."""
    told = []
    for limit in limits:
        unit = "" if limit.unit == "1" else f" {limit.unit}"
        ends = [f"{end:.3g}{unit}" if math.isfinite(end) else "never" for end in (limit.low, limit.high)]
        believed = f"{limit.nominal:.3g}{unit}" if math.isfinite(limit.nominal) else "none"
        told.append({"cause": limit.name, "number": limit.number, "model": believed, "low": ends[0], "high": ends[1]})
    return told


# --- a first look: per joint what moves it most, provisional ----------------------------------------------------------


def lines_of(found: FirstLook) -> Iterator[str]:
    """Lines to print: what all joints share, then each joint."""
    yield PROVISIONAL
    if found.latency is not None:
        yield ""
        yield f"All joints: {told_latency(found.latency)}, at {', '.join(found.latency.joints)}"
    for joint, seen in found.joints.items():
        unit = seen.problem.signal[1]
        before, after, noise = (fine(error, unit) for error in (*seen.errors, seen.problem.noise))
        yield ""
        yield f"{joint}: error {before} as believed, {after} with these numbers (noise {noise})"
        if seen.errors[1] > LEFT_OPEN * seen.problem.noise:
            yield "  they do not explain it: something else is there, and may have turned them beyond their intervals"
        yield from list(_numbers(seen, unit))[:MAX_TOLD] or ["  nothing that would move it by more than the noise"]


def _numbers(seen: Look, unit: str) -> Iterator[str]:
    nominal = seen.problem.models[0]
    by_path = {p.path: p for p in seen.parameters}
    for path, moved in seen.effects().items():
        if moved < seen.problem.noise:
            continue
        parameter = by_path[path]
        ends = (seen.found.values[path], *seen.bounds[path])
        value, low, high = (number(parameter.physical(x, nominal)) for x in ends)
        of = nominal.unit(parameter.number) if parameter.factor else parameter.unit
        size = f"{value}{'' if of == '1' else ' ' + of}"
        believed = number(nominal.value(parameter.number))
        yield (
            f"  {seen.causes[path]:25s} {parameter.number} = {size} ({low} to {high}, model {believed}): "
            f"moves it by {fine(moved, unit)}"
        )


def rest_of(diagnosis: JointDiagnosis) -> str:
    """What explains of a gap what no cause does: of the robot all that is of single joints."""
    if diagnosis.joint == ROBOT:
        return SINGLE
    return "refitted numbers" if diagnosis.refitted else "tuned numbers"


# --- what to type after a diagnosis ----------------------------------------------------------------------------------

BENCH = "bench"
RUN = (
    f"Run the proposed experiment {EXPERIMENT_REPEATS} times, with hw= and port= of these servos, and diagnose its "
    "logs together with the old ones:"
)
SINGLE = "single joints"
SETTLED = "No further experiment would tell more."
OPEN = "What this log cannot show stays open, and no experiment is proposed that would show it."
REFITTED = (
    "Numbers were refitted beyond their tolerance, and no experiment is proposed that would tell which of them is "
    "wrong: measure them apart where you can."
)
TRAIN = "{settled} Train on the machine as found:"
TORQUES = (
    "{settled} The machine as found is in {file}. What torques drive is trained with your own code: tasks give "
    "position goals."
)
MISSING = (
    "Nothing to train on yet: what was found is not identifiable, and no experiment is proposed that would tell. "
    "Needed is a log that shows more: {needed}."
)
DESCRIBE = " The load is not known either: describe it in the file of a robot, so that the motion itself is judged."


def next_step(
    diagnoses: Sequence[JointDiagnosis], written: Mapping[str, Path], logs: Path | None = None
) -> tuple[str, Sequence[str]]:
    """A sentence and the commands that it leads to; no sentence where there is nothing to train on.

    Args:
        diagnoses: one per joint.
        written: files by what they hold.
        logs: folder of the logs, where those of the experiment belong.
    """
    several = len(diagnoses) > 1
    keys = [f"{item.joint} experiment" if several else "experiment" for item in diagnoses if tells(item)]
    commands = [experiment_command(written[key], logs) for key in keys if key in written]
    if commands:
        return RUN, commands
    found = any(item.causes or item.model == "refitted" for item in diagnoses)
    if keys or not found or "extended" not in written:
        return "", ()
    if overall([to_document(item) for item in diagnoses])["verdict"] == NOT_IDENTIFIABLE:
        driven = any(item.problem is not None and item.problem.free_joint is None for item in diagnoses)
        held = next((f.sentence for item in diagnoses for f in item.findings if f.code == HELD), "")
        return MISSING.format(needed=_needed(diagnoses)) + (f" {held}" if held else DESCRIBE if driven else ""), ()
    hidden = any(
        item.verdict == NOT_IDENTIFIABLE or any(cause.standing == ONE_OF_SEVERAL for cause in item.causes)
        for item in diagnoses
    )
    settled = REFITTED if any(item.refitted for item in diagnoses) else OPEN if hidden else SETTLED
    if any(map(_by_torque, diagnoses)):
        return TORQUES.format(settled=settled, file=written["extended"]), ()
    return TRAIN.format(settled=settled), [train_command(written["extended"].parent)]


def _needed(diagnoses: Sequence[JointDiagnosis]) -> str:
    """What a log would have to show more of: motion, load, and columns that a chain predicts and that it lacks."""
    lacked = [name for name in EFFORTS if any(name in _lacking(item) for item in diagnoses)]
    ways = ["a wider and faster motion (limits=)", "another load"]
    if lacked:
        ways.append(f"the column{'s' if len(lacked) > 1 else ''} {listed(lacked)}")
    return f"{', '.join(ways[:-1])}{',' if len(ways) > 2 else ''} or {ways[-1]}"


def _lacking(diagnosis: JointDiagnosis) -> Sequence[str]:
    """Columns of effort that would tell more of a joint."""
    joint = None if diagnosis.problem is None else diagnosis.problem.joint
    return COLUMNS if joint is None else lacking(joint)


def _by_torque(diagnosis: JointDiagnosis) -> bool:
    """Whether a joint was commanded by a torque."""
    joint = None if diagnosis.problem is None else diagnosis.problem.joint
    return joint is not None and any(model.by_torque for model in joint.models)


def tells(diagnosis: JointDiagnosis) -> bool:
    """Whether the proposed experiment tells its rivals apart at all."""
    experiment = diagnosis.experiment
    return experiment is not None and experiment.separation >= VISIBLE_DIFFERENCE


def experiment_command(goals: Path, logs: Path | None = None) -> str:
    """The command that runs a proposed experiment on its robot, with the load that it asks for.

    Args:
        goals: its CSV, with the sidecar beside it.
        logs: folder of the old logs; None: where ``deploy`` puts its own. Of logs with zeros and directions of their
            own, the new ones go beside that folder: they are in those of the model.
    """
    said = read_sidecar(goals)
    words = ["sealegs", "deploy", f"excitation={goals}", f"robot={said.robot}"]
    if said.robot == BENCH:
        words += [f"actuator={chain}" for chain in said.actuators.values() if isinstance(chain, str)]
    try:
        usual = get_robot(said.robot).parameters({})
    except SealegsError:  # said by the command
        usual = {}
    for name, value in said.robot_params.items():
        if value != 0.0 and not math.isclose(value, usual.get(name, math.nan)):
            words.append(f"robot.params.{name}={value:g}")
    if logs is not None:
        words.append(f"out={logs}-model-frame" if said.meta.get("frames") else f"out={logs}")
    return shlex.join([*words, *plugins.arguments()])


def train_command(folder: Path) -> str:
    """The command that trains on the extended model of a folder."""
    robot = read_extended(folder).robot
    task = ["env=track", f"robot={robot}"] if is_robot_file(robot) else [f"env={robot}"] if robot in ROBOTS else []
    return shlex.join(["sealegs", "train", *task, f"extended={folder}", *plugins.arguments()])
