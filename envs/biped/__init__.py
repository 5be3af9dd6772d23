"""The planar biped MABEL (paper 003)."""

EPISODE_STEPS = 1000
"""Control steps of an episode."""
