"""Explain a gap: find from measured logs what the simulation gets wrong, name the cause, and extend the model by it.

    sealegs diagnose log=logs/today out=diagnosis
    sealegs diagnose log=logs/today look=true           only a first look, in seconds; nothing is written
    sealegs diagnose log=logs/xl330 test=kp400          keep the runs of that group for the final measurement
    sealegs diagnose log=logs/fleet fleet=true          a folder of logs for each servo, and a table over all of them
    sealegs train extended=diagnosis                    train on the extended model

A log is a CSV or Parquet file with a YAML beside it (docs/log-format.md); a folder of them is one data set. The command
writes diagnosis.json, report.html (one page to send), pictures, the extended chain and MJCF, and the next experiment
where one helps. For a fleet it writes such a folder for each servo, fleet.html and fleet.csv. After Ctrl-C or a kill,
the same command resumes; until it is done, partial/partial.json holds what was found so far.
"""

from __future__ import annotations

import shlex
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from ..common.atomic import fresh
from ..common.errors import SealegsError
from ..configs.script import Interrupted

DIAGNOSES = Path("diagnoses")


def main(arguments: list[str]) -> None:
    """Diagnose the log that the command line names."""
    from ..configs.compose import compose, split  # here, so that --help does not wait for the compiled laws
    from ..gap.diagnose import checked_settings
    from ..gap.output.partial import alone

    config = compose("diagnose", split(arguments, plain=("log", "out", "test"), first="log"))
    if config["log"] is None:
        raise SealegsError(
            "log=<file or folder> is missing: name the measured log (CSV or Parquet, with a YAML beside it), or try "
            "sealegs demo."
        )
    values = _checked(config)
    log = Path(str(config["log"]))
    out = None if config["out"] is None else Path(str(config["out"]))
    test = None if config["test"] is None else str(config["test"])
    numbers = (config[key] for key in ("seed", "limits", "speed_limit"))
    names = ([config[key]] if isinstance(config[key], str) else config[key] for key in ("causes", "joints"))
    settings = checked_settings(test, *numbers, *names)
    if values["look"]:
        look(log, settings)
    elif values["fleet"]:
        out = out or fresh(DIAGNOSES, log.stem)
        with alone(out, inner=""):
            diagnose_fleet(log, out, settings, values["workers"], values["fleet"] == "ray")
    else:
        diagnose_one(log, out, settings, values["workers"], arguments)


def _checked(config: Mapping[str, Any]) -> dict[str, Any]:
    """Fleet and workers; :func:`sealegs.gap.diagnose.checked_settings` has the settings of a diagnosis."""
    from ..configs.check import Count, checked, or_null

    types: dict[str, tuple[Any, str]] = {
        "fleet": (Literal[True, False, "ray"], "true (this machine), ray (a Ray cluster) or false"),
        "workers": (or_null(Count), "a whole number from 1"),
        "look": (bool, "true or false"),
    }
    return {
        key: checked(key, config[key], kind, f"{key}={config[key]} must be {words}.")
        for key, (kind, words) in types.items()
    }


# --- one data set --------------------------------------------------------------------------------------------------


def diagnose_one(
    log: Path, out: Path | None, settings: dict[str, Any], workers: int | None, arguments: Sequence[str]
) -> None:
    """Diagnose one data set, so many joints at a time, and print what was found; ``arguments`` asked for it."""
    from rich.console import Console
    from rich.markup import escape

    from ..gap.fleet.jobs import diagnose_folder
    from ..gap.log.progress import Milestone
    from ..gap.output.partial import alone, source_of, unfinished
    from ..gap.output.terminal import next_step, screen, told_once
    from ..gap.verdict.verdict import UNUSABLE

    if out is None:
        before = DIAGNOSES.glob(f"{log.stem}-*")
        source = source_of(log, settings) if log.exists() else {}
        out = unfinished(before, source) or fresh(DIAGNOSES, log.stem)
    console = Console()
    with console.status("reading") as status:
        started = time.perf_counter()

        def progress(text: str) -> None:
            status.update(f"{escape(text)}  ({time.perf_counter() - started:.0f} s)")
            if isinstance(text, Milestone) or not console.is_terminal:  # a file or a pipe shows no status
                line = f"  {time.perf_counter() - started:5.0f} s  {text}"
                console.print(line, highlight=False, markup=False, soft_wrap=True)

        try:
            with alone(out):
                diagnosis, written = diagnose_folder(log, out, progress, workers=workers, **settings)
        except KeyboardInterrupt:
            raise Interrupted(how_to_go_on(arguments, out)) from None
    logs = log if log.is_dir() else log.parent
    if diagnosis.verdict == UNUSABLE:
        first = next(joint for joint in diagnosis.joints if joint.verdict == UNUSABLE)
        sentence, reasons = told_once(first)
        why = " ".join((sentence, *(reason.sentence for reason in reasons)))
        _, commands = next_step(diagnosis.joints, written, logs)
        begin = f" A motion to begin with: {' ; '.join(commands)}" if commands else ""
        raise SealegsError(f"{why} The findings are in {out}; give another out= for the next try.{begin}")
    for line in screen(diagnosis.joints, written, console.width, logs):
        console.print(line, highlight=False, markup=False, soft_wrap=True)


def look(log: Path, settings: Mapping[str, Any]) -> None:
    """Print what each joint of a data set shows at first sight."""
    from rich.console import Console

    from ..gap.checks.long import read_bounded
    from ..gap.finder.diagnosis import first_look
    from ..gap.output.terminal import lines_of
    from ..gap.prepare.request import Request

    console = Console()
    with console.status("looking"):
        request = Request(seed=settings["seed"], causes=settings["causes"])
        found = first_look(read_bounded(log), request, settings["joints"])
    for line in lines_of(found):
        console.print(line, highlight=False, markup=False, soft_wrap=True)


def how_to_go_on(arguments: Sequence[str], out: Path) -> str:
    """What is said where a person stops a diagnosis that ``arguments`` asked for: the command that goes on with it."""
    from ..gap.output.partial import FOLDER, TOLD

    if not (out / FOLDER / TOLD).is_file():
        return "Stopped before anything was found."
    same = shlex.join([*(word for word in arguments if not word.startswith("out=")), f"out={out}"])
    return (
        f"Stopped; what was found so far is in {out / FOLDER / TOLD}. Go on with the same command and out={out}: "
        f"sealegs diagnose {same}"
    )


# --- a fleet -------------------------------------------------------------------------------------------------------


def diagnose_fleet(log: Path, out: Path, settings: dict[str, Any], workers: int | None, cluster: bool) -> None:
    """Diagnose every folder in a folder, and print which servos share a cause."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.table import Table

    from ..gap.fleet import diagnose_fleet, find_jobs, rows_of, shared_causes, write_table

    jobs = find_jobs(log, out, settings)
    out.mkdir(parents=True, exist_ok=True)
    console = Console()
    outcomes = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    doing: dict[str, str] = {}
    try:
        with Progress(*columns, console=console, transient=True) as bar:
            task = bar.add_task("diagnosing", total=len(jobs))

            def report(name: str, text: str) -> None:
                doing[name] = text
                bar.update(task, description="  ".join(f"{name}: {text[:40]}" for name, text in doing.items()))

            for outcome in diagnose_fleet(jobs, workers, cluster, report):
                outcomes.append(outcome)
                doing.pop(outcome.name, None)
                said = outcome.error or (
                    "kept" if outcome.kept or outcome.document is None else outcome.document["verdict"]
                )
                bar.console.print(f"  {outcome.name}: {said}", highlight=False, markup=False, soft_wrap=True)
                bar.advance(task)
    except KeyboardInterrupt:
        kept = sum(outcome.document is not None for outcome in outcomes)
        raise Interrupted(
            f"Stopped; {kept} of {len(jobs)} servos are kept in {out}. Go on with the same command and out={out}."
        ) from None
    rows = rows_of(outcomes)
    shared = shared_causes(rows)
    write_table(rows, out / "fleet.csv")
    from ..gap.fleet.page import write_page

    written = write_page(rows, shared, out, log.resolve().name)
    table = Table("servo", "verdict", "causes (share of the gap)", box=None, pad_edge=False)
    for row in rows:
        causes = ", ".join(f"{cause['name']} {100 * cause['share']:.0f} %" for cause in row.causes)
        table.add_row(row.servo, row.verdict, causes or row.sentence)
    console.print(table, highlight=False, markup=False)
    console.print()
    for cause in shared:
        console.print(f"  {cause.sentence}", highlight=False, markup=False, soft_wrap=True)
    for path in (written["page"], out / "fleet.csv"):
        console.print(f"  {path}", highlight=False, markup=False)
    if all(row.failed for row in rows):
        raise SealegsError(f"None of the {len(rows)} servos could be diagnosed: {rows[0].sentence}")
