"""Runs under faults drawn at random: whether any ends with torque on and nothing said, or with a false alarm.

    python -m benchmarks.fault_schedules              # seeds 1000 to 1299; writes benchmarks/results/fault_schedules.md
    python -m benchmarks.fault_schedules 5000 40      # forty from 5000 on; their rows stand beside the others

Each seed is one run in simulated time: one to three faults, a policy whose calls may take longer than a period, an
adapter that may come back under another name, an emergency stop and a supervisor's death now and then. What the seeds
are and how a run is judged is in ``tests/hw/test_fault_schedules.py``, which tests run daily with seeds of their own.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as Xml
from collections import Counter
from pathlib import Path
from typing import Any

from sealegs.common.errors import SealegsError
from sealegs.common.markdown import page, table

from benchmarks.kept import CHECKOUT, RESULTS, Kept, command, study, write

FIRST, NUMBER = 1000, 300
LONGEST = 300  # characters of a finding that are kept
TEST = "tests/hw/test_fault_schedules.py::test_no_run_ends_with_torque_on_unsaid_or_a_false_alarm"
ROBOTS = {
    "feetech": "Feetech servos on one adapter: bench, four in a row, the hopper's committed policy",
    "dynamixel": "Dynamixels on one adapter: bench, hopper",
    "two": "a hopper on two adapters, of Feetech both, or the second one of Dynamixels",
    "biped": "the biped's committed policy, 11 Feetech servos",
    "hexapod": "the hexapod's committed policy, 24 Feetech servos",
}


Row = dict[str, Any]


def run(first: int, number: int, processes: int) -> list[Row]:
    """Kind, seed, finding and date of each run; no finding is ""."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "runs.xml"
        words = [sys.executable, "-m", "pytest", "-q", "-n", str(processes), "--tb=short", f"--junitxml={file}", TEST]
        subprocess.run(words, cwd=CHECKOUT, env={**os.environ, "SEALEGS_SCHEDULES": f"{first} {number}"}, check=False)
        found = []
        for case in Xml.parse(file).getroot().iter("testcase"):
            kind, seed = re.findall(r"\[(\w+)-(\d+)\]", case.get("name", ""))[0]
            problems = [item.get("message", "") for item in case if item.tag in ("failure", "error")]
            finding = problems[0].splitlines()[0][:LONGEST] if problems else ""
            found.append({"kind": kind, "seed": int(seed), "finding": finding, "date": time.strftime("%Y-%m-%d")})
        return found


def told(rows: list[Row]) -> str:
    """The results as a page of Markdown."""
    runs, bad = Counter(row["kind"] for row in rows), Counter(row["kind"] for row in rows if row["finding"])
    dates = sorted({row["date"] for row in rows})
    cells = [(what, runs[kind], bad[kind]) for kind, what in ROBOTS.items()]
    return page(
        "Fault schedules",
        f"{len(rows)} runs in simulated time under faults drawn at random, with the seeds {spans(rows)}; "
        f"{' and '.join(dates)}. `python -m benchmarks.fault_schedules`",
        "A finding is a run that ends with torque on and nothing said, names a servo at its last word that is released "
        "and answers, leaves a log that does not read back, or does not name a fault that certainly shows.",
        table(("robot", "runs", "findings"), [*cells, ("all", len(rows), bad.total())]),
        *(f"Seed {row['seed']} ({row['kind']}): {row['finding']}" for row in rows if row["finding"]),
    )


def spans(rows: list[Row]) -> str:
    """Seeds in words."""
    seeds = [row["seed"] for row in rows]
    starts = [seed for seed in seeds if seed - 1 not in seeds]
    ends = [seed for seed in seeds if seed + 1 not in seeds]
    return ", ".join(f"{start} to {end}" for start, end in zip(starts, ends, strict=True))


@study
def main() -> int:
    """Run, print, and write what was found; return the exit status."""
    parser = command(__doc__)
    parser.add_argument("first", nargs="?", type=int, default=FIRST, help="seed")
    parser.add_argument("number", nargs="?", type=int, default=NUMBER, help="of seeds")
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    try:
        found = run(arguments.first, arguments.number, arguments.processes)
    except (FileNotFoundError, Xml.ParseError):
        raise SealegsError("The runs did not begin; what pytest said is above.") from None
    kept = Kept(RESULTS / "fault_schedules.jsonl")
    rows = {row["seed"]: row for row in (*kept.rows, *found)}
    ordered = [rows[seed] for seed in sorted(rows)]
    kept.file.write_text("".join(json.dumps(row) + "\n" for row in ordered), encoding="utf-8")
    write("fault_schedules", told(ordered))
    print("\n" + told(ordered))
    return int(any(row["finding"] for row in found))


if __name__ == "__main__":
    sys.exit(main())
