"""The search for what joints of a robot share, on top of what each of them was found to have by itself.

A payload is more load at every joint that carries it. Sought joint by joint, it is named as often as there are joints,
each time with another number, or hidden in the friction of one of them. Here one number explains all joints at once, or
none: numbers of single joints are tuned beside it, and what their own searches named stays unless it is of their load.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..causes.catalogue import ENTRIES
from ..causes.cause import Cause
from ..load.robot import LoggedRobot
from ..log.parts import FIT_A, FIT_B
from ..log.progress import Progress
from ..log.types import Array, MeasuredRun
from ..measure.confidence import by_effect, with_shares
from ..measure.measured import Measured
from ..replay.flattened import flattened
from ..replay.parameters import BAR, Parameter, address
from ..replay.problem import JointProblem
from ..replay.tree import motion_of, terms_of
from ..search.fit import merge, middle
from ..search.forward import Searcher
from ..search.result import Search
from ..search.settings import DEFAULT, SearchSettings
from ..search.sketch import spread
from .directions import Direction, about_joints, centres, masses, payload, rows_of, tilt
from .problem import RobotModel, RobotProblem

BODY_CAUSES = ("load.mass", "load.centre_of_mass")
"""Causes of a joint that its bodies weigh differently."""
LOAD_CAUSES = (*BODY_CAUSES, "load.inertia")
"""Causes of a joint that may be a part of what the robot has; an inertia may be its own, of a rotor behind the gear."""
PLAIN_FRICTIONS = ("friction.coulomb", "friction.viscous")
"""Friction that every joint has."""


@dataclass(frozen=True, eq=False)
class SharedFound:
    """What a search over all joints found.

    Attributes:
        problem: the joints.
        search: of what they share.
        tuned: numbers of single joints.
        rows: by number of the robot and joint, what the number adds to the joint's terms in each run (samples, T_SIZE).
        heavier: joints that were found by themselves to carry other bodies than believed.
    """

    problem: RobotProblem
    search: Search
    tuned: tuple[Parameter, ...]
    rows: Mapping[str, Mapping[str, Sequence[Array]]]
    heavier: frozenset[str] = frozenset()

    def widespread(self) -> bool:
        """Whether what was found is of the robot: it helps several joints, or those whose own causes are of its bodies.

        What else helps one joint alone is of that joint, whatever it is.
        """
        settings = self.search.settings
        before, after = (self._losses(middle(*pair)) for pair in (self.search.base, self.search.fits))
        joints = helped(before, after, settings)
        of_bodies = all(one.cause.name in BODY_CAUSES for one in self.search.accepted)
        return len(joints) >= settings.shared_joints or (of_bodies and bool(joints) and joints <= self.heavier)

    def loss(self) -> float:
        """Loss of all joints on what was fitted, with what was found."""
        return sum(self._losses(middle(*self.search.fits)).values())

    def _losses(self, values: Mapping[str, float]) -> dict[str, float]:
        """Loss of each joint on what was fitted."""
        fitted = self.problem.part(FIT_A, FIT_B)
        simulated, at, found = fitted.simulate([values])[0], 0, {}
        for joint, problem in fitted.joints.items():
            found[joint] = float(problem.block_errors(simulated[at : at + len(problem.time)]).sum())
            at += len(problem.time)
        return found

    def by_effect(self, measured: Measured, number: str = "", cause: str = "") -> Measured:
        """What was measured, its shares by effect: bodies and frictions of the joints make up for most of a payload.

        Args:
            measured: of the robot.
            number: of each joint's chain that has a share of its own, as ``cause``; empty: none.
            cause: that changes this number at all joints alike.
        """
        full = middle(*self.search.fits)
        parts = [set(one.parameters) for one in measured.causes]
        parts.append({path for path in full if number and address(path).joint and address(path).own == number})
        parts.append(set(full).difference(*parts))
        explained = measured.tuned_share + sum(one.share for one in measured.causes)
        *shares, shared, tuned = map(float, explained * by_effect(self.problem, full, parts))
        causes = with_shares(measured.causes, shares)
        return replace(measured, causes=causes, shared_shares={cause: shared} if number else {}, tuned_share=tuned)

    def more(self, joint: str, values: Mapping[str, float]) -> list[Array] | None:
        """What numbers of the robot add to the terms of a joint in each run (samples, T_SIZE); None where nothing."""
        model = self.problem.models[0]
        parts = [
            [(value - model.neutral[number]) * table for table in self.rows[number][joint]]
            for number, value in values.items()
            if joint in self.rows.get(number, {})
        ]
        return [np.sum(tables, axis=0) for tables in zip(*parts, strict=True)] if parts else None


def helped(before: Mapping[str, float], after: Mapping[str, float], settings: SearchSettings = DEFAULT) -> set[str]:
    """The joints that lose a good part of their own loss, however much larger that of another is."""
    return {joint for joint, loss in before.items() if loss - after[joint] > settings.shared_gain * loss}


def affected(named: Mapping[str, Iterable[str]], noticed: Mapping[str, bool]) -> bool:
    """Whether anything at the joints may be of the whole robot: a load is named, or something is left unexplained.

    Args:
        named: causes of each joint.
        noticed: whether its errors have structure that none of them explains.
    """
    return any(noticed.values()) or any(name in LOAD_CAUSES for names in named.values() for name in names)


def search_shared(
    robot: LoggedRobot,
    runs: Sequence[MeasuredRun],
    problems: Mapping[str, JointProblem],
    searches: Mapping[str, Search],
    seed: int,
    progress: Progress = lambda text: None,
    causes: Sequence[str] | None = None,
    settings: SearchSettings = DEFAULT,
    look_on: bool = False,
    apart: Sequence[str] = (),
) -> SharedFound | None:
    """Seek causes that joints share; None where there are too few joints, or none that could.

    Args:
        robot: that was logged.
        runs: of it.
        problems: of the joints that were replayed freely, as they were searched.
        searches: what was found at each.
        seed: of all resampling.
        progress: is told what goes on.
        causes: names of those to consider; default: all.
        settings: thresholds of the search.
        look_on: whether it records rounds that it would skip.
        apart: causes of joints, beside those of their loads, that what they share may stand for.
    """
    if len(problems) < settings.shared_joints:
        return None
    progress("looking for what joints share")
    taken = flattened(runs, problems, {joint: middle(*searches[joint].fits) for joint in problems})
    motions = [motion_of(robot, run, each) for run, each in zip(runs, taken, strict=True)]
    problems = {joint: spread(problem, settings.sketched) for joint, problem in problems.items()}
    problems = {
        joint: replace(problem, terms=laid(terms_of(robot, joint, runs, motions), problem))
        for joint, problem in problems.items()
    }
    every = [group for group in _groups(robot, problems, settings) if causes is None or group.name in causes]
    rows: dict[str, dict[str, Sequence[Array]]] = {}
    for direction in {d.number: d for group in every for d in group.directions}.values():
        for joint in problems:
            found = rows_of(direction, robot, joint, runs, motions)
            if found is not None:
                rows.setdefault(direction.number, {})[joint] = found
    # what only one joint feels is that joint's own
    wide = [
        group for group in every if any(len(rows.get(d.number, {})) >= settings.shared_joints for d in group.directions)
    ]
    if not wide:
        return None
    directions = [d for group in wide for d in group.directions]
    model = RobotModel(
        problems, {d.number: d.neutral for d in directions}, {d.number: d.parameter.unit for d in directions}
    )
    tables = {number: {j: laid(found, problems[j]) for j, found in each.items()} for number, each in rows.items()}
    problem = RobotProblem.of(dict(problems), tables, (model,))
    own = {joint: _own(found, (*LOAD_CAUSES, *apart)) for joint, found in searches.items()}
    geared = {joint: _own(found, (*BODY_CAUSES, *apart)) for joint, found in searches.items()}
    heavier = frozenset(j for j, found in searches.items() if any(c.cause.name in BODY_CAUSES for c in found.accepted))
    plain = {joint: _friction(problems[joint], found) for joint, found in searches.items()}
    rotors = {joint: _rotor(problem) for joint, problem in problems.items()}
    # each joint's own search has been there: sixty numbers take long from anywhere else
    known = {f"{joint}{BAR}{path}": x for joint, found in searches.items() for path, x in middle(*found.fits).items()}
    tries: list[tuple[Mapping[str, Sequence[Parameter]], int, Mapping[str, float] | None]] = [(own, 0, known)]
    if kept := sum(map(len, geared.values())) - sum(map(len, own.values())):
        tries.append((geared, kept, known))
    led = len(tries)  # by what was found of the joints
    tries.append((plain, 0, None))  # what a joint was said to have may only have stood in for what all of them share
    if count := sum(map(len, rotors.values())):
        tries.append(({joint: merge(numbers, rotors[joint]) for joint, numbers in plain.items()}, count, None))
    sought: list[SharedFound] = []
    charged: list[float] = []
    for beside, more, start in tries:
        tuned = tuple(p.of_joint(joint) for joint, numbers in beside.items() for p in numbers)
        search = Searcher(problem, _causes(wide), tuned, progress, seed, settings, look_on, start=start).run()
        sought.append(SharedFound(problem, search, tuned, rows, heavier))
        turned = more + sum(one.flexibility for one in search.accepted)
        charged.append(sought[-1].loss() * (1.0 + settings.parameter_charge * turned))
        if len(sought) >= led and min(one.search.record.last.round.excess for one in sought) < settings.far:
            break  # no rotor is missing where what is left is small
    # where inertias of the joints do without anything of the robot, that counts as well
    taken = [k for k, item in enumerate(sought) if item.search.accepted or 0 < k < led]
    return sought[min(taken, key=charged.__getitem__, default=0)]


def laid(rows: Sequence[Array], problem: JointProblem) -> Array:
    """Rows of whole runs at the samples of a joint's units (n, columns)."""
    return np.concatenate([rows[unit.run][unit.start : unit.stop] for unit in problem.units])


def _own(search: Search, apart: Sequence[str]) -> list[Parameter]:
    """What a joint's own search left to turn, without causes of its load."""
    kept = [candidate.variant for candidate in search.accepted if candidate.cause.name not in apart]
    return merge(search.tuned, *kept)


def _friction(problem: JointProblem, search: Search) -> list[Parameter]:
    """What is tuned anyway and plain friction, which every joint has, in place of what its own search named."""
    nominal = problem.models[0]
    plain = [ENTRIES[name] for name in PLAIN_FRICTIONS if ENTRIES[name].applies(nominal)]
    return merge(search.tuned, *(entry.cause(nominal).variants[0] for entry in plain))


def _rotor(problem: JointProblem) -> list[Parameter]:
    """A rotor's inertia where a torque is commanded, beyond what the robot's file has: no motor's data say it."""
    nominal = problem.models[0]
    inertia = ENTRIES["load.inertia"]
    if not (nominal.by_torque and inertia.applies(nominal)):
        return []
    return [replace(p, low=0.0) for p in inertia.cause(nominal).variants[0]]  # a rotor only adds


@dataclass(frozen=True)
class Group:
    """Directions that act together.

    Attributes:
        name: of the cause that they are of.
        directions: of it; those of one cause are its variants.
        about: body that tells the cause from others of its name.
    """

    name: str
    directions: tuple[Direction, ...]
    about: str = ""


def _groups(robot: LoggedRobot, joints: Iterable[str], settings: SearchSettings) -> list[Group]:
    """Directions by the cause that they are of: one for all masses, the payload first; centres of mass body by body."""
    carried = [direction for joint in joints if (direction := payload(robot, joint)) is not None]
    found = [Group("load.mass", (direction,)) for direction in {d.number: d for d in carried}.values()]
    found += [Group("load.mass", (direction,)) for direction in masses(robot, settings.light_body)]
    found += [Group("load.centre_of_mass", group, body) for body, group in centres(robot, settings.light_body)]
    if (about := about_joints(robot)) is not None:
        found.append(Group("load.inertia", (about,)))
    return [*found, Group("load.tilt", tilt(robot))]


SENTENCES = {
    "load.mass": "The robot, or what it carries, is lighter or heavier than believed.",
    "load.centre_of_mass": "The centre of mass of a body sits elsewhere.",
    "load.inertia": "The model file gives inertias about the joints, where they are meant about the centres of mass.",
    "load.tilt": "The base of the robot does not stand level.",
}


def _causes(groups: Sequence[Group]) -> list[Cause]:
    """Causes of the search."""
    found: dict[tuple[str, str], list[tuple[Parameter, ...]]] = {}
    for group in groups:
        variants = found.setdefault((group.name, group.about), [])
        variants.append(tuple(direction.parameter for direction in group.directions))
    return [
        Cause(sentence=SENTENCES[name], picture="", variants=tuple(variants), error=True, name=name, about=about)
        for (name, about), variants in found.items()
    ]
