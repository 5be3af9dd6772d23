"""What an import makes of the headers of recordings: ``python -m benchmarks.import_headers [--write]``.

Each header of ``import_headers.yaml`` is written as a small file and proposed for. ``results/import_headers.json``
holds, for each column of the log, its line and whether it is asked about. A run compares: understood as before, asked
about now, or *wrong*, which is a line that gives other numbers. With ``--write`` the file is written.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.io import savemat
from sealegs.common.errors import SealegsError
from sealegs.gap.log.importers import Recording, propose_for
from sealegs.gap.log.importers.expression import evaluate

from benchmarks.kept import DATA, RESULTS, command, study

HEADERS = Path(__file__).resolve().with_suffix(".yaml")
WRITTEN = RESULTS / "import_headers.json"
REAL = (
    "ak80_pendulum/ddp.csv", "double_pendulum/sys_id_00.parquet", "emps/DATA_EMPS.mat", "so101_arm/chirp_sweep.parquet",
    "xl330_pendulum/xl330_kp100_sin_sin.csv", "xl330_pendulum/raw_2026-01-15_10h28m10.json",
    "cases/bag_offset/bag/train", "cases/light_rotor/a.csv", "cases/headers/json_runs/runs.json",
    "cases/headers/list_cells_a/run.csv", "cases/headers/list_cells_b/run.csv", "cases/headers/moving_flag/run.csv",
    "cases/headers/pace_pt/chirp_data.pt", "cases/headers/registers/run.csv", "cases/headers/repeated_stamp/run.csv",
    "cases/headers/state_and_command", "cases/headers/zero_velocity_garbage_effort",
)  # fmt: skip
"""Recordings of real machines, where they are beside the checkout."""
TIME = np.arange(0.0, 10.0, 0.01)  # [s]
JOINTS = 3


def motions() -> dict[str, Any]:
    """Goals, positions and velocities of three joints by the names that headers use, and factors of units."""
    values: dict[str, Any] = {"t": TIME, "row": np.arange(len(TIME)), "deg": 180.0 / np.pi, "turn": 2.0 * np.pi,
                              "rpm": 60.0 / (2.0 * np.pi)}  # fmt: skip
    for joint in range(JOINTS):
        rate = 1.0 + 0.3 * joint

        def angle(time: np.ndarray, rate: float = rate, size: float = 1.0 - 0.2 * joint) -> np.ndarray:
            return size * (0.6 * np.sin(2.0 * rate * time) + 0.2 * np.sin(5.1 * rate * time))

        late = angle(TIME - 0.04)
        values |= {f"g{joint}": angle(TIME), f"p{joint}": late, f"v{joint}": np.gradient(late, TIME)}
    return values | {signal: values[f"{signal}0"] for signal in "gpv"}


def columns_of(line: str, values: dict[str, Any]) -> dict[str, Any]:
    """The columns of a header by their names, each of shape (n,), or a number."""
    found: dict[str, Any] = {}
    for part in line.split("; "):
        name, _, text = part.rpartition(": ")
        for joint in range(JOINTS) if "{}" in name else (0,):
            own = text.replace("{}", str(joint))
            floored = own.replace("floor(", "(")
            cells = evaluate(floored, values, name)
            found[name.replace("{}", str(joint))] = np.floor(cells) if own.startswith("floor(") else cells
    return found


def written(folder: Path, name: str, columns: dict[str, Any]) -> Path:
    """A header as a file."""
    path = folder / (name if "." in name else f"{name}.csv")
    whole = {key: np.broadcast_to(cells, TIME.shape) if np.ndim(cells) else cells for key, cells in columns.items()}
    if path.suffix == ".mat":
        savemat(path, whole)
    elif path.suffix == ".npz":
        np.savez(path, **whole)  # pyright: ignore[reportArgumentType]
    elif path.suffix == ".json":
        rows = [dict(zip(whole, row, strict=True)) for row in zip(*whole.values(), strict=True)]
        path.write_text(json.dumps(rows, default=float))
    else:
        np.savetxt(path, np.stack(list(whole.values()), 1), "%.12g", ",", header=",".join(whole), comments="",
                   encoding="utf-8")  # fmt: skip
    return path


def proposals() -> tuple[dict[str, Any], dict[str, Recording]]:
    """What is proposed for each header, and the recording that it is for."""
    found: dict[str, Any] = {}
    recordings: dict[str, Recording] = {}
    values = motions()
    with tempfile.TemporaryDirectory() as folder:
        sources = {}
        for name, line in yaml.safe_load(HEADERS.read_text(encoding="utf-8")).items():
            sources[name] = written(Path(folder), name, columns_of(line, values))
        sources |= {name: DATA / name for name in REAL if (DATA / name).exists()}
        for name, path in sources.items():
            try:
                proposed = propose_for(path, Path(folder) / "out")
            except SealegsError as error:
                found[name] = {"refused": str(error).replace(str(path), path.name).partition(": ")[2]}
                continue
            except Exception as error:
                found[name] = {"refused": f"traceback: {type(error).__name__}"}
                continue
            asked = {column for question in proposed.mapping.questions for column in question.about}
            found[name] = {
                column: {"line": text, "asked": column in asked or column not in proposed.certain.columns}
                for column, text in proposed.mapping.columns.items()
            }
            recordings[name] = proposed.recordings[0]
    return found, recordings


def same(line: str, other: str, recording: Recording) -> bool:
    """Whether two lines give the same numbers."""
    facts = {key: value for key, value in recording.facts.items() if not isinstance(value, str)}
    names = {"row": np.arange(recording.length, dtype=float), **facts, **recording.columns}
    try:
        first, second = (np.asarray(evaluate(text, names, "line"), float) for text in (line, other))
    except SealegsError:
        return False
    return bool(np.allclose(first, second, rtol=1e-6, atol=1e-9, equal_nan=True))


def compared(before: dict[str, Any], now: dict[str, Any], recordings: dict[str, Recording]) -> list[tuple[str, str]]:
    """What became of each column: ``understood``, ``asked now``, ``wrong`` or ``new``, and which it is."""
    out = []
    for name, columns in before.items():
        for column, old in columns.items() if name in now and "refused" not in columns else ():
            new = now[name].get(column) if "refused" not in now[name] else None
            if new is not None and not new["asked"]:
                verdict = "understood" if same(old["line"], new["line"], recordings[name]) else "wrong"
                out.append(("new" if old["asked"] else verdict, f"{name}: {column}: {new['line']}"))
            elif not old["asked"]:
                out.append(("asked now", f"{name}: {column}: {old['line']}"))
        more = [] if "refused" in now.get(name, {"refused": 0}) else now[name].keys() - columns.keys()
        out += [("new", f"{name}: {column}: {now[name][column]['line']}") for column in sorted(more)
                if not now[name][column]["asked"]]  # fmt: skip
    return out


@study
def main() -> int:
    """Compare with the file, or write it."""
    parser = command(__doc__)
    parser.add_argument("--write", action="store_true", help="write what is proposed now as what is right")
    chosen = parser.parse_args()
    now, recordings = proposals()
    if chosen.write:
        WRITTEN.write_text(json.dumps(now, indent=1, ensure_ascii=False) + "\n")
        print(f"{len(now)} headers in {WRITTEN}")
        return 0
    before = json.loads(WRITTEN.read_text())
    found = compared(before, now, recordings)
    for verdict, what in found:
        if verdict != "understood":
            print(f"{verdict}: {what}")
    count = Counter(verdict for verdict, _ in found)
    known = count["understood"] + count["asked now"] + count["wrong"]
    print(
        f"{len(now)} headers: {count['understood']} of {known} columns understood as before, "
        f"{count['asked now']} asked about now, {count['wrong']} wrong, {count['new']} new"
    )
    return 1 if count["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
