"""Measured logs of robots that others published, diagnosed joint by joint: ``python -m benchmarks.robot_logs``.

Reads ``../shared/data`` (``data=`` another folder) and writes ``benchmarks/results/robot_logs.{json,md}``. Joints that
are done are kept in ``robot_logs.jsonl`` while it runs, so that it can be stopped and goes on. One case by its name:
``python -m benchmarks.robot_logs double_pendulum``; the rows of the others stay on the page. One joint of it, with some
causes, which is only printed: ``python -m benchmarks.robot_logs so101_arm joint=shoulder_pan causes=drive.gain,...``.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import scipy.io
import yaml
from sealegs.common.markdown import table
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.reader import measured_set
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.verdict.verdict import JointDiagnosis

from benchmarks.hidden import row_of
from benchmarks.kept import CHECKOUT, DATA, RESULTS, Kept, read, study, write

WORK = CHECKOUT / "build" / "robot_logs"
TORQUE_CHAIN = [{"delay": {"seconds": 0.0}}, {"torque_command": {}}]
"""Nothing between the commanded torque and the joint: what the published model believes."""
FORCE_PER_COMMAND = 35.15  # [N] per unit of `vir` (README of the data)
CARRIAGE_MASS = 95.0  # [kg] about (README of the data)
CARRIAGE = f"""<mujoco model="emps"><worldbody><body name="carriage"><joint name="carriage" type="slide" axis="1 0 0"/>
<inertial pos="0 0 0" mass="{CARRIAGE_MASS}" diaginertia="1 1 1"/></body></worldbody></mujoco>"""
SO101_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")


def double_pendulum(data: Path, work: Path) -> MeasuredSet:
    """Two joints, torque in, position out; the model file has no friction."""
    del work
    folder = data / "double_pendulum"
    runs = []
    for path in sorted(folder.glob("*.parquet")):
        table = pyarrow.parquet.read_table(path).to_pydict()
        columns: dict[str, Any] = {"time": np.array(table["time"])}
        for k in (1, 2):
            columns[f"Joint{k}.torque_command"] = np.array(table[f"tau_con{k}"])
            columns[f"Joint{k}.position"] = np.array(table[f"pos_meas{k}"])
            columns[f"Joint{k}.velocity"] = np.array(table[f"vel_meas{k}"])
        runs.append(columns)
    sidecar = {"robot": str(folder / "design_A.urdf"), "actuators": {f"Joint{k}": TORQUE_CHAIN for k in (1, 2)}}
    return measured_set(runs, sidecar, "double_pendulum")


def emps(data: Path, work: Path) -> MeasuredSet:
    """A carriage on a ball screw, force in, position out."""
    table = scipy.io.loadmat(data / "emps" / "DATA_EMPS.mat")
    time_, position, goal, command = (np.asarray(table[key], float).ravel() for key in ("t", "qm", "qg", "vir"))
    work.mkdir(parents=True, exist_ok=True)
    model = work / "carriage.xml"
    model.write_text(CARRIAGE, encoding="utf-8")
    columns = {
        "time": time_,
        "carriage.goal": goal,
        "carriage.torque_command": FORCE_PER_COMMAND * command,
        "carriage.position": position,
    }
    units = {"carriage.position": "m", "carriage.goal": "m"}
    sidecar = {"robot": str(model), "actuators": {"carriage": TORQUE_CHAIN}, "units": units}
    return measured_set(columns, sidecar, "emps")


def so101_chain() -> list[dict[str, Any]]:
    """The library's servo, set up as the publisher says: P 16, where the factory's 32 is 5.3 duty per rad; 12 V."""
    known = {"position_p": {"gain": 5.3 * 16 / 32}, "supply": {"volts": 12.0}}
    file = CHECKOUT / "configs" / "actuator" / "sts3215.yaml"
    stages: list[dict[str, Any]] = yaml.safe_load(file.read_text(encoding="utf-8"))
    return [{name: {**values, **known.get(name, {})} for name, values in stage.items()} for stage in stages]


def so101(data: Path, work: Path, motions: Sequence[str] = ("chirp_sweep",)) -> MeasuredSet:
    """Six servos of an arm, position goals in; how zeros and directions of log and model stand is not recorded."""
    del work
    folder = data / "so101_arm"
    runs = []
    for motion in motions:
        table = pyarrow.parquet.read_table(folder / f"{motion}.parquet").to_pydict()
        columns: dict[str, Any] = {"time": np.array(table["t"], float)}
        for joint in SO101_JOINTS:
            columns[f"{joint}.goal"] = np.array(table[f"goal_{joint}"], float)
            columns[f"{joint}.position"] = np.array(table[f"pos_{joint}"], float)
        runs.append(columns)
    sidecar = {
        "robot": str(folder / "so101.xml"),
        "actuators": dict.fromkeys(SO101_JOINTS, so101_chain()),
        "units": {"gripper.position": "fraction", "gripper.goal": "fraction"},
    }
    return measured_set(runs, sidecar, "so101_arm")


def so101_steps(data: Path, work: Path) -> MeasuredSet:
    """Another motion of the same arm."""
    return so101(data, work, ("step_response",))


def so101_all(data: Path, work: Path) -> MeasuredSet:
    """All motions of the same arm together."""
    return so101(data, work, sorted(path.stem for path in (data / "so101_arm").glob("*.parquet")))


CASES: dict[str, Callable[[Path, Path], MeasuredSet]] = {
    "double_pendulum": double_pendulum,
    "emps": emps,
    "so101_arm": so101,
    "so101_arm_steps": so101_steps,
    "so101_arm_all": so101_all,
}


def row(case: str, found: JointDiagnosis, seconds: float) -> dict[str, Any]:
    """What a page says of one joint."""
    return {
        "case": case,
        "joint": found.joint,
        "verdict": found.verdict,
        "sentence": found.sentence,
        "signal": found.signal,
        "unit": found.unit,
        "seconds": seconds,
        "gap": {name: error.rmse for name, error in found.gap.items()},
        "causes": [row_of(cause) for cause in found.causes],
        "findings": [finding.sentence for finding in found.findings],
    }


def rows_of(case: str, data: Path, kept: Path) -> Iterator[dict[str, Any]]:
    """One row per joint, those that are done from ``kept``."""
    done = Kept(kept)
    known = {item["joint"]: item for item in done.rows if item["case"] == case}
    data_set = CASES[case](data, WORK)
    if known.keys() >= data_set.runs[0].joints.keys():
        yield from known.values()
        return
    whole = began = time.perf_counter()
    heard: dict[str, float] = {}  # when each of the joints that are diagnosed side by side first said something
    fresh: list[dict[str, Any]] = []

    def hear(line: str) -> None:
        heard.setdefault(line.partition(":")[0], time.perf_counter())

    def keep(found: JointDiagnosis) -> None:
        nonlocal began
        fresh.append(row(case, found, time.perf_counter() - heard.get(found.joint, began)))
        done.add(fresh[-1])
        print(f"{case} {found.joint}: {found.sentence} ({fresh[-1]['seconds']:.0f} s)", flush=True)
        began = time.perf_counter()

    found = diagnose(data_set, progress=hear, done=keep, workers=None)
    seconds = {item["joint"]: item["seconds"] for item in reversed(fresh)}  # of the first time it was judged
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    spent = {} if known else {"whole": time.perf_counter() - whole, "cores": cores}
    final = [row(case, joint, seconds.get(joint.joint, 0.0)) | spent for joint in found]  # with what joints share
    lines = [item for item in done.rows if item["case"] != case] + final
    kept.write_text("".join(json.dumps(item) + "\n" for item in lines), encoding="utf-8")
    yield from final


class _Enough(Exception):
    """The joint that was asked for is diagnosed."""


def one_joint(case: str, data: Path, joint: str, causes: Sequence[str] | None) -> None:
    """Diagnose one joint with some causes, and print its line of the page; nothing is kept."""
    began = time.perf_counter()

    def stop(found: JointDiagnosis) -> None:
        if found.joint == joint:
            print(told([row(case, found, time.perf_counter() - began)]))
            raise _Enough

    with contextlib.suppress(_Enough):
        diagnose(CASES[case](data, WORK), causes=causes, done=stop)


def told(rows: list[dict[str, Any]]) -> str:
    """The results as Markdown."""
    cells = []
    for item in rows:
        gap = item["gap"]
        size = f"{1e3 * gap['nominal']:.2f} to {1e3 * gap['extended']:.2f}" if gap else "-"
        floor = f"{1e3 * gap['noise_floor']:.2f}" if gap else "-"
        causes = "; ".join(
            c["name"]
            + " "
            + ", ".join(f"{k} {v[0]:.3g} [{v[1]:.3g}, {v[2]:.3g}] {v[4]}" for k, v in c["parameters"].items())
            for c in item["causes"]
        )
        unit = f"m{item['unit']}"
        cells.append((item["case"], item["joint"], item["verdict"], f"{size} {unit}", f"{floor} {unit}", causes or "-",
                      f"{item['seconds']:.0f}"))  # fmt: skip
    whole = {item["case"]: item for item in rows if "whole" in item}
    took = ", ".join(
        f"{case} {item['whole']:.0f} s" + (f" on {item['cores']}" if "cores" in item else "")
        for case, item in whole.items()
    )
    heads = ("machine", "joint", "verdict", "error, before to after", "noise", "causes", "s")
    last = f"\n\nWhole diagnoses, in seconds on so many cores: {took}." if whole else ""
    return table(heads, cells) + last + "\n"


@study
def main() -> None:
    """Run the cases that are named, or all whose data are there, and write the page."""
    names = [word for word in sys.argv[1:] if "=" not in word] or list(CASES)
    asked = dict(word.split("=", 1) for word in sys.argv[1:] if "=" in word)
    data = Path(asked.get("data", DATA))
    if "joint" in asked:
        one_joint(names[0], data, asked["joint"], asked["causes"].split(",") if "causes" in asked else None)
        return
    kept = RESULTS / "robot_logs.jsonl"
    if not data.is_dir():
        raise SystemExit(f"{data} is not there: give the folder of the data as data=<folder>.")
    measured = {name: list(rows_of(name, data, kept)) for name in names}
    # read last: another case that was measured meanwhile has its rows there
    before: list[dict[str, Any]] = read("robot_logs", [])
    others = {name: [item for item in before if item["case"] == name] for name in CASES}
    rows = [item for name in CASES for item in measured.get(name, others[name])]
    write("robot_logs", told(rows), rows)
    print(told(rows))


if __name__ == "__main__":
    sys.exit(main())
