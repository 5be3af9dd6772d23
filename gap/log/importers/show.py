"""A proposed mapping as a person reads it: YAML with a reason behind each line."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from .expression import quoted
from .lines import ASK, LIKELY
from .proposal import Proposal
from .recording import Recording

LINE_WIDTH = 118
MARKS = {ASK: "? ", LIKELY: "likely: "}


def proposal_text(
    proposal: Proposal,
    sidecar: Mapping[str, Any],
    recordings: Sequence[Recording],
    command: str,
    left: Sequence[str],
    said: Sequence[str] = (),
) -> str:
    """The mapping file that is shown, edited and read again.

    Args:
        proposal: what is proposed.
        sidecar: of the logs.
        recordings: that it is for.
        command: that imports with it.
        left: sentences on recordings that are left out.
        said: notes on the proposal, without the sign at their end.
    """
    first = recordings[0]
    rows = sum(recording.length for recording in recordings)
    count = f"{len(recordings)} recordings" if len(recordings) > 1 else "1 recording"
    lines = [
        f"# How {first.source if len(recordings) == 1 else first.source.parent} becomes a log: {count}, {rows} samples."
    ]
    lines += ["# Correct what is wrong; columns that are not wanted are removed. Then:", f"#   {command}"]
    lines += [f"# Note: {note}." for note in dict.fromkeys([*(n for one in recordings for n in one.notes), *said])]
    lines += [f"# Left out: {one}" for one in left]
    lines.append("columns:")
    entries = [
        (name, _scalar(read.text), MARKS.get(read.trust, "") + read.why) for name, read in proposal.columns.items()
    ]
    margin = min(max((len(name) + len(text) for name, text, _ in entries), default=0) + 6, 60)
    for name, text, why in entries:
        head = f"  {name}: {text}".ljust(margin)
        first_line, *more = textwrap.wrap(why, max(LINE_WIDTH - margin - 4, 40)) or [""]
        lines.append(f"{head}  # {first_line}")
        lines += [" " * margin + f"  # {line}" for line in more]
    if proposal.where:
        lines.append(f"where: {_scalar(proposal.where)} # samples that are kept: others have no goal or no position")
    if proposal.questions:
        lines.append("questions: # the import waits for these: correct the lines above, then remove the question")
        for question in proposal.questions:
            lines.append(f"- about: [{', '.join(question.about)}]")
            lines += [f"  ask: {_scalar(question.ask)}"]
    if proposal.unused:
        lines.append("unused: # columns of the file, and why")
        lines += [f"  {_scalar(name)}: {_scalar(why)}" for name, why in proposal.unused.items()]
    if sidecar:
        lines.append("sidecar: # ${...} stands for a number or word of the file")
        lines.append(
            textwrap.indent(
                yaml.safe_dump(dict(sidecar), sort_keys=False, allow_unicode=True, width=LINE_WIDTH), "  "
            ).rstrip()
        )
    else:
        lines.append(
            "# sidecar: {robot: bench, robot_params: {mass: 0.5, length: 0.1}, actuators: {...}} # or fill it in later"
        )
    numbers = {key: value for key, value in first.facts.items() if not isinstance(value, str)}
    if numbers:
        lines.append(
            "# Numbers of the file: " + ", ".join(f"{quoted(key)} = {value:g}" for key, value in numbers.items())
        )
    return "\n".join(lines) + "\n"


def _scalar(text: str) -> str:
    """Text as a YAML value on one line."""
    return (
        yaml.safe_dump(text, allow_unicode=True, width=10**6, default_flow_style=True)
        .strip()
        .removesuffix("\n...")
        .strip()
    )
