"""What moves: robots, their tasks, and the batch engine that steps them.

``import sealegs`` registers ``SeaLegs/Hopper-v0`` and the other robots' environments with Gymnasium. A robot is a
folder and one entry of :data:`ENVIRONMENTS`: its module ``robot`` holds ``HOPPER``, its module ``task`` the dataclass
``HopperTask``, its module ``env`` the documented classes ``HopperEnv`` and ``HopperVectorEnv`` of that task.
"""

from __future__ import annotations

import gymnasium as gym

ENVIRONMENTS = {"Bench": 250, "Hopper": 500, "Biped": 1000, "Hexapod": 30, "Leg": 400}
"""Robots with an environment, and the control steps of an episode."""


def env_id(robot: str) -> str:
    """Id of a robot's environment: ``SeaLegs/Hopper-v0`` of ``Hopper``."""
    return f"SeaLegs/{robot}-v0"


def register_environments() -> None:
    """Make the environments known to ``gymnasium.make`` and ``gymnasium.make_vec``; again does no harm."""
    for robot, steps in ENVIRONMENTS.items():
        if env_id(robot) not in gym.registry:
            entry = f"{__name__}.{robot.lower()}.env:{robot}"
            gym.register(
                id=env_id(robot),
                entry_point=f"{entry}Env",
                vector_entry_point=f"{entry}VectorEnv",
                max_episode_steps=steps,
            )
