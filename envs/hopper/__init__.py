"""The series elastic hopper of the paper (paper 004)."""

EPISODE_STEPS = 500
"""Control steps of an episode."""
