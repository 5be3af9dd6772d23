"""Explain a gap: from measured logs to what the simulation gets wrong, why, and a model that has it right.

    python diagnose.py log=logs/today out=diagnosis
    python diagnose.py log=logs/xl330 test=kp400          keep the runs of that group for the final measurement
    python train.py actuator=diagnosis/extended.yaml      train on the extended model

A log is a CSV or Parquet file with a YAML beside it (docs/log-format.md); a folder of them is one data set. Written
are diagnosis.json, report.html (one page to send), pictures, the extended chain and MJCF, and the next experiment
where one helps.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from actuators.errors import SealegsError
from configs.script import run


def main(arguments: list[str]) -> None:
    """Diagnose the log that the command line names."""
    from configs.compose import compose, split  # here, so that --help does not wait for the compiled laws

    config = compose("diagnose", split(arguments, plain=("log", "out", "test")))
    if config["log"] is None:
        raise SealegsError(
            "log=<file or folder> is missing: name the measured log (docs/log-format.md), or try make demo."
        )
    if isinstance(config["seed"], bool) or not isinstance(config["seed"], int) or config["seed"] < 0:
        raise SealegsError(f"seed={config['seed']} must be a whole number from 0.")
    from rich.console import Console

    from gap.diagnosis import UNUSABLE, diagnose
    from gap.diagnosis_files import fresh_folder, write_diagnosis
    from gap.log import read_measured

    log = Path(str(config["log"]))
    stamp = time.strftime("%Y%m%d-%H%M%S")
    out = Path(str(config["out"])) if config["out"] is not None else Path("diagnoses") / f"{log.stem}-{stamp}"
    data = read_measured(log)
    out = fresh_folder(out)
    console = Console()
    with console.status("reading") as status:
        started = time.perf_counter()

        def progress(text: str) -> None:
            status.update(f"{text}  ({time.perf_counter() - started:.0f} s)")
            if text.startswith("found") or not console.is_terminal:  # a file or a pipe shows no status line
                console.print(f"  {time.perf_counter() - started:5.0f} s  {text}", highlight=False)

        test = None if config["test"] is None else str(config["test"])
        diagnoses = diagnose(data, test, int(config["seed"]), progress)
        written = write_diagnosis(diagnoses, data, out, progress)
    unusable = [diagnosis for diagnosis in diagnoses if diagnosis.verdict == UNUSABLE]
    if unusable:
        raise SealegsError(f"{unusable[0].sentence} The findings are in {out}; give another out= for the next try.")
    for diagnosis in diagnoses:
        console.print(f"\n[bold]{diagnosis.verdict}[/bold]  {diagnosis.sentence}", highlight=False)
        for cause in diagnosis.causes:
            values = ", ".join(
                f"{path} = {v.value:.4g} [{v.low:.4g}, {v.high:.4g}] {v.unit}" for path, v in cause.parameters.items()
            )
            console.print(
                f"  {cause.name:32s} share {100 * cause.share:3.0f} %  confidence {cause.confidence:.2f}  {values}",
                highlight=False,
                markup=False,
            )
    console.print()
    for name, path in written.items():
        console.print(f"  {name:12s} {path}", highlight=False, markup=False)


if __name__ == "__main__":
    sys.exit(run(main, "diagnose", __doc__ or "", sys.argv[1:]))
