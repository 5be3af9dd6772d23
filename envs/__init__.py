"""What moves: robots, their tasks, and the batch engine that steps them.

``import sealegs`` registers ``SeaLegs/Hopper-v0`` and the other robots' environments with Gymnasium.
"""

from __future__ import annotations

import gymnasium as gym

# name: (folder and class, steps of an episode); a robot's task is one entry
_ENVIRONMENTS = {
    "SeaLegs/Hopper-v0": ("sealegs.envs.hopper.env:Hopper", 500),
    "SeaLegs/Bench-v0": ("sealegs.envs.bench.env:Bench", 250),
    "SeaLegs/Hexapod-v0": ("sealegs.envs.hexapod.env:Hexapod", 30),
    "SeaLegs/Biped-v0": ("sealegs.envs.biped.env:Biped", 1000),
}


def register_environments() -> None:
    """Make the environments known to ``gymnasium.make`` and ``gymnasium.make_vec``; again does no harm."""
    for name, (entry, steps) in _ENVIRONMENTS.items():
        if name not in gym.registry:
            gym.register(
                id=name,
                entry_point=f"{entry}Env",
                vector_entry_point=f"{entry}VectorEnv",
                max_episode_steps=steps,
            )
