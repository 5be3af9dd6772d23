"""The hexapod AMRU5 of paper 001."""

EPISODE_STEPS = 30
"""Control steps of an episode."""
