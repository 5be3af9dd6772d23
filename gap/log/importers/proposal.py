"""A mapping proposed from claims on columns, with the reason for each line, and questions where nobody says enough."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Collection, Sequence
from collections.abc import Mapping as AnyMapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import yaml

from ..types import COMMANDS, TOLD, Array
from .claims import ONLY_JOINT, Claimed, claims_of, first_of, is_action, placed, plain, ranked, renamed
from .clocks import find_clock
from .dialects import Dialect, dialects
from .drive_lines import SHARES_OF, drive_line
from .expression import evaluate, hold, longest_jump, lost_sign, measures, names_in, quoted
from .lines import (
    ACTIONS,
    ASK,
    COMPARED_FIT,
    LIKELY,
    SURE,
    Line,
    Position,
    bare,
    by_velocity,
    doubted,
    goal_line,
    goal_velocity_line,
    position_lines,
    velocity_line,
)
from .mapping import Mapping, Question
from .motion import Relation, as_derivative, following, span
from .names import Claim, said
from .recording import STRAY_SHARE, Recording

MEASURED_BY_MOTION = ("velocity", "torque", "current")
LARGEST_WRITTEN = 1e9
"""A value beyond this, or as far below one, is memory that nobody wrote."""
SIGNED_SHARE = 0.1
"""Share of its size by which a voltage must go below zero to be no supply's; assumed."""
ALIKE_FIT, ALIKE_WAY = 0.1, math.log(2.0)
"""By how much less of a motion a goal may explain, and how much less alike their ways may be, for a pair of goal and
position to do as well as the best: names decide then. Assumed."""
LOAD_IN_PERCENT = (
    "Is it the duty, as the load of Feetech's servos is? Keep the line then; if it is a torque in percent, remove it"
)
LINE_WIDTH = 118
MARKS = {ASK: "? ", LIKELY: "likely: "}


@dataclass
class Proposal:
    """A mapping with what is to be said of it.

    Attributes:
        columns: how each column of the log is read.
        unused: why a column of the file is left out.
        questions: that are open.
        slides: joints whose position is a way.
        keep: conditions of the samples that are kept, each of them a factor of ``where``.
    """

    columns: dict[str, Line] = field(default_factory=dict)
    unused: dict[str, str] = field(default_factory=dict)
    questions: list[Question] = field(default_factory=list)
    slides: set[str] = field(default_factory=set)
    keep: list[str] = field(default_factory=list)

    @property
    def joints(self) -> list[str]:
        """Joints that have a position."""
        return [name.rpartition(".")[0] for name in self.columns if name.endswith(".position")]

    @property
    def where(self) -> str | None:
        """Expression of the samples that are kept; None where all are."""
        return "*".join(dict.fromkeys(self.keep)) or None

    def mapping(self) -> Mapping:
        """The mapping without what it says of itself."""
        texts = {name: line.text for name, line in self.columns.items()}
        return Mapping(texts, questions=tuple(self.questions), where=self.where)

    def certain(self) -> Proposal:
        """Without what is in question; a joint whose position or command is goes as a whole."""
        open_ones = {name for question in self.questions for name in question.about}
        kept = {name: line for name, line in self.columns.items() if name not in open_ones}
        for joint in self.joints:
            if f"{joint}.position" not in kept or not any(f"{joint}.{signal}" in kept for signal in COMMANDS):
                kept = {name: line for name, line in kept.items() if name.rpartition(".")[0] != joint}
        return Proposal(kept, self.unused, [], self.slides, self.keep)

    def put(self, name: str, line: Line) -> None:
        """Take a column, with its question; those that ask the same are asked about together."""
        self.columns[name] = line
        if line.trust == ASK:
            self.ask(name, line.ask or line.why)

    def ask(self, name: str, ask: str) -> None:
        same = next((k for k, question in enumerate(self.questions) if question.ask == ask), None)
        if same is None:
            self.questions.append(Question((name,), ask))
        else:
            self.questions[same] = Question(tuple(dict.fromkeys((*self.questions[same].about, name))), ask)


def propose(
    recordings: Sequence[Recording],
    unit: str | None = None,
    slides: Collection[str] = frozenset(),
    known: Sequence[Dialect] | None = None,
    joints: Collection[str] = (),
) -> Proposal:
    """Propose a mapping for recordings that have the same columns.

    Args:
        recordings: of one kind.
        unit: of positions and goals, the answer to the question for it.
        slides: joints that are slides as the robot's file says.
        known: dialects; None: those that are installed.
        joints: names of the robot's joints.

    Raises:
        LogError: each column says another unit than the answer.
    """
    known = dialects() if known is None else known
    return _Proposer(recordings, unit, {bare(joint) for joint in slides}, known, joints).run()


class _Proposer:
    """Claims become lines, joint by joint; what is read of one column is handed on to those that hang on it."""

    def __init__(
        self, recordings: Sequence[Recording], unit: str | None, slides: Collection[str], known: Sequence[Dialect],
        joints: Collection[str],
    ) -> None:  # fmt: skip
        self.signed = _lost_signs(recordings, known)
        self.recordings = [_with_signs(recording, self.signed) for recording in recordings]
        self.slides, self.known, self.robot = slides, known, joints
        self.first = max(self.recordings, key=lambda recording: recording.length)
        self.out, self.unit, self.time = Proposal(), unit, ""
        self.claimed = Claimed()

    def run(self) -> Proposal:
        out = self.out
        self.find_time()
        measured = {joint: own for joint, own in self.claimed.groups.items() if own.get("position")}
        chosen = {joint: self.choose(own) for joint, own in measured.items()}
        positions = {joint: self.position(joint, own, measured[joint]) for joint, own in chosen.items()}
        lines = position_lines([*positions.values()], self.unit, self.first.source)
        for joint, own in chosen.items():
            self.read_joint(joint, own, positions[joint], lines[positions[joint].claim.column])
        self.share_strays()
        self.ask_for_what_lacks()
        for name, line in out.columns.items():
            if read := [one for one in names_in(line.text) if one in self.signed]:
                why = f"{line.why}; its sign was lost"
                out.columns[name] = line.but(text=self.with_sign(line.text, read), why=why)
        out.questions = [replace(one, ask=self.with_sign(one.ask, self.signed)) for one in out.questions]
        return out

    def with_sign(self, text: str, columns: Collection[str]) -> str:
        """A text with the readings of columns whose sign was lost in their places."""
        for column in columns:
            name = quoted(column)
            edges = (r"(?<![\w.`])", r"(?![\w.\[`])") if name == column else ("", "")
            reading = self.signed[column].replace("{}", name)
            text = re.sub(edges[0] + re.escape(name) + edges[1], lambda _, to=reading: to, text)
        return text

    def find_time(self) -> None:
        """The clock, and the columns that are claimed beside it."""
        clock = find_clock(self.first, claims_of(self.first, self.known))
        self.time = clock.name
        self.out.put("time", clock.line)
        if self.timed:
            steps = np.diff(self.clock(self.first))
            repeated = int((steps == 0.0).sum())
            stray = repeated <= STRAY_SHARE * len(steps) + 1 or self.doubled(steps)
            if repeated > 0 and stray and not (steps < 0.0).any():
                self.out.keep.append(f"later({clock.line.text})")
        self.claimed = placed(self.first, self.known, {*clock.unused, *names_in(clock.line.text)})
        measured = [joint for joint, own in self.claimed.groups.items() if own.get("position")]
        self.claimed.groups = renamed(self.claimed.groups, spelled(measured, self.robot))
        self.out.unused |= clock.unused | self.claimed.aside
        why = "nobody says what it is: no dialect has it, and its name says no signal of a log"
        self.out.unused |= dict.fromkeys(self.claimed.nobodys, why) | self.first.left

    def doubled(self, steps: Array) -> bool:
        """Whether each row without a step of the time before it (n - 1,) is the row before once more."""
        rows = np.flatnonzero(steps == 0.0)
        return all(np.array_equal(one[rows], one[rows + 1], equal_nan=True) for one in self.first.columns.values())

    def choose(self, signals: dict[str, list[Claim]]) -> dict[str, Claim]:
        """One of several columns of each signal; of the others it is said why they are left out."""
        chosen = {signal: ranked(signal, claims)[0] for signal, claims in signals.items() if claims}
        if {"position", "goal"} <= chosen.keys():
            chosen["position"], chosen["goal"] = self.pair(
                *(first_of(key, signals[key]) for key in ("position", "goal"))
            )
        for signal, best in chosen.items():
            others = (other.column for other in signals[signal] if other is not best)
            self.out.unused |= dict.fromkeys(others, f"{signal} as well; {best.column} is taken")
        return chosen

    def pair(self, positions: Sequence[Claim], goals: Sequence[Claim]) -> tuple[Claim, Claim]:
        """A position and the goal that it follows, as far as it goes; of those that do alike, the first by their names.

        A motor turns further than the joint behind its gear, and a drive does not follow the end of a way at once.
        """
        pairs = [(position, goal) for position in positions for goal in goals]
        if len(pairs) == 1:
            return pairs[0]
        goes = [self.follows(*pair) for pair in pairs]
        best = max(fit for fit, _ in goes)
        near = [k for k, (fit, _) in enumerate(goes) if fit >= best - ALIKE_FIT]
        least = min(goes[k][1] for k in near)
        return next(pairs[k] for k in near if goes[k][1] <= least + ALIKE_WAY) if best > COMPARED_FIT else pairs[0]

    def follows(self, position: Claim, goal: Claim) -> tuple[float, float]:
        """Share of a position's motion that a goal explains, and how far from equal their ways are, a logarithm."""
        run = self.moved(position.column)
        values = run.columns[goal.column]
        goes = following(self.clock(run), hold(values), run.columns[position.column])
        own, other = (measures(one.unit, "angle", "way") for one in (position, goal))
        times = goes.scale * (own.factor / other.factor if own and other else 1.0)
        alike = bool(own and other) or position.unit == goal.unit
        return (goes.fit if goes.scale > 0.0 else 0.0), abs(math.log(times)) if alike and times > 0.0 else 0.0

    def position(self, joint: str, chosen: dict[str, Claim], signals: dict[str, list[Claim]]) -> Position:
        claim, run = chosen["position"], self.moved(chosen["position"].column)
        way = any(measures(one.unit, "way", "speed", "force") for one in chosen.values())
        goals = tuple(run.columns[one.column] for one in signals.get("goal", []))
        return Position(claim, run.columns[claim.column], goals, way or bare(joint) in self.slides)

    def read_joint(self, joint: str, chosen: dict[str, Claim], position: Position, line: Line) -> None:
        """The lines of one joint."""
        out, run = self.out, self.moved(position.claim.column)
        speed = chosen.get("velocity")
        goes = self.slope(run, position.values, speed)
        base = by_velocity(line, position, speed, goes)
        if measures(base.unit, "way"):
            out.slides.add(joint)
        self.put(f"{joint}.position", base, position.claim)
        for signal, claim in sorted(chosen.items(), key=lambda one: one[0] == "goal_velocity"):  # behind its goal
            moved, goal = self.moved(claim.column).columns[claim.column], out.columns.get(f"{joint}.goal")
            if signal == "position":
                continue
            if why := self.no_signal(signal, moved):
                out.unused[claim.column] = why
            elif signal == "goal":
                self.read_goal(joint, claim, run, position, base)
            elif signal == "link_position":
                self.put(f"{joint}.{signal}", goal_line(claim, base), claim)
            elif signal == "velocity":
                self.put(f"{joint}.velocity", velocity_line(claim, goes, base), claim)
            elif signal == "goal_velocity" and (goal is None or not np.nan_to_num(moved).any()):
                out.unused[claim.column] = "a commanded velocity beside no goal, or of zero"
            elif signal == "goal_velocity" and goal is not None:
                self.put(f"{joint}.{signal}", goal_velocity_line(claim, goal), claim)
            elif signal == "load" and claim.unit in SHARES_OF and "duty" not in chosen:
                self.put(f"{joint}.duty", drive_line("duty", claim, moved).but(trust=ASK, ask=LOAD_IN_PERCENT), claim)
            elif signal == "load":
                out.unused[claim.column] = "a register without a unit, no torque"
            else:
                self.put(f"{joint}.{signal}", drive_line(signal, claim, moved), claim)

    def read_goal(self, joint: str, claim: Claim, run: Recording, position: Position, base: Line) -> None:
        """The goal of a joint, with how late its position comes, and what speaks against its being one."""
        values = run.columns[claim.column]
        known = np.isfinite(values)
        sparse = bool(known.any()) and 1.0 - known.mean() > STRAY_SHARE
        steady = hold(values) if sparse else values
        goes = following(self.clock(run), steady, position.values)
        line = goal_line(claim, base)
        if is_action(claim) and claim.by == "the name" and line.trust != ASK:
            line = line.but(trust=ASK, ask=ACTIONS)
        line = doubted(line, base, goes, self.clock(run) if self.timed else None, steady, position.values)
        if sparse:
            text = line.text.replace(quoted(claim.column), f"hold({quoted(claim.column)})", 1)
            why = f"{line.why}; {int(known.sum())} of {len(values)} samples have a goal: each is held until the next"
            line = line.but(text=text, trust=LIKELY if line.trust == SURE else line.trust, why=why)
            self.out.keep += [f"known(hold({quoted(claim.column)}))"] * bool(np.isnan(steady).any())
            self.out.keep += [f"known({quoted(position.claim.column)})"] * bool(np.isnan(position.values).any())
        self.put(f"{joint}.goal", line, claim)

    def no_signal(self, signal: str, values: Array) -> str:
        """Why a column is no such signal at all; empty where it may be one."""
        known = np.abs(values[np.isfinite(values)])
        if signal in MEASURED_BY_MOTION and span(values) == 0.0:
            return f"a {signal} that never changes is not measured"
        if signal == "voltage" and -float(values[np.isfinite(values)].min(initial=0.0)) > SIGNED_SHARE * float(
            known.max(initial=0.0)
        ):
            return "it changes its sign, as what a motor gets does: no voltage of the supply"
        odd = known[(known > LARGEST_WRITTEN) | ((known > 0.0) & (known < LARGEST_WRITTEN**-20))]
        if signal not in ("position", "goal") and len(odd):
            return f"it holds {odd[0]:.3g}, which is no {signal.replace('_', ' ')} but memory that nobody wrote"
        return ""

    def share_strays(self) -> None:
        """Columns of no joint with a position: a supply is of all joints, what names none of the only one."""
        out = self.out
        strays = [(joint, signal, claim) for joint, own in self.claimed.groups.items() if not own.get("position")
                  for signal, claims in own.items() for claim in claims]  # fmt: skip
        for joint, signal, claim in strays:
            for_all = signal == "voltage" and not plain(joint)
            alone = signal in ("voltage", "temperature", "enabled", "current", "duty") and len(out.joints) == 1
            targets = [one for one in out.joints if (for_all or alone) and f"{one}.{signal}" not in out.columns]
            for target in targets:
                values = self.moved(claim.column).columns[claim.column]
                out.put(f"{target}.{signal}", drive_line(signal, claim, values))
            if not targets:
                out.unused.setdefault(claim.column, f"{signal} of '{joint}', which has no position")

    def ask_for_what_lacks(self) -> None:
        """A log needs a position, and what drove the joint."""
        out = self.out
        if not out.joints:
            free = ", ".join(map(quoted, self.claimed.nobodys[:8]))
            ask = "which column is the position of a joint? Write <joint>.position: <column>, in rad (slide: m)"
            ask += f", and its goal as <joint>.goal. Nobody says what these are: {free}" if free else ""
            out.questions.append(Question((f"{ONLY_JOINT}.position",), ask))
        needed = COMMANDS if len(out.joints) == 1 else TOLD  # of a robot a measured torque is no command
        for joint in out.joints:
            names = [f"{joint}.{signal}" for signal in needed]
            if not any(name in out.columns for name in names):
                ask = f"what was commanded to {joint}? It needs {' or '.join(names)}"
                out.questions.append(Question((f"{joint}.goal",), ask))

    # --- helpers ---------------------------------------------------------------------------------------------------

    def put(self, name: str, line: Line, claim: Claim) -> None:
        """Take a column into the proposal, with the question of its claim."""
        self.out.put(name, line.but(trust=ASK, ask=claim.ask) if claim.ask and not claim.formula else line)

    def slope(self, run: Recording, values: Array, claim: Claim | None) -> Relation | None:
        """How a velocity, where there is one, goes with the derivative of an angle; None where no time is known."""
        if not self.timed:
            return None
        return Relation() if claim is None else as_derivative(self.clock(run), values, run.columns[claim.column])

    def moved(self, name: str) -> Recording:
        """The recording in which a column changes most."""
        return max(self.recordings, key=lambda run: span(run.columns[name]))

    @property
    def timed(self) -> bool:
        """Whether the time is known, so that derivatives and delays can be told."""
        return bool(self.time) and self.out.columns["time"].trust != ASK

    def clock(self, run: Recording) -> Array:
        """Time of a recording [s], as far as it is known."""
        if not self.time:
            return np.arange(run.length, dtype=np.float64) * 0.01
        seconds = np.asarray(evaluate(self.out.columns["time"].text, run.known_names(), str(run.source)), np.float64)
        return seconds - seconds[0]


def _lost_signs(recordings: Sequence[Recording], known: Sequence[Dialect]) -> dict[str, str]:
    """How columns are read whose sign was lost, by name, but for clocks, and those that a dialect reads itself."""
    found: dict[str, str] = {}
    for column, claim in claims_of(recordings[0], known).items():
        if "sign" in claim.formula or claim.signal in ("time", ""):
            continue
        runs = [one.columns[column] for one in recordings]
        for reading in filter(None, map(lost_sign, runs)):
            # a register that goes over the middle of its range, and not over 0, has no sign
            if all(longest_jump(read_as(reading, values)) <= longest_jump(values) for values in runs):
                found[column] = reading
                break
    return found


def _with_signs(recording: Recording, signed: AnyMapping[str, str]) -> Recording:
    """The recording with these columns as they are read."""
    columns = {
        name: read_as(signed[name], values) if name in signed else values for name, values in recording.columns.items()
    }
    return replace(recording, columns=columns)


def read_as(reading: str, values: Array) -> Array:
    """A column (n,) by its reading."""
    return np.asarray(evaluate(reading.replace("{}", "x"), {"x": values}, reading), np.float64)


def spelled(joints: Collection[str], robot: Collection[str]) -> dict[str, str]:
    """Names of joints as in the robot's file."""
    names: dict[str, str] = {}
    for joint in joints:
        alike = {name for name in robot if bare(joint) in (bare(name), bare(said(name).joint))}  # dof_1, read as joint1
        if len(alike) == 1 and [*map(bare, joints)].count(bare(joint)) == 1:
            names[joint] = alike.pop()
    return names


# --- as a person reads it --------------------------------------------------------------------------------------------


def proposal_text(
    proposal: Proposal,
    sidecar: AnyMapping[str, Any],
    recordings: Sequence[Recording],
    command: str,
    left: Sequence[str],
) -> str:
    """The mapping file that is shown, edited and read again.

    Args:
        proposal: what is proposed.
        sidecar: of the logs.
        recordings: that it is for.
        command: that imports with it.
        left: sentences on recordings that are left out.
    """
    first, rows = recordings[0], sum(recording.length for recording in recordings)
    many = len(recordings) > 1
    lines = [
        f"# How {first.source.parent if many else first.source} becomes a log: {len(recordings)} recording"
        f"{'s' * many}, {rows} samples.",
        "# Correct what is wrong; columns that are not wanted are removed. Then:",
        f"#   {command}",
        *(f"# Note: {note}." for note in dict.fromkeys(note for one in recordings for note in one.notes)),
        *(f"# Left out: {one}" for one in left),
        "columns:",
    ]
    entries = {name: (f"  {name}: {_scalar(read.text)}", MARKS.get(read.trust, "") + read.why)
               for name, read in proposal.columns.items()}  # fmt: skip
    margin = min(max((len(head) for head, _ in entries.values()), default=0) + 2, 60)
    for head, why in entries.values():
        first_line, *more = textwrap.wrap(why, max(LINE_WIDTH - margin - 4, 40)) or [""]
        lines.append(f"{head.ljust(margin)}  # {first_line}")
        lines += [" " * margin + f"  # {line}" for line in more]
    if proposal.where:
        lines.append(f"where: {_scalar(proposal.where)} # samples that are kept")
    if proposal.questions:
        lines.append("questions: # the import waits for these: correct the lines above, then remove the question")
        for question in proposal.questions:
            lines += [f"- about: [{', '.join(question.about)}]", f"  ask: {_scalar(question.ask)}"]
    if proposal.unused:
        lines.append("unused: # columns of the file, and why")
        lines += [f"  {_scalar(name)}: {_scalar(why)}" for name, why in proposal.unused.items()]
    if sidecar:
        text = yaml.safe_dump(dict(sidecar), sort_keys=False, allow_unicode=True, width=LINE_WIDTH)
        lines += ["sidecar: # ${...} stands for a number or word of the file", textwrap.indent(text, "  ").rstrip()]
    else:
        lines.append("# sidecar: {robot: bench, robot_params: {mass: 0.5, length: 0.1}, actuators: {...}}")
    if numbers := [f"{quoted(key)} = {value:g}" for key, value in first.facts.items() if not isinstance(value, str)]:
        lines.append("# Numbers of the file: " + ", ".join(numbers))
    return "\n".join(lines) + "\n"


def _scalar(text: str) -> str:
    """Text as a YAML value on one line."""
    plain = yaml.safe_dump(text, allow_unicode=True, width=10**6, default_flow_style=True)
    return plain.strip().removesuffix("\n...").strip()
