"""The IMU of a walking robot held against its legs: what is hidden in it, nulls, and their sizes.

``python -m benchmarks.hidden_imu`` runs everything and writes ``benchmarks/results/hidden_imu.md``. Finished cases are
kept in ``hidden_imu.jsonl`` beside it, so that it can be stopped and resumed. The walker is the independent one of
``testbed/quadruped.py``, with two runs of 6 s each. Seeds below 900 are for development.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from sealegs.common.markdown import page, table
from sealegs.gap.finder.imu import diagnose_imu

from benchmarks.kept import RESULTS, Kept, command, study, write
from testbed.logs import measured_run
from testbed.quadruped import BoughtImu, record_walker

FILE = RESULTS / "hidden_imu.jsonl"
FIRST_SEED, SEEDS = 901, 10
BELIEVED = {"delay": 0.01, "bias": {"orientation": 0.01, "turn_rate": 0.005}}
TURNED, LATE = np.radians(5.0), 0.02  # [rad], [s]
WITHIN = {"imu.turned": np.radians(1.5), "imu.delay": 0.008, "imu.lag": 0.008}
"""How far a size may be off to be right [rad], [s]: a third of what is hidden; assumed."""


@dataclass(frozen=True)
class Hidden:
    """What is hidden: what it makes of the IMU, the finding that is right, and its size [rad] or [s]."""

    imu: Callable[[np.random.Generator], BoughtImu]
    code: str | None
    size: float | None = None


def turned(random: np.random.Generator) -> BoughtImu:
    """It sits turned about an axis that is drawn, not the vertical alone: that is a heading, which legs do not tell."""
    way = random.uniform(0.0, 2.0 * np.pi)
    return BoughtImu(mount=Rotation.from_rotvec(TURNED * np.array([np.cos(way), np.sin(way), 0.0])))


CASES: Mapping[str, Hidden] = {
    "nothing": Hidden(lambda random: BoughtImu(), None),
    "turned by 5 degrees": Hidden(turned, "imu.turned", TURNED),
    "20 ms later than believed": Hidden(lambda random: BoughtImu(delay=BELIEVED["delay"] + LATE), "imu.delay", LATE),
    "orientation filtered by 20 ms": Hidden(lambda random: BoughtImu(filtered=LATE), "imu.lag", LATE),
    "sign of a turn rate": Hidden(lambda random: BoughtImu(axes=np.diag([1.0, -1.0, 1.0])), "imu.sign"),
    "turn rates in degrees": Hidden(lambda random: BoughtImu(unit=np.pi / 180.0), "imu.unit"),
    "mounted a quarter turn": Hidden(
        lambda random: BoughtImu(mount=Rotation.from_euler("z", 90.0, degrees=True)), "imu.mount"
    ),
}


def judged(name: str, seed: int) -> dict[str, Any]:
    """The findings of one case: codes and sizes."""
    with TemporaryDirectory() as folder:
        imu = CASES[name].imu(np.random.default_rng(seed))
        recordings, _ = record_walker({}, seed, Path(folder), duration=6.0, runs=2, imu=imu)
        runs = [replace(run, meta={**run.meta, "imu": BELIEVED}) for run in map(measured_run, recordings)]
        found = diagnose_imu(runs, {}, lambda text: None)
    told = {finding.code: finding.value for finding in found.findings}
    told |= {
        error.name: None for error in found.data_errors if error.name.startswith("imu.")
    }  # a lag is a sensor.delay, too
    return {"case": name, "seed": seed, "verdict": found.verdict, "found": told}


def right(row: Mapping[str, Any]) -> bool:
    """Whether the hidden effect, and its size, is what was found first; of nothing: whether nothing was."""
    hidden, found = CASES[row["case"]], row["found"]
    if hidden.code is None:
        return not found
    if hidden.code not in found:
        return False
    size = found[hidden.code]
    whole = BELIEVED["delay"] + LATE if hidden.code == "imu.delay" else hidden.size
    return hidden.size is None or size is None or abs(size - float(whole or 0.0)) < WITHIN[hidden.code]


def told(rows: list[dict[str, Any]]) -> str:
    """The results as a page of Markdown."""
    of = {name: [row for row in rows if row["case"] == name] for name in CASES}
    return page(
        "Effects hidden in the IMU of a walking robot",
        f"Of each {SEEDS} walks, two runs of 6 s. Right: the finding that was hidden, within a third of its size; "
        "false: any other. `python -m benchmarks.hidden_imu`",
        table(
            ("hidden", "walks", "right", "false"),
            ((name, len(own), sum(map(right, own)), sum(bool(set(row["found"]) - {CASES[name].code}) for row in own))
             for name, own in of.items()),
        ),
    )  # fmt: skip


@study
def main() -> None:
    """Run what is missing, write the page."""
    parser = command(__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS, help=f"of each case; default: {SEEDS}")
    parser.add_argument("--first", type=int, default=FIRST_SEED, help=f"seed; default: {FIRST_SEED}")
    parser.add_argument("--out", type=Path, default=FILE, help="where finished cases are kept")
    arguments = parser.parse_args()
    kept = Kept(arguments.out, lambda row: (row["case"], row["seed"]))
    for seed in range(arguments.first, arguments.first + arguments.seeds):
        for name in CASES:
            if (name, seed) not in kept:
                kept.add(judged(name, seed))
                print(kept.rows[-1], flush=True)
    write(arguments.out.with_suffix(""), told(kept.rows))
    print(told(kept.rows))


if __name__ == "__main__":
    sys.exit(main())
