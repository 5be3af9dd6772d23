"""Time of a diagnosis: three 24 s bench runs at 200 Hz, and how it grows with the length of the log.

    python -m benchmarks.diagnosis_speed              writes benchmarks/results/diagnosis_speed.{json,md,png}

The bench is a hidden one (:mod:`testbed`, seed below 900) with friction that grows with load. Every length is
diagnosed in this process after a short one that compiles. Time on the clock depends on what else the machine does;
processor time of all threads is given beside it, and half of that is what two idle cores need at least.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from sealegs.common.markdown import page, table

from benchmarks.kept import RESULTS, command, study, write

FACTORS = (1, 2, 4, 8)
CORES = 2
WANTED, AIM = 120.0, 60.0  # [s] for the plain case on two cores
SEED = 21
EFFECT = {"friction.load_dependent": "clear"}


def measure(factor: float) -> dict[str, Any]:
    """Diagnose runs ``factor`` times 24 s long."""
    from sealegs.gap.finder.diagnosis import diagnose

    from testbed import hidden_bench
    from testbed.excitation import DEFAULT_SCHEDULES

    repeats = max(int(np.ceil(factor)), 1)
    schedules = tuple(schedule * repeats for schedule in DEFAULT_SCHEDULES)
    data, _ = hidden_bench(
        dict(EFFECT), SEED, ("light", "medium", "heavy"), duration=24.0 * factor, schedules=schedules
    )
    began, cpu = time.perf_counter(), time.process_time()
    (found,) = diagnose(data)
    assert found.problem is not None
    return {
        "factor": factor,
        "samples": sum(len(run.time) for run in data.runs),
        "seconds": time.perf_counter() - began,
        "processor_seconds": time.process_time() - cpu,
        "causes_considered": len(found.search.causes) if found.search else 0,
        "rounds": len(found.search.rounds) if found.search else 0,
        "verdict": found.verdict,
        "causes": [cause.name for cause in found.causes],
    }


@study
def main() -> None:
    """Command line."""
    parser = command(__doc__)
    parser.add_argument("--factors", type=float, nargs="+", default=list(FACTORS))
    parser.add_argument("--out", type=Path, default=RESULTS / "diagnosis_speed")
    options = parser.parse_args()
    import numba

    numba.set_num_threads(min(CORES, numba.config.NUMBA_NUM_THREADS))  # type: ignore[attr-defined]
    measure(0.1)
    results = []
    for factor in options.factors:
        results.append(measure(factor))
        print(json.dumps(results[-1]), flush=True)
    report(results, options.out)


def report(results: Sequence[dict[str, Any]], out: Path) -> None:
    """Write numbers, table and picture."""
    from sealegs.gap.output.pictures.style import EXTENDED, NOMINAL, figure, styled

    load = os.getloadavg()[0]
    samples = np.array([row["samples"] for row in results], float)
    processor = np.array([row["processor_seconds"] for row in results])
    power = float(np.polyfit(np.log(samples), np.log(processor), 1)[0]) if len(results) > 1 else float("nan")
    cells = (
        (f"{row['factor']:g} x 3 x 24 s", f"{row['samples']:,}", row["causes_considered"], f"{row['seconds']:.0f}",
         f"{row['processor_seconds'] / CORES:.0f}", row["rounds"], ", ".join(row["causes"]))
        for row in results
    )  # fmt: skip
    heads = ("log", "samples", "causes tried", "on the clock [s]", "processor time / 2 [s]", "rounds", "named")
    text = page(
        "Time of a diagnosis (`python -m benchmarks.diagnosis_speed`)",
        f"Two cores; load of the machine while it ran: {load:.1f}. Wanted: at most {WANTED:g} s for the first line, "
        f"aim {AIM:g} s. Processor time grows with the length of the log to the power of {power:.2f}.",
        table(heads, cells),
    )
    write(out, text, {"results": list(results), "power": power, "load": load})

    @styled
    def draw() -> None:
        chart = figure(5.0, 3.4)
        axes = chart.subplots()
        axes.plot(samples, processor / CORES, "o-", color=EXTENDED, label="processor time / 2")
        axes.plot(samples, samples / samples[0] * processor[0] / CORES, "--", color=NOMINAL, label="in proportion")
        axes.set(xlabel="samples", ylabel="time of a diagnosis [s]")
        axes.set_xlim(0, None)
        axes.set_ylim(0, None)
        axes.legend()
        chart.savefig(out.with_suffix(".png"))

    draw()


if __name__ == "__main__":
    sys.exit(main())
