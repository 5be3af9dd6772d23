"""The SO-101 arm, joint by joint: ``python -m benchmarks.so101``. Writes ``results/so101.{json,md}``.

Six Feetech STS3215 on a table, 8 motions at 50 Hz, whose load on each joint is not known. Windows of all motions are
diagnosed (as of a long log), one joint after the other; finished joints are kept in ``so101.jsonl`` while it runs, so
that it can be stopped and resumed.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from sealegs.configs.script import run
from sealegs.gap.checks.long import read_bounded
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.output.files import to_document
from sealegs.gap.verdict.diagnosis import diagnose
from sealegs.gap.verdict.verdict import NOT_IDENTIFIABLE, JointDiagnosis

from benchmarks.real_data import RESULTS, cause_lines, recorded

ROWS = 12_000  # that are replayed: 240 s
LATE, FRICTION = ("drive.delay", "sensor.delay"), "friction."
COLUMNS = {"velocity.scale": "velocity over the derivative", "current.unsigned": "unsigned current"}


def only(data: MeasuredSet, joint: str) -> MeasuredSet:
    """The set with one joint."""
    runs = tuple(
        replace(run, joints={joint: run.joints[joint]}, actuators={joint: run.actuators[joint]}) for run in data.runs
    )
    return replace(data, runs=runs, findings=tuple(f for f in data.findings if f.joint in (joint, None)))


def drive(found: JointDiagnosis) -> dict[str, float]:
    """Delays and friction of the extended joint."""
    if found.problem is None or found.problem.joint is None:
        return {}
    joint = found.problem.joint.models[0].with_fitted(found.values)
    paths = ("delay.seconds", "encoder.latency", "friction.coulomb", "friction.viscous", "friction.stribeck",
             "friction.load", "friction.load_quadratic", "friction.load_stribeck")  # fmt: skip
    return {path: float(joint.value(path)) for path in paths}


def told_apart(causes: list[dict[str, Any]]) -> str:
    """Whether lateness and friction are told apart: nothing that is named has a rival of the other kind."""

    def kind(name: str) -> str:
        return "delay" if name in LATE else "friction" if name.startswith(FRICTION) else ""

    mixed = [
        f"{cause['name']} or {rival}"
        for cause in causes
        for rival in cause["rivals"]
        if {kind(cause["name"]), kind(rival)} == {"delay", "friction"}
    ]
    if mixed:
        return f"no: {', '.join(mixed)}"
    kinds = sorted({kind(cause["name"]) for cause in causes} - {""})
    return f"yes: {' and '.join(kinds)} named" if kinds else "neither is named"


def row(data: MeasuredSet, joint: str) -> dict[str, Any]:
    """What a joint's line tells."""
    began = time.perf_counter()
    (found,) = diagnose(only(data, joint), progress=lambda text: print(f"  {joint}: {text}", flush=True))
    document = to_document(found)
    return {
        "joint": joint,
        "verdict": document["verdict"],
        "error": {name: 1e3 * error.mae for name, error in found.gap.items()},
        "causes": [cause for cause in document["causes"] if cause["kind"] != "data"],
        "drive": drive(found),
        "columns": {COLUMNS[f.code]: f.value for f in found.findings if f.data_error and f.code in COLUMNS},
        "sentence": found.text,
        "seconds": time.perf_counter() - began,
    }


def page(rows: list[dict[str, Any]]) -> str:
    """The table as Markdown."""
    lines = [
        "# SO-101 arm, joint by joint",
        "",
        "Written by `python -m benchmarks.so101`; do not edit. Mean absolute position error [mrad; gripper: 1/1000 of",
        f"its opening] on windows that nothing was fitted to, of {ROWS:,} samples in all. Refitted: every number of",
        "the nominal model may move up to fivefold, and no cause is added.",
        "",
        "| joint | verdict | nominal | refitted | extended | causes (share of the gap, confidence) "
        "| delay told from friction | wrong columns |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for item in rows:
        causes = "; ".join(f"{c['name']} ({c['share']:.0%}, {c['confidence']:.2f})" for c in item["causes"]) or "-"
        columns = "; ".join(f"{words} {value:.3g}" if value else words for words, value in item["columns"].items())
        errors = [
            f"{item['error'][name]:.1f}" if item["error"] else "-" for name in ("nominal", "refitted", "extended")
        ]
        apart = "-" if item["verdict"] == NOT_IDENTIFIABLE else told_apart(item["causes"])
        lines.append(
            f"| {item['joint']} | {item['verdict']} | {' | '.join(errors)} | {causes} | {apart} | {columns or '-'} |"
        )
    for item in rows:
        lines += ["", f"**{item['joint']}**: {item['sentence']}", "", *cause_lines(item["causes"])]
        if item["drive"]:
            late = 1e3 * (item["drive"]["delay.seconds"] + item["drive"]["encoder.latency"])
            rest = ", ".join(f"{path} {value:.3g}" for path, value in item["drive"].items() if value and "fric" in path)
            lines += ["", f"Extended: commands and readings {late:.1f} ms late; {rest}."]
    return "\n".join(lines) + "\n"


def main(arguments: list[str]) -> None:
    """Diagnose the joints that are still to do, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.so101")
    parser.add_argument("--out", type=Path, default=RESULTS / "so101.jsonl", help="finished joints; the page beside it")
    kept = parser.parse_args(arguments).out
    rows = [json.loads(line) for line in kept.read_text().splitlines()] if kept.is_file() else []
    data = recorded("so101", "so101_arm", lambda logs: read_bounded(logs, ROWS))
    for joint in data.runs[0].joints:
        if joint not in {item["joint"] for item in rows}:
            rows.append(row(data, joint))
            with kept.open("a") as file:
                file.write(json.dumps(rows[-1], default=float) + "\n")
    kept.with_suffix(".json").write_text(json.dumps(rows, indent=1, default=float) + "\n")
    kept.with_suffix(".md").write_text(page(rows))
    kept.unlink()
    print(page(rows))


if __name__ == "__main__":
    if {"-h", "--help"} & set(sys.argv[1:]):
        sys.exit(print((__doc__ or "").strip()))
    sys.exit(run(main, "", "", sys.argv[1:]))
