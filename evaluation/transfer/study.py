"""The order of the study: machines are chosen, diagnosed, and every policy is trained and judged.

What is done is a file in the study's folder. A study that was stopped goes on with the same command.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...common.atomic import write_text
from ...common.documents import read_json
from ...common.errors import SealegsError
from ...common.processes import worker_pool
from .cells import FINE, LIMIT, NOMINAL, REFERENCES, SCREENING, TREATMENTS, Cell, Recipe, diagnosed, judged
from .figures import Errors, errors_of, figures_of, table
from .machines import Hidden, check_robot, hidden_in

RESULT = "transfer.json"
TABLE = "transfer.md"
TRIES = 4  # machines that are drawn for each that is counted, at most
Say = Callable[[str], None]


@dataclass(frozen=True)
class Study:
    """What is asked.

    Attributes:
        robots: names of machines.
        machines: of each robot, that are counted.
        seeds: of each training.
        seed: of the first machine.
        least_loss: share of the limit's accuracy that the nominal policy must lose on a machine that is counted.
        treatments: of :data:`~sealegs.evaluation.transfer.cells.TREATMENTS`; nominal and limit are among them.
        recipe: of the trainings.
    """

    robots: tuple[str, ...]
    machines: int
    seeds: int
    seed: int
    least_loss: float
    treatments: tuple[str, ...]
    recipe: Recipe

    def check(self) -> None:
        """Raises:
        SealegsError: something in it does not fit.
        """
        for name in self.robots:
            check_robot(name)
        for name in self.treatments:
            if name not in TREATMENTS:
                raise SealegsError(f"there is no treatment '{name}'; there are: {'; '.join(TREATMENTS)}.")
        if not {NOMINAL, LIMIT} <= set(self.treatments):
            raise SealegsError(f"treatments must have '{NOMINAL}' and '{LIMIT}': all others are told beside them.")


def run(study: Study, out: Path, workers: int, say: Say) -> dict[str, Any]:
    """Do what is not done yet, and write table, JSON and pictures; the document.

    Raises:
        SealegsError: the folder is of another study.
    """
    study.check()
    _same(study, out)
    with worker_pool(workers) as processes:
        pool = _Workers(processes, say)
        chosen: list[Hidden] = []
        passed_over: list[str] = []
        for robot in study.robots:
            mine, others = _chosen(robot, study, out, pool)
            chosen, passed_over = [*chosen, *mine], [*passed_over, *others]
        pool.all("diagnosing", [partial(diagnosed, hidden, out) for hidden in chosen])
        cells = [Cell(hidden, reference) for hidden in chosen for reference in REFERENCES]
        cells += [
            Cell(hidden, treatment, seed)
            for seed in range(study.seeds)  # one seed of everything first: a study that is stopped has a whole table
            for hidden in chosen
            for treatment in study.treatments
        ]
        for late in (False, True):  # fine-tuning begins with the nominal policies
            jobs = [partial(judged, cell, study.recipe, out) for cell in cells if (cell.treatment == FINE) == late]
            pool.all("fine-tuning" if late else "training and judging", jobs)
    return tell(study, out, chosen, passed_over)


def tell(study: Study, out: Path, chosen: Sequence[Hidden], passed_over: Sequence[str]) -> dict[str, Any]:
    """Write what the kept cells say, of machines whose diagnosis is done."""
    machines = [hidden.name for hidden in chosen]
    rows = [
        read_json(file) for name in machines for file in sorted((out / name).glob("*.json")) if file.stem != "diagnosis"
    ]
    errors = errors_of([row for row in rows if isinstance(row, dict)], machines, range(study.seeds))
    found = [figure for name in (*REFERENCES, *TREATMENTS) if (figure := figures_of(errors, name)) is not None]
    hidden = {one.name: {"effects": hidden_in(one), **read_json(out / one.name / "diagnosis.json")} for one in chosen}
    document = {
        "study": _plain(study),
        "figures": [asdict(one) for one in found],
        "errors": {name: {key: value.tolist() for key, value in own.items()} for name, own in errors.items()},
        "saturated": _saturated(rows, machines),
        "hidden": hidden,
        "passed_over": list(passed_over),
    }
    write_text(out / RESULT, json.dumps(document, indent=1) + "\n", replace=True)
    write_text(out / TABLE, table(errors, passed_over, _how(study, errors), hidden), replace=True)
    for robot in study.robots:
        own: Errors = {name: errors[name] for name in machines if name.startswith(f"{robot}-")}
        if own:
            from ..pictures import draw_treatments

            draw_treatments(robot, own, (*REFERENCES[:1], *TREATMENTS), out / f"{robot}.png")
    return document


def _saturated(rows: Sequence[Any], machines: Sequence[str]) -> dict[str, dict[str, float]]:
    """Share of the time in which a drive saturates, by machine and treatment."""
    found: dict[str, dict[str, float]] = {name: {} for name in machines}
    for row in rows:
        found[row["machine"]][row["treatment"]] = row["saturated"]
    return found


def _how(study: Study, errors: Errors) -> list[str]:
    steps = "as configured" if study.recipe.steps is None else f"of {study.recipe.steps} steps"
    further = f", `{' '.join(study.recipe.arguments)}`" if study.recipe.arguments else ""
    most = f"{1.0 - study.least_loss:.0%}"
    counts = sorted({len(row) for own in errors.values() for name, row in own.items() if name in TREATMENTS})
    seeds = " to ".join(map(str, dict.fromkeys((counts[0], counts[-1])))) if counts else "no"
    seeds += " seed" + "s" * (seeds != "1")
    return [
        f"{len(errors)} machines ({', '.join(errors)} of `testbed/everyday`), {seeds}, trainings "
        f"{steps}{further}, {study.recipe.episodes} episodes on the machine. A machine is counted where a nominal "
        f"policy of another seed has at most {most} of the limit's accuracy, the inverse of the rms tracking error."
    ]


# --- which machines ----------------------------------------------------------------------------------------------


def _chosen(robot: str, study: Study, out: Path, pool: _Workers) -> tuple[list[Hidden], list[str]]:
    """The first machines of a robot on which the nominal policy loses enough, and those before them where not."""
    chosen: list[Hidden] = []
    passed_over: list[str] = []
    for number in range(TRIES * study.machines):
        if len(chosen) == study.machines:
            break
        hidden = Hidden(robot, number, study.seed)
        cells = [Cell(hidden, treatment, SCREENING) for treatment in (NOMINAL, LIMIT)]
        pool.all(f"trying {hidden.name}", [partial(judged, cell, study.recipe, out) for cell in cells])
        nominal, limit = (_error(out / cell.file) for cell in cells)
        if limit <= (1.0 - study.least_loss) * nominal:
            chosen.append(hidden)
        else:
            passed_over.append(hidden.name)
    return chosen, passed_over


def _error(file: Path) -> float:
    row = read_json(file)
    return float(np.sqrt(np.mean(np.square(row["rms"]))))


# --- keeping and working -----------------------------------------------------------------------------------------


def _plain(study: Study) -> dict[str, Any]:
    return json.loads(json.dumps(asdict(study)))


def _same(study: Study, out: Path) -> None:
    """Keep what is asked; refuse to go on with something else, but for more machines or seeds."""
    out.mkdir(parents=True, exist_ok=True)
    file = out / "study.json"
    grows = ("machines", "seeds", "robots", "treatments")
    if file.is_file():
        kept, now = read_json(file), _plain(study)
        for key, value in now.items():
            if key not in grows and kept.get(key) != value:
                raise SealegsError(
                    f"{out} was begun with {key}={kept.get(key)}, and now it is {value}; give another out=<folder>."
                )
    write_text(file, json.dumps(_plain(study), indent=1) + "\n", replace=True)


@dataclass(frozen=True)
class _Workers:
    """Processes that do jobs, each a call without a result that finds by itself what is done."""

    pool: ProcessPoolExecutor
    say: Say

    def all(self, what: str, jobs: Iterable[Callable[[], None]]) -> None:
        """Do all jobs; what goes wrong is raised here."""
        began, left = time.monotonic(), {self.pool.submit(job) for job in jobs}
        total = len(left)
        while left:
            ended: set[Future[None]]
            ended, left = wait(left, return_when=FIRST_COMPLETED)
            for future in ended:
                future.result()
            done, spent = total - len(left), time.monotonic() - began
            rest = f", about {spent / done * len(left) / 60.0:.0f} min left" if left and spent > 5.0 else ""
            self.say(f"{what}: {done} of {total}{rest}")
