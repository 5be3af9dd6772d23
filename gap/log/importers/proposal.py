"""A mapping proposed from header and data, with the reason for each column, and questions where they do not tell."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from ..types import COMMANDS, OTHER, SIGNAL_UNITS, TOLD, Array
from . import pairs
from .actions import read_action, together
from .answer import Answer
from .between_runs import differing_units
from .clocks import find_clock
from .column import Column, plain, span, taken, without_doubt
from .evidence import Relation, as_derivative, both_move_apart, drives, following, no_signal, same_motion
from .expression import evaluate, names_in
from .groups import best_of, match_goals, renamed, untwist
from .impedance import place_goal_velocity
from .in_table import said_together
from .mapping import Question, known_names
from .nameless import lists_of
from .names import said
from .proposed import Proposal
from .recording import Recording
from .sparse import held_goal, held_read, kept_samples
from .spelling import bare
from .unit_or_name import parted
from .unit_words import measures
from .units import ASK, TELLS, Read, read_other
from .velocities import counted_by_velocity, read_velocity, slope_beside, with_sign

ONLY_JOINT = "joint"
MEASURED_BY_MOTION = ("velocity", "torque", "current")
DRIVES = 0.6
"""Share of a column that motion explains, from which it may be a command or a torque."""


def propose(
    recordings: Sequence[Recording], unit: str | None = None, slides: Collection[str] = frozenset()
) -> Proposal:
    """Propose a mapping for recordings that have the same columns.

    Args:
        recordings: of one kind.
        unit: of positions and goals, the answer to the question for it.
        slides: joints that are slides as the robot's file says.

    Raises:
        LogError: each column says another unit than the answer.
    """
    return _Proposer(recordings, unit, slides).run()


class _Proposer:
    def __init__(self, recordings: Sequence[Recording], unit: str | None, slides: Collection[str]) -> None:
        self.recordings, self.slides = recordings, {bare(joint) for joint in slides}
        self.first = max(recordings, key=lambda recording: recording.length)
        self.answer = Answer(unit)
        self.out = Proposal()
        self.time = ""
        self.groups: dict[str, dict[str, list[Column]]] = {}
        self.unknown: list[str] = []
        self.by_motion: set[str] = set()  # goals that no name puts to a joint
        self.lists = lists_of(self.first, frozenset({*SIGNAL_UNITS, "load"}))
        self.actions: dict[str, Read] = {}  # how actions of a policy become goals, by column of the log
        self.renamed: dict[str, str] = {}  # words that logs reserve, by the joint's name here

    def run(self) -> Proposal:
        """All steps, in the order in which one needs the other."""
        self.find_time()
        self.sort_by_name()
        self.find_positions()
        self.place_unknown()
        measured = {joint: signals for joint, signals in self.groups.items() if signals.get("position")}
        self.answer.look_at(self.base_and_goals(signals) for signals in measured.values())
        for joint, signals in measured.items():
            self.read_joint(joint, signals)
        for name, read in together(self.actions, self.out.columns):
            self.put(name, read)
        self.answer.check(self.first.source)
        self.leave_out_strays()
        if len(self.out.joints) >= 1:
            self.ask_for_commands()
        for question in differing_units(self.recordings, self.out.columns):
            self.out.questions.append(question)
            self.out.columns |= {name: replace(self.out.columns[name], trust=ASK) for name in question.about}
        return self.out

    # --- the steps -------------------------------------------------------------------------------------------------

    def find_time(self) -> None:
        """The clock, and what is wrong with columns that look like one."""
        clock = find_clock(self.first)
        self.time = clock.name
        self.out.unused |= clock.unused
        self.put("time", clock.read)

    def sort_by_name(self) -> None:
        """Columns by joint and signal, as the format or their names say."""
        known = {*SIGNAL_UNITS, "load"}
        found: list[tuple[str, str, Column]] = []
        listed = {name for names in self.lists.columns.values() for name in names}
        for name, spoken in said_together(name for name in self.first.columns if name not in listed).items():
            if name in self.out.unused or name in names_in(self.out.columns["time"].text):
                continue
            role = self.first.roles.get(name)
            unit = self.first.units.get(name, "")
            if role and role != "time":
                joint, _, signal = role.rpartition(".")
                column = Column(name, spoken, unit or spoken.unit, "the format", True)
                found.append((joint, signal, column))
            elif spoken.signal in known:
                column = Column(name, spoken, spoken.unit, spoken.by, False)
                found.append((spoken.joint, spoken.signal, column))
            elif spoken.signal == "time":
                self.out.unused[name] = "another clock"
            elif spoken.signal:
                self.out.unused[name] = f"{spoken.signal}, which the log has no column for"
            else:
                self.unknown.append(name)
        found = parted(found)
        joints = {joint for joint, _, column in found if not column.by_format}
        moving = {joint for joint, signal, _ in found if signal in ("position", "goal", "velocity")}
        single = len({plain(joint) for joint in moving}) <= 1
        for joint, signal, column in found:
            if not column.by_format:
                joint = self.joint_of(joint, single, joints, moving)
                unexplained = single and plain(column.said.joint).isalpha() and column.said.joint != joint
                column = replace(column, rest=column.rest or (column.said.joint if unexplained else ""))
            self.groups.setdefault(joint, {}).setdefault(signal, []).append(column)
        self.join_names()
        self.join_strays()
        self.match_goals()
        self.lists.put(self.groups, self.first, self.clock(self.first))
        self.by_motion |= self.lists.by_motion
        self.out.unused |= self.lists.unused

    def join_names(self) -> None:
        """Joints that are one by their names, and a name for the one that has none beside others."""
        names = pairs.same_joint(self.groups, self.same_motion)
        if len(self.groups) > 1 and "position" in self.groups.get("", {}) and ONLY_JOINT not in self.groups:
            names[""] = ONLY_JOINT
        self.renamed = {f"{joint}_{ONLY_JOINT}": joint for joint in OTHER if joint in self.groups}
        names |= {joint: name for name, joint in self.renamed.items()}
        self.groups = renamed(self.groups, names)

    def same_motion(self, joint: str, other: str) -> bool:
        """Whether two joints have the same position, by their numbers."""
        first, second = (self.first.columns[self.groups[one]["position"][0].name] for one in (joint, other))
        return same_motion(first, second)

    def find_positions(self) -> None:
        """Positions that no name says: what is called as a joint with a goal, and what follows a goal."""
        for joint, signals in list(self.groups.items()):
            named = [name for name in self.unknown if joint and said(name).joint == joint]
            if "position" not in signals and named and signals.keys() & {*COMMANDS}:
                self.unknown.remove(named[0])
                signals["position"] = [Column(named[0], said(named[0]), said(named[0]).unit, "the name", False)]
        if any("position" in signals for signals in self.groups.values()):
            return
        goals = [(joint, signals["goal"][0].name) for joint, signals in self.groups.items() if "goal" in signals]
        moving = [name for name in self.unknown if span(self.first.columns[name]) > 0.0]
        if len(goals) > 1:
            return
        joint, goal = goals[0] if goals else (ONLY_JOINT, None)
        pair = pairs.best_pair(moving, self.relation, goal)
        if pair is None:
            return
        signals = self.groups.setdefault(joint, {})
        for signal, name in (("goal", pair[0]), ("position", pair[1])):
            if signal not in signals:
                self.unknown.remove(name)
                signals[signal] = [Column(name, said(name), said(name).unit, "the name", False)]
        self.out.questions.append(pairs.who_moves(joint, pair))

    def relation(self, first: str, second: str) -> Relation:
        """How much later than one column another one moves."""
        return following(self.clock(self.first), self.first.columns[first], self.first.columns[second])

    def join_strays(self) -> None:
        """What drives a joint goes to the only position there is, whatever else their names say."""
        measured = [joint for joint, signals in self.groups.items() if signals.get("position")]
        if len(measured) != 1:
            return
        own = self.groups[measured[0]]
        for joint, signals in list(self.groups.items()):
            for signal in [*COMMANDS, "velocity", "goal_velocity"]:
                if joint == measured[0] or signal not in signals or signal in own:
                    continue
                if plain(joint) and not self.goes_along(signals[signal][0], own["position"][0]):
                    continue
                own[signal] = signals.pop(signal)

    def match_goals(self) -> None:
        """Goals that no name puts to a joint, as of a list without names, go to the joint that follows them."""
        self.by_motion |= match_goals(self.groups, self.relation)

    def goes_along(self, column: Column, base: Column) -> bool:
        """Whether a position moves as a goal, or its derivative as a velocity."""
        run = self.moved(base.name)
        time, position, values = self.clock(run), run.columns[base.name], run.columns[column.name]
        goes = following(time, values, position)
        return (goes.fit > pairs.FOLLOWS and goes.lag >= 0.0) or as_derivative(time, position, values).fit > 0.9

    def joint_of(self, joint: str, single: bool, joints: set[str], moving: set[str]) -> str:
        """The joint that a name's rest means."""
        by_format = {role.rpartition(".")[0] for role in self.first.roles.values() if role != "time"}
        if single:
            return next(iter(by_format)) if len(by_format) == 1 else (plain(next(iter(moving), "")) or ONLY_JOINT)
        ends = [known for known in by_format | moving if known and joint.endswith(f"_{known}")]
        return max(ends, key=len) if ends and joint not in moving else joint

    def place_unknown(self) -> None:
        """Columns whose names say nothing, by what their numbers do."""
        for name in self.unknown:
            self.out.unused[name] = self.place(name)
        self.out.unused = {name: why for name, why in self.out.unused.items() if why} | self.first.left

    def place(self, name: str) -> str:
        """Put one column where its numbers belong; or say why it is not used."""
        values = self.moved(name).columns[name]
        if why := no_signal(values):
            return why
        for joint, signals in self.groups.items():
            for other in signals.get("position", []):
                run = self.moved(other.name)
                time, position, values = self.clock(run), run.columns[other.name], run.columns[name]
                column = Column(name, said(name), "", "its name", False)
                slope = as_derivative(time, position, values)
                if slope.fit > 0.9 and "velocity" not in signals:
                    signals["velocity"] = [column]
                    return ""
                goes = following(time, values, position)
                if goes.fit > pairs.FOLLOWS and goes.lag > 0.0 and "goal" not in signals and 0.2 < goes.scale < 5.0:
                    signals["goal"] = [column]
                    return ""
                share = drives(time, position, values)
                if share > DRIVES:
                    asked = pairs.what_drives(joint, name, share, self.first.facts)
                    self.out.columns[f"{joint}.torque_command"] = asked[0]
                    self.out.questions.append(asked[1])
                    return "in question"
        return "its name says no signal of the log, and its numbers do not go with a motion"

    def read_joint(self, joint: str, signals: dict[str, list[Column]]) -> None:
        """The columns of one joint, their units and what they say of each other."""
        self.untwist(joint, signals)
        chosen = {signal: self.choose(signal, columns) for signal, columns in signals.items() if columns}
        base = chosen["position"]
        run = self.moved(base.name)
        position = run.columns[base.name]
        says_way = any(measures(one.unit, "way", "speed", "force") for one in chosen.values())
        slide = says_way or bare(joint) in self.slides
        read = self.answer.position(base, position, slide)
        speed = chosen.get("velocity")
        time = self.clock(run) if self.timed else None
        slope = slope_beside(time, position, run.columns[speed.name] if speed else None)
        read = counted_by_velocity(read, base.name, position, speed.unit if speed else "", slope)
        if measures(read.unit, "way"):
            self.out.slides.add(joint)
        if joint in self.renamed:
            read = replace(read, why=f"{read.why}; {joint}, for {self.renamed[joint]}.* means no joint in a log")
        self.put(f"{joint}.position", read)
        for signal, column in chosen.items():
            values = run.columns[column.name]
            if signal in ("position", "goal_velocity"):
                continue
            if signal in MEASURED_BY_MOTION and span(self.moved(column.name).columns[column.name]) == 0.0:
                self.out.unused[column.name] = f"a {signal} that never changes is not measured"
                continue
            if signal in ("goal", "link_position"):
                held = held_goal(values) if signal == "goal" else None
                steady = values if held is None else held
                goes = following(self.clock(run), steady, position)
                other = self.answer.alike(column, read, goes)
                if signal == "goal":
                    action = read_action(other, goes, steady, position, read)
                    if action is not None:
                        self.actions[f"{joint}.goal"] = action
                    other = pairs.in_order(other, goes, column.name in self.by_motion, read, self.timed, action)
                    if goes.fit < TELLS and both_move_apart(self.clock(run), steady, position, TELLS):
                        other = pairs.unfollowed(other, column.name, read, self.follower(column.name))
                    other = pairs.no_reading(other, (column.name, values), (base.name, position))
                if held is not None:
                    other = held_read(other, column.name, values)
                    self.out.keep[joint] = kept_samples(column.name, held, base.name, position)
                self.put(f"{joint}.{signal}", other)
            elif signal == "velocity":
                unit = without_doubt(column.unit)
                other = read_velocity(column.name, unit, column.how, slope, read)
                self.put(f"{joint}.velocity", with_sign(other, column.name, values))
            elif signal == "load":
                wraps = " (65527 is -9 as a number of 16 bits: signed16(load))" if np.nanmax(values) > 32767 else ""
                self.out.unused[column.name] = f"a register without a unit{wraps}, no torque"
            else:
                whole = self.moved(column.name).columns[column.name]
                other = read_other(signal, column.name, whole, column.unit, column.how, column.rest)
                self.put(f"{joint}.{signal}", other)
        place_goal_velocity(self.out, joint, chosen, run.columns, time)

    def leave_out_strays(self) -> None:
        """Joints that have no position: shared columns such as a supply go to the only joint, others are left out."""
        placed = {name for read in self.out.columns.values() for name in taken(read.text, self.first)}
        for joint, signals in self.groups.items():
            if signals.get("position"):
                continue
            for signal, columns in signals.items():
                for column in columns:
                    only = self.out.joints[0] if len(self.out.joints) == 1 else None
                    target = f"{only}.{signal}"
                    if signal == "voltage" and not only and not plain(joint):
                        self.share(column)
                    elif (
                        only
                        and signal in ("voltage", "temperature", "enabled", "current", "duty")
                        and target not in self.out.columns
                    ):
                        values = self.moved(column.name).columns[column.name]
                        self.put(target, read_other(signal, column.name, values, column.unit, column.how))
                    elif column.name not in placed:
                        self.out.unused[column.name] = f"{signal} of '{joint}', which has no position"
        if not self.out.joints:
            ask = "which column is the position of a joint? Write <joint>.position: <column>, in rad (slide: m)"
            self.out.questions.append(Question((f"{ONLY_JOINT}.position",), ask))

    def share(self, column: Column) -> None:
        """A supply that all joints have."""
        values = self.moved(column.name).columns[column.name]
        for joint in self.out.joints:
            if f"{joint}.voltage" not in self.out.columns:
                self.put(f"{joint}.voltage", read_other("voltage", column.name, values, column.unit, column.how))

    def ask_for_commands(self) -> None:
        """A joint that nothing drives is no log of a drive."""
        needed = COMMANDS if len(self.out.joints) == 1 else TOLD  # of a robot a measured torque is no command
        for joint in self.out.joints:
            names = [f"{joint}.{signal}" for signal in needed]
            if not any(name in self.out.columns for name in names):
                own = self.groups[joint]["position"][0].name
                others = [self.groups[other]["position"][0].name for other in self.out.joints if other != joint]
                pair = next((pair for other in others if (pair := pairs.best_pair([own], self.relation, other))), None)
                self.out.questions.append(pairs.what_commands(joint, names, pair))

    def follower(self, goal: str) -> str:
        """The position that follows a goal, by its column; empty where none does."""
        positions = (signals["position"][0].name for signals in self.groups.values() if signals.get("position"))
        return next((position for position in positions if pairs.best_pair([position], self.relation, goal)), "")

    # --- helpers ---------------------------------------------------------------------------------------------------

    def put(self, name: str, read: Read) -> None:
        """Take a column into the proposal, with its question."""
        if ask := next((self.lists.asked[name] for name in names_in(read.text) if name in self.lists.asked), ""):
            read = replace(read, trust=ASK, why=f"{read.why}; no name says whose it is", ask=ask)
        self.out.columns[name] = read
        if read.trust == ASK:
            ask = read.ask or read.why
            same = next((q for q in self.out.questions if q.ask == ask), None)
            if same:
                self.out.questions[self.out.questions.index(same)] = Question((*same.about, name), ask)
            else:
                self.out.questions.append(Question((name,), ask))

    def moved(self, name: str) -> Recording:
        """The recording in which a column changes most."""
        return max(self.recordings, key=lambda run: span(run.columns[name]))

    def base_and_goals(self, signals: dict[str, list[Column]]) -> tuple[Column, Array, list[Array]]:
        """The position of a joint, and its goals in the same recording."""
        base = self.choose("position", signals["position"])
        run = self.moved(base.name)
        return base, run.columns[base.name], [run.columns[one.name] for one in signals.get("goal", [])]

    @property
    def timed(self) -> bool:
        """Whether the time is known, so that derivatives and delays can be told."""
        return bool(self.time) and self.out.columns["time"].trust != ASK

    def clock(self, run: Recording) -> Array:
        """Time of a recording [s], as far as it is known."""
        if not self.time:
            return np.arange(run.length, dtype=np.float64) * 0.01
        seconds = np.asarray(evaluate(self.out.columns["time"].text, known_names(run), str(run.source)), np.float64)
        return seconds - seconds[0]

    def untwist(self, joint: str, signals: dict[str, list[Column]]) -> None:
        """``qd`` may be the derivative or the wanted one: the numbers tell."""
        base = self.choose("position", signals["position"])
        run = self.moved(base.name)
        untwist(signals, lambda name: as_derivative(self.clock(run), run.columns[base.name], run.columns[name]))

    def choose(self, signal: str, columns: list[Column]) -> Column:
        """One of several columns of the same signal; of the others it is said why they are left out."""
        best, left = best_of(signal, columns, self.first)
        self.out.unused |= left
        return best
