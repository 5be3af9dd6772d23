"""A walking robot's log laid out for a search of its ground: in pieces of it, joints follow their measured motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ...actuators import Chain, load_chain
from ...common.errors import SealegsError
from ...envs.described.as_robot import as_robot
from ...envs.engine.robot import Robot
from ...envs.robots import get_robot
from ..causes.cause import Cause
from ..load.robot import Frame, robot_of
from ..log.finding import Finding
from ..log.parts import held_out
from ..log.progress import Progress
from ..log.types import LogError, MeasuredRun
from ..replay.parameters import Parameter, factor
from .pieces import ENGINE_STEP, PIECE_SECONDS
from .problem import CONTACT_TIME_FACTOR, MIN_PIECES, Laid, ground_causes, ground_problem, too_few
from .tree_model import TreeModel, base_joints, base_layout
from .tree_replay import BaseColumns, TreeReplay, find_pieces

HEIGHT_ZERO_TOLERANCE = 0.02  # [m] how well the zero of the base's height is known: assumed, of a camera
DAMPING_RATIO_FACTOR = 5.0  # factor on its damping ratio, which stands for none either
STIFFNESS_START_SHARES = (0.1, 0.3)  # of the stiffness that the model has: where fits of soft ground start


def stands(run: MeasuredRun) -> bool:
    """Whether a run is of a robot whose base moves."""
    robot = robot_under(run)
    if robot is None or (robot.file is not None and robot.file.base == "fixed" and not robot.file.model.free):
        return False
    return bool(base_joints(robot, robot.build_spec(run.robot_params).compile()))


def lay_robot(
    runs: Sequence[MeasuredRun], chains: Mapping[str, Chain], progress: Progress, test_group: str | None = None
) -> Laid | str:
    """Pieces of a walking robot's log; a sentence where it has none to judge.

    Args:
        runs: of one machine.
        chains: of the joints that were diagnosed, as found.
        progress: is told what goes on.
        test_group: group of runs that no fit and no choice may see.

    Raises:
        SealegsError: the sidecar's numbers are none of the robot's, or the test group does not exist.
    """
    held, robot = held_out(runs, test_group), robot_under(runs[0])
    if robot is None:
        return "its sidecar names no robot."
    names = [item.name for item in robot.coordinates]
    if absent := [name for name in names if any(name not in run.joints for run in runs)]:
        return f"not all of its joints were logged; record {' and '.join(f'{name}.position' for name in absent)}."
    try:
        said = {**robot.chains, **runs[0].actuators, **chains}
        believed = {name: load_chain(source) for name, source in robot.chains_for(said).items()}
        flat = TreeModel.of(robot, runs[0].robot_params, believed, (0.0, 0.0))
    except SealegsError as error:
        raise LogError(f"{runs[0].name}: {error}") from None
    columns = BaseColumns.of(base_layout(robot, flat.drivetrain()), runs)
    if missing := columns.missing():
        return (
            f"how its base stands was not logged; record {' and '.join(missing)} [m, rad] (a camera or an IMU; with "
            "the way along the ground, friction shows too)."
        )
    judged = columns.judged(runs)
    pieces = find_pieces(runs, columns, judged)
    if len(pieces) < MIN_PIECES:
        seen = f"its base was seen in {len(pieces)} pieces of {PIECE_SECONDS:g} s"
        return f"{seen}, and {MIN_PIECES} are needed; log for longer."
    tested = sum(piece.run in held for piece in pieces)
    if (why := too_few(len(pieces), tested, bool(held), test_group, "pieces")) is not None:
        return why
    progress(f"laying out {len(pieces)} pieces of the walk")
    model = replace(flat, pivot=_middle(runs, columns))
    replay = TreeReplay(model, runs, pieces, columns, _frames(runs[0]))
    values = [columns.values(run) for run in runs]
    unlogged = [name for name, said in zip(columns.names, columns.logged, strict=True) if not said]
    return Laid(
        problem=ground_problem(runs, model, replay, judged, values, test_group),
        causes=partial(_causes, model, columns),
        tuned=tuple(_numbers(model)),
        pieces="pieces of the walk",
        advice="its feet stay far from their limits. Walk faster, turn, or carry more.",
        findings=(_hidden(unlogged),) if unlogged else (),
        by_worst=True,
    )


def robot_under(run: MeasuredRun) -> Robot | None:
    """The robot of a run; None where its sidecar names none that is known."""
    logged = robot_of(run)
    if logged is not None:
        return as_robot(logged.file)
    try:
        return get_robot(run.robot)
    except SealegsError:
        return None


def _frames(run: MeasuredRun) -> Mapping[str, Frame]:
    logged = robot_of(run)
    return {} if logged is None else logged.frames


def _middle(runs: Sequence[MeasuredRun], columns: BaseColumns) -> tuple[float, float]:
    """Where the robot was on the ground, in the middle of all runs [m]."""
    table = np.concatenate([columns.values(run) for run in runs])
    found = {"x": 0.0, "y": 0.0}
    for c, direction in enumerate(columns.directions):
        if direction in found and columns.logged[c]:
            found[direction] = float(np.nanmedian(table[:, c]))
    return found["x"], found["y"]


def _causes(model: TreeModel, columns: BaseColumns, names: Sequence[str] | None) -> list[Cause]:
    stiffness = model.value("contact.stiffness")
    way = _first(columns, ("x", "y", "yaw"))
    up = _first(columns, ("z", "pitch", "roll"))
    shown = {"contact.friction": way, "contact.stiffness": up, "contact.slope": _first(columns, ("pitch", "roll", "z"))}
    across = not {"y", "roll"}.isdisjoint(columns.directions)
    slopes = ("contact.slope", "contact.slope_y") if across else ("contact.slope",)
    starts = [share * stiffness for share in STIFFNESS_START_SHARES]
    return ground_causes(starts, stiffness, STIFFNESS_START_SHARES[1] * stiffness, shown, slopes, names, damped=False)


def _first(columns: BaseColumns, keys: Sequence[str]) -> str:
    """The column of the first of some directions that was logged; else the first column."""
    rows = zip(columns.directions, columns.names, columns.logged, strict=True)
    logged = {direction: name for direction, name, said in rows if said}
    return f"base.{next((logged[key] for key in keys if key in logged), next(iter(logged.values())))}"


def _numbers(model: TreeModel) -> list[Parameter]:
    """What every fit tunes: how hard and how damped the engine's contact is made, and the zero of the height."""
    shortest = 2.0 * ENGINE_STEP / model.value("contact.time")
    return [
        factor("contact.time", min(max(1.0 / CONTACT_TIME_FACTOR, shortest), 1.0), 1.0, 0.2),
        factor("contact.damping_ratio", 1.0 / DAMPING_RATIO_FACTOR, DAMPING_RATIO_FACTOR, 0.3),
        Parameter("contact.height", "m", -HEIGHT_ZERO_TOLERANCE, HEIGHT_ZERO_TOLERANCE, 0.0, 1e-3),
    ]


def _hidden(names: Sequence[str]) -> Finding:
    columns = " and ".join(f"base.{name}" for name in names)
    return Finding(
        "contact.columns", "note", "ground", f"base.{names[0]}",
        f"{columns} {'was' if len(names) == 1 else 'were'} not logged: friction and slope show through the rest alone, "
        "and are less certain.",
    )  # fmt: skip
