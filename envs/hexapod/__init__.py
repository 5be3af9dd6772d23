"""The hexapod AMRU5 of seed 001."""
