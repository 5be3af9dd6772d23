"""Real machines with one part held out: ``python -m benchmarks.real_data``. Writes ``results/real_data.{json,md,png}``.

XL330 pendulum: each gain is held out in turn. No fit and no choice sees it (``log.parts.cut``): causes are chosen
by fitting one of the two other gains and predicting the other. Beside the result stand the published friction models
M1 to M6 (Duclusaud et al., ICRA 2025), fitted to the same two gains with CMA-ES.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from sealegs.common.errors import SealegsError
from sealegs.common.markdown import page, table
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log import read_measured
from sealegs.gap.log.importers import import_logs, read_mapping
from sealegs.gap.log.parts import TEST
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.output.files import to_document
from sealegs.gap.verdict.verdict import JointDiagnosis

from benchmarks.kept import DATA, RESULTS, command, study, write

GAINS = (400, 200, 100)
PUBLISHED = {
    400: {"M1": 71, "M2": 71, "M3": 46, "M4": 34, "M5": 38, "M6": 49},
    200: {"M1": 58, "M2": 60, "M3": 31, "M4": 37, "M5": 21, "M6": 26},
    100: {"M1": 77, "M2": 99, "M3": 35, "M4": 33, "M5": 33, "M6": 23},
}
"""Mean absolute error [mrad] on the gain that was held out; CMA-ES on free runs of 6 s, best of three starts."""


def recorded(machine: str, folder: str, read: Callable[[Path], MeasuredSet] = read_measured) -> MeasuredSet:
    """The recordings of a machine as measured logs, or what else ``read`` makes of their folder.

    Raises:
        SealegsError: the recordings are not there.
    """
    with tempfile.TemporaryDirectory() as target:
        import_logs(DATA / folder, Path(target), read_mapping(machine))
        return read(Path(target))


def held_out(data: MeasuredSet, gain: int) -> tuple[dict[str, Any], JointDiagnosis]:
    """Diagnose with one gain held out: a row of the table, and the diagnosis behind it."""
    started = time.perf_counter()
    (found,) = diagnose(data, f"kp{gain}", progress=lambda text: print(f"  gain {gain}: {text}", flush=True))
    runs = _per_run(found)
    row = {
        "gain": gain,
        "verdict": found.verdict,
        "sentence": found.text,
        "mae": {name: float(np.mean([run[name] for run in runs.values()])) for name in found.simulated},
        "causes": [cause for cause in to_document(found)["causes"] if cause["kind"] != "data"],
        "published": PUBLISHED[gain],
        "target": min(PUBLISHED[gain].values()),
        "runs": runs,
        "seconds": time.perf_counter() - started,
    }
    return row, found


def _per_run(found: JointDiagnosis) -> dict[str, dict[str, float]]:
    """Mean absolute error [mrad] of each held-out run under each model, from its first sample on."""
    problem = found.problem
    assert problem is not None
    rows: dict[str, dict[str, float]] = {}
    for k, unit in enumerate(problem.units):
        if unit.part == TEST:
            part = slice(problem.starts[k], problem.starts[k + 1])
            rows[f"run {unit.run}"] = {
                name: 1e3 * float(np.mean(np.abs(simulated[part, 0] - problem.measured[part, 0])))
                for name, simulated in found.simulated.items()
            }
    return rows


def told(rows: list[dict[str, Any]]) -> str:
    """The page as Markdown."""
    names = list(PUBLISHED[400])
    cells = (
        (f"gain {row['gain']}", f"{row['mae']['nominal']:.1f}", f"{row['mae']['refitted']:.1f}",
         f"**{row['mae']['extended']:.1f}**", row["target"], *(row["published"][name] for name in names),
         ", ".join(f"{c['name']} ({c['share']:.0%})" for c in row["causes"]) or "none")
        for row in rows
    )  # fmt: skip
    each = [(f"Gain {row['gain']}: {row['verdict']}. {row['sentence']}", "\n".join(cause_lines(row["causes"])))
            for row in rows]  # fmt: skip
    return page(
        "Real machines, one part held out",
        "Written by `python -m benchmarks.real_data`; do not edit. XL330-M288-T with a pendulum, 12 runs of 6 s: mean\n"
        "absolute position error on the gain that was held out, free runs from the first sample [mrad]. M1 to M6 were\n"
        "fitted to the same two gains with CMA-ES, best of three starts; which is best is known with hindsight only.",
        table(("held out", "nominal", "refitted", "**extended**", "best of M1 to M6", *names, "causes"), cells),
        *(part for parts in each for part in parts),
    )


def cause_lines(causes: list[dict[str, Any]]) -> list[str]:
    """Causes of a ``diagnosis.json`` with their numbers and rivals, one item of Markdown each."""
    lines = []
    for cause in causes:
        values = ", ".join(
            f"{path} {v['value']:.3g} [{v['low']:.3g}, {v['high']:.3g}] {v['unit']}"
            for path, v in cause["parameters"].items()
        )
        rivals = f"; rivals: {', '.join(cause['rivals'])}" if cause["rivals"] else ""
        lines.append(f"- `{cause['name']}`: {values}; confidence {cause['confidence']:.2f}{rivals}")
    return lines


def draw(found: dict[int, JointDiagnosis], data: MeasuredSet, path: Path) -> None:
    """Measured and simulated motion of every held-out run, one row per gain."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(len(found), 4, figsize=(16, 3.2 * len(found)), squeeze=False, layout="constrained")
    for row, (gain, diagnosis) in zip(axes, found.items(), strict=True):
        problem = None if diagnosis.problem is None else diagnosis.problem.joint
        assert problem is not None
        shown = [k for k, unit in enumerate(problem.units) if unit.part == TEST][:4]
        for axis, k in zip(row, shown, strict=False):
            part = slice(problem.starts[k], problem.starts[k + 1])
            time_ = problem.time[part]
            axis.plot(time_, problem.goal[part], ":", color="0.6", label="goal")
            axis.plot(time_, diagnosis.simulated["nominal"][part, 0], color="tab:orange", lw=1, label="nominal")
            axis.plot(time_, diagnosis.simulated["extended"][part, 0], color="tab:red", lw=1.2, label="extended")
            axis.plot(time_, problem.measured[part, 0], color="tab:blue", lw=1.2, label="measured")
            axis.set_title(data.runs[problem.units[k].run].name.removeprefix("xl330_"), fontsize=10)
            axis.set_ylim(-2, 2)
            axis.grid(alpha=0.3)
        row[0].set_ylabel(f"gain {gain} held out\nposition [rad]")
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    axes[0, 0].legend(fontsize=8)
    figure.savefig(path, dpi=80)
    plt.close(figure)


@study
def main() -> None:
    """Run all hold-outs and write the results."""
    parser = command(__doc__)
    parser.add_argument("gains", nargs="*", type=int, default=[], help=f"only these of {GAINS}; prints, writes nothing")
    options = parser.parse_args()
    if wrong := [gain for gain in options.gains if gain not in GAINS]:
        raise SealegsError(f"gain {wrong[0]} was not recorded; choose of {', '.join(map(str, GAINS))}.")
    data = recorded("xl330", "xl330_pendulum")
    results = [held_out(data, gain) for gain in options.gains or GAINS]
    rows = [row for row, _ in results]
    print("\n" + told(rows))
    if not options.gains:
        write("real_data", told(rows), rows)
        draw({row["gain"]: found for row, found in results}, data, RESULTS / "real_data.png")


if __name__ == "__main__":
    sys.exit(main())
