"""Robots of one bag whose joints have the same names: what their joints are called, and whom a command is for."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..claims import ARM
from ..names import is_a
from .topics import Topic

STATES = re.compile(r"_?joint_?states?_?", re.IGNORECASE)
"""What the names of topics of joint states have in common."""
SAME_MOTION_SHARE = 0.02
"""Share of a motion up to which two topics that differ by it are of one robot."""


@dataclass(frozen=True)
class Robots:
    """Who has which joints.

    Attributes:
        main: topic of the joint states whose messages are the rows.
        joints: names in the log by names in the messages, of each topic of joint states.
        words: that tell a topic from the others, by topic.
    """

    main: str
    joints: Mapping[str, Mapping[str, str]]
    words: Mapping[str, frozenset[str]]

    def owner(self, topic: str, joint: str) -> tuple[str, str] | None:
        """The joint states that a command of a topic is for, and the joint's name in the log.

        None where several have the joint, and the name of the topic tells none of them.
        """
        having = [state for state, names in self.joints.items() if joint in names and not is_led(names[joint])]
        if not having:
            return self.main, joint
        said = _words(topic)
        told = having if len(having) == 1 else [state for state in having if self.words[state] <= said]
        rank = {state: len(self.words[state]) for state in told}
        best = [state for state in told if rank[state] == max(rank.values())]
        return (best[0], self.joints[best[0]][joint]) if len(best) == 1 else None


def is_led(joint: str) -> bool:
    """Whether a joint's name says that its arm is led by hand."""
    match = ARM.fullmatch(joint)
    return bool(match and match[2])


def robots_of(states: Mapping[str, Topic], main: str) -> Robots:
    """Tell robots apart whose joints have the same names and other positions.

    Args:
        states: topics of joint states.
        main: topic whose messages are the rows.
    """
    several: set[str] = set()
    for pair in combinations(states, 2):
        shared = [joint for joint in states[pair[0]].with_positions() if joint in states[pair[1]].with_positions()]
        filtered = is_a("filtered", *_words(pair[0]), *_words(pair[1]))
        if not filtered and any(_differ([states[topic] for topic in pair], f"{joint}.position") for joint in shared):
            several |= {*pair}
    names = {**_names(sorted(several)), main: ""} if main not in several else _names(sorted(several))
    called = {
        topic: {
            joint: "_".join(filter(None, (name, joint.replace("/", "_")))) for joint in states[topic].with_positions()
        }
        for topic, name in names.items()
    }
    return Robots(main, called, {topic: frozenset(_words(name)) for topic, name in names.items()})


def _words(text: str) -> set[str]:
    return {word.lower() for word in re.split(r"[/_]", text) if word}


def _names(topics: Sequence[str]) -> dict[str, str]:
    """What tells topics of joint states apart: ``left`` of ``/left/joint_states`` beside ``/right/joint_states``."""
    parts = {topic: topic.strip("/").split("/") for topic in topics}
    common = set.intersection(*map(set, parts.values())) if parts else set()
    names = {topic: "_".join(part for part in own if part not in common) for topic, own in parts.items()}
    short = {topic: STATES.sub("", name) for topic, name in names.items()}
    short = {topic: f"robot{name}" if name.isdigit() else name for topic, name in short.items()}
    return short if len(set(short.values())) == len(short) else {topic: "_".join(own) for topic, own in parts.items()}


def _differ(pair: Sequence[Topic], field: str) -> bool:
    """Whether two topics say other positions of a joint at the same times."""
    few, many = sorted(pair, key=lambda topic: len(topic.frame))  # lines between few would be another motion
    first = few.frame[field].to_numpy(np.float64)
    second = many.between(field, few.time)
    both = np.isfinite(first) & np.isfinite(second)
    if not both.any():
        return False
    apart = float(np.sqrt(np.mean((first - second)[both] ** 2)))
    return apart > SAME_MOTION_SHARE * max(float(first[both].std()), float(second[both].std())) + 1e-9
