"""What a joint of a robot costs beside a servo on a bench: ``python -m benchmarks.robot_cost``.

Both hide the same kind of friction, are as long, and consider the same causes. Processor time of all threads counts, so
that it matters little what else the machine does. How many fits a search needs depends on the machine that hides the
friction, up to twice from one seed to the next: sums over seeds are compared. Writes ``results/robot_cost.{json,md}``;
rows that are done are kept.
Wanted: a joint of a six-joint arm within 1.5 times of the bench, and time in proportion to joints and rows.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from sealegs.common.markdown import page, table
from sealegs.gap.finder.diagnosis import diagnose, diagnose_joint
from sealegs.gap.load.robot import Machine
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.prepare.pieces import cut_joint
from sealegs.gap.prepare.request import Request

from benchmarks.kept import CHECKOUT, command, read, study, write
from testbed.logs import hidden_arm, hidden_bench

CAUSES = ("friction.coulomb", "friction.load_dependent", "drive.delay", "drive.gain")
JOINT = "shoulder_lift"
KINDS = ("bench", "arm")
LENGTHS = (6.0, 12.0, 24.0)  # [s] of each of three runs
WANTED = 1.5
SEEDS = (31, 32, 33, 34, 35)


def bench(length: float, seed: int) -> MeasuredSet:
    """A servo on a bench."""
    data, _ = hidden_bench({"friction.load_dependent": "clear"}, seed, ("medium",) * 3, duration=length)
    return data


def arm(length: float, seed: int) -> MeasuredSet:
    """Six joints, of which one hides friction; all are logged."""
    with tempfile.TemporaryDirectory() as folder:
        kept = Path(folder)
        data, _ = hidden_arm(kept, "six_joint", {"load_friction": (JOINT, "clear")}, seed, duration=length)
        model = CHECKOUT / "build" / "robot_cost.xml"
        model.parent.mkdir(exist_ok=True)
        model.write_text((kept / "arm.xml").read_text(), encoding="utf-8")
    return replace(data, runs=tuple(replace(run, robot=str(model)) for run in data.runs))


def spent(work: Callable[[], Any]) -> tuple[float, Any]:
    """Processor time of all threads [s], and what comes of the work."""
    began = time.process_time()
    result = work()
    return time.process_time() - began, result


def row(kind: str, length: float, seed: int) -> dict[str, Any]:
    """Time of one joint: of its load along the log, of a hundred replays, and of its diagnosis."""
    data = bench(length, seed) if kind == "bench" else arm(length, seed)
    joint = next(iter(data.runs[0].joints)) if kind == "bench" else JOINT
    request = Request(causes=CAUSES)
    load, _ = spent(lambda: cut_joint(Machine.of(data.runs), joint, None))
    whole, found = spent(lambda: diagnose_joint(Machine.of(data.runs), joint, (), request))
    problem = found.problem
    assert problem is not None
    replays, _ = spent(lambda: problem.simulate([{}] * 100))
    return {
        "kind": kind,
        "seconds": length,
        "seed": seed,
        "rows": sum(len(run.time) for run in data.runs),
        "load": load,
        "replays": replays,
        "diagnosis": whole,
        "causes": [cause.name for cause in found.causes],
    }


def told(rows: list[dict[str, Any]]) -> str:
    """The results as Markdown."""
    cells = []
    for length in LENGTHS:
        of = {kind: [one for one in rows if (one["kind"], one["seconds"]) == (kind, length)] for kind in KINDS}
        if any(len(found) < len(SEEDS) for found in of.values()):
            continue

        def mean(kind: str, key: str, of: dict[str, list[dict[str, Any]]] = of) -> float:
            return sum(one[key] for one in of[kind]) / len(of[kind])

        pairs = [other["diagnosis"] / one["diagnosis"] for one, other in zip(of["bench"], of["arm"], strict=True)]
        ratio = mean("arm", "diagnosis") / mean("bench", "diagnosis")
        cells.append((
            f"3 x {length:g} s", f"{of['arm'][0]['rows']:,}", f"{mean('bench', 'diagnosis'):.1f}",
            f"{mean('arm', 'load'):.1f}", f"{mean('arm', 'diagnosis'):.1f}",
            f"{ratio:.2f} ({min(pairs):.2f} to {max(pairs):.2f})",
            f"{mean('arm', 'replays') / mean('bench', 'replays'):.2f}",
        ))  # fmt: skip
    heads = ("log", "rows", "bench: diagnosis", "arm: load", "arm: diagnosis", "ratio", "replays, ratio")
    return page(
        "A joint of a robot beside a bench (`python -m benchmarks.robot_cost`)",
        f"Processor time [s] of one joint, {len(CAUSES)} causes, mean of {len(SEEDS)} hidden machines. Wanted: at most "
        f"{WANTED:g} times the bench. In brackets: lowest and highest ratio of one pair.",
        table(heads, cells),
    )


@study
def main() -> None:
    """Measure what is not measured yet, and write the page."""
    command(__doc__).parse_args()
    rows: list[dict[str, Any]] = read("robot_cost", [])
    done = {(item["kind"], item["seconds"], item["seed"]) for item in rows}
    todo = [(kind, length, seed) for length in LENGTHS for seed in SEEDS for kind in KINDS]
    if todo := [item for item in todo if item not in done]:
        diagnose(bench(3.0, SEEDS[0]), causes=CAUSES[:1])  # both compile
        diagnose(arm(3.0, SEEDS[0]), causes=CAUSES[:1], only=(JOINT,))
    for kind, length, seed in todo:
        rows.append(row(kind, length, seed))
        print(json.dumps(rows[-1]), flush=True)
        write("robot_cost", None, rows)
    write("robot_cost", told(rows))


if __name__ == "__main__":
    sys.exit(main())
