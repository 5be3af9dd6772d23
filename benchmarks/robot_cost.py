"""What a joint of a robot costs beside a servo on a bench: ``python -m benchmarks.robot_cost``.

Both hide the same kind of friction, are as long, and consider the same causes. Processor time of all threads counts, so
that it matters little what else the machine does. Writes ``results/robot_cost.{json,md}``; rows that are done are kept.
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

from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.verdict.diagnosis import diagnose, diagnose_joint
from sealegs.gap.verdict.pieces import cut_joint
from sealegs.gap.verdict.request import Request

from testbed.logs import hidden_arm, hidden_bench

RESULTS = Path(__file__).parent / "results" / "robot_cost"
CAUSES = ("friction.coulomb", "friction.load_dependent", "drive.delay", "drive.gain")
JOINT = "shoulder_lift"
LENGTHS = (6.0, 12.0, 24.0)  # [s] of each of three runs
WANTED = 1.5
SEED = 31


def bench(length: float) -> MeasuredSet:
    """A servo on a bench."""
    data, _ = hidden_bench({"friction.load_dependent": "clear"}, SEED, ("medium",) * 3, duration=length)
    return data


def arm(length: float) -> MeasuredSet:
    """Six joints, of which one hides friction; all are logged."""
    with tempfile.TemporaryDirectory() as folder:
        kept = Path(folder)
        data, _ = hidden_arm(kept, "six_joint", {"load_friction": (JOINT, "clear")}, SEED, duration=length)
        model = RESULTS.parent.parent.parent / "build" / "robot_cost.xml"
        model.parent.mkdir(exist_ok=True)
        model.write_text((kept / "arm.xml").read_text(), encoding="utf-8")
    return replace(data, runs=tuple(replace(run, robot=str(model)) for run in data.runs))


def spent(work: Callable[[], Any]) -> tuple[float, Any]:
    """Processor time of all threads [s], and what comes of the work."""
    began = time.process_time()
    result = work()
    return time.process_time() - began, result


def row(kind: str, length: float) -> dict[str, Any]:
    """Time of one joint: of its load along the log, of a hundred replays, and of its diagnosis."""
    data = bench(length) if kind == "bench" else arm(length)
    joint = next(iter(data.runs[0].joints)) if kind == "bench" else JOINT
    request = Request(causes=CAUSES)
    load, _ = spent(lambda: cut_joint(data.runs, joint, None))
    whole, found = spent(lambda: diagnose_joint(data.runs, joint, (), request))
    problem = found.problem
    assert problem is not None
    replays, _ = spent(lambda: problem.simulate([{}] * 100))
    return {
        "kind": kind,
        "seconds": length,
        "rows": sum(len(run.time) for run in data.runs),
        "load": load,
        "replays": replays,
        "diagnosis": whole,
        "causes": [cause.name for cause in found.causes],
    }


def page(rows: list[dict[str, Any]]) -> str:
    """The results as Markdown."""
    by = {(item["kind"], item["seconds"]): item for item in rows}
    lines = [
        "# A joint of a robot beside a bench (`python -m benchmarks.robot_cost`)",
        "",
        f"Processor time [s] of one joint, {len(CAUSES)} causes. Wanted: at most {WANTED:g} times the bench.",
        "",
        "| log | rows | bench: diagnosis | arm: load | arm: diagnosis | ratio | replays, ratio |",
        "|---|---|---|---|---|---|---|",
    ]
    for length in LENGTHS:
        one, other = by.get(("bench", length)), by.get(("arm", length))
        if one and other:
            lines.append(
                f"| 3 x {length:g} s | {other['rows']:,} | {one['diagnosis']:.1f} | {other['load']:.1f} | "
                f"{other['diagnosis']:.1f} | {other['diagnosis'] / one['diagnosis']:.2f} | "
                f"{other['replays'] / one['replays']:.2f} |"
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure what is not measured yet, and write the page."""
    kept = RESULTS.with_suffix(".json")
    rows: list[dict[str, Any]] = json.loads(kept.read_text()) if kept.is_file() else []
    done = {(item["kind"], item["seconds"]) for item in rows}
    if not done:
        diagnose(bench(3.0), causes=CAUSES[:1])  # both compile
        diagnose(arm(3.0), causes=CAUSES[:1], only=(JOINT,))
    for length in LENGTHS:
        for kind in ("bench", "arm"):
            if (kind, length) not in done:
                rows.append(row(kind, length))
                print(json.dumps(rows[-1]), flush=True)
                kept.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    RESULTS.with_suffix(".md").write_text(page(rows), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
