"""The flexible-joint arm SRLFJ of the paper (paper 002)."""

EPISODE_STEPS = 500
"""Control steps of an episode."""
