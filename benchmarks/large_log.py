"""Memory and time of diagnosing logs from a hundred thousand to ten million rows.

    python -m benchmarks.large_log                         writes benchmarks/results/large_log.{json,md}
    python -m benchmarks.large_log --rows 300000           one size

Each log is recorded by a virtual bench whose gearbox loses torque under load; its motion changes kind every minute and
a half, most of it being slow. Every size is read and diagnosed in a process of its own, whose peak memory is taken.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import yaml
from pyarrow import csv as arrow_csv
from pyarrow import parquet
from sealegs.common.markdown import page, table
from sealegs.gap.replay.joint_model import JointModel

from benchmarks.kept import RESULTS, command, study, write

ROWS = (120_000, 1_000_000, 10_000_000)
RATE = 200.0  # [Hz]
STRETCH = 90.0  # [s] of one kind of motion
STILL = 2.0  # [s] at the end of each: the next one is simulated anew from there, which must not show
LOAD = {"mass": 0.5, "arm_mass": 0.03, "length": 0.12}
HIDDEN = {"friction.load": 0.15}
CHAIN = "sts3215"
TICK = 2.0 * np.pi / 4096
NOISE = 3.9e-4  # [rad]


def goals(kind: str, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Goals (n,) [rad] of one stretch of motion."""
    if kind == "steps":
        return rng.uniform(-0.9, 0.9, int(STRETCH / 0.8) + 2)[(t / 0.8).astype(int)]
    if kind == "chirp":
        return 0.5 * np.sin(2 * np.pi * (0.1 * t + 0.01 * t**2))
    if kind == "multisine":
        waves = [0.3 / (1 + f) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.2, 0.5, 1.1, 1.9)]
        return np.sum(waves, axis=0)
    if kind == "rest":
        return np.zeros(len(t))
    return 0.4 * (4 * np.abs((t / 12.0) % 1.0 - 0.5) - 1.0)


def stretches(rows: int, seed: int = 0) -> Iterator[dict[str, np.ndarray]]:
    """Columns of the log, a stretch of motion at a time."""
    from sealegs.actuators import load_chain
    from sealegs.gap.replay.free import NO_TERMS
    from sealegs.gap.replay.simulator import replay

    joint = JointModel(load_chain(CHAIN)).with_values(HIDDEN)
    program = joint.chain.program()
    constants = joint.constants(LOAD, program)
    rng = np.random.default_rng(seed)
    kinds = ("slow", "slow", "rest", "steps", "slow", "chirp", "slow", "multisine")
    size, made, state, held = int(STRETCH * RATE), 0, 0.0, 0.0
    while made < rows:
        count = min(size, rows - made)
        t = np.arange(count) / RATE
        kind = kinds[(made // size) % len(kinds)]
        ramp = np.clip(t / 1.0, 0.0, 1.0)
        goal = held + ramp * (goals(kind, np.minimum(t, STRETCH - STILL), rng) - held)
        out = np.empty((count, 4))
        warm = np.full(count, 30.0)
        replay(program.copy(), constants, NO_TERMS, t, goal, np.ones(count, bool), warm, state, 0.0, 5e-4, out)
        state, held = float(out[-1, 0]), float(goal[-1])
        reading = TICK * np.round((out[:, 0] + rng.normal(0.0, NOISE, count)) / TICK)
        current = 0.0065 * np.round((out[:, 3] + rng.normal(0.0, 0.0065, count)) / 0.0065)
        at = (made + np.arange(count)) / RATE + rng.uniform(-3e-4, 3e-4, count)
        yield {
            "time": at,
            "servo.goal": np.round(goal, 6),
            "servo.position": np.round(reading, 7),
            "servo.duty": np.round(out[:, 2], 3),
            "servo.current": current,
        }
        made += count


def record(path: Path, rows: int) -> None:
    """Write one log with its sidecar."""
    writer: Any = None
    for columns in stretches(rows):
        part = pa.table(columns)
        if writer is None:
            make = arrow_csv.CSVWriter if path.suffix == ".csv" else parquet.ParquetWriter
            writer = make(path, part.schema)
        writer.write_table(part)
    writer.close()
    sidecar = {"robot": "bench", "robot_params": LOAD, "actuators": {"servo": CHAIN}}
    path.with_suffix(".yaml").write_text(yaml.safe_dump(sidecar))


def measure(path: Path) -> dict[str, Any]:
    """Read and diagnose a log in this process; peak memory [MiB] before, after reading and at the end, times [s]."""
    from sealegs.gap.checks.long import read_bounded
    from sealegs.gap.finder.diagnosis import diagnose

    def peak() -> float:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0

    before, began, cpu = peak(), time.perf_counter(), time.process_time()
    data = read_bounded(path)
    reading, held = time.perf_counter() - began, peak()
    (found,) = diagnose(data)
    value = next((v for c in found.causes for p, v in c.parameters.items() if p == "friction.load"), None)
    return {
        "before_mib": before,
        "reading_mib": held,
        "peak_mib": peak(),
        "reading_s": reading,
        "total_s": time.perf_counter() - began,
        "cpu_s": time.process_time() - cpu,
        "windows": len(data.runs),
        "held_rows": sum(len(run.time) for run in data.runs),
        "verdict": found.verdict,
        "causes": {cause.name: [cause.kind, cause.confidence] for cause in found.causes},
        "friction.load": None if value is None else [value.value, value.low, value.high],
    }


@study
def main() -> None:
    """Command line."""
    parser = command(__doc__)
    parser.add_argument("--rows", type=int, nargs="+", default=list(ROWS))
    parser.add_argument("--format", choices=("csv", "parquet"), default="csv")
    parser.add_argument("--measure", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--out", type=Path, default=RESULTS / "large_log")
    options = parser.parse_args()
    if options.measure is not None:
        print(json.dumps(measure(options.measure)))
        return
    results = []
    for rows in options.rows:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"log.{options.format}"
            record(path, rows)
            size = path.stat().st_size / 2**20
            words = [sys.executable, "-m", "benchmarks.large_log", "--measure", str(path)]
            done = subprocess.run(words, capture_output=True, text=True, check=True)
        results.append({"rows": rows, "file_mib": size, **json.loads(done.stdout.splitlines()[-1])})
        print(json.dumps(results[-1]), flush=True)
    write(options.out, told(results), results)


def told(results: Sequence[dict[str, Any]]) -> str:
    """The page."""
    cells = []
    for row in results:
        value = row["friction.load"]
        causes = [f"{name} ({confidence:.2f})" for name, (_, confidence) in row["causes"].items()]
        named = ", ".join(causes) + (f" {value[0]:.3f} [{value[1]:.3f}, {value[2]:.3f}]" if value else "")
        cells.append((
            f"{row['rows']:,}", f"{row['file_mib']:.0f}", f"{row['held_rows']:,}", f"{row['reading_mib']:.0f}",
            f"{row['peak_mib']:.0f}", f"{row['reading_s']:.0f}", f"{row['cpu_s']:.0f}", named,
        ))  # fmt: skip
    heads = ("rows", "file [MiB]", "held", "peak, reading [MiB]", "peak [MiB]", "reading [s]", "processor time [s]",
             "named")  # fmt: skip
    return page(
        "Diagnosing long logs (`python -m benchmarks.large_log`)",
        "Peak memory of a process that reads and diagnoses one log of a virtual bench (hidden: friction.load = "
        f"{HIDDEN['friction.load']}). `held` are the rows that were replayed; causes with their confidence.",
        table(heads, cells),
    )


if __name__ == "__main__":
    sys.exit(main())
