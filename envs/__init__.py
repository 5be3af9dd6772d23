"""What moves: robots, their tasks, and the batch engine that steps them.

``import sealegs`` registers ``SeaLegs/Hopper-v0`` and the other robots' environments with Gymnasium. A robot is a
folder here, and is found by being one: ``hopper`` holds ``EPISODE_STEPS``, its module ``robot`` holds ``HOPPER``, its
module ``task`` the dataclass ``HopperTask``, its module ``env`` the documented classes ``HopperEnv`` and
``HopperVectorEnv`` of that task. Robots that a file describes need no Python: the tasks in :data:`TASKS` take any.
"""

from __future__ import annotations

import importlib
from pathlib import Path

import gymnasium as gym

ENVIRONMENTS = {
    folder.name.capitalize(): importlib.import_module(f".{folder.name}", __package__).EPISODE_STEPS
    for folder in sorted(path.parent for path in Path(__file__).parent.glob("*/env.py"))
    if (folder / "robot.py").is_file()
}
"""Robots with an environment, and the control steps of an episode."""

TASKS = {"Track": 500, "Reach": 250, "Walk": 1000, "Drive": 500}
"""Tasks that any robot has, by its name or its file: ``robot=`` of their environments; and steps of an episode."""

EARLIER: dict[str, tuple[dict[str, object], ...]] = {"Track": ({"correction": 0.0, "lead": 0.0},)}
"""Earlier versions of environments, from v0 on: the arguments with which the present one is what they were."""


def env_id(robot: str, version: int | None = None) -> str:
    """Id of a robot's environment: ``SeaLegs/Hopper-v0`` of ``Hopper``; of its newest version where none is named."""
    return f"SeaLegs/{robot}-v{len(EARLIER.get(robot, ())) if version is None else version}"


def register_environments() -> None:
    """Make the environments known to ``gymnasium.make`` and ``gymnasium.make_vec``; again does no harm."""
    folders = {robot: robot.lower() for robot in ENVIRONMENTS} | dict.fromkeys(TASKS, "any_robot")
    for name, steps in {**ENVIRONMENTS, **TASKS}.items():
        entry = f"{__name__}.{folders[name]}.env:{name}"
        for version, arguments in enumerate((*EARLIER.get(name, ()), {})):
            if (known := env_id(name, version)) not in gym.registry:
                gym.register(
                    id=known,
                    entry_point=f"{entry}Env",
                    vector_entry_point=f"{entry}VectorEnv",
                    max_episode_steps=steps,
                    kwargs=dict(arguments),
                )


def registered_id(name: str) -> str:
    """The Gymnasium id of an environment, by that id or by ``path/to/task.py:MyTask``, which is run and registered.

    For names that a person or a caller gives; those that a file gives are for :func:`known_id`.

    Raises:
        SealegsError: there is none.
    """
    from .any_robot.user import is_user_task, user_id  # late: `import sealegs` loads nothing heavy

    return user_id(name) if is_user_task(name) else known_id(name)


def known_id(name: str) -> str:
    """The Gymnasium id of an environment, by that id or by ``path/to/task.py:MyTask`` where that was run already.

    Raises:
        SealegsError: there is none, or it is a file that nobody named.
    """
    from ..common.errors import SealegsError, nearest
    from .any_robot.user import is_user_task, known_user_id

    register_environments()
    if is_user_task(name):
        if (found := known_user_id(name)) is None:
            raise SealegsError(
                f"{name} is code, which is not run because a file names it: name it yourself, on the command line as "
                "task=, in Python by sealegs.make_env."
            )
        return found
    if name not in gym.registry:
        known = [key for key in gym.registry if key.startswith("SeaLegs/")]
        raise SealegsError(
            f"there is no environment '{name}'{nearest(name, known)}; there are {', '.join(known)}, and a task of your "
            "own as path/to/task.py:MyTask."
        )
    return name
