"""The SO-101 arm, joint by joint: ``python -m benchmarks.so101``. Writes ``results/so101.{json,md}``.

Six Feetech STS3215 on a table, 8 motions at 50 Hz, whose load on each joint is not known. ``diagnose.py`` writes into
``runs/so101`` (about an hour); if a diagnosis is there, only the page is made from it.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from actuators.errors import SealegsError
from benchmarks.real_data import DATA, RESULTS
from configs.script import run
from gap.converters import CONVERTERS

REPOSITORY = Path(__file__).resolve().parents[1]
COLUMNS = {"velocity.scale": "velocity over the derivative", "current.unsigned": "unsigned current"}


def diagnosed(folder: Path) -> dict[str, Any]:
    """The diagnosis in ``folder``, made if it is not there.

    Raises:
        SealegsError: there are no recordings, or ``diagnose.py`` failed.
    """
    file = folder / "diagnosis.json"
    if not file.is_file():
        with tempfile.TemporaryDirectory() as logs:
            CONVERTERS["so101"](DATA / "so101_arm", Path(logs))
            command = [sys.executable, str(REPOSITORY / "diagnose.py"), f"log={logs}", f"out={folder}"]
            if (status := subprocess.run(command, check=False).returncode) != 0:
                raise SealegsError(f"diagnose.py ended with status {status}; its message stands above.")
    return json.loads(file.read_text())


def row(joint: dict[str, Any]) -> dict[str, Any]:
    """What a joint's line tells."""
    errors = {f["code"]: f["value"] for f in joint["findings"] if f["data_error"]}
    causes = [cause for cause in joint["causes"] if cause["kind"] != "data"]
    return {
        "joint": joint["joint"],
        "verdict": joint["verdict"],
        "error": {name: 1e3 * joint["gap"][name]["mae"] for name in ("nominal", "retuned", "extended")},
        "causes": [
            {
                "name": cause["name"],
                "share": cause["share"],
                "confidence": cause["confidence"],
                "rivals": cause["rivals"],
                "parameters": cause["parameters"],
            }
            for cause in causes
        ],
        "columns": {words: errors.get(code) for code, words in COLUMNS.items() if code in errors},
        "sentence": joint["sentence"],
    }


def page(rows: list[dict[str, Any]]) -> str:
    """The table as Markdown."""
    lines = [
        "# SO-101 arm, joint by joint",
        "",
        "Written by `python -m benchmarks.so101`; do not edit. Mean absolute position error [mrad; gripper: 1/1000 of",
        "its opening] on motions that nothing was fitted to.",
        "",
        "| joint | verdict | nominal | re-tuned | extended | causes (share of the gap, confidence) | wrong columns |",
        "|---|---|---|---|---|---|---|",
    ]
    for item in rows:
        causes = "; ".join(f"{c['name']} ({c['share']:.0%}, {c['confidence']:.2f})" for c in item["causes"]) or "-"
        columns = "; ".join(f"{words} {value:.3g}" if value else words for words, value in item["columns"].items())
        error = item["error"]
        lines.append(
            f"| {item['joint']} | {item['verdict']} | {error['nominal']:.1f} | {error['retuned']:.1f} | "
            f"{error['extended']:.1f} | {causes} | {columns or '-'} |"
        )
    for item in rows:
        lines += ["", f"**{item['joint']}**: {item['sentence']}", ""]
        for cause in item["causes"]:
            values = ", ".join(
                f"{path} {v['value']:.3g} [{v['low']:.3g}, {v['high']:.3g}] {v['unit']}"
                for path, v in cause["parameters"].items()
            )
            rivals = f"; rivals: {', '.join(cause['rivals'])}" if cause["rivals"] else ""
            lines.append(f"- `{cause['name']}`: {values}{rivals}")
    return "\n".join(lines) + "\n"


def main(arguments: list[str]) -> None:
    """Diagnose, where that is still to do, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.so101")
    parser.add_argument("--folder", type=Path, default=REPOSITORY / "runs" / "so101", help="of the diagnosis")
    document = diagnosed(parser.parse_args(arguments).folder)
    rows = [row(joint) for joint in document["joints"]]
    (RESULTS / "so101.json").write_text(json.dumps(rows, indent=1) + "\n")
    (RESULTS / "so101.md").write_text(page(rows))
    print(page(rows))


if __name__ == "__main__":
    if {"-h", "--help"} & set(sys.argv[1:]):
        sys.exit(print((__doc__ or "").strip()))
    sys.exit(run(main, "", "", sys.argv[1:]))
