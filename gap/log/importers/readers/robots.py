"""Robots of one bag whose joints have the same names: what their joints are called, and whom a command is for."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from ...types import Array
from ..claims import ARM, beside
from ..names import is_a
from .topics import Topic

STATES = re.compile(r"_?joint_?states?_?", re.IGNORECASE)
"""What the names of topics of joint states have in common."""
SAME_MOTION = 0.02
"""Share of a motion up to which two topics that differ by it are of one robot."""
FEWEST_MESSAGES = 50


@dataclass(frozen=True)
class Robots:
    """Who has which joints.

    Attributes:
        main: topic of the joint states whose messages are the rows.
        joints: names in the log by names in the messages, of each topic of joint states.
        leaders: topics of arms that are led by hand.
        words: that tell a topic from the others, by topic.
    """

    main: str
    joints: Mapping[str, Mapping[str, str]]
    leaders: frozenset[str]
    words: Mapping[str, frozenset[str]]

    def owner(self, topic: str, joint: str) -> tuple[str, str] | None:
        """The joint states that a command of a topic is for, and the joint's name in the log.

        None where several have the joint, and the name of the topic tells none of them.
        """
        having = [state for state, names in self.joints.items() if joint in names and state not in self.leaders]
        if not having:
            return self.main, joint
        said, parts = _words(topic), topic.strip("/").split("/")
        told = having if len(having) == 1 else [state for state in having if self.words[state] <= said]
        alike = {state: [a == b for a, b in zip(parts, state.strip("/").split("/"), strict=False)] for state in told}
        rank = {state: (len(self.words[state]), [*alike[state], False].index(False)) for state in told}
        best = [state for state in told if rank[state] == max(rank.values())]
        return (best[0], self.joints[best[0]][joint]) if len(best) == 1 else None


def robots_of(states: Mapping[str, Topic], times: Mapping[str, Array], main: str) -> Robots:
    """Tell robots apart whose joints have the same names and other positions.

    Args:
        states: topics of joint states.
        times: of the messages of each topic [s].
        main: topic whose messages are the rows.
    """
    known = {topic: held.with_positions() for topic, held in states.items()}
    several: set[str] = set()
    for pair in combinations(states, 2):
        shared = [joint for joint in known[pair[0]] if joint in known[pair[1]]]
        filtered = is_a("filtered", *_words(pair[0]), *_words(pair[1]))
        if not filtered and any(_differ([(states[topic], times[topic]) for topic in pair], joint) for joint in shared):
            several |= {*pair}
    names = _names(sorted(several))
    called = {topic: {joint: _join(names[topic], joint) for joint in known[topic]} for topic in several}
    arms = {topic: ARM.fullmatch(_join(names[topic], "joint")) for topic in several}
    leaders: set[str] = set()
    for (lead, first), (follow, second) in permutations(arms.items(), 2):
        if first and second and first[2] and second[3] and beside(first) == beside(second):
            leaders.add(lead)
            for topic in (lead, follow):
                matches = {joint: ARM.fullmatch(name) for joint, name in called[topic].items()}
                called[topic] = {joint: beside(match) if match else joint for joint, match in matches.items()}
    called.setdefault(main, {joint: _join("", joint) for joint in known[main]})
    words = {topic: frozenset(_words(names.get(topic, ""))) for topic in called}
    return Robots(main, called, frozenset(leaders), words)


def _join(name: str, joint: str) -> str:
    return "_".join(part for part in (name, joint.replace("/", "_")) if part)


def _words(text: str) -> set[str]:
    return {word.lower() for word in re.split(r"[/_]", text) if word}


def _names(topics: Sequence[str]) -> dict[str, str]:
    """What tells topics of joint states apart: ``left`` of ``/left/joint_states`` beside ``/right/joint_states``."""
    rest = {topic: topic.strip("/").split("/") for topic in topics}
    for end in (-1, 0):
        while len(rest) > 1 and all(rest.values()) and len({parts[end] for parts in rest.values()}) == 1:
            rest = {topic: parts[:-1] if end else parts[1:] for topic, parts in rest.items()}
    names = {topic: "_".join(parts) for topic, parts in rest.items()}
    short = {topic: STATES.sub("", name) for topic, name in names.items()}
    short = {topic: f"robot{name}" if name.isdigit() else name for topic, name in short.items()}
    return short if len(set(short.values())) == len(short) else names


def _differ(pair: Sequence[tuple[Topic, Array]], joint: str) -> bool:
    """Whether two topics say other positions of a joint at the same times."""
    (few, own), (many, times) = sorted(pair, key=lambda one: len(one[1]))  # lines between few would be another motion
    values, second = few.column(f"{joint}.position"), many.between(f"{joint}.position", times, own)
    good = np.isfinite(values) & np.isfinite(second)
    if good.sum() < FEWEST_MESSAGES:
        return False
    apart = float(np.sqrt(np.mean((values[good] - second[good]) ** 2)))
    return apart > SAME_MOTION * max(float(values[good].std()), float(second[good].std())) + 1e-9
