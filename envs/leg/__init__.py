"""One leg of the quadruped SILO4 (paper 000)."""

EPISODE_STEPS = 400
"""Control steps of an episode."""
