"""A sweep: a folder with a training for each trial, and the study of Optuna that chooses their values.

sweep.yaml        what was asked for
study.journal     the study: every trial with its values, reward and state; a journal of JSON, read by Optuna alone
trial<k>/         the run of a trial, or the folder of its seeds; trial<k>.log is what it printed
trials.md         all of them, the best first

The study is told a reward as soon as a trial has it, by one process alone. So a kill loses no finished trial, and those
that ran go on from their checkpoints. One without a reward is never at its end: a sweep that goes on tries it again.
The folder may be moved or copied.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from ..common.atomic import write_text
from ..common.documents import read_mapping
from ..common.errors import SealegsError, closest
from ..common.extras import needed_for
from ..common.markdown import page, table
from ..configs.check import Count, checked, or_null
from ..configs.compose import FOLDER, compose, groups, override, split
from ..configs.script import Interrupted
from .run_folder import RunFolder
from .sweep_plan import Code, Plan, code_of, rooted, tasks_in
from .sweep_space import as_arguments, combinations
from .sweep_workers import ATTEMPTS, MARK, Result, Trial, Workers, outcome, workers_for

with needed_for("sealegs sweep"):
    import optuna
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend
    from optuna.trial import FrozenTrial, TrialState

JOURNAL, TABLE = "study.journal", "trials.md"
TRIALS = 20
"""Where an interval is swept and nobody says how many."""
STUDY = "sweep"
"""Name of the study in its journal, wherever the folder is."""
OWN = ("trials", "workers", "cluster", "name", "out", "resume")


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
    """A sweep to begin, or to go on with in ``resume``, the code that may run, and where its trials are trained."""

    sweep: Sweep
    code: Code
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
    if resume is None:
        _hint(pairs)
        rest = rooted(rest)
        code = Code(tuple(tasks_in(rest)), trust=True)
        Plan(rest, code, "The sweep").check()
    else:
        if not resume:
            raise SealegsError("resume= names no folder: give that of a sweep, resume=<folder>.")
        code, rest = _code_again([*rest, *(f"{key}={pairs[key]}" for key in ("name", "out") if key in pairs)]), []
    return SweepRequest(
        Sweep(tuple(rest), trials), code, Path(checked("out", own["out"], str)), None if name is None else str(name),
        None if resume is None else Path(resume), checked("workers", own["workers"], or_null(Count)), cluster,
    )  # fmt: skip


def _hint(pairs: Mapping[str, str]) -> None:
    """Refuse a key that is none of a training and nearly one of a sweep."""
    known = {*OWN, *groups("train"), *read_mapping(FOLDER / "train.yaml")}
    for key in pairs:
        if "." not in key and key not in known and (meant := closest(key, OWN)):
            raise SealegsError(f"There is no key '{key}' (did you mean '{meant}'?); --help lists the keys.")


def _code_again(rest: Sequence[str]) -> Code:
    """The code that a command names beside ``resume``, with which nothing else can be given."""
    trust = {key: value for key, _, value in (word.partition("=") for word in rest) if key == "trust"}
    others = [word for word in rest if word.partition("=")[0] not in ("env", "trust")]
    if others:
        raise SealegsError(f"A sweep that goes on keeps what it sweeps, so {others[0]} cannot be given with resume.")
    return code_of(rest, checked("trust", override({"trust": False}, trust)["trust"], bool))


def sweep(request: SweepRequest) -> Path:
    """Begin a sweep, or go on with one, to its end; its folder.

    Raises:
        SealegsError: wrong input, or a trial failed.
        Interrupted: the user stopped it; the message says how it goes on.
    """
    folder = _new_folder(request) if request.resume is None else _there(request.resume)
    locked = RunFolder(folder)
    try:
        asked = _stored(folder, request.sweep.trials)
        plan = Plan(asked.arguments, request.code, str(folder / MARK))
        plan.check()
        with workers_for(request.cluster, request.workers) as workers:
            study = Study(folder, plan, asked.trials)
            print(f"Sweeping {', '.join(plan.space)}: {study.trials} trials, {workers.size} at a time, in {folder}")
            try:
                study.run(workers)
            except KeyboardInterrupt:
                done = f"{study.finished()} of {study.trials} trials are finished"
                raise Interrupted(f"Stopped; {done}. Go on with: {plan.command(folder)}") from None
        print(study.write_table(), end="", flush=True)
    finally:
        locked.close()
    if study.failed:
        raise SealegsError(
            f"{len(study.failed)} of {study.trials} trials failed; {folder / TABLE} says which. Once that is mended, "
            f"try them again: {plan.command(folder)}"
        )
    return folder


def _there(folder: Path) -> Path:
    """The folder of a sweep, by its own path."""
    if not (folder / MARK).is_file():
        beside = sorted(mark.parent.name for mark in folder.parent.glob(f"*/{MARK}"))[-5:]
        there = f"; {folder.parent} has {', '.join(beside)}" if beside else ""
        what = f"is not the folder of a sweep: it has no {MARK}" if folder.is_dir() else "does not exist"
        raise SealegsError(f"resume={folder} {what}{there}.")
    return folder.resolve()


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


def _mended(journal: Path) -> Path:
    """A journal without a last line that was cut off as the power failed; no reward that was told is in it."""
    if journal.is_file():
        with journal.open("r+b") as file:
            file.truncate(file.read().rfind(b"\n") + 1)
    return journal


class Study:
    """The study of Optuna in a sweep's folder.

    Attributes:
        trials: how many there are to be.
        failed: by the number of a trial, why it failed since the sweep was begun or gone on with.
    """

    def __init__(self, folder: Path, plan: Plan, trials: int | None) -> None:
        """The study in ``folder``, whose lock is held."""
        self._folder, self._plan = folder, plan
        self.failed: dict[int, str] = {}
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        storage = JournalStorage(JournalFileBackend(str(_mended(folder / JOURNAL))))
        name = next((item.study_name for item in optuna.get_all_study_summaries(storage)), None)
        # with a seed of its own after each stop: the same one would draw again what it has drawn
        count = 0 if name is None else len(optuna.load_study(study_name=name, storage=storage).trials)
        self._study = optuna.create_study(
            study_name=name or STUDY, storage=storage, direction="maximize", load_if_exists=True,
            sampler=optuna.samplers.TPESampler(seed=count, constant_liar=True),
        )  # fmt: skip
        for item in self._all(TrialState.RUNNING):
            if not plan.space.keys() <= item.params.keys():  # killed while it was drawn
                self._study.tell(item.number, state=TrialState.FAIL)
        begun = self._all(TrialState.RUNNING, TrialState.COMPLETE)
        self.trials = max(trials or TRIALS, len(begun))
        if (each := combinations(plan.space, trials)) is not None:
            known = [*begun, *self._all(TrialState.WAITING)]
            told = [as_arguments(self._values(item)) for item in known]
            missing = [values for values in each if as_arguments(values) not in told]
            for values in missing:
                self._study.enqueue_trial(values)
            self.trials = len(known) + len(missing)
        if trials is not None and trials != self.trials:
            why = "are all combinations" if trials > self.trials else "are there already"
            print(f"trials={trials}: {self.trials} {why}.", flush=True)

    def run(self, workers: Workers) -> None:
        """Train until all trials are done: first those that have no reward from before.

        Raises:
            SealegsError: the machines stop a trial again and again.
        """
        running: dict[Future[Result], Trial] = {}
        left = [self._trial(item) for item in self._all(TrialState.RUNNING)]
        lost: Counter[int] = Counter()
        while True:
            while len(running) < workers.size and (trial := self._next(left)) is not None:
                running[workers.submit(trial)] = trial
                print(f"{trial.folder.name}: {' '.join(self._said(trial.number))}", flush=True)
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                trial = running.pop(future)
                result = outcome(future, trial)
                if result.lost:
                    lost[trial.number] += 1
                    if lost[trial.number] >= ATTEMPTS:
                        raise SealegsError(
                            f"{trial.folder.name} was stopped {ATTEMPTS} times: {result.lost} Go on with: "
                            f"{self._plan.command(self._folder)}"
                        )
                    print(f"{trial.folder.name} is begun again: {result.lost}", flush=True)
                    left.append(trial)
                else:
                    self._tell(trial, result)
            self.write_table()

    def _next(self, left: list[Trial]) -> Trial | None:
        """A trial to train: one that is left, or a new one; None: there are as many as there are to be."""
        if left:
            return left.pop(0)
        if len(self._all(TrialState.RUNNING, TrialState.COMPLETE)) >= self.trials:
            return None
        asked = self._study.ask(dict(self._plan.space))
        return self._trial(self._study.trials[asked.number])

    def _trial(self, item: FrozenTrial) -> Trial:
        arguments = self._plan.arguments(self._values(item))
        task = next(iter(tasks_in(arguments)), None)
        return Trial(item.number, tuple(arguments), self._folder, task, self._plan.code.trust)

    def _values(self, item: FrozenTrial) -> dict[str, Any]:
        """Of a trial, in the order of the command line; of one that waits, those that it will have."""
        values = item.params or item.system_attrs["fixed_params"]
        return {key: values[key] for key in self._plan.space}

    def _tell(self, trial: Trial, result: Result) -> None:
        if result.reward is not None:
            self._study.tell(trial.number, result.reward)
            print(f"{trial.folder.name}: {result.reward:.4g}", flush=True)
        else:
            self.failed[trial.number] = result.error
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
        others = self._all(TrialState.RUNNING)
        rows = [(item, f"{item.value:.5g}") for item in told]
        rows += [
            (item, f"failed: trial{item.number}.log" if item.number in self.failed else "unfinished") for item in others
        ]
        cells = ((item.number, said, *_cells(self._values(item))) for item, said in rows)
        text = page(
            f"{self._folder.name}: {len(told)} of {self.trials} trials",
            table(("trial", "mean reward", *self._plan.space), cells),
            f"Best policy: {self._folder / f'trial{told[0].number}'}" if told else "",
        )
        write_text(self._folder / TABLE, text, replace=True)
        return text


def _cells(values: Mapping[str, Any]) -> list[str]:
    return [word.partition("=")[2] for word in as_arguments(values)]
