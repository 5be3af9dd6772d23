"""The finder against hidden arms: two links and six joints, one effect at one joint, nulls and strangers.

``python -m benchmarks.hidden_arm`` (``make hidden-arm``) runs the matrix and writes ``results/hidden_arm.md`` from
``hidden_arm.jsonl``, where every arm that is done is kept: it can be stopped and goes on. A part of it by words of its
keys: ``python -m benchmarks.hidden_arm two_link friction``. Seeds below 900 are for development.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sealegs.common.markdown import page, table
from sealegs.gap.finder.diagnosis import diagnose

from benchmarks.hidden import revision, row_of
from benchmarks.kept import RESULTS, Kept, command, study, write
from testbed.arm import ARMS, record_arm
from testbed.arm_effects import EFFECTS, STRANGERS
from testbed.logs import hidden_arm

FIRST_SEED = 900
SURE = 0.9
"""Confidence from which a wrong name counts as wrong with confidence."""
NULLS = 20


@dataclass(frozen=True)
class Case:
    """One hidden arm: what it hides, at which joint, how large; nothing in a null."""

    arm: str
    effect: str
    joint: str
    size: str
    seed: int

    @property
    def key(self) -> str:
        """Name in the results."""
        hidden = f"{self.effect} {self.joint} {self.size}" if self.effect else "null"
        return f"{self.arm} {hidden} #{self.seed}"


def cases() -> Iterator[Case]:
    """The matrix in a fixed order; the joint is drawn with the seed."""
    number = 0
    for arm, bodies in ARMS.items():
        names = [body.joint for body in bodies]
        usable = names if arm == "two_link" else names[1:4]  # those that gravity acts on and that carry something
        for size in ("clear", "moderate"):
            for effect in (*EFFECTS, *STRANGERS):
                seed = FIRST_SEED + number
                yield Case(arm, effect, usable[seed % len(usable)], size, seed)
                number += 1
        for k in range(NULLS):
            yield Case(arm, "", "", "", FIRST_SEED + 500 + k)


def run(case: Case, causes: Sequence[str] | None = None, **recording: Any) -> dict[str, Any]:
    """Record and diagnose one arm: a row of the results."""
    effects = {case.effect: (case.joint, case.size)} if case.effect else {}
    with tempfile.TemporaryDirectory() as folder:
        data, truth = hidden_arm(Path(folder), case.arm, effects, case.seed, **recording)
        began = time.perf_counter()
        found = diagnose(data, causes=causes)
    hidden = truth["effects"].get(case.effect)
    return {
        "key": case.key,
        "hidden": hidden and {name: hidden[name] for name in ("cause", "joint", "value", "everywhere")},
        "revision": revision(),
        "seconds": time.perf_counter() - began,
        "joints": {
            joint.joint: {
                "verdict": joint.verdict,
                "gap": {name: error.rmse for name, error in joint.gap.items()},
                "causes": [row_of(cause) for cause in joint.causes],
            }
            for joint in found
        },
    }


def false_names(row: dict[str, Any]) -> list[tuple[str, str]]:
    """Joint and cause of all that is named with confidence and is not hidden there."""
    hidden = row["hidden"] or {"cause": "", "joint": "", "everywhere": False}
    return [
        (joint, cause["name"])
        for joint, item in row["joints"].items()
        for cause in item["causes"]
        if cause["confidence"] >= SURE
        and not (cause["name"] == hidden["cause"] and (hidden["everywhere"] or joint == hidden["joint"]))
    ]


def outcome(row: dict[str, Any]) -> str:
    """``right``, ``doubtful`` (named among rivals, or not sure), ``missed``, or ``wrong`` with confidence; of a null
    ``quiet`` or ``wrong``; of a stranger ``flagged``, ``missed`` or ``wrong``.
    """
    hidden, joints = row["hidden"], row["joints"]
    false = false_names(row)
    if hidden is None:
        return "wrong" if false else "quiet"
    where = {joint for joint in joints if hidden["everywhere"] or joint == hidden["joint"]}
    if not hidden["cause"]:  # a stranger
        at = joints[hidden["joint"]]["verdict"]
        return "wrong" if false else "flagged" if at in ("not identifiable", "partly explained") else "missed"
    first = [item["causes"][0] for joint, item in joints.items() if joint in where and item["causes"]]
    if any(cause["name"] == hidden["cause"] for cause in first):
        return "wrong" if any(joint not in where for joint, _ in false) else "right"
    if any(hidden["cause"] in cause["rivals"] for cause in first):
        return "doubtful"
    return "wrong" if false else "missed"


def true_number(row: dict[str, Any], joint: str) -> float:
    """What the number of a hidden cause is at a joint: the arm of the row is drawn again, without its logs."""
    arm, effect, at, size, seed = row["key"].split()
    where = joint if joint in {body.joint for body in ARMS[arm]} else at  # what joints share belongs to the robot
    with tempfile.TemporaryDirectory() as folder:
        _, truth = record_arm(Path(folder), arm, {effect: (where, size)}, int(seed.lstrip("#")), runs=0)
    return float(truth["effects"][effect]["number"])


def covered(rows: Sequence[dict[str, Any]]) -> list[bool]:
    """Whether the interval of a right cause covers the truth, of every joint of every arm that is right."""
    found = []
    for row in rows:
        hidden = row["hidden"]
        if outcome(row) != "right":
            continue
        for joint, item in row["joints"].items():
            if not (hidden["everywhere"] or joint == hidden["joint"]):
                continue
            for cause in item["causes"]:
                if cause["name"] == hidden["cause"]:
                    ends = [(low, high) for _, low, high, *_ in cause["parameters"].values()]
                    found.append(len(ends) == 1 and ends[0][0] <= true_number(row, joint) <= ends[0][1])
    return found


def shares(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Lines of the page: the figures that a bar is set for."""
    lines = []

    def line(what: str, good: int, count: int) -> None:
        if count:
            lines.append(f"- {what}: {good} of {count} ({good / count:.0%})")

    outcomes = [(row, outcome(row)) for row in rows]
    known = [found for row, found in outcomes if row["hidden"] and row["hidden"]["cause"]]
    line("right cause at the right joint first", known.count("right"), len(known))
    inside = covered(rows)
    line("the interval covers the truth, joint by joint", sum(inside), len(inside))
    false = [(row, false_names(row)) for row in rows if row["hidden"]]
    beside = [row for row, names in false if any(joint != row["hidden"]["joint"] for joint, _ in names)]
    line(f"another joint named with {SURE:g} or more", len(beside), len(false))
    line(f"any false name with {SURE:g} or more, beside the right one too", sum(bool(n) for _, n in false), len(false))
    nulls = [row for row in rows if not row["hidden"]]
    loud = sum(len(false_names(row)) for row in nulls)
    line(f"joints of nulls with a cause named with {SURE:g} or more", loud, sum(len(row["joints"]) for row in nulls))
    strange = [found for row, found in outcomes if row["hidden"] and not row["hidden"]["cause"]]
    line("strangers flagged", strange.count("flagged"), len(strange))
    made = sorted({row.get("revision", "?") for row in rows})
    return [*lines, f"- revision of gap, actuators and the plant: {', '.join(made)}"]


def named(row: dict[str, Any]) -> str:
    """What was named at the joints of an arm."""
    return "; ".join(
        f"{joint}: " + ", ".join(f"{c['name']} {c['confidence']:.2f}" for c in item["causes"])
        for joint, item in row["joints"].items()
        if item["causes"]
    )


def told(rows: Sequence[dict[str, Any]]) -> str:
    """The results as Markdown: one line per arm."""
    counts = Counter(outcome(row) for row in rows)
    cells = (
        (row["key"], outcome(row), named(row) or "-", f"{row['seconds'] / max(len(row['joints']), 1):.0f}")
        for row in rows
    )
    return page(
        "Hidden effects on arms",
        f"{len(rows)} of {sum(1 for _ in cases())} arms with two or six joints, at 10 kHz, whose plant shares no code "
        "with the project (`testbed/arm_physics.py`); nominal numbers are 5 % wrong. Made by "
        "`python -m benchmarks.hidden_arm`, which can be stopped and goes on. Right: the hidden cause is the first at "
        "its joint, and none is named with "
        f"{SURE:g} or more at another. Flagged: a stranger's joint is said to be open. Quiet: nothing is named with "
        f"{SURE:g} or more where nothing is hidden.",
        ", ".join(f"{name} {count}" for name, count in sorted(counts.items())) + f" of {len(rows)} arms.",
        "\n".join(shares(rows)),
        table(("arm", "outcome", "what was named", "s per joint"), cells),
    )


@study
def main() -> None:
    """Run what is not done yet of the cases whose keys hold all words, and write the page of all that is done."""
    parser = command(__doc__)
    parser.add_argument("words", nargs="*", help="of the keys of cases; default: all")
    words, kept = parser.parse_args().words, Kept(RESULTS / "hidden_arm.jsonl")
    kept.run(run, [c for c in cases() if c.key not in kept and all(word in c.key for word in words)], outcome)
    write("hidden_arm", told(kept.rows))
    print(Counter(outcome(row) for row in kept.rows))


if __name__ == "__main__":
    sys.exit(main())
