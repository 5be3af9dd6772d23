"""A diagnosis on disk: ``diagnosis.json``, the extended chain and MJCF, the next experiment, pictures and report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...common.atomic import STAGED, folder_written
from ...common.extras import missing_package
from ...envs.described.robot_file import is_robot_file
from ...envs.extended import DRAWS, write_draws
from ..experiment import write_experiment
from ..log.parts import TEST
from ..log.progress import Milestone, Progress
from ..log.types import LogError, MeasuredSet
from ..replay.engine import STEP, bench, replay_in_engine
from ..replay.problem import JointProblem, largest_step
from ..replay.simulator import joint_state
from ..verdict.verdict import JointDiagnosis
from .document import FILE, to_document, whole, write_document
from .extension import as_taken, changes, not_native, write_extended, write_extension
from .hand_over import hand_over, without_doubted_encoders
from .robot_mjcf import write_robot


def fresh_folder(path: Path, besides: Sequence[str] = ()) -> Path:
    """Make the output folder.

    Args:
        path: new or empty, except for what an unfinished diagnosis left there.
        besides: names of that.

    Raises:
        LogError: it has something in it already, which is never overwritten.
    """
    if path.exists() and (not path.is_dir() or any(item.name not in (STAGED, *besides) for item in path.iterdir())):
        raise LogError(f"{path} is not empty, and nothing in it is overwritten; give another out=<folder>.")
    path.mkdir(parents=True, exist_ok=True)
    return path


def write_diagnosis(
    diagnoses: Sequence[JointDiagnosis],
    data: MeasuredSet,
    folder: Path,
    progress: Progress = lambda text: None,
) -> dict[str, Path]:
    """Write everything into a fresh folder.

    Returns:
        Paths by what they hold: ``json``, ``report``, ``pictures``; with an extension also ``chain`` and ``mjcf``, with
        a proposal ``experiment``; of several joints ``<joint> chain`` and so on.
    """
    written: dict[str, Path] = {}
    documents = []
    differences: list[dict[str, Any]] = []
    recorded, data = data, as_taken(data, diagnoses)
    with folder_written(folder, last=FILE) as staged:  # a folder with the document is finished
        for diagnosis in diagnoses:
            several = len(diagnoses) > 1
            prefix, owner = (f"{diagnosis.joint}-", f"{diagnosis.joint} ") if several else ("", "")
            document = to_document(diagnosis)
            if diagnosis.problem is not None:
                progress("confirming in the engine")
                chain, free = diagnosis.problem.chain(diagnosis.values), diagnosis.problem.free_joint
                handed = without_doubted_encoders(diagnosis)
                files = write_extension(handed, data.runs, staged, prefix)
                written |= {f"{owner}{key}": path for key, path in files.items()}
                changed = changes(handed)
                document["extension"] = {
                    "files": {key: path.name for key, path in files.items()},
                    "changes": changed,
                    "not_native": [] if chain is None else not_native(chain),
                    "engine": {} if free is None or free.terms is not None else confirm(diagnosis, free),
                }
                differences += changed
            if diagnosis.experiment is not None:
                run = data.runs[0]
                actuator = run.actuators.get(diagnosis.joint)
                machine = run.robot if is_robot_file(run.robot) else "bench"
                frame = (run.meta.get("frames") or {}).get(diagnosis.joint)
                files = write_experiment(
                    diagnosis.experiment,
                    diagnosis.joint,
                    staged,
                    actuator=actuator,
                    prefix=prefix,
                    robot=machine,
                    frame=frame,
                    final=folder,
                )
                document["next_experiment"]["file"] = files["experiment"].name
                written |= {f"{owner}{key}": path for key, path in files.items()}
            documents.append(document)
        extended, confirmed = hand_over(diagnoses, recorded, progress)
        if extended is not None:
            written["extended"] = write_extended(extended, staged, folder)
            if extended.draws is not None:
                write_draws(extended.draws, staged / DRAWS)
            if (robot := write_robot(extended, data, staged, folder)) is not None:
                written["robot"] = robot
        written["json"] = staged / FILE
        document = whole(documents, data.name, [run.name for run in data.runs])
        write_document(document | ({} if confirmed is None else {"whole_robot": confirmed}), written["json"])
        progress("drawing")
        written |= _illustrate(diagnoses, data, staged, differences, confirmed, progress)
    return {key: folder / path.name for key, path in written.items()}


def _illustrate(
    diagnoses: Sequence[JointDiagnosis],
    data: MeasuredSet,
    folder: Path,
    differences: list[dict[str, Any]],
    robot: dict[str, Any] | None,
    progress: Progress,
) -> dict[str, Path]:
    """Pictures and report, where the packages of the extra ``report`` are installed; the findings need none of them."""
    try:
        from .pictures import draw_all
        from .report import write_report
    except ModuleNotFoundError as error:
        missing = missing_package(error, "A report with pictures")
        if missing is None:
            raise
        progress(Milestone(str(missing)))
        return {}
    written = {"pictures": folder / "pictures", "report": folder / "report.html"}
    written["pictures"].mkdir()
    draw_all(list(diagnoses), written["pictures"])
    write_report(list(diagnoses), data, written["report"], changes=differences, robot=robot)
    return written


def confirm(diagnosis: JointDiagnosis, problem: JointProblem) -> dict[str, float]:
    """The extended model in the engine, on the longest piece of the test part.

    Returns:
        ``rmse`` of the engine, ``search_rmse`` of the search's simulator, and their ``distance`` [rad].
    """
    at = [k for k, unit in enumerate(problem.units) if unit.part == TEST] or [0]
    k = max(at, key=lambda k: problem.starts[k + 1] - problem.starts[k])
    rows = slice(problem.starts[k], problem.starts[k + 1])
    if not problem.on[rows].all():
        at = [j for j in at if problem.on[problem.starts[j] : problem.starts[j + 1]].all()]
        if not at:
            return {}
        k = at[0]
        rows = slice(problem.starts[k], problem.starts[k + 1])
    unit = problem.units[k]
    joint = problem.models[unit.run].with_fitted(diagnosis.values)
    drivetrain = bench(joint, problem.params[unit.run])
    program = joint.chain.program()
    state = joint_state(program, joint.constants(problem.params[unit.run], program), *unit.state)
    step = min(STEP, largest_step(joint.chain))
    out = replay_in_engine(drivetrain, problem.time[rows], problem.goal[rows], state, step)
    judged = problem.judged[rows]
    reading = joint.host_scale * out[judged, 0] + joint.host_offset
    measured = problem.measured[rows][judged, 0]
    search = diagnosis.simulated["extended"][rows][judged, 0]
    return {
        "rmse": float(np.sqrt(np.mean((reading - measured) ** 2))),
        "search_rmse": float(np.sqrt(np.mean((search - measured) ** 2))),
        "distance": float(np.sqrt(np.mean((reading - search) ** 2))),
    }
