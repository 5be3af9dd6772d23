"""A servo with a pendulum load."""

EPISODE_STEPS = 250
"""Control steps of an episode."""
