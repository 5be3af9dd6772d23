"""One servo of a fleet: a folder of logs in, a folder with its diagnosis out, complete or absent."""

from __future__ import annotations

import contextlib
import json
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from ...common.atomic import folder_written, staged_folder
from ...common.bugs import Unforeseen, told
from ...common.documents import read_json
from ...common.errors import SealegsError
from ..log.progress import Progress
from ..log.table import ENDINGS
from ..log.types import LogError
from ..output.partial import FITS, FOLDER

if TYPE_CHECKING:
    from ..diagnosis import Diagnosis

SOURCE = "source.json"
"""What a diagnosis was made from: settings, name and checksum of each log and sidecar, a checksum of the robot."""


Report = Callable[[str, str], None]
"""Is told the name of a servo and what goes on with it."""


@dataclass(frozen=True)
class Job:
    """One data set to diagnose.

    Attributes:
        name: of its folder.
        log: folder with the logs.
        out: folder for the diagnosis.
        settings: keywords of :func:`diagnose_folder`.
    """

    name: str
    log: Path
    out: Path
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """How a job ended: its ``document`` (``diagnosis.json``), or in one ``error`` sentence."""

    name: str
    document: dict[str, Any] | None = None
    error: str = ""
    kept: bool = False


def find_jobs(folder: Path, out: Path, settings: Mapping[str, Any] | None = None) -> list[Job]:
    """One job for each folder in ``folder``, by name; of one without a log the diagnosis says so.

    Raises:
        LogError: none of them holds a log.
    """
    if not folder.is_dir():
        raise LogError(f"{folder}: a fleet is a folder that has a folder of logs for each servo")
    folders = (path for path in folder.iterdir() if path.is_dir() and path.resolve() != out.resolve())
    names = sorted(path.name for path in folders if not path.name.startswith("."))
    jobs = [Job(name, folder / name, out / name, dict(settings or {})) for name in names]
    if not any(path.suffix in ENDINGS for job in jobs for path in job.log.iterdir()):
        raise LogError(f"{folder}: none of its folders holds a log; a fleet has a folder of logs for each servo")
    return jobs


def finished(job: Job) -> Outcome | None:
    """The outcome of a job that was finished before, None where it was not.

    Raises:
        SealegsError: what was diagnosed were other logs, another robot or other settings.
    """
    if not (job.out / "diagnosis.json").is_file():
        if job.out.exists():
            raise SealegsError(f"{job.out} is there without a diagnosis; move it away, or give another out=<folder>.")
        return None
    before = read_json(job.out / SOURCE) if (job.out / SOURCE).is_file() else None
    if before != source(job):
        raise SealegsError(
            f"{job.log}, its robot or its settings are not what {job.out} was made from, and that is not overwritten; "
            "give another out=<folder>."
        )
    return Outcome(job.name, read_json(job.out / "diagnosis.json"), kept=True)


def source(job: Job) -> dict[str, Any]:
    """What the diagnosis of a job depends on, as plain data."""
    from ..output.partial import source_of

    return source_of(job.log, job.settings)


def remove_unfinished(job: Job) -> None:
    """Remove what a stopped diagnosis left."""
    shutil.rmtree(staged_folder(job.out), ignore_errors=True)


def diagnose_folder(
    log: Path, out: Path, progress: Progress = lambda text: None, **settings: Any
) -> tuple[Diagnosis, dict[str, Path]]:
    """Diagnose one data set into a fresh folder, which keeps what is found while it is found.

    Args:
        log: file or folder of logs.
        out: folder to write into: new, empty, or with an unfinished diagnosis of the same log, which goes on.
        progress: is told what goes on.
        settings: of :func:`sealegs.diagnose`.

    Returns:
        The diagnosis, and the paths of its files by what they hold.

    Raises:
        SealegsError: the logs cannot be read or diagnosed, or the folder is not empty.
        Unforeseen: a bug of sealegs; what was found of other joints is in the folder.
    """
    from ..diagnose import diagnose
    from ..output.files import fresh_folder

    made = not out.exists()
    fresh_folder(out, besides=(FOLDER,))
    if made:
        out.rmdir()  # until there is something to keep
    try:
        found = diagnose(log, progress=progress, keep=out, **settings)
    except Unforeseen as error:
        if error.found is not None:
            cast("Diagnosis", error.found).save(out, progress)
            error.where = out
        raise
    return found, found.save(out, progress)


def joints_of(log: Path) -> Sequence[str]:
    """The joints of a folder of logs that can be diagnosed each for itself; none where it cannot be read."""
    from ..checks.long import read_bounded
    from ..prepare.columns import commanded

    try:
        return commanded(read_bounded(log).runs)
    except SealegsError:  # the diagnosis says it
        return ()


def fits_of_joint(log: Path, joint: str, settings: Mapping[str, Any]) -> bytes:
    """The fits of one joint's diagnosis, as the journal keeps them; none where it is refused."""
    from ..diagnose import diagnose
    from ..search.journal import keeping

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / FITS
        with keeping(path), contextlib.suppress(SealegsError):  # the diagnosis of all joints says it
            diagnose(log, **{**settings, "joints": [joint]})
        return path.read_bytes()


def run_job(job: Job, progress: Progress = lambda text: None, joints: int = 1, fits: bytes = b"") -> Outcome:
    """Diagnose one servo or robot, so many joints at a time; its folder appears whole or not at all.

    Fits that were made elsewhere (:func:`fits_of_joint`) are not made again. Whatever goes wrong becomes the outcome's
    sentence, so that one servo does not stop the others.
    """
    try:
        with folder_written(job.out) as staged:
            if fits:
                (staged / FOLDER).mkdir()
                (staged / FOLDER / FITS).write_bytes(fits)
            diagnose_folder(job.log, staged, progress, workers=joints, **job.settings)
            (staged / SOURCE).write_text(json.dumps(source(job), indent=1) + "\n", encoding="utf-8")
        return Outcome(job.name, read_json(job.out / "diagnosis.json"))
    except SealegsError as error:
        return Outcome(job.name, error=str(error))
    except OSError as error:
        return Outcome(job.name, error=f"{job.out} cannot be written: {error.strerror or error}.")
    except MemoryError:
        return Outcome(job.name, error=f"{job.log}: there is not enough memory; use fewer workers=<number>.")
    except Exception as error:
        return Outcome(job.name, error=f"{job.log}: a bug of sealegs, {told(error)}; please report it with the log.")
