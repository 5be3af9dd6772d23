"""A sweep: a folder with a training for each trial, and the study of Optuna that chooses their values.

sweep.yaml        what was asked for
study.journal     the study: every trial with its values, reward and state; a journal of JSON, read by Optuna alone
trial<k>/         the run of a trial, or the folder of its seeds; trial<k>.log is what it printed
trials.md         all of them, the best first

The study is told a reward as soon as a trial has it, by one process alone. So a kill loses no finished trial, and those
that ran go on from their checkpoints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from ..common.atomic import write_text
from ..common.documents import read_mapping
from ..common.errors import SealegsError
from ..common.extras import needed_for
from ..configs.check import Count, checked, or_null
from ..configs.compose import compose, split
from ..configs.script import Interrupted
from .config import read_config
from .run_folder import RunFolder
from .sweep_space import Space, as_arguments, combinations, first_values, read_space
from .sweep_workers import MARK, Result, Trial, Workers, outcome, workers_for

with needed_for("sealegs sweep"):
    import optuna
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend
    from optuna.trial import FrozenTrial, TrialState

JOURNAL, TABLE = "study.journal", "trials.md"
TRIALS = 20
"""Where an interval is swept and nobody says how many."""
ARGUMENTS = "arguments"
"""Of a trial in the study."""
OWN = ("trials", "workers", "cluster", "name", "out", "resume")
QUIET = "video.seconds=0"


@dataclass(frozen=True)
class Sweep:
    """What is asked for.

    Attributes:
        arguments: of ``sealegs train``, some of which have several values.
        trials: in all; None: each combination once, or :data:`TRIALS`.
    """

    arguments: tuple[str, ...]
    trials: int | None = None


@dataclass(frozen=True)
class SweepRequest:
    """A sweep to begin, or to go on with in ``resume``, and where its trials are trained."""

    sweep: Sweep
    out: Path
    name: str | None
    resume: Path | None
    workers: int | None
    cluster: str | None


def read_sweep(arguments: Sequence[str]) -> SweepRequest:
    """Request of the command line.

    Raises:
        SealegsError: a wrong value, or a training that does not take what is swept.
    """
    pairs = split(arguments)
    own = compose("sweep", split([word for word in arguments if word.partition("=")[0].strip() in OWN], plain=OWN[2:]))
    rest = [f"{key}={value}" for key, value in pairs.items() if key not in OWN]
    trials = checked("trials", own["trials"], or_null(Count))
    cluster = checked("cluster", own["cluster"], str | None)
    if cluster not in (None, "ray"):
        raise SealegsError(f"cluster={cluster} is not known: give cluster=ray, or leave it out.")
    name, resume = checked("name", own["name"], str | int | None), checked("resume", own["resume"], str | None)
    folder = None if resume is None else Path(resume)
    if folder is None:
        check(rest)
    elif rest:
        raise SealegsError(f"A sweep that goes on keeps what it sweeps, so {rest[0]} cannot be given with resume.")
    return SweepRequest(
        Sweep(tuple(rest), trials), Path(checked("out", own["out"], str)), None if name is None else str(name), folder,
        checked("workers", own["workers"], or_null(Count)), cluster,
    )  # fmt: skip


def check(arguments: Sequence[str]) -> None:
    """See that something is swept, and that a training takes it.

    Raises:
        SealegsError: it is not so.
    """
    space, fixed = read_space(arguments)
    if not space:
        raise SealegsError("Nothing is swept: give a key several values, such as agent.gamma=0.9,0.95.")
    read_config([*fixed, *as_arguments(first_values(space))])


def sweep(request: SweepRequest) -> Path:
    """Begin a sweep, or go on with one, to its end; its folder.

    Raises:
        SealegsError: wrong input, or every trial failed.
        Interrupted: the user stopped it; the message says how it goes on.
    """
    folder = request.resume or _new_folder(request)
    if not (folder / MARK).is_file():
        raise SealegsError(f"resume={folder} is not the folder of a sweep: it has no {MARK}.")
    locked = RunFolder(folder)
    try:
        asked = _stored(folder, request.sweep.trials)
        with workers_for(request.cluster, request.workers) as workers:
            study = Study(folder, asked)
            print(f"Sweeping {', '.join(study.space)}: {study.trials} trials, {workers.size} at a time, in {folder}")
            try:
                study.run(workers)
            except KeyboardInterrupt:
                raise Interrupted(
                    f"Stopped; {study.finished()} trials are finished. Go on with: sealegs sweep resume={folder}"
                ) from None
        print(study.write_table(), end="", flush=True)
    finally:
        locked.close()
    if study.finished() == 0:
        raise SealegsError(f"No trial of {folder} has a reward; {folder / TABLE} says why.")
    return folder


def _new_folder(request: SweepRequest) -> Path:
    run = RunFolder.create(request.out.absolute(), "sweep", request.name)
    write_text(run.path / MARK, yaml.safe_dump(_plain(request.sweep), sort_keys=False))
    run.close()
    return run.path


def _plain(asked: Sweep) -> dict[str, Any]:
    return {**asdict(asked), "arguments": list(asked.arguments)}


def _stored(folder: Path, trials: int | None) -> Sweep:
    """What a folder's sweep is asked for; ``trials`` is another number of them, which is kept."""
    plain = read_mapping(folder / MARK)
    where = str(folder / MARK)
    asked = Sweep(
        tuple(checked(where, plain.get("arguments"), list[str])), checked(where, plain.get("trials"), or_null(Count))
    )
    if trials is not None and trials != asked.trials:
        asked = replace(asked, trials=trials)
        write_text(folder / MARK, yaml.safe_dump(_plain(asked), sort_keys=False), replace=True)
    return asked


class Study:
    """The study of Optuna in a sweep's folder.

    Attributes:
        space: what is swept.
        trials: how many there are to be.
    """

    def __init__(self, folder: Path, asked: Sweep) -> None:
        self._folder = folder.absolute()
        self.space: Space
        self.space, self._fixed = read_space(asked.arguments)
        each = combinations(self.space) if asked.trials is None else None
        self.trials = asked.trials or (TRIALS if each is None else len(each))
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        storage = JournalStorage(JournalFileBackend(str(folder / JOURNAL)))
        known = [item.study_name for item in optuna.get_all_study_summaries(storage)]
        # with a seed of its own after each stop: the same one would draw again what it has drawn
        count = len(optuna.load_study(study_name=folder.name, storage=storage).trials) if folder.name in known else 0
        self._study = optuna.create_study(
            study_name=folder.name, storage=storage, direction="maximize", load_if_exists=True,
            sampler=optuna.samplers.TPESampler(seed=count, constant_liar=True),
        )  # fmt: skip
        if each is not None and count == 0:
            for values in each:
                self._study.enqueue_trial(values)

    def run(self, workers: Workers) -> None:
        """Train until all trials are done: first those that were running when the sweep was stopped."""
        running: dict[Future[Result], Trial] = {}
        left = [self._trial(item) for item in self._all(TrialState.RUNNING)]
        while True:
            while len(running) < workers.size and (trial := self._next(left)) is not None:
                running[workers.submit(trial)] = trial
                print(f"{trial.folder.name}: {' '.join(self._said(trial.number))}", flush=True)
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                trial = running.pop(future)
                self._tell(trial, outcome(future, trial))
            self.write_table()

    def _next(self, left: list[Trial]) -> Trial | None:
        """A trial to train: one that is left, or a new one; None: there are as many as there are to be."""
        if left:
            return left.pop(0)
        done = [item for item in self._study.trials if item.state != TrialState.WAITING]
        if len(done) >= self.trials:
            return None
        asked = self._study.ask(dict(self.space))
        return self._trial(self._study.trials[asked.number])

    def _trial(self, item: FrozenTrial) -> Trial:
        arguments = [*self._fixed, *as_arguments(self._values(item))]
        if not any(word.startswith("video.seconds=") for word in arguments):
            arguments.append(QUIET)
        return Trial(item.number, tuple(arguments), self._folder)

    def _values(self, item: FrozenTrial) -> dict[str, Any]:
        """Of a trial, in the order of the command line; of one killed while it was drawn, its first values."""
        return {**first_values(self.space), **{key: item.params[key] for key in self.space if key in item.params}}

    def _tell(self, trial: Trial, result: Result) -> None:
        if result.reward is not None:
            self._study.tell(trial.number, result.reward)
            print(f"{trial.folder.name}: {result.reward:.4g}", flush=True)
        elif result.error:
            self._study.tell(trial.number, state=TrialState.FAIL)
            with trial.log.open("a", encoding="utf-8") as log:
                log.write(f"{result.error}\n")
            print(f"{trial.folder.name} failed: {result.error}", flush=True)

    def _all(self, *states: TrialState) -> list[FrozenTrial]:
        return [item for item in self._study.trials if item.state in states]

    def _said(self, number: int) -> list[str]:
        return as_arguments(self._values(self._study.trials[number]))

    def finished(self) -> int:
        """Trials that have a reward."""
        return len(self._all(TrialState.COMPLETE))

    def write_table(self) -> str:
        """Write ``trials.md``, and return it."""
        told = sorted(self._all(TrialState.COMPLETE), key=lambda item: -float(item.value or 0.0))
        others = self._all(TrialState.FAIL, TrialState.RUNNING)
        rows = [(item, f"{item.value:.5g}") for item in told]
        rows += [
            (item, f"failed: trial{item.number}.log" if item.state == TrialState.FAIL else "unfinished")
            for item in others
        ]
        lines = [
            f"# {self._folder.name}: {len(told)} of {self.trials} trials",
            "",
            "| trial | mean reward | " + " | ".join(self.space) + " |",
            "|---" * (len(self.space) + 2) + "|",
            *(f"| {item.number} | {said} | " + " | ".join(_cells(self._values(item))) + " |" for item, said in rows),
        ]
        if told:
            lines += ["", f"Best policy: {self._folder / f'trial{told[0].number}'}"]
        text = "\n".join(lines) + "\n"
        write_text(self._folder / TABLE, text, replace=True)
        return text


def _cells(values: Mapping[str, Any]) -> list[str]:
    return [word.partition("=")[2] for word in as_arguments(values)]
