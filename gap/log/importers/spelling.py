"""Names of joints as the robot's file spells them, or else the header of a log that names them as logs do."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

from ..types import SIGNAL_UNITS
from .names import said
from .proposed import Proposal

AS_A_LOG = re.compile(rf"([^.]+)\.(?:{'|'.join(SIGNAL_UNITS)})")


def bare(joint: str) -> str:
    """A name without what is only spelling: ``joint_1``, ``Joint1`` and ``joint-1`` are the same."""
    return re.sub(r"[\W_]", "", joint).lower()


def spelled(proposal: Proposal, columns: Iterable[str], robot: Collection[str] = ()) -> Proposal:
    """A proposal whose joints are called as in the robot's file; joints that it lacks as in the header, where that has
    ``<joint>.<signal>``.

    Args:
        proposal: with joints whose names were put together from words.
        columns: header of the file.
        robot: names of the robot's joints.
    """
    columns = list(columns)
    headers = [match[1] for name in columns if (match := AS_A_LOG.fullmatch(name))]
    mine = Counter(bare(joint) for joint in proposal.joints)
    names: dict[str, str] = {}
    for joint in proposal.joints:
        for known in (robot, headers):
            alike = {name for name in known if bare(name) == bare(joint)}
            alike = alike or {name for name in known if bare(said(name).joint) == bare(joint)}  # dof_1, read as joint1
            if len(alike) == 1 and mine[bare(joint)] == 1:
                names[joint] = alike.pop()
                break
    return _renamed(proposal, {old: new for old, new in names.items() if old != new}, set(columns))


def _renamed(proposal: Proposal, names: Mapping[str, str], columns: Collection[str]) -> Proposal:
    if not names:
        return proposal

    def column(name: str) -> str:
        joint, _, signal = name.rpartition(".")
        return f"{names.get(joint, joint)}.{signal}" if joint else name

    return Proposal(
        {column(name): read for name, read in proposal.columns.items()},
        proposal.unused,
        [
            replace(question, about=tuple(map(column, question.about)), ask=_in_words(question.ask, names, columns))
            for question in proposal.questions
        ],
        {names.get(joint, joint) for joint in proposal.slides},
        {names.get(joint, joint): kept for joint, kept in proposal.keep.items()},
    )


def _in_words(text: str, names: Mapping[str, str], columns: Collection[str]) -> str:
    """A sentence with joints by their new names; columns of the file that are called alike keep theirs."""
    new = dict(names) | {f"{old}.{signal}": f"{to}.{signal}" for old, to in names.items() for signal in SIGNAL_UNITS}
    new |= {name: name for name in columns}
    words = "|".join(re.escape(word) for word in sorted(new, key=len, reverse=True))
    return re.sub(rf"(?<![\w.\]])(?:{words})(?![\w\[])", lambda match: new[match[0]], text)
