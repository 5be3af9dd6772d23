"""Turn recordings of other formats into measured logs: CSV, Parquet, MATLAB, ROS bags and MCAP, LeRobot, BAM.

    sealegs import run.csv out=logs/arm                                 proposes a mapping, shows it and stops
    sealegs import run.csv out=logs/arm mapping=logs/arm.mapping.yaml   imports with it, edited or not
    sealegs import run.csv out=logs/arm yes=true                        imports with the proposal, less what is asked
    sealegs import run.csv out=logs/arm dialect=mine.yaml               claims columns by rows of your own
    sealegs import run.csv out=logs/mine robot=bench actuator=sts3215 "robot_params={mass: 0.5, length: 0.12}"
                                                                        fills in what no file says

A column is claimed: by its format, by a row of a dialect, or by the words and the unit of its name; each line of the
proposal says by whom. What nobody claims is a question, never a guess.
"""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Any

from ..common.atomic import write_text
from ..common.errors import SealegsError
from ..configs.check import checked
from ..configs.compose import compose, split
from ..gap.log.importers import Imported, Proposed, answered, import_logs, propose_for, read_mapping
from ..gap.log.importers.mapping import FOLDER, ended

PLAIN = ("source", "out", "mapping", "unit", "dialect", "robot", "actuator", "format")
UNITS = ("rad", "deg", "turn", "ticks", "percent", "m", "mm")


def main(arguments: list[str]) -> None:
    """Import what the command line asks for, or propose how."""
    words = list(arguments)
    if len(words) == 3 and (FOLDER / f"{words[0]}.yaml").is_file() and not any("=" in word for word in words):
        words = [f"mapping={words[0]}", f"source={words[1]}", f"out={words[2]}"]  # of published data
    if words and "=" not in words[0] and not words[0].startswith("-"):
        words[0] = f"source={words[0]}"
    config = compose("import", split(words, plain=PLAIN, first="source"))
    for key, what in (("source", "a file or folder of recordings"), ("out", "a folder for the logs")):
        if config[key] is None:
            raise SealegsError(f"say {what}: sealegs import <file or folder> out=logs/<name>.")
    source, out = Path(str(config["source"])), Path(str(config["out"]))
    if config["unit"] not in (None, *UNITS):
        raise SealegsError(f"unit={config['unit']} is none of {', '.join(UNITS)}.")
    if config["mapping"] is not None:
        for key, what in (("unit", "the units stand in its columns"), ("dialect", "each column has its line")):
            if config[key] is not None:
                raise SealegsError(f"{key}={config[key]} is for a proposal; in a mapping {what}.")
        params = checked("robot_params", config["robot_params"], dict[str, float])
        said = read_mapping(str(config["mapping"]))
        mapping = answered(said, out, config["robot"], config["actuator"], params, source)
        tell(import_logs(source, out, mapping, config["format"]), out)
        return
    file = _free(out)
    command = shlex.join(["sealegs", "import", str(source), f"out={out}", f"mapping={file}"])
    params = checked("robot_params", config["robot_params"], dict[str, float])
    answers = config["unit"], config["robot"], config["actuator"]
    proposed = propose_for(source, out, *answers, command, params, config["dialect"])
    print(proposed.text)
    if checked("yes", config["yes"], bool) or _confirmed(proposed):
        take(source, out, proposed, config)
        return
    file.parent.mkdir(parents=True, exist_ok=True)
    write_text(file, proposed.text, replace=True)
    count = len(proposed.mapping.questions)
    open_ones = f" {count} question{'s are' if count > 1 else ' is'} open." if count else ""
    print(f"Nothing is imported yet.{open_ones} The mapping is in {file}; check it and run\n  {command}")


def take(source: Path, out: Path, proposed: Proposed, config: dict[str, Any]) -> None:
    """Import with the proposal, without what is in question."""
    left = sorted(proposed.mapping.columns.keys() - proposed.certain.columns.keys())
    if (
        not any(name.endswith(".position") for name in proposed.certain.columns)
        or "time" not in proposed.certain.columns
    ):
        asked = proposed.mapping.questions[0]
        call = "Answer it (unit=...), or call" if "unit=" in asked.ask else "Call"
        raise SealegsError(
            f"{source}: cannot be imported as it is; {', '.join(asked.about[:3])}: {ended(asked.ask)} {call} without "
            "yes=true and correct the mapping."
        )
    done = import_logs(source, out, proposed.certain, config["format"], proposed.recordings)
    if left:
        print(f"Left out, for they are in question: {', '.join(left)}.")
    for sentence in proposed.left:
        print(f"Left out: {sentence}.")
    tell(done, out)


def tell(done: Imported, out: Path) -> None:
    """Say what was written and what has to be filled in."""
    for sentence in done.left:
        print(f"Left out: {sentence}.")
    print(f"{len(done.files)} measured log{'s' * (len(done.files) != 1)} in {out}")
    if done.missing:
        *first, last = done.missing
        what = f"{', '.join(first)} and {last}" if first else last
        print(f"Fill in {what} in {done.sidecar}, where FILL IN stands. Then")
    print(f"  {shlex.join(['sealegs', 'diagnose', f'log={out}', f'out={out}-diagnosis'])}")


def _confirmed(proposed: Proposed) -> bool:
    if not (sys.stdin.isatty() and sys.stdout.isatty()) or proposed.mapping.questions:
        return False
    try:
        return input("Import with this mapping? [y/N] ").strip().lower() in ("y", "yes")
    except EOFError:
        return False


def _free(out: Path) -> Path:
    """A name for the mapping's file that nothing has yet."""
    file, number = out.with_name(f"{out.name}.mapping.yaml"), 2
    while file.exists():
        file, number = out.with_name(f"{out.name}.mapping-{number}.yaml"), number + 1
    return file
